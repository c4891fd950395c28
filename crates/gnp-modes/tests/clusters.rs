//! Clusters of made-up futures: recovered, repeatable, and every bad input named.

use gnp_modes::{ModeError, ModeFrame, ModeParams, Modes, fit};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const T_PRED: usize = 7;

fn params(modes: usize) -> ModeParams {
    ModeParams { modes, seed: 11, max_iterations: 50, restarts: 2 }
}

/// `n` futures around five constant accelerations; the first are the most common.
fn futures(n: usize) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let kinds = [[0., 0.], [-3., 0.], [2., 0.], [0., 1.5], [0., -1.5]];
    let mut values = Vec::new();
    for i in 0..n {
        let kind = kinds[[0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 4][i % 15]];
        for j in 1..=T_PRED {
            let t = j as f32 * 0.5;
            for a in kind {
                values.push(0.5 * a * t * t + rng.random_range(-0.3..0.3));
            }
        }
    }
    values
}

#[test]
fn five_manoeuvres_are_found_largest_first() {
    let futures = futures(450);
    let modes = fit(&futures, T_PRED, ModeFrame::Deviation, &params(5)).unwrap();
    assert_eq!(modes.sizes, [150, 120, 90, 60, 30]);
    let ends: Vec<[f32; 2]> = (0..5).map(|i| modes.centre(i).unwrap()[2 * T_PRED - 2..].try_into().unwrap()).collect();
    let t = 0.5 * T_PRED as f32;
    for (end, a) in ends.iter().zip([[0., 0.], [-3., 0.], [2., 0.], [0., 1.5], [0., -1.5]]) {
        for (x, a) in end.iter().zip(a) {
            assert!((x - 0.5 * a * t * t).abs() < 0.1, "{ends:?}");
        }
    }
    // The inertia is that of the noise: variance 0.3²/3 a value.
    let expected = f64::from(0.03f32) * futures.len() as f64;
    assert!((modes.inertia / expected - 1.).abs() < 0.1, "{} against {expected}", modes.inertia);
    assert!(modes.converged);
}

#[test]
fn each_future_belongs_to_its_nearest_centre() {
    let futures = futures(200);
    let modes = fit(&futures, T_PRED, ModeFrame::Position, &params(9)).unwrap();
    let mut sizes = vec![0; 9];
    for path in futures.chunks_exact(2 * T_PRED) {
        sizes[modes.nearest(path).unwrap()] += 1;
    }
    assert_eq!(sizes, modes.sizes);
}

#[test]
fn threads_do_not_reach_the_result() {
    let futures = futures(1000);
    let on = |threads| -> Modes {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&futures, T_PRED, ModeFrame::Position, &params(23))).unwrap()
    };
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(5));
}

#[test]
fn the_seed_matters_and_repeats() {
    let futures = futures(300);
    let with = |seed| {
        let params = ModeParams { seed, restarts: 1, ..params(31) };
        fit(&futures, T_PRED, ModeFrame::Position, &params).unwrap().centres
    };
    assert_eq!(with(1), with(1));
    assert_ne!(with(1), with(2));
}

#[test]
fn more_starts_are_no_worse() {
    let futures = futures(300);
    let with = |restarts| {
        let params = ModeParams { restarts, ..params(17) };
        fit(&futures, T_PRED, ModeFrame::Position, &params).unwrap().inertia
    };
    assert!(with(6) <= with(1));
}

#[test]
fn as_many_modes_as_futures_reproduce_them() {
    let futures = futures(13);
    let modes = fit(&futures, T_PRED, ModeFrame::Position, &params(13)).unwrap();
    assert_eq!(modes.sizes, [1; 13]);
    assert!(modes.inertia < 1e-6);
}

#[test]
fn duplicates_do_not_count_as_modes() {
    let four = futures(4);
    let repeated: Vec<f32> = (0..5).flat_map(|_| four.clone()).collect();
    assert_eq!(fit(&repeated, T_PRED, ModeFrame::Position, &params(4)).unwrap().sizes, [5; 4]);
    for futures in [&repeated, &four] {
        let error = fit(futures, T_PRED, ModeFrame::Position, &params(6)).unwrap_err();
        assert!(matches!(error, ModeError::TooFewDistinct { modes: 6, distinct: 4, .. }), "{error}");
    }
}

#[test]
fn bad_futures_are_named() {
    let mut futures = futures(8);
    futures[2 * T_PRED * 3 + 5] = f32::NAN;
    let error = fit(&futures, T_PRED, ModeFrame::Position, &params(2)).unwrap_err();
    assert!(matches!(error, ModeError::Coordinate { sample: 3, step: 2, .. }), "{error}");
    futures[2 * T_PRED * 3 + 5] = 1e9;
    assert!(matches!(
        fit(&futures, T_PRED, ModeFrame::Position, &params(2)).unwrap_err(),
        ModeError::Coordinate { sample: 3, step: 2, .. }
    ));
    for (values, t_pred) in [(&futures[1..], T_PRED), (&futures[..], 0)] {
        let error = fit(values, t_pred, ModeFrame::Position, &params(2)).unwrap_err();
        assert!(matches!(error, ModeError::Shape { .. }), "{error}");
    }
    let none = fit(&[], T_PRED, ModeFrame::Position, &params(2)).unwrap_err();
    assert!(matches!(none, ModeError::TooFewDistinct { samples: 0, .. }), "{none}");
}

#[test]
fn a_file_gives_back_what_was_saved() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("modes.safetensors");
    let modes = fit(&futures(60), T_PRED, ModeFrame::Deviation, &params(6)).unwrap();
    modes.save(&path).unwrap();
    assert_eq!(Modes::load(&path).unwrap(), modes);
    let bytes = std::fs::read(&path).unwrap();
    modes.save(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same modes, the same bytes");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");

    for (broken, what) in [(&bytes[..bytes.len() - 5], "truncated"), (b"not modes at all", "foreign"), (&[], "empty")] {
        std::fs::write(&path, broken).unwrap();
        let error = Modes::load(&path).unwrap_err();
        assert!(matches!(error, ModeError::File { .. }), "{what}: {error}");
    }
    let missing = Modes::load(&folder.path().join("none")).unwrap_err().to_string();
    assert!(missing.contains("none: cannot be read"), "{missing}");
}
