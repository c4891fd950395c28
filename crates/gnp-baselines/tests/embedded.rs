//! Errors of the baselines on the embedded real recordings.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::path::Path;

use gnp_baselines::{ConstantAcceleration, ConstantVelocity};
use gnp_data::{Dataset, Expectation, Predictor, Recording, WindowConfig, WindowSet, discover, read};

fn embedded(site: &str) -> Vec<Recording> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/ngsim");
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: Some(10.) };
    let sources = discover(&folder, Dataset::NGSIM).unwrap();
    let recordings = sources.iter().flat_map(|source| read(source, &expect).unwrap());
    recordings.map(|(recording, _)| recording).filter(|recording| recording.meta().site == site).collect()
}

/// Root of the mean squared displacement at 1, 2, .., 5 s, m.
fn rmse(predictor: &dyn Predictor, recordings: &[Recording], stride_s: f64) -> [f64; 5] {
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 10., stride_s, site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(recordings, &config).unwrap();
    let observations: Vec<_> = set.iter().map(|window| window.observation()).collect();
    let forecasts = predictor.predict(&observations, 1).unwrap();
    let mut squares = [0.; 5];
    for (window, forecast) in set.iter().zip(&forecasts) {
        for (second, square) in squares.iter_mut().enumerate() {
            let frame = 10 * second + 9;
            let ([x, y], truth) = (forecast.modes[0].path[frame], window.truth().target(frame));
            *square += f64::from((x - truth.x).powi(2) + (y - truth.y).powi(2));
        }
    }
    squares.map(|square| (square / set.len() as f64).sqrt())
}

#[test]
fn constant_velocity_on_us_101_is_what_the_literature_reports() {
    let recordings = embedded("us-101");
    let found = rmse(&ConstantVelocity::default(), &recordings, 0.2);
    // On other scenes of the same measurement: .91 1.96 3.27 4.86 6.68 m.
    for (found, reported) in found.iter().zip([0.91, 1.96, 3.27, 4.86, 6.68]) {
        assert!((found - reported).abs() < 0.12, "{found} instead of {reported}");
    }
    // The reasons for the default: one frame is too noisy, three seconds are too old.
    for span in [0.1, 3.] {
        let other = rmse(&ConstantVelocity::new(span).unwrap(), &recordings, 0.2);
        assert!(other[4] > found[4] + 1., "{span} s: {other:?}");
    }
}

#[test]
fn constant_acceleration_is_worse_than_constant_velocity_in_the_long_run() {
    let recordings = embedded("i-80");
    let velocity = rmse(&ConstantVelocity::default(), &recordings, 2.);
    let acceleration = rmse(&ConstantAcceleration::default(), &recordings, 2.);
    assert!(acceleration[4] > velocity[4] && acceleration[4] < 15., "{velocity:?} {acceleration:?}");
}
