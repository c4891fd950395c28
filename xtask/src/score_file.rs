//! `score`: anyone's predictions in the published Parquet schema, on the same windows as ours.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use gnp_baselines::ConstantVelocity;
use gnp_data::{
    Dataset, Forecast, Observation, OraclePredictor, PredictError, Predictor, Split, Window, WindowId, WindowSet,
};
use gnp_eval::{
    Detail, EvalConfig, Predictions, TableHead, comparison_tables, csv, read_predictions, save_comparisons,
    save_scores, tables,
};

use crate::cli::ScoreArgs;
use crate::config::RunConfig;
use crate::modes::kinds;
use crate::run_folder::{Draft, RunFolder, Stage, write};
use crate::session::{Machine, Session};
use crate::tables::systems::{self, System};
use crate::terminal::Terminal;
use crate::{ingest, source};

/// Missing windows that an error names; the others are counted.
const NAMED: usize = 5;

/// Scores a file of predictions beside constant velocity.
///
/// # Errors
/// When the file cannot be read, is of other data, or lacks a window; when `--out` is in use.
pub(crate) fn run(args: &ScoreArgs) -> Result<()> {
    let predictions = read_predictions(&args.predictions, Detail::Paths)?;
    same_data(&predictions, args.dataset, &args.predictions)?;
    let out = args.out.as_deref().map(|out| Draft::start(out, "take another --out")).transpose()?;
    let machine = Machine::start(&args.machine)?;
    let terminal = machine.terminal.clone();
    match &args.run {
        Some(run) => {
            let folder = RunFolder::open(run)?;
            folder.require(Stage::Goal)?; // the split is there
            let config = RunConfig::read(&folder.path("config.toml"), &[])?;
            if config.dataset != args.dataset {
                bail!("--dataset {} but {} is of other data", args.dataset.as_str(), run.display());
            }
            let session = Session::new(folder, config, machine);
            let set = session.windows()?;
            let split = Split::load(&set, &session.folder.path("split.json"))?;
            let leaks = if split.leaks() { " (leaks)" } else { "" };
            let words = &session.folder.state.data.words;
            let material =
                Material { set: &set, ids: split.test(), split: format!("{}{leaks}", kinds(split.kinds())), words };
            score(args, predictions, &material, &session.config, out, &terminal)
        }
        None => {
            let path = crate::project::root().join("configs").join(format!("{}.toml", args.dataset.as_str()));
            let config = RunConfig::read(args.config.as_ref().unwrap_or(&path), &args.set)?;
            let found = source::find(&config, args.data_dir.as_deref())?;
            terminal.result(&format!("Data: {}", found.data.words));
            let place = tempfile::tempdir().context("cannot make a temporary folder")?;
            let report = ingest::run(found, &config, place.path(), &terminal)?;
            let recordings = report.load(place.path(), &terminal)?;
            let (set, _) = WindowSet::cut(&recordings, &config.windows)?;
            let split = "nothing, all windows".to_owned();
            let material = Material { set: &set, ids: set.ids(), split, words: &report.data.words };
            score(args, predictions, &material, &config, out, &terminal)
        }
    }
}

/// The windows to score on.
struct Material<'a> {
    set: &'a WindowSet<'a>,
    ids: &'a [WindowId],
    split: String,
    words: &'a str,
}

fn score(
    args: &ScoreArgs,
    predictions: Predictions,
    material: &Material<'_>,
    config: &RunConfig,
    out: Option<Draft>,
    terminal: &Terminal,
) -> Result<()> {
    covered(&predictions, material, terminal)?;
    let uses_future = predictions.provenance().get("uses_future").is_some_and(|value| value == "true");
    let name = predictions.name().to_owned();
    let system = if uses_future {
        System::oracle(name.clone(), WithFuture(predictions))
    } else {
        System::predictor(name.clone(), predictions)
    };
    let beside = if name == "constant velocity" { "constant velocity (ours)" } else { "constant velocity" };
    let systems = [system, System::predictor(beside, ConstantVelocity::default())];
    let protocols = if args.protocol.is_empty() {
        config.evaluate.protocols.clone()
    } else {
        args.protocol.iter().map(|name| (*name).into()).collect()
    };
    if uses_future && !protocols.iter().any(|protocol| protocol.allows_future()) {
        bail!("{name} is handed recorded futures, which `clean` does not allow; give --protocol literature");
    }
    let evaluate = EvalConfig { protocols, ..config.evaluate.clone() };
    let evaluation = systems::score(material.set, material.ids, &systems, &evaluate, terminal)?;
    let scores = evaluation.scores(&evaluate.bootstrap);
    let differences = evaluation.comparisons(&name, &evaluate.bootstrap)?;
    let head = TableHead { split: material.split.clone(), rate_hz: material.set.shape().rate_hz };
    let mut shown = tables(&scores, &head);
    shown.extend(comparison_tables(&differences, &head));
    let mut markdown = format!("# Scores of {name}\n\nOn {}. Lengths in m.\n", material.words);
    for table in &shown {
        if !table.detail {
            terminal.result(&format!("\n{}", table.terminal()));
        }
        let _ = write!(markdown, "\n{}\n", table.markdown().trim_end());
    }
    if let Some(draft) = out {
        save_scores(&draft.path().join("metrics.json"), &scores)?;
        save_comparisons(&draft.path().join("differences.json"), &differences)?;
        write(&draft.path().join("metrics.csv"), csv(&shown).as_bytes())?;
        write(&draft.path().join("metrics.md"), markdown.as_bytes())?;
        let place = draft.publish()?;
        terminal.note(&format!("scores: {}", place.join("metrics.md").display()));
    }
    Ok(())
}

/// A file says of itself what data it is for; one that does not say is believed.
fn same_data(predictions: &Predictions, dataset: Dataset, path: &Path) -> Result<()> {
    let wanted = dataset.as_str();
    match predictions.provenance().get("dataset") {
        Some(found) if found != wanted => {
            bail!("{}: predictions for {found}, not for {wanted}; give --dataset {found}", path.display())
        }
        _ => Ok(()),
    }
}

/// Refuses a file that leaves windows out: scores of the rest would not be comparable.
fn covered(predictions: &Predictions, material: &Material<'_>, terminal: &Terminal) -> Result<()> {
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
            "{} of {} windows have no prediction: {}{rest}; predict every window, or score on the windows that were \
             predicted (--run takes a run's test part)",
            coverage.windows_alone,
            material.ids.len(),
            named.join("; ")
        );
    }
    if coverage.predictions_alone > 0 {
        terminal.note(&format!("score: {} predictions are for none of the windows", coverage.predictions_alone));
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
