//! Scores on the test part: the model, its goal head, and predictors without a network.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow};
use gnp_baselines::{ConstantAcceleration, ConstantVelocity, Idm, Kalman};
use gnp_data::{Predictor as _, Split, SplitConfig, Subset, Window, WindowId, WindowSet};
use gnp_eval::{
    EvalConfig, EvalError, EvaluatedModel, Evaluation, PredictionWriter, Provenance, TableHead, evaluate,
    save_comparisons, save_scores, tables,
};
use gnp_model::Gnp;

use crate::config::RunConfig;
use crate::modes::kinds;
use crate::run_folder::{DataState, write};
use crate::session::Session;
use crate::stop::{self, Interrupted, STOP};
use crate::terminal::Terminal;

/// What is scored, and how that is said.
pub(crate) struct Scoring<'a> {
    /// Folder of the trained model.
    pub(crate) model: &'a Path,
    /// Folder for scores and predictions.
    pub(crate) out: &'a Path,
    /// All windows.
    pub(crate) set: &'a WindowSet<'a>,
    /// Those that are scored.
    pub(crate) ids: &'a [WindowId],
    /// How the windows were parted.
    pub(crate) split: String,
    /// The recordings.
    pub(crate) data: &'a DataState,
    /// Of the run that the model comes from.
    pub(crate) config: &'a RunConfig,
}

/// Scores a run on its test part.
///
/// # Errors
/// When the model does not fit the windows or a file cannot be written.
pub(crate) fn run(session: &Session) -> Result<()> {
    let set = session.windows()?;
    let split = Split::load(&set, &session.folder.path("split.json"))?;
    let scoring = Scoring {
        model: session.folder.root(),
        out: session.folder.root(),
        set: &set,
        ids: split.subset(session.config.evaluate.part),
        split: format!(
            "{}{}{}",
            kinds(split.kinds()),
            fold(&session.config.split),
            remarks(&split, session.config.evaluate.part)
        ),
        data: &session.folder.state.data,
        config: &session.config,
    };
    score(&scoring, session)
}

/// Which fold is the test part; nothing where there is one split.
pub(crate) fn fold(split: &SplitConfig) -> String {
    if split.folds == 1 { String::new() } else { format!(", fold {} of {}", split.fold, split.folds) }
}

/// What must be said of a split wherever its scores stand: that it leaks, or that it is not the test
/// part that was scored.
pub(crate) fn remarks(split: &Split, part: Subset) -> String {
    let leaks = if split.leaks() { " (leaks)" } else { "" };
    let part = if part == Subset::Test { String::new() } else { format!(" ({} part)", part.name()) };
    format!("{leaks}{part}")
}

/// Scores and predicts; writes `metrics.json`, `differences.json`, `metrics.md` and `predictions.parquet`.
///
/// # Errors
/// As [`run`].
pub(crate) fn score(scoring: &Scoring<'_>, session: &Session) -> Result<()> {
    let terminal = session.terminal();
    let config = scoring.config;
    let neighbours = config.predict.neighbours.without_future();
    let gnp = Gnp::load(scoring.model, neighbours, &session.machine.device)?.selecting(config.predict.selection);
    let (goal_head, oracle) = (gnp.goal_head(), gnp.oracle());
    let (velocity, acceleration) = (ConstantVelocity::default(), ConstantAcceleration::default());
    let (kalman, idm) = (Kalman::default(), Idm::default());
    let models = [
        EvaluatedModel::Predictor(&gnp),
        EvaluatedModel::Predictor(&goal_head),
        EvaluatedModel::Predictor(&velocity),
        EvaluatedModel::Predictor(&acceleration),
        EvaluatedModel::Predictor(&kalman),
        EvaluatedModel::Predictor(&idm),
    ];
    let mut evaluation = evaluated(scoring, &models, &config.evaluate, terminal)?;
    let uses_future: Vec<_> = config.evaluate.protocols.iter().copied().filter(|p| p.allows_future()).collect();
    if config.predict.neighbours.uses_future() && !uses_future.is_empty() {
        let informed = EvalConfig { protocols: uses_future, ..config.evaluate.clone() };
        evaluation = evaluation.joined(evaluated(scoring, &[EvaluatedModel::Oracle(&oracle)], &informed, terminal)?)?;
    }
    let bootstrap = &config.evaluate.bootstrap;
    let scores = evaluation.scores(bootstrap);
    let differences = evaluation.comparisons(gnp.name(), bootstrap)?;
    predictions(scoring, gnp.explaining(true), terminal)?;
    save_scores(&scoring.out.join("metrics.json"), &scores)?;
    save_comparisons(&scoring.out.join("differences.json"), &differences)?;
    let tables = tables(&scores, &TableHead { split: scoring.split.clone(), rate_hz: scoring.set.shape().rate_hz });
    let mut markdown = heading(scoring);
    terminal.result(&format!("\nScored on {}", scoring.data.words));
    for table in &tables {
        if !table.detail {
            terminal.result(&format!("\n{}", table.terminal()));
        }
        let _ = write!(markdown, "\n{}\n", table.markdown().trim_end());
    }
    write(&scoring.out.join("metrics.md"), markdown.as_bytes())
}

fn heading(scoring: &Scoring<'_>) -> String {
    let RunConfig { seed, predict, evaluate, .. } = scoring.config;
    format!(
        "# Scores\n\nOn {}. Seed {seed}; neighbours in the future: `{}`. Lengths in m. Intervals: middle 95 % of {} \
         draws of vehicles with replacement. Top-1 and best of k are different quantities.\n",
        scoring.data.words,
        predict.neighbours.name(),
        evaluate.bootstrap.resamples
    )
}

fn evaluated(
    scoring: &Scoring<'_>,
    models: &[EvaluatedModel<'_>],
    config: &EvalConfig,
    terminal: &Terminal,
) -> Result<Evaluation> {
    let mut work = None;
    let evaluation = evaluate(scoring.set, scoring.ids, models, config, &mut |batch| {
        let work = work.get_or_insert_with(|| terminal.work("evaluate", batch.total as u64, "forecasts"));
        work.at(batch.done as u64, batch.model);
        if STOP.load(std::sync::atomic::Ordering::SeqCst) { Err(EvalError::Stopped) } else { Ok(()) }
    });
    match evaluation {
        Err(EvalError::Stopped) => Err(Interrupted.into()),
        other => Ok(other?),
    }
}

/// Writes forecasts of the model with their forces.
fn predictions(scoring: &Scoring<'_>, gnp: Gnp, terminal: &Terminal) -> Result<()> {
    let provenance = Provenance {
        model: gnp.name().to_owned(),
        dataset: scoring.config.dataset,
        rate_hz: scoring.set.shape().rate_hz,
        simulated: scoring.data.simulated,
        uses_future: false,
    };
    let mut writer = PredictionWriter::create(&scoring.out.join("predictions.parquet"), &provenance)?;
    let work = terminal.work("predictions", scoring.ids.len() as u64, "windows");
    let mut done = 0;
    for ids in scoring.ids.chunks(scoring.config.evaluate.batch) {
        stop::check()?;
        let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| scoring.set.get(*id)).collect();
        let seen: Vec<_> = windows.iter().map(Window::observation).collect();
        let forecasts = gnp.predict(&seen, scoring.config.predict.k).map_err(|error| anyhow!(error))?;
        for (seen, forecast) in seen.iter().zip(&forecasts) {
            writer.write(&seen.key(), seen.origin(), forecast)?;
        }
        done += ids.len() as u64;
        work.at(done, "");
    }
    Ok(writer.finish()?)
}
