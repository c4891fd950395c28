//! Golden values worked out by hand, and what must hold between metrics.

use gnp_data::{Forecast, Mode};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::case::Reference;
use crate::protocol::Protocol;

fn forecast(modes: &[(f32, &[[f32; 2]])]) -> Forecast {
    let mode = |(probability, path): &(f32, &[[f32; 2]])| Mode {
        probability: *probability,
        path: path.to_vec(),
        explanation: None,
    };
    Forecast { modes: modes.iter().map(mode).collect() }
}

fn value(metric: Metric, reference: &Reference, forecast: &Forecast) -> f64 {
    let case = ScoredWindow::new(reference, forecast, forecast.modes.len()).unwrap();
    metric.kind.value(metric.contribution(&case).unwrap().unwrap())
}

/// Two frames a second for two seconds, the vehicle goes 1 m a frame; three modes.
///
/// | mode | p | errors by frame (m) | ADE to 2 s |
/// |---|---|---|---|
/// | 0 | 0.5 | 0, 3, 0, 5 (3 along and 4 across) | 2 |
/// | 1 | 0.3 | 0, 0, 0, 6 along | 1.5 |
/// | 2 | 0.2 | 2, 2, 2, 2 to the right | 2 |
fn golden() -> (Reference, Forecast) {
    let reference = Reference::from_path(vec![[1., 0.], [2., 0.], [3., 0.], [4., 0.]], 2.);
    let forecast = forecast(&[
        (0.5, &[[1., 0.], [2., 3.], [3., 0.], [7., 4.]]),
        (0.3, &[[1., 0.], [2., 0.], [3., 0.], [-2., 0.]]),
        (0.2, &[[1., -2.], [2., -2.], [3., -2.], [4., -2.]]),
    ]);
    (reference, forecast)
}

#[test]
fn golden_values() {
    use MetricKind as M;
    let (reference, forecast) = golden();
    let cases = [
        (Metric::top_1(M::Ade, 2.), 2.),
        (Metric::top_1(M::Ade, 1.), 1.5),
        (Metric::top_1(M::Fde, 2.), 5.),
        (Metric::top_1(M::Fde, 1.), 3.),
        (Metric::top_1(M::RmseAt, 1.), 3.),
        (Metric::top_1(M::RmseAt, 2.), 5.),
        (Metric::top_1(M::RmseTo, 1.), 4.5f64.sqrt()),
        (Metric::top_1(M::RmseTo, 2.), 8.5f64.sqrt()),
        (Metric::top_1(M::RmseToPerCoordinate, 2.), 4.25f64.sqrt()),
        (Metric::top_1(M::LateralRmseAt, 2.), 4.),
        (Metric::top_1(M::LongitudinalRmseAt, 2.), 3.),
        (Metric::top_1(M::LongitudinalRmseAt, 1.), 0.),
        (Metric::top_1(M::LongitudinalBiasAt, 2.), 3.),
        (Metric::top_1(M::LongitudinalBiasAt, 1.), 0.),
        // The first is the likeliest, too.
        (Metric::of_all(M::LikeliestRmseAt, 2.), 5.),
        // Mean at the end: x = .5*7 - .3*2 + .2*4 = 3.7, y = .5*4 - .2*2 = 1.6; truth (4, 0).
        (Metric::of_all(M::MixtureMeanRmseAt, 2.), (0.3f64.powi(2) + 1.6f64.powi(2)).sqrt()),
        (Metric::best_of(M::MinAde, 2, 2.), 1.5),
        (Metric::best_of(M::MinFde, 2, 2.), 5.),
        (Metric::best_of(M::MinFde, 3, 2.), 2.),
        (Metric::best_of(M::RmseAt, 3, 2.), 2.),
        // Squared errors to 2 s: 34, 36 and 16 over 4.
        (Metric::best_of(M::RmseTo, 2, 2.), 8.5f64.sqrt()),
        (Metric::best_of(M::RmseToPerCoordinate, 3, 2.), 2f64.sqrt()),
        (Metric::best_of(M::MissRate, 2, 2.), 1.),
        (Metric::best_of(M::MissRate, 3, 2.), 0.), // 2 m is not beyond 2 m
        (Metric::best_of(M::BrierMinFde, 3, 2.), 2. + 0.8f64.powi(2)),
        // Of the two likeliest the first ends nearer; it has .5 of .8.
        (Metric::best_of(M::BrierMinFde, 2, 2.), 5. + 0.375f64.powi(2)),
        (Metric::top_1(M::BrierMinFde, 2.), 5.),
        // A forecast with fewer modes than k is scored on those it has.
        (Metric::best_of(M::MinFde, 20, 2.), 2.),
        (Metric::best_of(M::Overlap, 3, 2.), 0.),
    ];
    for (metric, expected) in cases {
        let found = value(metric, &reference, &forecast);
        assert!((found - expected).abs() < 1e-6, "{metric}: {found}, not {expected}");
    }
}

/// A prediction that stays behind has a bias below zero.
#[test]
fn a_lag_is_negative() {
    let (reference, _) = golden();
    let behind = forecast(&[(1., &[[0.5, 0.], [1., 0.], [1.5, 0.], [2., 3.]])]);
    assert_eq!(value(Metric::top_1(MetricKind::LongitudinalBiasAt, 2.), &reference, &behind), -2.);
}

/// The first mode is the prediction and need not be likeliest; of equally likely ones the first counts.
#[test]
fn the_likeliest_is_sought_among_all() {
    let (reference, _) = golden();
    let ends = |x: f32| [[1., 0.], [2., 0.], [3., 0.], [x, 0.]];
    let of = |shares: [f32; 3]| {
        let paths = [ends(5.), ends(6.), ends(7.)];
        let modes: Vec<(f32, &[[f32; 2]])> = shares.into_iter().zip(paths.iter().map(|path| &path[..])).collect();
        value(Metric::of_all(MetricKind::LikeliestRmseAt, 2.), &reference, &forecast(&modes))
    };
    assert_eq!(of([0.2, 0.5, 0.3]), 2.);
    assert_eq!(of([0.4, 0.4, 0.2]), 1.);
    assert_eq!(of([0.2, 0.4, 0.4]), 2.);
}

#[test]
fn off_road_does_not_apply_where_no_line_is_known() {
    let (reference, forecast) = golden();
    let case = ScoredWindow::new(&reference, &forecast, 3).unwrap();
    assert_eq!(Metric::best_of(MetricKind::OffRoad, 3, 2.).contribution(&case).unwrap(), None);
}

#[test]
fn no_metric_is_given_between_two_frames() {
    let (reference, forecast) = golden();
    let case = ScoredWindow::new(&reference, &forecast, 3).unwrap();
    for horizon_s in [0., 0.7, 2.5, f64::NAN] {
        let found = Metric::top_1(MetricKind::Fde, horizon_s).contribution(&case);
        assert!(matches!(found, Err(EvalError::Horizon { t_pred: 4, .. })), "{horizon_s}");
    }
}

#[test]
fn a_forecast_of_the_truth_scores_zero() {
    let (reference, _) = golden();
    let perfect = forecast(&[(1., &[[1., 0.], [2., 0.], [3., 0.], [4., 0.]])]);
    use MetricKind as M;
    for kind in [M::RmseAt, M::RmseTo, M::Ade, M::Fde, M::MinAde, M::MinFde, M::MissRate, M::BrierMinFde] {
        assert_eq!(value(Metric::top_1(kind, 2.), &reference, &perfect), 0., "{kind:?}");
    }
}

/// Random walks, seeded: a path and a forecast of `modes` equally likely modes.
fn random_case(rng: &mut ChaCha8Rng, modes: usize) -> (Reference, Forecast) {
    let mut walk = || {
        let mut at = [0f32; 2];
        let mut step = || {
            at = [at[0] + rng.random_range(-2. ..3.), at[1] + rng.random_range(-1. ..1.)];
            at
        };
        (0..7).map(|_| step()).collect::<Vec<_>>()
    };
    let reference = Reference::from_path(walk(), 1.);
    let probability = 1. / modes as f32;
    let modes = (0..modes).map(|_| Mode { probability, path: walk(), explanation: None }).collect();
    (reference, Forecast { modes })
}

/// For one set of two-dimensional displacements the root mean square is never below the mean
/// (Jensen), for the likeliest mode and for the best of k, each metric choosing its own.
#[test]
fn rmse_is_never_below_ade() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for k in [1, 3, 6] {
        let (mut rmse, mut ade) = (0., 0.);
        for _ in 0..50 {
            let (reference, forecast) = random_case(&mut rng, 6);
            let case = ScoredWindow::new(&reference, &forecast, 6).unwrap();
            rmse += Metric::best_of(MetricKind::RmseTo, k, 7.).contribution(&case).unwrap().unwrap();
            ade += Metric::best_of(MetricKind::MinAde, k, 7.).contribution(&case).unwrap().unwrap();
        }
        let (rmse, ade) = (MetricKind::RmseTo.value(rmse / 50.), MetricKind::MinAde.value(ade / 50.));
        assert!(rmse > ade, "k = {k}: RMSE {rmse}, ADE {ade}");
    }
}

#[test]
fn best_of_more_is_never_worse() {
    use MetricKind as M;
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for _ in 0..50 {
        let (reference, forecast) = random_case(&mut rng, 9);
        for kind in [M::MinAde, M::MinFde, M::RmseAt, M::RmseTo, M::RmseToPerCoordinate, M::MissRate] {
            let values: Vec<f64> =
                (1..=9).map(|k| value(Metric::best_of(kind, k, 5.), &reference, &forecast)).collect();
            assert!(values.windows(2).all(|pair| pair[1] <= pair[0]), "{kind:?}: {values:?}");
        }
        let [min_fde, fde] = [M::MinFde, M::Fde].map(|kind| value(Metric::best_of(kind, 1, 5.), &reference, &forecast));
        assert_eq!(min_fde, fde);
    }
}

/// The error across and the error along make up the whole.
#[test]
fn lateral_and_longitudinal_errors_add_up() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let (reference, forecast) = random_case(&mut rng, 2);
    let of = |kind| value(Metric::top_1(kind, 4.), &reference, &forecast);
    let [across, along, whole] =
        [MetricKind::LateralRmseAt, MetricKind::LongitudinalRmseAt, MetricKind::RmseAt].map(of);
    assert!((across.hypot(along) - whole).abs() < 1e-9);
}

/// What a preset gives, by metric as shown.
fn preset(protocol: Protocol, reference: &Reference, forecast: &Forecast, rate_hz: f64) -> Vec<(String, f64)> {
    let shape = gnp_data::WindowShape { t_obs: 7, t_pred: reference.path().len(), step: 1, rate_hz };
    let metrics = protocol.metrics(&shape).unwrap();
    metrics
        .iter()
        .map(|metric| {
            let case = ScoredWindow::new(reference, forecast, forecast.modes.len()).unwrap();
            let mean = metric.contribution(&case).unwrap().unwrap_or(f64::NAN);
            (metric.to_string(), metric.kind.value(mean))
        })
        .collect()
}

#[track_caller]
fn assert_preset(found: &[(String, f64)], expected: &[(&str, f64)]) {
    for (name, value) in expected {
        let value_found = found.iter().find(|(found, _)| found == name).unwrap_or_else(|| panic!("{name}: {found:?}"));
        assert!((value_found.1 - value).abs() < 1e-5, "{name}: {}, not {value}", value_found.1);
    }
}

/// A path with the same error to the left in each frame, or one that grows.
fn beside(reference: &Reference, offset: impl Fn(usize) -> [f32; 2]) -> Vec<[f32; 2]> {
    reference.path().iter().enumerate().map(|(j, p)| [p[0] + offset(j)[0], p[1] + offset(j)[1]]).collect()
}

/// 10 m/s for 6 s, two frames a second. Errors to the left: mode 0 has 0.25 m more in each frame, so
/// 0.25 to 3 m, 1.625 m on average; mode 1 has 2 m throughout; mode 2 has 4 m.
fn urban() -> (Reference, Forecast) {
    let reference = Reference::from_path((1..=12).map(|j| [5. * j as f32, 0.]).collect(), 2.);
    let paths = [
        beside(&reference, |j| [0., 0.25 * (j + 1) as f32]),
        beside(&reference, |_| [0., 2.]),
        beside(&reference, |_| [0., 4.]),
    ];
    let forecast = forecast(&[(0.6, &paths[0]), (0.3, &paths[1]), (0.1, &paths[2])]);
    (reference, forecast)
}

/// Argoverse 2: the end error decides, missed beyond 2 m, (1 - p)² of the best mode is added.
#[test]
fn argoverse_2_by_hand() {
    let (reference, forecast) = urban();
    let found = preset(Protocol::Argoverse2, &reference, &forecast, 2.);
    assert_preset(
        &found,
        &[
            ("min_ade (k = 1, 6 s)", 1.625),
            ("min_fde (k = 1, 6 s)", 3.),
            ("miss_rate (k = 1, 6 s)", 1.),
            ("brier_min_fde (k = 1, 6 s)", 3.),
            ("min_ade (k = 6, 6 s)", 1.625),
            ("min_fde (k = 6, 6 s)", 2.),
            ("miss_rate (k = 6, 6 s)", 0.), // 2 m is not beyond 2 m
            ("brier_min_fde (k = 6, 6 s)", 2. + 0.7f64.powi(2)),
        ],
    );
}

/// nuScenes: the largest error of any point decides, and 2 m is a miss: the same forecasts that
/// Argoverse 2 counts as a hit are missed.
#[test]
fn nuscenes_by_hand() {
    let (reference, forecast) = urban();
    let found = preset(Protocol::NuScenes, &reference, &forecast, 2.);
    assert_preset(
        &found,
        &[
            ("min_ade_2hz (k = 1, 6 s)", 1.625),
            ("min_fde (k = 1, 6 s)", 3.),
            ("miss_rate_any_point (k = 1, 6 s)", 1.),
            ("min_ade_2hz (k = 5, 6 s)", 1.625),
            ("min_fde (k = 5, 6 s)", 2.),
            ("miss_rate_any_point (k = 5, 6 s)", 1.),
        ],
    );
    // Off by 3 m on the way and by nothing at the end: hit for Argoverse 2, missed for nuScenes.
    let there = beside(&reference, |j| [if j == 5 { 3. } else { 0. }, 0.]);
    let detour = self::forecast(&[(1., &there)]);
    let value = |metric| value(metric, &reference, &detour);
    assert_eq!(value(Metric::best_of(MetricKind::MissRate, 5, 6.)), 0.);
    assert_eq!(value(Metric::best_of(MetricKind::AnyPointMissRate, 5, 6.)), 1.);
    assert!((value(Metric::best_of(MetricKind::SampledMinAde, 5, 6.)) - 0.25).abs() < 1e-6);
}

/// An error of 0.4 m a second, at 25 Hz: points 0.5 to 5 s are 2.75 s on average, every other one of
/// them between two frames.
#[test]
fn points_between_frames_are_interpolated() {
    let reference = Reference::from_path((1..=125).map(|j| [0.8 * j as f32, 0.]).collect(), 25.);
    let path = beside(&reference, |j| [0., 0.016 * (j + 1) as f32]);
    let forecast = forecast(&[(1., &path)]);
    let found = value(Metric::best_of(MetricKind::SampledMinAde, 6, 5.), &reference, &forecast);
    assert!((found - 1.1).abs() < 1e-5, "{found}");
    let of_frames = value(Metric::best_of(MetricKind::MinAde, 6, 5.), &reference, &forecast);
    assert!((of_frames - 0.4 * 2.52).abs() < 1e-5, "{of_frames}");
}

/// Waymo: a box along the heading, whole at 20 m/s.
///
/// | | 3 s: 2 m along, 1 m beside | 5 s: 3.6 m along, 1.8 m beside |
/// |---|---|---|
/// | mode 0, 1.9 m along and 1.1 m to the left | outside | inside |
/// | mode 1, 2.1 m along | outside | inside |
/// | mode 2, 3.7 m along from 4 s on | inside | outside |
#[test]
fn waymo_by_hand() {
    let reference = Reference::from_path((1..=10).map(|j| [10. * j as f32, 0.]).collect(), 2.);
    let paths = [
        beside(&reference, |_| [1.9, 1.1]),
        beside(&reference, |_| [2.1, 0.]),
        beside(&reference, |j| [if j < 7 { 0. } else { 3.7 }, 0.]),
    ];
    let only = |modes: &[usize]| {
        let share = 1. / modes.len() as f32;
        let modes: Vec<(f32, &[[f32; 2]])> = modes.iter().map(|m| (share, &paths[*m][..])).collect();
        preset(Protocol::Waymo, &reference, &forecast(&modes), 2.)
    };
    let (at_3, at_5) = ("miss_rate_box (k = 6, 3 s)", "miss_rate_box (k = 6, 5 s)");
    assert_preset(&only(&[0]), &[(at_3, 1.), (at_5, 0.)]);
    assert_preset(&only(&[1]), &[(at_3, 1.), (at_5, 0.)]);
    assert_preset(&only(&[2]), &[(at_3, 0.), (at_5, 1.)]);
    assert_preset(&only(&[0, 1]), &[(at_3, 1.), (at_5, 0.)]);
    let all = only(&[1, 0, 2]);
    assert_preset(&all, &[(at_3, 0.), (at_5, 0.)]);
    // Ten points to 5 s: mode 2 is off by 3.7 m in the last three of them.
    assert_preset(&all, &[("min_ade_2hz (k = 6, 3 s)", 0.), ("min_ade_2hz (k = 6, 5 s)", 1.11)]);
    assert_preset(&all, &[("min_fde (k = 6, 5 s)", 2.1), ("overlap (k = 1, 5 s)", 0.)]);
    assert!(!all.iter().any(|(name, _)| name.contains("8 s")), "windows of 5 s have no 8 s");
}

/// The box follows the heading, and shrinks with the present speed: halved to 1.4 m/s, three quarters
/// at 6.2 m/s, whole from 11 m/s.
#[test]
fn waymos_box_turns_and_shrinks() {
    let missed = |speed: f32, offset: [f32; 2], direction: [f32; 2]| {
        let step = speed / 2.;
        let path = (1..=6).map(|j| [step * j as f32 * direction[0], step * j as f32 * direction[1]]).collect();
        let reference = Reference::from_path(path, 2.);
        let path = beside(&reference, |_| offset);
        value(Metric::best_of(MetricKind::BoxMissRate, 6, 3.), &reference, &forecast(&[(1., &path)])) == 1.
    };
    let along = [1., 0.];
    for (speed, reach) in [(20., 2.), (11., 2.), (6.2, 1.5), (1.4, 1.), (0.5, 1.)] {
        assert!(!missed(speed, [reach - 0.01, 0.], along), "{speed} m/s");
        assert!(missed(speed, [reach + 0.01, 0.], along), "{speed} m/s");
        assert!(!missed(speed, [0., reach / 2. - 0.01], along), "{speed} m/s");
        assert!(missed(speed, [0., reach / 2. + 0.01], along), "{speed} m/s");
    }
    // 1.5 m along a heading of 3 : 4 is inside, 1.5 m across it is not.
    assert!(!missed(20., [0.9, 1.2], [0.6, 0.8]));
    assert!(missed(20., [-1.2, 0.9], [0.6, 0.8]));
}
