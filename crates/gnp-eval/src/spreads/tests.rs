//! Densities whose values are known.

use gnp_data::Forecast;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::metric::{Metric, MetricKind};

/// Standard normal numbers (Box and Muller).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.), rng.random());
    (-2. * u.ln()).sqrt() * (TAU * v).cos()
}

fn modes(modes: &[(f32, [f32; 2])]) -> Forecast {
    let mode =
        |(probability, end): &(f32, [f32; 2])| Mode { probability: *probability, path: vec![*end], explanation: None };
    Forecast { modes: modes.iter().map(mode).collect() }
}

/// What one window at 1 s adds to a metric.
fn of(kind: MetricKind, truth: [f32; 2], forecast: &Forecast, spread: Option<[f64; 2]>) -> Option<f64> {
    let reference = Reference::from_path(vec![truth], 1.);
    let spreads: Vec<Spread> =
        spread.into_iter().map(|[along_m, across_m]| Spread { horizon_s: 1., along_m, across_m }).collect();
    let case = ScoredWindow::new(&reference, forecast, 20).unwrap().with_spreads(&spreads);
    Metric::of_all(kind, 1.).contribution(&case).unwrap()
}

/// -ln of exp(-(1.5²/2 + 0.5²/2)) / (2 pi 2 0.5): 1.5 deviations of 2 m along, half of one of 0.5 m across.
#[test]
fn the_likelihood_of_one_gaussian_is_the_textbook_one() {
    let found = of(MetricKind::NllAt, [13., 0.25], &modes(&[(1., [10., 0.])]), Some([2., 0.5])).unwrap();
    let expected = 0.5 * (1.5f64.powi(2) + 0.5f64.powi(2)) + (TAU * 2. * 0.5).ln();
    assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
}

/// Two modes, 4 m apart; the record at the second, in a plane of 1 m spreads: 0.3 exp(-8) + 0.7 of 1 / (2 pi).
#[test]
fn the_likelihood_of_two_modes_is_their_weighted_sum() {
    let forecast = modes(&[(0.3, [0., 0.]), (0.7, [4., 0.])]);
    let found = of(MetricKind::NllAt, [4., 0.], &forecast, Some([1.; 2])).unwrap();
    let expected = -((0.3 * (-8f64).exp() + 0.7) / TAU).ln();
    assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
    assert_eq!(of(MetricKind::NllAt, [4., 0.], &forecast, None), None, "no spreads, no density");
    let far = of(MetricKind::NllAt, [4000., 0.], &forecast, Some([1.; 2])).unwrap();
    assert!(far.is_finite() && far > 7e6, "{far}");
}

/// Half of a Gaussian lies within 0.6745 deviations, nine tenths within 1.6449.
#[test]
fn central_intervals_are_those_of_the_normal_distribution() {
    let inside = |kind, x: f32| of(kind, [x, 99.], &modes(&[(1., [10., 0.])]), Some([2., 1.])).unwrap() == 1.;
    for (kind, reach) in [(MetricKind::Coverage50At, 1.34898), (MetricKind::Coverage90At, 3.28971)] {
        for side in [-1., 1.] {
            assert!(inside(kind, 10. + side * (reach - 0.001)), "{kind:?} {side}");
            assert!(!inside(kind, 10. + side * (reach + 0.001)), "{kind:?} {side}");
        }
    }
    // Between two equal modes far apart the central half holds all that is between them.
    let two = modes(&[(0.5, [0., 0.]), (0.5, [40., 0.])]);
    let inside = |x: f32| of(MetricKind::Coverage50At, [x, 0.], &two, Some([1.; 2])).unwrap() == 1.;
    assert!(inside(20.) && inside(0.1) && inside(39.9) && !inside(-0.1) && !inside(40.1));
}

/// The mean over whole seconds, and only where the spreads reach.
#[test]
fn the_mean_is_of_all_seconds() {
    let reference = Reference::from_path(vec![[1., 0.], [2., 0.]], 1.);
    let forecast =
        Forecast { modes: vec![Mode { probability: 1., path: vec![[1., 0.], [5., 0.]], explanation: None }] };
    let spreads = [1., 2.].map(|horizon_s| Spread { horizon_s, along_m: horizon_s, across_m: 1. });
    let case = ScoredWindow::new(&reference, &forecast, 1).unwrap();
    let value = |case: &ScoredWindow<'_>, kind, at| Metric::of_all(kind, at).contribution(case).unwrap();
    assert_eq!(value(&case, MetricKind::NllTo, 2.), None);
    let case = case.with_spreads(&spreads);
    let [first, second] = [TAU.ln(), (2. * TAU).ln() + 0.5 * 1.5f64.powi(2)];
    let near = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9;
    assert!(near(value(&case, MetricKind::NllAt, 1.), first));
    assert!(near(value(&case, MetricKind::NllAt, 2.), second));
    assert!(near(value(&case, MetricKind::NllTo, 2.), (first + second) / 2.));
    let short = ScoredWindow::new(&reference, &forecast, 1).unwrap().with_spreads(&spreads[..1]);
    assert_eq!(value(&short, MetricKind::NllTo, 2.), None);
}

/// With one mode the likeliest deviation is the root of the mean squared error.
#[test]
fn one_mode_has_the_spread_of_its_errors() {
    let windows = [[1., 3., 0.2], [1., -1., 0.4], [1., 1., -0.2]];
    let windows: Vec<&[Component]> = windows.iter().map(std::slice::from_ref).collect();
    let [along, across] = likeliest(&windows);
    assert!((along - (11f64 / 3.).sqrt()).abs() < 1e-9 && (across - 0.08f64.sqrt()).abs() < 1e-9, "{along} {across}");
}

#[test]
fn a_system_without_error_has_a_density() {
    let windows = [[[1., 0., 0.]]; 4];
    let windows: Vec<&[Component]> = windows.iter().map(|window| &window[..]).collect();
    assert_eq!(likeliest(&windows), [LEAST_M; 2]);
    let (log_density, _) = log_density(windows[0], [LEAST_M; 2]);
    assert!((log_density + (TAU * LEAST_M.powi(2)).ln()).abs() < 1e-9);
}

/// Records drawn from three modes with known spreads: the fit finds these, and the density is calibrated.
#[test]
fn spreads_that_made_the_data_are_found_and_calibrated() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let (shares, ends) = ([0.5, 0.3, 0.2], [[0., 0.], [6., 1.], [-5., -3.]]);
    let windows: Vec<Vec<Component>> = (0..4000)
        .map(|_| {
            let u: f64 = rng.random();
            let mode = if u < 0.5 { 0 } else { usize::from(u >= 0.8) + 1 };
            let truth = [ends[mode][0] + 1.5 * normal(&mut rng), ends[mode][1] + 0.4 * normal(&mut rng)];
            (0..3).map(|m| [shares[m], truth[0] - ends[m][0], truth[1] - ends[m][1]]).collect()
        })
        .collect();
    let slices: Vec<&[Component]> = windows.iter().map(Vec::as_slice).collect();
    let [along, across] = likeliest(&slices);
    assert!((along - 1.5).abs() < 0.05 && (across - 0.4).abs() < 0.015, "{along} {across}");
    // No other spreads are likelier.
    let likelihood = |spread| slices.iter().map(|window| log_density(window, spread).0).sum::<f64>();
    for other in [[1.1, 1.], [0.9, 1.], [1., 1.1], [1., 0.9]] {
        assert!(likelihood([along, across]) > likelihood([along * other[0], across * other[1]]), "{other:?}");
    }
    let covered = |kind| {
        let inside = windows.iter().map(|window| {
            let placed = |it: &Component| (it[0] as f32, [-it[1] as f32, -it[2] as f32]);
            of(kind, [0.; 2], &modes(&window.iter().map(placed).collect::<Vec<_>>()), Some([along, across])).unwrap()
        });
        inside.sum::<f64>() / 4000.
    };
    // Three standard errors of a share of 4000.
    let (half, most) = (covered(MetricKind::Coverage50At), covered(MetricKind::Coverage90At));
    assert!((half - 0.5).abs() < 0.024 && (most - 0.9).abs() < 0.0143, "{half} {most}");
}
