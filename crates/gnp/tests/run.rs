//! A run through the library: what is trained, loaded, scored and stopped.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::path::Path;

use candle_core::Device;
use gnp::{Error, Machine, Plan, Run, RunConfig, Silent, Stage, Stop};
use gnp_data::{Observation, Predictor as _};
use gnp_model::{Checkpoint, Gnp, NeighbourFuture, Selection};
use gnp_modes::Modes;
use tempfile::TempDir;

fn config(more: &[&str]) -> RunConfig {
    let settings = ["data.max_recordings=3", "goal.epochs=1", "attraction.epochs=1", "repulsion.epochs=1"];
    let set: Vec<_> = settings.iter().chain(more).map(|text| text.parse().unwrap()).collect();
    RunConfig::embedded("smoke", &set).unwrap()
}

fn trained(config: RunConfig, out: &Path) -> Run {
    let mut run = Plan::new(config, None, out).begin(&Machine::default()).unwrap();
    run.train().unwrap();
    run
}

/// The model of a run once chose goals by another rule than `[predict]` says wherever it was shown: in the scene player
/// and in replays.
#[test]
fn the_model_of_a_run_selects_goals_as_its_configuration_says() {
    let out = TempDir::new().unwrap();
    let run = trained(config(&["predict.selection=most_probable"]), &out.path().join("run"));
    let set = run.windows().unwrap();
    let seen: Vec<Observation<'_>> = set.iter().take(4).map(|window| window.observation()).collect();
    let selecting = |selection| {
        let gnp = Gnp::load(run.path(), NeighbourFuture::Platoon, &Device::Cpu).unwrap();
        gnp.selecting(selection).predict(&seen, 6).unwrap()
    };
    let found = run.model().unwrap().predict(&seen, 6).unwrap();
    assert_eq!(found, selecting(Selection::MostProbable));
    assert_ne!(found, selecting(Selection::Medoids));
}

#[test]
fn rules_are_fitted_once_and_kept_with_the_run() {
    let out = TempDir::new().unwrap();
    let mut run = trained(config(&[]), &out.path().join("run"));
    run.perform(Stage::Evaluate).unwrap();
    let scores = run.scores().unwrap();
    let summary = scores.summary().unwrap();
    assert_eq!(summary.sites[0].rows[0].name, "GNP");
    let file = run.path().join("rules.json");
    let fitted = std::fs::read_to_string(&file).unwrap();
    let of = |scores: &gnp::Scores, model: &str| -> Vec<f64> {
        scores.scores.iter().filter(|score| score.model == model).map(|score| score.value).collect()
    };
    assert!(!of(&scores, "Kalman filter").is_empty());

    // The same numbers from the file; another noise is another filter.
    run.forget(Stage::Evaluate).unwrap();
    run.perform(Stage::Evaluate).unwrap();
    let again = run.scores().unwrap();
    assert_eq!(again.scores, scores.scores);
    let mut changed: serde_json::Value = serde_json::from_str(&fitted).unwrap();
    let wander = &mut changed["rules"]["Kalman filter"]["noise"][0]["wander"];
    *wander = (wander.as_f64().unwrap() * 3.).into();
    std::fs::write(&file, changed.to_string()).unwrap();
    run.forget(Stage::Evaluate).unwrap();
    run.perform(Stage::Evaluate).unwrap();
    let other = run.scores().unwrap();
    assert_ne!(of(&other, "Kalman filter"), of(&scores, "Kalman filter"));
    assert_eq!(of(&other, "gnp"), of(&scores, "gnp"));
}

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
    assert!(far(&predicted(&drawn)) > 0.1, "{}", far(&predicted(&drawn)));

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

/// The scene player once showed medoids where the configuration asks for the most probable modes.
#[test]
fn the_player_shows_the_futures_that_the_configuration_selects() {
    let out = TempDir::new().unwrap();
    let mut run = trained(config(&["predict.selection=most_probable"]), &out.path().join("run"));
    run.perform(Stage::Evaluate).unwrap();
    let played = |run: &Run| {
        let page = std::fs::read_to_string(gnp::write_report(run).unwrap().0).unwrap();
        let json = page.split_once("type=\"application/json\" id=\"recording\">").unwrap().1;
        let player: serde_json::Value = serde_json::from_str(json.split_once("</script>").unwrap().0).unwrap();
        player["forecasts"].as_array().unwrap().iter().map(|made| made["modes"].clone()).collect::<Vec<_>>()
    };
    let most_probable = played(&run);
    let file = run.path().join("config.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replace("\"most_probable\"", "\"medoids\"")).unwrap();
    let medoids = played(&Run::open(run.path(), &Machine::default()).unwrap());
    assert!(!medoids.is_empty() && medoids.len() == most_probable.len());
    assert_ne!(medoids, most_probable);
}

/// Figures and the player once said "test" whatever was evaluated.
#[test]
fn the_report_names_the_subset_that_was_evaluated() {
    let out = TempDir::new().unwrap();
    let mut run = trained(config(&["evaluate.subset=validation"]), &out.path().join("run"));
    run.perform(Stage::Evaluate).unwrap();
    let (path, figures) = gnp::write_report(&run).unwrap();
    for name in ["error-by-horizon", "reliability", "scenes"] {
        let figure = figures.iter().find(|figure| figure.name.starts_with(name)).unwrap();
        // The source may be broken into lines after any word.
        assert!(figure.svg.contains("validation"), "{name} does not say what was evaluated");
    }
    let page = std::fs::read_to_string(path).unwrap();
    assert!(page.contains("\"subset\":\"validation\"") && !page.contains("test subset") && !page.contains("test part"));
    // What was found first, what it rests on last.
    let place = |part: &str| page.find(part).unwrap();
    let order =
        ["class=\"headline\"", "class=\"summary\"", "id=\"player\"", "protocol clean:", "<details>", "split hash"];
    assert!(order.map(place).is_sorted(), "{:?}", order.map(place));
}

#[test]
fn a_stop_says_what_is_kept() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let stop = Stop::new();
    let machine = Machine::new(Device::Cpu, std::sync::Arc::new(Silent), stop.clone());
    let mut run = Plan::new(config(&[]), None, &place).begin(&machine).unwrap();
    assert!(!stop.request());
    let error = run.train().unwrap_err();
    assert_eq!(error.kept(), Some(Some(&place)), "{}", error.chain());
    // Before there is a folder, nothing is kept.
    let error = Plan::new(config(&[]), None, out.path().join("other")).begin(&machine).unwrap_err();
    assert!(matches!(error, Error::Stopped { kept: None }), "{}", error.chain());
    assert!(!out.path().join("other").exists());
    trained_on(&place);
}

/// What was stopped goes on.
fn trained_on(place: &Path) {
    let mut run = Plan::resume(place).begin(&Machine::default()).unwrap();
    run.train().unwrap();
    assert!(run.state().finished.contains_key(&Stage::Repulsion));
}

#[test]
fn a_run_that_is_not_finished_has_no_scores() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let run = Plan::new(config(&[]), None, &place).begin(&Machine::default()).unwrap();
    assert!(matches!(run.scores().unwrap_err(), Error::Folder(_)));
    assert!(Run::finished(&place, &Machine::default()).unwrap_err().chain().contains("gnp pipeline --resume"));
    assert!(run.model().is_err());
}

/// Half a training once gave another model under the name of the whole one.
#[test]
fn a_run_has_a_model_only_when_all_of_it_is_trained() {
    let out = TempDir::new().unwrap();
    let mut run = trained(config(&[]), &out.path().join("run"));
    assert!(run.model().is_ok());
    run.forget(Stage::Repulsion).unwrap();
    let error = run.model().unwrap_err().chain();
    assert!(error.contains("train --stage repulsion"), "{error}");
}
