//! Golden values worked out by hand, and what must hold between metrics.

use gnp_data::{Forecast, Mode};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::case::Reference;

fn forecast(modes: &[(f32, &[[f32; 2]])]) -> Forecast {
    let mode = |(probability, path): &(f32, &[[f32; 2]])| Mode {
        probability: *probability,
        path: path.to_vec(),
        explanation: None,
    };
    Forecast { modes: modes.iter().map(mode).collect() }
}

fn value(metric: Metric, reference: &Reference, forecast: &Forecast) -> f64 {
    let case = Case::new(reference, forecast, forecast.modes.len()).unwrap();
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

#[test]
fn off_road_does_not_apply_where_no_line_is_known() {
    let (reference, forecast) = golden();
    let case = Case::new(&reference, &forecast, 3).unwrap();
    assert_eq!(Metric::best_of(MetricKind::OffRoad, 3, 2.).contribution(&case).unwrap(), None);
}

#[test]
fn no_metric_is_given_between_two_frames() {
    let (reference, forecast) = golden();
    let case = Case::new(&reference, &forecast, 3).unwrap();
    for horizon_s in [0., 0.7, 2.5, f64::NAN] {
        let found = Metric::top_1(MetricKind::Fde, horizon_s).contribution(&case);
        assert!(matches!(found, Err(EvalError::Horizon { predicted: 4, .. })), "{horizon_s}");
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
            let case = Case::new(&reference, &forecast, 6).unwrap();
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
