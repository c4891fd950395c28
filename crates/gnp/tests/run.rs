//! A run through the library: what is trained, loaded, scored and stopped.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod smoke;

use std::path::Path;

use candle_core::Device;
use gnp::{Error, Machine, Plan, Run, Silent, Stage, Stop};
use gnp_data::{Observation, Predictor as _};
use gnp_model::{Gnp, Selection};
use tempfile::TempDir;

use smoke::{config, trained};

/// The model of a run once chose goals by another rule than `[predict]` says wherever it was shown: in the scene player
/// and in replays.
#[test]
fn the_model_of_a_run_selects_goals_as_its_configuration_says() {
    let out = TempDir::new().unwrap();
    let run = trained(config(&["predict.selection=most_probable"]), &out.path().join("run"));
    let set = run.windows().unwrap();
    let seen: Vec<Observation<'_>> = set.iter().take(4).map(|window| window.observation()).collect();
    let predict = &run.config().predict;
    let selecting = |selection| {
        let gnp = Gnp::load(run.path(), predict.neighbours.without_future(), &Device::Cpu).unwrap();
        gnp.selecting(selection).trusting(predict.trust).unwrap().predict(&seen, 6).unwrap()
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

    // The same numbers from the file; rules that somebody changed are fitted again.
    run.forget(Stage::Evaluate).unwrap();
    run.perform(Stage::Evaluate).unwrap();
    let again = run.scores().unwrap();
    assert_eq!(again.scores, scores.scores);
    let mut changed: serde_json::Value = serde_json::from_str(&fitted).unwrap();
    let wander = &mut changed["rules"]["Kalman filter"]["pooled"]["noise"][0]["wander"];
    *wander = (wander.as_f64().unwrap() * 3.).into();
    std::fs::write(&file, changed.to_string()).unwrap();
    run.forget(Stage::Evaluate).unwrap();
    run.perform(Stage::Evaluate).unwrap();
    assert_eq!(run.scores().unwrap().scores, scores.scores);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), fitted);
}

/// The scene player once showed medoids where the configuration asks for the most probable modes.
#[test]
fn the_player_shows_the_futures_that_the_configuration_selects() {
    let out = TempDir::new().unwrap();
    let played = |selection: &str| {
        let set = format!("predict.selection={selection}");
        let mut run = trained(config(&[&set]), &out.path().join(selection));
        run.perform(Stage::Evaluate).unwrap();
        let page = std::fs::read_to_string(gnp::write_report(&mut run).unwrap().0).unwrap();
        let json = page.split_once("type=\"application/json\" id=\"recording\">").unwrap().1;
        let player: serde_json::Value = serde_json::from_str(json.split_once("</script>").unwrap().0).unwrap();
        player["forecasts"].as_array().unwrap().iter().map(|made| made["modes"].clone()).collect::<Vec<_>>()
    };
    let [most_probable, medoids] = ["most_probable", "medoids"].map(played);
    assert!(!medoids.is_empty() && medoids.len() == most_probable.len());
    assert_ne!(medoids, most_probable);
}

/// Figures and the player once said "test" whatever was evaluated.
#[test]
fn the_report_names_the_subset_that_was_evaluated() {
    let out = TempDir::new().unwrap();
    let mut run = trained(config(&["evaluate.subset=validation"]), &out.path().join("run"));
    run.perform(Stage::Evaluate).unwrap();
    let (path, figures) = gnp::write_report(&mut run).unwrap();
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
