//! Motions whose continuation is known.

#![allow(clippy::unwrap_used, clippy::panic)] // also outside the test functions

use gnp_baselines::{ConstantAcceleration, ConstantVelocity};
use gnp_data::{
    Columns, Dataset, Observation, PredictError, Predictor, Recording, RecordingMeta, Road, SLOTS, Track, WindowShape,
};

const SHAPE: WindowShape = WindowShape { t_obs: 16, t_pred: 30, step: 1, rate_hz: 10. };

/// One vehicle whose centre at time `t` (s; 0 in the last observed frame) is `at(t)`, with nothing
/// recorded after the last observed frame.
fn driven(shape: WindowShape, at: impl Fn(f64) -> [f64; 2]) -> Recording {
    let rows = shape.t_obs;
    let path: Vec<[f64; 2]> = (0..rows).map(|i| at((i as f64 + 1. - rows as f64) * shape.dt())).collect();
    let column = |axis: usize| path.iter().map(|position| position[axis] as f32).collect::<Vec<f32>>();
    let columns = Columns {
        x: column(0),
        y: column(1),
        // Not to be used: a stored velocity may know the next row.
        vx: vec![-99.; rows],
        vy: vec![99.; rows],
        lane: vec![1; rows],
        neighbours: vec![[u32::MAX; SLOTS]; rows],
        named_leader: None,
    };
    let track = Track::new(1, [4.5, 1.8], 3, 0..rows);
    let meta = RecordingMeta::new(Dataset::NGSIM, "s", "a", shape.rate_hz).with_simulated(true);
    let road = Road { driving_direction: 2, lines: vec![], fitted: false, axis: None };
    Recording::from_parts(meta, vec![road], vec![track], columns).unwrap()
}

fn path(predictor: &dyn Predictor, shape: WindowShape, at: impl Fn(f64) -> [f64; 2]) -> Vec<[f32; 2]> {
    let recording = driven(shape, at);
    let observation = Observation::new(&recording, shape, 0, shape.t_obs - 1).unwrap();
    let forecasts = predictor.predict(&[observation, observation], 6).unwrap();
    assert_eq!(forecasts.len(), 2);
    assert_eq!(forecasts[0], forecasts[1]);
    let [mode] = &forecasts[0].modes[..] else { panic!("one mode") };
    assert_eq!((mode.probability, mode.path.len()), (1., shape.t_pred));
    assert!(mode.explanation.is_none());
    mode.path.clone()
}

fn assert_follows(path: &[[f32; 2]], dt: f64, truth: impl Fn(f64) -> [f64; 2]) {
    for (j, position) in path.iter().enumerate() {
        let wanted = truth((j + 1) as f64 * dt);
        for axis in 0..2 {
            let error = (f64::from(position[axis]) - wanted[axis]).abs();
            assert!(error < 2e-3, "step {j}, axis {axis}: {} instead of {}", position[axis], wanted[axis]);
        }
    }
}

#[test]
fn a_straight_motion_goes_on_under_both() {
    let at = |t: f64| [7. + 12. * t, 3. - 0.4 * t];
    let wanted = |t: f64| [12. * t, -0.4 * t];
    for span in [0.1, 0.3, 1., 1.5] {
        assert_follows(&path(&ConstantVelocity::new(span).unwrap(), SHAPE, at), 0.1, wanted);
        assert_follows(&path(&ConstantAcceleration::new(span).unwrap(), SHAPE, at), 0.1, wanted);
    }
}

#[test]
fn constant_acceleration_continues_a_parabola() {
    let at = |t: f64| [12. * t + 0.75 * t * t, 0.3 * t - 0.05 * t * t];
    for span in [0.2, 0.5, 1., 1.5] {
        assert_follows(&path(&ConstantAcceleration::new(span).unwrap(), SHAPE, at), 0.1, at);
    }
}

#[test]
fn constant_velocity_lags_an_acceleration_by_half_its_span() {
    // Of a parabola, the slope over a stretch is the velocity in its middle.
    let at = |t: f64| [12. * t + 0.75 * t * t, 0.];
    for span in [0.1f64, 0.4, 1.] {
        let velocity = 12. - 1.5 * span / 2.;
        assert_follows(&path(&ConstantVelocity::new(span).unwrap(), SHAPE, at), 0.1, |t| [velocity * t, 0.]);
    }
}

#[test]
fn a_braking_vehicle_stops_and_stays() {
    // 4 m/s and -2 m/s²: stands after 2 s and 4 m, having moved 0.2 * 2 + 0.1 * 2 = 0.6 m to the left.
    let at = |t: f64| [4. * t - t * t, 0.2 * t + 0.05 * t * t];
    let path = path(&ConstantAcceleration::default(), SHAPE, at);
    assert_follows(&path, 0.1, |t| at(t.min(2.)));
    assert!((path[29][0] - 4.).abs() < 2e-3 && (path[29][1] - 0.6).abs() < 2e-3);
    assert!(path.windows(2).all(|pair| pair[1][0] >= pair[0][0] - 1e-6), "never backwards");
}

#[test]
fn a_standing_vehicle_stands() {
    let stands = path(&ConstantAcceleration::default(), SHAPE, |_| [5., 5.]);
    assert!(stands.iter().all(|position| *position == [0., 0.]));
    let stands = path(&ConstantVelocity::default(), SHAPE, |_| [5., 5.]);
    assert!(stands.iter().all(|position| *position == [0., 0.]));
}

#[test]
fn a_longer_span_averages_noise_away() {
    // Positions jump to and fro by 0.1 m about 10 m/s: one difference is wrong by 2 m/s.
    let at = |t: f64| [10. * t + if (t * 10.).round() as i64 % 2 == 0 { 0.05 } else { -0.05 }, 0.];
    let end = |span: f64| path(&ConstantVelocity::new(span).unwrap(), SHAPE, at)[29][0];
    assert!((end(0.1) - 33.).abs() < 0.01, "{}", end(0.1));
    assert!((end(1.5) - 30.).abs() < 0.2, "{}", end(1.5));
}

#[test]
fn times_are_those_of_the_windows_rate() {
    let shape = WindowShape { t_obs: 11, t_pred: 7, step: 1, rate_hz: 25. };
    let at = |t: f64| [30. * t + t * t, 0.];
    assert_follows(&path(&ConstantAcceleration::new(0.4).unwrap(), shape, at), 0.04, at);
    assert_follows(&path(&ConstantVelocity::new(0.04).unwrap(), shape, at), 0.04, |t| [29.96 * t, 0.]);
}

#[test]
fn too_short_a_past_is_an_error_that_says_how_much_is_needed() {
    let shape = WindowShape { t_obs: 4, t_pred: 7, step: 1, rate_hz: 10. };
    let recording = driven(shape, |t| [t, 0.]);
    let observation = Observation::new(&recording, shape, 0, 3).unwrap();
    let error = ConstantAcceleration::default().predict(&[observation], 1).unwrap_err();
    assert!(matches!(error, PredictError::Shape { .. }), "{error}");
    assert!(error.to_string().contains("11 observed frames"), "{error}");
    for seconds in [0., -1., f64::NAN, f64::INFINITY] {
        assert!(ConstantVelocity::new(seconds).unwrap_err().to_string().contains("positive"));
        assert!(ConstantAcceleration::new(seconds).is_err());
    }
}
