//! Anyone's predictions in the published Parquet schema, on the same windows as ours.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use gnp_baselines::ConstantVelocity;
use gnp_data::{Forecast, Observation, OraclePredictor, PredictError, Predictor, Recording, Window, WindowSet};
use gnp_eval::{Detail, EvalConfig, Predictions, Protocol, read_predictions};

use super::faithfulness::Measured;
use super::rules::{self, CONSTANT_VELOCITY};
use super::systems::System;
use super::{Material, Scores, evaluate, split_description};
use crate::config::RunConfig;
use crate::data::{ingest, source};
use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::draft::Draft;
use crate::run::folder::Stage;

/// Missing windows, and unknown vehicles, that an error names; the others are counted.
const NAMED: usize = 5;

/// Which windows a file of predictions is scored on.
#[derive(Clone, Debug)]
pub enum PredictionsOn {
    /// The test part of a run.
    Run(PathBuf),
    /// All windows of some recordings; without a folder, of those that come with the project.
    Recordings {
        /// How windows are cut.
        config: Box<RunConfig>,
        /// Folder or file of the recordings.
        data: Option<PathBuf>,
    },
}

/// Scores a file of predictions beside constant velocity (on the windows of a run as fitted to its training windows, on
/// recordings as it is where nothing is fitted), under `protocols` or, where that is empty,
/// those of the configuration. Writes the scores to the new folder `out` if there is one.
///
/// # Errors
/// When the file cannot be read, is of other data, lacks a window, or has predictions for vehicles that are not there;
/// when `out` is in use.
pub fn score_predictions(
    file: &Path,
    on: &PredictionsOn,
    protocols: &[Protocol],
    out: Option<&Path>,
    machine: &Machine,
) -> Result<Scores> {
    let predictions = read_predictions(file, Detail::Paths)?;
    let out = out.map(|out| Draft::start(out, "take another --out", machine)).transpose()?;
    match on {
        PredictionsOn::Run(folder) => {
            let run = Run::open(folder, machine)?;
            run.folder.require(Stage::Goal)?; // the split is there
            same_data(&predictions, &run.config, file)?;
            let set = run.windows()?;
            let split = run.split(&set)?;
            let ids = split.subset(run.config.evaluate.subset);
            let words = split_description(&run, &split);
            let material = Material { set: &set, ids, fitting: None, split: words, data: &run.folder.state.data };
            let beside = (rules::constant_velocity(&run)?, "fitted to the training windows of the run".to_owned());
            score(predictions, beside, &material, &evaluated(&run.config, protocols), out, machine)
        }
        PredictionsOn::Recordings { config, data } => {
            same_data(&predictions, config, file)?;
            let found = source::find(config, data.as_deref())?;
            machine.progress.result(&format!("Data: {}", found.data.description));
            let place = tempfile::tempdir().context("cannot make a temporary folder")?;
            let report = ingest::run(found, config, place.path(), machine)?;
            let recordings = report.load(place.path(), machine)?;
            let (set, _) = WindowSet::cut(&recordings, &config.windows)?;
            let words = "nothing, all windows".to_owned();
            let material = Material { set: &set, ids: set.ids(), fitting: None, split: words, data: &report.data };
            let words = format!("from the last {} s, fitted to nothing", ConstantVelocity::SPAN_S);
            let beside = (System::predictor(CONSTANT_VELOCITY, ConstantVelocity::default()), words);
            score(predictions, beside, &material, &evaluated(config, protocols), out, machine)
        }
    }
}

/// How a configuration scores under other protocols, if any are given.
fn evaluated(config: &RunConfig, protocols: &[Protocol]) -> EvalConfig {
    let protocols = if protocols.is_empty() { config.evaluate.protocols.clone() } else { protocols.to_vec() };
    EvalConfig { protocols, ..config.evaluate.clone() }
}

/// Scores predictions beside constant velocity, of which is said how it was fitted.
fn score(
    predictions: Predictions,
    (beside, fitted): (System, String),
    material: &Material<'_>,
    config: &EvalConfig,
    out: Option<Draft>,
    machine: &Machine,
) -> Result<Scores> {
    known(&predictions, material.set)?;
    covered(&predictions, material, machine)?;
    let uses_future = predictions.provenance().get("uses_future").is_some_and(|value| value == "true");
    let name = predictions.name().to_owned();
    let system = if uses_future {
        System::oracle(&name, WithFuture(predictions))
    } else {
        System::predictor(&name, predictions)
    };
    let ours = if name == beside.name() { format!("{name} (ours)") } else { beside.name().to_owned() };
    let systems = [system, beside.named(ours)];
    if uses_future && !config.protocols.iter().any(|protocol| protocol.allows_future()) {
        bail!(
            Predictions,
            "{name} is handed recorded futures, which `clean` does not allow; give --protocol literature"
        );
    }
    let evaluation = evaluate(material, &systems, config, machine)?;
    let scores = Scores::of(&evaluation, &Measured::default(), &name, material.split.clone(), &config.bootstrap)?;
    if let Some(draft) = out {
        let heading = format!(
            "# Scores of {name}\n\nOn {}. Lengths in m. Constant velocity: {fitted}.\n",
            material.data.description
        );
        scores.save(draft.path(), &heading)?;
        let place = draft.publish()?;
        machine.progress.note(&format!("scores: {}", place.join("metrics.md").display()));
    }
    Ok(scores)
}

/// A file says of itself what data and which rate it is for; one that does not say is believed.
fn same_data(predictions: &Predictions, config: &RunConfig, path: &Path) -> Result<()> {
    let says = |key: &str| predictions.provenance().get(key).map(String::as_str);
    let (dataset, rate_hz) = (config.dataset.as_str(), config.windows.rate_hz);
    if let Some(found) = says("dataset").filter(|found| *found != dataset) {
        bail!(Predictions, "{}: predictions for {found}, not for {dataset}", path.display());
    }
    let same = |found: &&str| found.parse::<f64>().is_ok_and(|found| (found - rate_hz).abs() <= 1e-6 * rate_hz);
    if let Some(found) = says("rate_hz").filter(|found| !same(found)) {
        bail!(Predictions, "{}: predictions at {found} Hz, the windows have {rate_hz} Hz", path.display());
    }
    Ok(())
}

/// Refuses a file with predictions for vehicles that the recordings do not have: it is of other recordings, or its
/// vehicles are numbered otherwise, and then scores of those that match by chance mean nothing.
fn known(predictions: &Predictions, set: &WindowSet<'_>) -> Result<()> {
    let vehicles = |recording: &Recording| recording.tracks().iter().map(|track| track.vehicle).collect();
    let there: BTreeMap<&str, BTreeSet<u32>> =
        set.recordings().iter().map(|recording| (recording.meta().name.as_str(), vehicles(recording))).collect();
    let unknown: BTreeSet<String> = predictions
        .iter()
        .filter_map(|prediction| match there.get(prediction.key.recording.as_str()) {
            None => Some(format!("recording {}", prediction.key.recording)),
            Some(vehicles) if !vehicles.contains(&prediction.key.vehicle) => {
                Some(format!("recording {}, vehicle {}", prediction.key.recording, prediction.key.vehicle))
            }
            Some(_) => None,
        })
        .collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let named: Vec<&str> = unknown.iter().take(NAMED).map(String::as_str).collect();
    let more = unknown.len() - named.len();
    let rest = if more > 0 { format!("; and {more} more") } else { String::new() };
    bail!(
        Predictions,
        "{} has predictions for what is not in these recordings: {}{rest}; leave these rows out, or score on the \
         recordings that they are for",
        predictions.name(),
        named.join("; ")
    );
}

/// Refuses a file that leaves windows out: scores of the rest would not be comparable.
fn covered(predictions: &Predictions, material: &Material<'_>, machine: &Machine) -> Result<()> {
    let windows = || material.ids.iter().filter_map(|id| material.set.get(*id));
    let coverage = predictions.coverage(windows());
    if coverage.windows_alone > 0 {
        let missing = windows().filter(|window| predictions.get(&window.key()).is_none()).take(NAMED);
        let named: Vec<String> = missing
            .map(|window| window.key())
            .map(|key| format!("recording {}, vehicle {}, frame {}", key.recording, key.vehicle, key.t0))
            .collect();
        let more = coverage.windows_alone.saturating_sub(named.len());
        let rest = if more > 0 { format!("; and {more} more") } else { String::new() };
        bail!(
            Predictions,
            "{} of {} windows have no prediction: {}{rest}; predict every window, or score on the windows that were \
             predicted (--run takes those that a run is evaluated on)",
            coverage.windows_alone,
            material.ids.len(),
            named.join("; ")
        );
    }
    if coverage.predictions_alone > 0 {
        machine.progress.note(&format!(
            "score: {} predictions are for other windows of these vehicles",
            coverage.predictions_alone
        ));
    }
    Ok(())
}

/// Predictions made with recorded futures in reach.
struct WithFuture(Predictions);

impl OraclePredictor for WithFuture {
    fn name(&self) -> &str {
        Predictor::name(&self.0)
    }

    fn predict_with_future(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
        self.0.predict(&seen, k)
    }
}

#[cfg(test)]
mod tests {
    use gnp_data::{Mode, WindowKey};
    use gnp_eval::Prediction;

    use super::*;
    use crate::evaluation::tests::{recording, windows};

    #[test]
    fn predictions_for_vehicles_that_are_not_there_are_refused_by_name() {
        let recordings = [recording("a")];
        let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
        let told = |vehicles: &[(&str, u32)]| {
            let of = |(name, vehicle): &(&str, u32)| Prediction {
                key: WindowKey { recording: (*name).to_owned(), vehicle: *vehicle, segment: 0, t0: 7 },
                origin: None,
                forecast: Forecast { modes: vec![Mode { probability: 1., path: vec![[1., 0.]], explanation: None }] },
            };
            known(&Predictions::new("theirs", vehicles.iter().map(of)), &set).map_err(|error| error.to_string())
        };
        // Another window of a vehicle that is there is counted elsewhere.
        assert_eq!(told(&[("a", 1), ("a", 20)]), Ok(()));
        let message = told(&[("a", 1), ("a", 21), ("b", 1), ("b", 2)]).unwrap_err();
        assert!(message.contains("recordings: recording a, vehicle 21; recording b; leave"), "{message}");
        let many: Vec<_> = (100..120).map(|vehicle| ("a", vehicle)).collect();
        assert!(told(&many).unwrap_err().contains("; and 15 more;"));
    }
}
