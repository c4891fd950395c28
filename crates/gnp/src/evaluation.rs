//! Scores: of a run on its own windows, on other recordings, and of anybody's predictions. All are made by one
//! driver: systems go in; scores, differences and tables come out.

pub(crate) mod faithfulness;
mod predictions;
mod recordings;
pub(crate) mod rules;
pub(crate) mod systems;

use std::fmt::Write as _;
use std::path::Path;

use gnp_baselines::{RULES, Rule};
use gnp_data::{Predictor as _, Split, SplitConfig, Subset, Window, WindowId, WindowSet};
use gnp_eval::{
    Batch, Bootstrap, Comparison, EvalConfig, EvalError, EvaluatedModel, Evaluation, PredictionWriter, Protocol,
    Provenance, Score, Spreads, Summary, SummaryModels, Table, TableHead, comparison_tables, csv, load_comparisons,
    load_scores, save_comparisons, save_scores, tables,
};

use self::faithfulness::{Faithfulness, Measured};
pub use self::predictions::{PredictionsOn, score_predictions};
pub use self::recordings::score_recordings;
use self::systems::System;
use crate::config::RunConfig;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::progress::Progress;
use crate::run::Run;
use crate::run::folder::{DataState, Stage, write, write_json};
use crate::stages::kinds;

/// Windows to score on.
pub(crate) struct Material<'a> {
    /// All windows.
    pub(crate) set: &'a WindowSet<'a>,
    /// Those that are scored.
    pub(crate) ids: &'a [WindowId],
    /// Others, perhaps of other recordings, that say how wide the forecasts of a system are; without them no densities
    /// are scored.
    pub(crate) fitting: Option<(&'a WindowSet<'a>, &'a [WindowId])>,
    /// How the windows were parted.
    pub(crate) split: String,
    /// The recordings.
    pub(crate) data: &'a DataState,
}

/// The windows of a split to which densities are fitted: the validation part, unless that is scored itself.
pub(crate) fn fitting<'a>(
    set: &'a WindowSet<'a>,
    split: &'a Split,
    scored: Subset,
) -> Option<(&'a WindowSet<'a>, &'a [WindowId])> {
    let there = scored != Subset::Validation && !split.validation().is_empty();
    there.then(|| (set, split.validation()))
}

/// What systems got on the same windows.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Scores {
    /// Every metric of every system, site and protocol.
    pub scores: Vec<Score>,
    /// One system against each other one, on the same windows.
    pub differences: Vec<Comparison>,
    /// Whether explanations are true, of the systems that explain themselves.
    pub faithfulness: Vec<Faithfulness>,
    /// All of it for people.
    pub tables: Vec<Table>,
}

impl Scores {
    /// The scores of an evaluation, the differences between `ours` and each other system, and what was measured of
    /// explanations.
    pub(crate) fn of(
        evaluation: &Evaluation,
        faithfulness: &Measured,
        ours: &str,
        split: String,
        bootstrap: &Bootstrap,
    ) -> Result<Self> {
        let scores = evaluation.scores(bootstrap);
        let differences = evaluation.comparisons(ours, bootstrap)?;
        let head = TableHead { split, rate_hz: evaluation.setting().rate_hz };
        Ok(Self::new(scores, differences, faithfulness.rows(bootstrap), &head))
    }

    /// Shows the tables that a terminal has room for.
    pub fn show(&self, progress: &dyn Progress) {
        for table in self.tables.iter().filter(|table| !table.detail) {
            progress.result(&format!("\n{}", table.terminal()));
        }
    }

    /// One sentence and one short table: the model, constant velocity and the best rule, by site. `None` where the
    /// model was not scored under the protocol `clean`.
    #[must_use]
    pub fn summary(&self) -> Option<Summary> {
        let model = self.differences.first().map(|difference| difference.a.as_str())?;
        let label = if model.starts_with("gnp") { model.replacen("gnp", "GNP", 1) } else { model.to_owned() };
        let names: Vec<&str> = RULES.iter().map(Rule::name).collect();
        let models = SummaryModels { model, label: &label, reference: rules::CONSTANT_VELOCITY, rules: &names };
        Summary::of(&self.scores, &self.differences, &models)
    }

    fn new(
        scores: Vec<Score>,
        differences: Vec<Comparison>,
        faithfulness: Vec<Faithfulness>,
        head: &TableHead,
    ) -> Self {
        let mut tables = tables(&scores, head);
        tables.extend(faithfulness::table(&faithfulness, head));
        tables.extend(comparison_tables(&differences, head));
        Self { scores, differences, faithfulness, tables }
    }

    /// All tables under a heading.
    pub(crate) fn markdown(&self, heading: &str) -> String {
        let mut text = heading.to_owned();
        for table in &self.tables {
            let _ = write!(text, "\n{}\n", table.markdown().trim_end());
        }
        text
    }

    /// Writes `metrics.json`, `differences.json`, `metrics.csv`, `metrics.md`, and `faithfulness.json` where a system
    /// explains itself.
    fn save(&self, folder: &Path, heading: &str) -> Result<()> {
        save_scores(&folder.join("metrics.json"), &self.scores)?;
        save_comparisons(&folder.join("differences.json"), &self.differences)?;
        if !self.faithfulness.is_empty() {
            write_json(&folder.join(faithfulness::FILE), &self.faithfulness)?;
        }
        self.save_tables(folder, heading)
    }

    /// Writes `metrics.csv` and `metrics.md`.
    fn save_tables(&self, folder: &Path, heading: &str) -> Result<()> {
        write(&folder.join("metrics.csv"), csv(&self.tables).as_bytes())?;
        write(&folder.join("metrics.md"), self.markdown(heading).as_bytes())
    }
}

/// Scores systems on the same windows: those that are handed recorded futures only under the protocols that
/// allow it. The densities of the others are fitted first, where there are windows for that.
///
/// # Errors
/// When a system fails; [`Error::Stopped`].
pub(crate) fn evaluate(
    material: &Material<'_>,
    systems: &[System],
    config: &EvalConfig,
    machine: &Machine,
) -> Result<Evaluation> {
    let run = |models: &[EvaluatedModel<'_>], config: &EvalConfig| -> Result<Evaluation> {
        let watch = &mut watching("evaluate", machine);
        stoppable(gnp_eval::evaluate(material.set, material.ids, models, config, watch))
    };
    let (oracles, blind): (Vec<&System>, Vec<&System>) = systems.iter().partition(|system| system.uses_future());
    let mut spreads = Vec::new();
    for system in &blind {
        spreads.push(fitted(material, system, config, machine)?);
    }
    let models: Vec<_> = blind.iter().zip(&spreads).map(|(system, spreads)| system.model(spreads.as_ref())).collect();
    let evaluation = run(&models, config)?;
    let allowing: Vec<_> = config.protocols.iter().copied().filter(|protocol| protocol.allows_future()).collect();
    if oracles.is_empty() || allowing.is_empty() {
        return Ok(evaluation);
    }
    let oracles: Vec<_> = oracles.iter().map(|system| system.model(None)).collect();
    Ok(evaluation.joined(run(&oracles, &EvalConfig { protocols: allowing, ..config.clone() })?)?)
}

/// How wide the forecasts of a system are; `None` where no density is asked for, or there are no windows to see it by.
fn fitted(material: &Material<'_>, system: &System, config: &EvalConfig, machine: &Machine) -> Result<Option<Spreads>> {
    let Some((set, ids)) = material.fitting.filter(|_| config.protocols.contains(&Protocol::Clean)) else {
        return Ok(None);
    };
    stoppable(Spreads::fit(set, ids, system, config.batch, &mut watching("densities", machine))).map(Some)
}

/// Shows how far an evaluation is, and ends it when it is to stop.
fn watching<'m>(
    label: &'static str,
    machine: &'m Machine,
) -> impl FnMut(&Batch<'_>) -> std::result::Result<(), EvalError> + 'm {
    let mut work = None;
    move |batch| {
        let work = work.get_or_insert_with(|| machine.work(label, batch.total, "forecasts"));
        work.at(batch.done as u64, batch.model);
        if machine.stop.is_requested() { Err(EvalError::Stopped) } else { Ok(()) }
    }
}

fn stoppable<T>(result: std::result::Result<T, EvalError>) -> Result<T> {
    match result {
        Err(EvalError::Stopped) => Err(Error::Stopped { kept: None }),
        other => Ok(other?),
    }
}

/// Scores a run on the windows of its split that its configuration names; returns the files that only some systems leave.
///
/// # Errors
/// When the model does not fit the windows or a file cannot be written.
pub(crate) fn own(run: &Run) -> Result<Vec<String>> {
    let set = run.windows()?;
    let split = run.split(&set)?;
    let (scored, data) = (run.config.evaluate.subset, &run.folder.state.data);
    let (ids, fitting) = (split.subset(scored), fitting(&set, &split, scored));
    let material = Material { set: &set, ids, fitting, split: split_description(run, &split), data };
    let scores = of_run(run, &material, run.path())?;
    Ok(if scores.faithfulness.is_empty() { Vec::new() } else { vec![faithfulness::FILE.to_owned()] })
}

impl Run {
    /// The scores of a finished run on its own windows, as they were written.
    ///
    /// # Errors
    /// When the run has no scores, or a file of them is damaged.
    pub fn scores(&self) -> Result<Scores> {
        self.folder.require(Stage::Report)?;
        let scores = load_scores(&self.folder.usable("metrics.json")?)?;
        let differences = load_comparisons(&self.folder.usable("differences.json")?)?;
        let set = self.windows()?;
        let head = TableHead { split: split_description(self, &self.split(&set)?), rate_hz: set.shape().rate_hz };
        Ok(Scores::new(scores, differences, faithfulness::load(&self.folder)?, &head))
    }

    /// Writes the tables of the scores anew.
    ///
    /// # Errors
    /// As [`Run::scores`]; when the folder cannot be written.
    pub(crate) fn rewrite_tables(&self) -> Result<()> {
        self.scores()?.save_tables(self.path(), &heading(&self.folder.state.data, &self.config))
    }
}

/// How the windows of a run were parted, and which of them are scored.
pub(crate) fn split_description(run: &Run, split: &Split) -> String {
    format!("{}{}{}", kinds(split.kinds()), fold(&run.config.split), remarks(split, run.config.evaluate.subset))
}

/// Which fold is the test part; nothing where there is one split.
pub(crate) fn fold(split: &SplitConfig) -> String {
    if split.folds == 1 { String::new() } else { format!(", fold {} of {}", split.fold, split.folds) }
}

/// What must be said of a split wherever its scores stand: that it leaks, or that it is not the test
/// part that was scored.
pub(crate) fn remarks(split: &Split, subset: Subset) -> String {
    let leaks = if split.leaks() { " (leaks)" } else { "" };
    let subset = if subset == Subset::Test { String::new() } else { format!(" ({} part)", subset.name()) };
    format!("{leaks}{subset}")
}

/// Scores a run's model, its goal head and the rules on some windows, and writes scores and predictions to `out`.
fn of_run(run: &Run, material: &Material<'_>, out: &Path) -> Result<Scores> {
    let config = &run.config;
    let gnp = run.model()?;
    let ours = gnp.name().to_owned();
    let mut systems = vec![System::gnp(&ours, gnp.clone()), System::predictor("goal head", gnp.goal_head())];
    systems.extend(rules::systems(run)?);
    if config.predict.neighbours.uses_future() {
        systems.push(System::oracle("gnp (oracle neighbours)", gnp.oracle()));
    }
    let evaluation = evaluate(material, &systems, &config.evaluate, &run.machine)?;
    let faithfulness = Measured::of_systems(material, &systems, &run.machine)?;
    let scores = Scores::of(&evaluation, &faithfulness, &ours, material.split.clone(), &config.evaluate.bootstrap)?;
    write_predictions(run, material, out)?;
    scores.save(out, &heading(material.data, config))?;
    Ok(scores)
}

fn heading(data: &DataState, config: &RunConfig) -> String {
    let RunConfig { seed, predict, evaluate, .. } = config;
    format!(
        "# Scores\n\nOn {}. Seed {seed}; neighbours in the future: `{}`. Lengths in m. Intervals of 95 % from {} \
         draws of drivers with replacement, and in square brackets, where there are 3 events or more, of events. Top-1 \
         and best of k are different quantities.\n",
        data.description,
        predict.neighbours.name(),
        evaluate.bootstrap.resamples
    )
}

/// Writes forecasts of the model with their forces to `predictions.parquet`.
fn write_predictions(run: &Run, material: &Material<'_>, out: &Path) -> Result<()> {
    let gnp = run.model()?.explaining(true);
    let provenance = Provenance {
        model: gnp.name().to_owned(),
        dataset: run.config.dataset,
        rate_hz: material.set.shape().rate_hz,
        simulated: material.data.simulated,
        uses_future: false,
    };
    let mut writer = PredictionWriter::create(&out.join("predictions.parquet"), &provenance)?;
    let work = run.machine.work("predictions", material.ids.len(), "windows");
    let mut done = 0;
    for ids in material.ids.chunks(run.config.evaluate.batch) {
        run.machine.stop.check()?;
        let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| material.set.get(*id)).collect();
        let seen: Vec<_> = windows.iter().map(Window::observation).collect();
        let forecasts = gnp.predict(&seen, run.config.predict.k)?;
        for (seen, forecast) in seen.iter().zip(&forecasts) {
            writer.write(&seen.key(), seen.origin(), forecast)?;
        }
        done += ids.len() as u64;
        work.at(done, "");
    }
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests;
