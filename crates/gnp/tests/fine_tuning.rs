//! A run that starts from another one: what it takes over, and from what it cannot.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod smoke;

use std::path::Path;

use gnp::{Machine, Plan, Run, Stage};
use gnp_data::{Observation, Predictor as _};
use gnp_model::Checkpoint;
use gnp_modes::Modes;
use tempfile::TempDir;

use smoke::{config, trained};

/// First futures of some windows, m.
fn predicted(run: &Run) -> Vec<[f32; 2]> {
    let set = run.windows().unwrap();
    let seen: Vec<Observation<'_>> = set.iter().take(6).map(|window| window.observation()).collect();
    let forecasts = run.model().unwrap().predict(&seen, 1).unwrap();
    forecasts.into_iter().flat_map(|forecast| forecast.modes[0].path.clone()).collect()
}

/// The same trainings, which hardly move a weight.
const STILL: [&str; 3] =
    ["goal.learning_rate=1e-12", "attraction.learning_rate=1e-12", "repulsion.learning_rate=1e-12"];

#[test]
fn a_fine_tuned_run_starts_from_another_ones_networks() {
    let out = TempDir::new().unwrap();
    let source = trained(config(&[]), &out.path().join("source"));
    let expected = predicted(&source);
    let far = |found: &[[f32; 2]]| {
        found.iter().zip(&expected).map(|(a, b)| (a[0] - b[0]).abs().max((a[1] - b[1]).abs())).fold(0., f32::max)
    };
    let mut plan = Plan::new(config(&STILL), None, out.path().join("tuned"));
    plan.from = Some(source.path().to_owned());
    let mut tuned = plan.begin(&Machine::default()).unwrap();
    let drawn = trained(config(&STILL), &out.path().join("drawn"));
    assert!(far(&predicted(&drawn)) > 0.02, "{}", far(&predicted(&drawn)));

    // It goes on without the other run, and says where it comes from.
    let moved = out.path().join("moved");
    std::fs::rename(source.path(), &moved).unwrap();
    tuned.train().unwrap();
    assert!(far(&predicted(&tuned)) < 1e-3, "{}", far(&predicted(&tuned)));
    let origin = tuned.state().origin.clone().unwrap();
    assert!(origin.folder.ends_with("source") && origin.split_hash == source.state().split_hash);
    for part in ["goal", "attraction", "repulsion"] {
        let header = Checkpoint::load(&tuned.path().join(format!("{part}.safetensors"))).unwrap().header;
        assert_eq!(header.origin.as_ref(), Some(&origin), "{part}");
    }
    assert!(source.state().origin.is_none());

    // On other recordings statistics and modes stay, weights move, and drivers are fitted anew.
    let mut plan = Plan::new(config(&["data.max_recordings=2"]), None, out.path().join("other"));
    plan.from = Some(moved.clone());
    let mut other = plan.begin(&Machine::default()).unwrap();
    other.train().unwrap();
    let header = |folder: &Path| Checkpoint::load(&folder.join("goal.safetensors")).unwrap().header;
    let (there, here) = (header(&moved), header(other.path()));
    let (drivers, fitted) = (there.features.platoon().unwrap(), here.features.platoon().unwrap());
    assert_ne!(drivers, fitted);
    assert_eq!(there.features.clone().with_platoon(fitted), here.features);
    let modes = |folder: &Path| Modes::load(&folder.join("modes.safetensors")).unwrap().centres;
    assert_eq!(modes(&moved), modes(other.path()));

    // Resumed with the same words it is the same run; from another one it is not.
    plan.resume = true;
    assert!(plan.begin(&Machine::default()).unwrap().model().is_ok());
    plan.from = Some(drawn.path().to_owned());
    let error = plan.begin(&Machine::default()).unwrap_err().chain();
    assert!(error.contains("started from") && error.contains("drawn"), "{error}");
    plan.out = drawn.path().to_owned();
    plan.config = None;
    let error = plan.begin(&Machine::default()).unwrap_err().chain();
    assert!(error.contains("did not start from another run"), "{error}");
}

#[test]
fn a_run_that_cannot_be_started_from_is_refused_and_leaves_nothing() {
    let out = TempDir::new().unwrap();
    let mut source = trained(config(&[]), &out.path().join("source"));
    let place = out.path().join("tuned");
    let refused = |from: &Path, settings: &[&str]| {
        let mut plan = Plan::new(config(settings), None, &place);
        plan.from = Some(from.to_owned());
        let error = plan.begin(&Machine::default()).unwrap_err().chain();
        assert!(!place.exists(), "{error}");
        error
    };
    for (setting, key) in [
        ("goal.width=16", "goal.width"),
        ("traj.hidden=12", "traj.hidden"),
        ("modes.modes=3", "modes.modes"),
        ("features.vehicles_ahead=1", "features.vehicles_ahead"),
        ("windows.predicted_s=4.0", "windows.predicted_s"),
    ] {
        let error = refused(source.path(), &[setting]);
        assert!(error.contains("cannot start from") && error.contains(&format!("`{key}`")), "{error}");
    }
    // What does not shape the networks may differ.
    assert!(refused(out.path(), &["goal.epochs=2"]).contains("is not a run folder"));
    let drawn = Plan::new(config(&[]), None, out.path().join("drawn"));
    let mut begun = drawn.begin(&Machine::default()).unwrap();
    begun.start_from(source.path()).unwrap();
    begun.start_from(source.path()).unwrap();
    begun.perform(Stage::Modes).unwrap();
    let mut own = trained(config(&[]), &out.path().join("own"));
    assert!(own.start_from(source.path()).unwrap_err().chain().contains("modes of its own"));
    assert!(begun.start_from(own.path()).unwrap_err().chain().contains("started from"));

    source.forget(Stage::Repulsion).unwrap();
    assert!(refused(source.path(), &[]).contains("its repulsion is not finished"));
}
