//! The Kalman filter against closed forms.

use std::f64::consts::PI;

use gnp_baselines::{AxisNoise, ConstantVelocity, Gaussian, Kalman};
use gnp_data::{Observation, Predictor, Window, WindowShape};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::road::{Car, SHAPE, path, road};

fn kalman(position: f64, wander: f64) -> Kalman {
    Kalman::new([AxisNoise { position, wander }, AxisNoise { position: 2. * position, wander: 3. * wander }]).unwrap()
}

fn gaussians(kalman: &Kalman, at: &dyn Fn(f64) -> [f64; 2]) -> Vec<Gaussian> {
    let recording = road(SHAPE, 0, &[Car { from: 0, at }]);
    kalman.gaussians(&Observation::new(&recording, SHAPE, 0, SHAPE.t_obs - 1).unwrap()).unwrap()
}

#[test]
fn a_straight_motion_goes_on() {
    let target = |t: f64| [7. + 12. * t, 3. - 0.4 * t];
    let recording = road(SHAPE, 0, &[Car { from: 0, at: &target }]);
    for kalman in [Kalman::default(), kalman(0.01, 5.), kalman(1., 0.01)] {
        for (j, position) in path(&kalman, SHAPE, &recording).iter().enumerate() {
            let time = (j + 1) as f64 * 0.1;
            assert!((f64::from(position[0]) - 12. * time).abs() < 0.01, "{j}: {position:?}");
            assert!((f64::from(position[1]) + 0.4 * time).abs() < 0.01, "{j}: {position:?}");
        }
    }
}

#[test]
fn without_wandering_it_is_the_least_squares_line() {
    let target = |t: f64| [12. * t + 0.4 * (9. * t).sin(), 0.3 * (23. * t).cos()];
    let recording = road(SHAPE, 0, &[Car { from: 0, at: &target }]);
    let line = path(&ConstantVelocity::new(1.5).unwrap(), SHAPE, &recording);
    let filtered = path(&kalman(0.3, 1e-6), SHAPE, &recording);
    for (a, b) in filtered.iter().zip(&line) {
        for axis in 0..2 {
            // The line starts at the last recorded position, the filter at the filtered one.
            let (a, b) = (a[axis] - filtered[0][axis], b[axis] - line[0][axis]);
            assert!((a - b).abs() < 1e-3, "{a} instead of {b}");
        }
    }
    // The spread of a regression of 16 frames, of which the last is 0.75 s after the middle.
    let squares: f64 = (0..16).map(|i| (0.1 * f64::from(i) - 0.75).powi(2)).sum();
    for (j, gaussian) in gaussians(&kalman(0.3, 1e-6), &target).iter().enumerate() {
        let time = 0.75 + 0.1 * (j + 1) as f64;
        let sigma = 0.3 * (1. + 1. / 16. + time * time / squares).sqrt();
        assert!((gaussian.sigma[0] - sigma).abs() < 1e-4 * sigma, "{j}: {} instead of {sigma}", gaussian.sigma[0]);
        assert!((gaussian.sigma[1] - 2. * sigma).abs() < 1e-3 * sigma);
    }
}

#[test]
fn without_noise_in_positions_the_spread_is_that_of_integrated_wandering() {
    // Exact positions every 0.1 s leave a variance of 0.1 / sqrt(12) of the speed, in units of the
    // density; from there it grows by t, and the position's by t^3 / 3.
    for (j, gaussian) in gaussians(&kalman(1e-4, 2.), &|t: f64| [9. * t, 0.]).iter().enumerate() {
        let time = 0.1 * (j + 1) as f64;
        let sigma = 2. * (time * time * (0.1 / 12f64.sqrt() + time / 3.)).sqrt();
        assert!((gaussian.sigma[0] - sigma).abs() < 1e-3 * sigma, "{j}: {} instead of {sigma}", gaussian.sigma[0]);
        assert!((gaussian.sigma[1] - 3. * sigma).abs() < 3e-3 * sigma);
    }
}

#[test]
fn the_likelihood_is_the_logarithm_of_a_density() {
    let gaussian = Gaussian { mean: [3., -1.], sigma: [0.7, 0.2] };
    let peak = gaussian.nll(gaussian.mean);
    assert!((peak - (2. * PI * 0.7 * 0.2).ln()).abs() < 1e-12, "{peak}");
    // One deviation forward and two to the left: 0.5 + 2 nats more.
    assert!((gaussian.nll([3.7, -0.6]) - peak - 2.5).abs() < 1e-12);
    // The density integrates to 1, and its negative logarithm over it to the entropy.
    let (step, mut whole, mut entropy) = (0.02, 0., 0.);
    for i in -300..300 {
        for j in -300..300 {
            let nll = gaussian.nll([3. + f64::from(i) * step, -1. + f64::from(j) * step]);
            whole += (-nll).exp() * step * step;
            entropy += nll * (-nll).exp() * step * step;
        }
    }
    assert!((whole - 1.).abs() < 1e-6, "{whole}");
    assert!((entropy - (peak + 1.)).abs() < 1e-6, "{entropy}");
}

#[test]
fn the_fit_finds_the_noise_that_made_the_windows() {
    let made = [AxisNoise { position: 0.4, wander: 0.8 }, AxisNoise { position: 0.1, wander: 0.3 }];
    let shape = WindowShape { t_obs: 12, t_pred: 20, step: 1, rate_hz: 5. };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.;
    let recordings: Vec<_> = (0..400)
        .map(|_| {
            let mut paths = [Vec::new(), Vec::new()];
            for (path, noise) in paths.iter_mut().zip(made) {
                let (mut x, mut v) = (0., if noise.wander > 0.5 { 20. } else { 0. });
                for _ in 0..shape.t_obs + shape.t_pred {
                    path.push(x + noise.position * normal());
                    // A white acceleration over a period, in 4 parts.
                    for _ in 0..4 {
                        let kick = noise.wander * 0.05f64.sqrt() * normal();
                        x += (v + kick / 2.) * 0.05;
                        v += kick;
                    }
                }
            }
            let at = |t: f64| {
                let frame = (t * 5.).round() as i64 + shape.t_obs as i64 - 1;
                [0, 1].map(|axis: usize| paths[axis][frame as usize])
            };
            road(shape, shape.t_pred, &[Car { from: 0, at: &at }])
        })
        .collect();
    let windows: Vec<_> = recordings.iter().map(|recording| Window::new(recording, shape, 0, 11).unwrap()).collect();
    let fitted = Kalman::fit(&windows).unwrap().noise();
    for (found, made) in fitted.iter().zip(made) {
        assert!((found.wander / made.wander - 1.).abs() < 0.1, "{found:?} instead of {made:?}");
        assert!((found.position / made.position - 1.).abs() < 0.25, "{found:?} instead of {made:?}");
    }
}

#[test]
fn nobody_drives_backwards() {
    let path = path(&Kalman::default(), SHAPE, &road(SHAPE, 0, &[Car { from: 0, at: &|t| [-0.3 * t, 0.] }]));
    assert!(path.windows(2).all(|pair| pair[1][0] >= pair[0][0]));
}

#[test]
fn bad_parameters_and_windows_are_refused() {
    let bad = [AxisNoise { position: 0., wander: 1. }, AxisNoise { position: 1., wander: 1. }];
    let message = Kalman::new(bad).unwrap_err().to_string();
    assert!(message.contains("position") && message.contains("positive"), "{message}");
    assert!(Kalman::fit(&[]).unwrap_err().to_string().contains("training windows"));
    let recording = road(SHAPE, SHAPE.t_pred, &[Car { from: 0, at: &|t| [t, 0.] }]);
    let single = WindowShape { t_obs: 1, ..SHAPE };
    let observation = Observation::new(&recording, single, 0, 4).unwrap();
    assert!(Kalman::default().predict(&[observation], 1).unwrap_err().to_string().contains("2 observed frames"));
    let window = |shape| Window::new(&recording, shape, 0, 15).unwrap();
    assert!(Kalman::fit(&[window(SHAPE), window(WindowShape { t_pred: 9, ..SHAPE })]).is_err());
    assert!(Kalman::fit(&[window(single)]).is_err());
}
