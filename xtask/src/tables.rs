//! `table1` and `table2`: every system trained where it is not yet, scored on the same windows.
//!
//! A table has a folder: `gnp/` is the run of the full model, `learned/` has the learned baselines,
//! `variants/` the runs of ablations. With a split into folds there is one such folder a fold,
//! `fold-1/` and so on, and every window is scored once, by models that were not trained on what is
//! kept together with it. What is trained there stays; a table that is started again with
//! `--resume` trains what is missing and scores everything anew.

mod learned;
mod printed;
mod report;
pub(crate) mod systems;
mod variants;

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use gnp_baselines::{ConstantAcceleration, ConstantVelocity, Idm, Kalman};
use gnp_data::{Split, Window, WindowSet};
use gnp_model::Gnp;
use gnp_neural_baselines::NeuralBaseline;

use crate::cli::{RunArgs, TableArgs};
use crate::config::{RunConfig, Setting};
use crate::pipeline;
use crate::project;
use crate::run_folder::occupied;
use crate::session::{Machine, Session};
use crate::stop::Interrupted;
use crate::tables::report::{Report, Scored, write_report};
use crate::tables::systems::System;
use crate::tables::variants::{FULL, VARIANTS};
use crate::terminal::Terminal;

/// Most windows of the training part that the Kalman filter's noise is fitted to.
const KALMAN_WINDOWS: usize = 2000;

/// `table1`: all systems.
///
/// # Errors
/// When a training or a score fails; [`Interrupted`].
pub(crate) fn table1(args: &TableArgs) -> Result<()> {
    let recipes =
        learned::read(&args.recipes.clone().unwrap_or_else(|| project::root().join("configs/neural-baselines.toml")))?;
    let kinds: Vec<NeuralBaseline> =
        NeuralBaseline::ALL.into_iter().filter(|kind| recipes.contains_key(kind.stem())).collect();
    let missing: Vec<String> = NeuralBaseline::ALL
        .into_iter()
        .filter(|kind| !kinds.contains(kind))
        .map(|kind| format!("{}: has no recipe ([{}])", kind.name(), kind.stem()))
        .collect();
    let table = Table::start("table1", args, 6 + kinds.len())?;
    let scored = table.scored(|fold| {
        let model = gnp(fold.session)?;
        let goal_head = System::predictor("goal head", model.goal_head());
        let mut systems = vec![System::predictor(FULL, model), goal_head];
        systems.extend(rules(fold.set, fold.split)?);
        for (done, kind) in kinds.iter().copied().enumerate() {
            fold.progress(7 + done, kind.name());
            let folder = fold.folder.join("learned");
            systems.push(learned::system(kind, &recipes[kind.stem()], fold, &folder)?);
        }
        Ok(systems)
    })?;
    let report = Report {
        stem: "table1",
        title: "Table 1: all systems on the same windows",
        about: "Every system was trained and scored here. Below stand the figures that the papers print, which rest \
                on other windows, other splits and in part on other quantities.",
        ours: FULL,
        missing: &missing,
        printed: printed::table1(scored.session.config.dataset),
    };
    write_report(&report, &scored, &table.folder)
}

/// `table2`: ablations.
///
/// # Errors
/// As [`table1`].
pub(crate) fn table2(args: &TableArgs) -> Result<()> {
    let table = Table::start("table2", args, VARIANTS.len())?;
    let scored = table.scored(|fold| {
        let session = fold.session;
        // As written: a session has the run's seed added to the parts' own.
        let config = RunConfig::read(&session.folder.path("config.toml"), &[])?;
        let mut systems = Vec::new();
        for (done, variant) in VARIANTS.iter().enumerate() {
            if variant.is_the_full_model(session.folder.root(), &config)? {
                continue;
            }
            let place = match variant.folder(&config) {
                None => session.folder.root().to_owned(),
                Some(name) => {
                    fold.progress(done + 1, variant.name);
                    let place = fold.folder.join("variants").join(name);
                    let (folder, changed) = variant.start(&session.folder, &config, &place)?;
                    let mut session = Session::new(folder, changed, session.machine.clone());
                    for stage in variant.redo {
                        pipeline::perform(&mut session, *stage, &table.resume)?;
                    }
                    place
                }
            };
            systems.push(variant.system(&place, &config, &session.machine.device)?);
        }
        Ok(systems)
    })?;
    let config = RunConfig::read(&scored.session.folder.path("config.toml"), &[])?;
    let mut missing = Vec::new();
    for variant in &VARIANTS {
        if variant.is_the_full_model(scored.session.folder.root(), &config)? {
            missing.push(format!("{}: the configuration is like that", variant.name));
        }
    }
    let report = Report {
        stem: "table2",
        title: "Table 2: what the parts of GNP do",
        about: "Each row changes one thing in the full model (first row, neighbours going straight on); parts that the \
                change does not reach are shared. *No modes* is a single mode, the mean future, hence one goal made \
                of the observation alone.",
        ours: FULL,
        missing: &missing,
        printed: printed::table2(scored.session.config.dataset),
    };
    write_report(&report, &scored, &table.folder)
}

/// A table being made.
struct Table {
    stem: &'static str,
    folder: PathBuf,
    run: RunArgs,
    machine: Machine,
    /// Folds of the split; each has its own models.
    folds: usize,
    /// Systems of a fold, for progress.
    total: usize,
    /// The command that goes on after an interruption.
    resume: String,
}

/// One fold of a table being made: what its systems are trained on.
pub(crate) struct Fold<'a> {
    /// The run of the full model.
    pub(crate) session: &'a Session,
    /// All windows.
    pub(crate) set: &'a WindowSet<'a>,
    /// Their parts.
    pub(crate) split: &'a Split,
    /// Where the models of this fold are kept.
    folder: PathBuf,
    table: &'a Table,
    /// From 1.
    number: usize,
}

impl Fold<'_> {
    fn progress(&self, number: usize, name: &str) {
        self.table.note(&self.table.machine.terminal, self.number, number, name);
    }
}

impl Table {
    /// Refuses a folder in use unless it is to be resumed.
    fn start(stem: &'static str, args: &TableArgs, total: usize) -> Result<Self> {
        let (config, name) = RunConfig::resolve(&args.run)?;
        let folder = args.run.out.clone().unwrap_or_else(|| pipeline::default_out(&format!("{stem}-{name}")));
        if !args.run.resume && occupied(&folder)? {
            bail!("{} exists and is not empty; go on with it by --resume, or take another --out", folder.display());
        }
        let dataset = args.run.dataset.map_or_else(String::new, |dataset| format!(" --dataset {}", dataset.as_str()));
        let resume = format!("cargo xtask {stem}{dataset} --resume --out {}", folder.display());
        let folds = config.split.folds;
        let table =
            Self { stem, folder, run: args.run.clone(), machine: Machine::start(&args.machine)?, folds, total, resume };
        if occupied(&table.folder)? && !occupied(&table.fold_folder(1).join("gnp"))? {
            bail!("{} is not the folder of a table; take another --out", table.folder.display());
        }
        Ok(table)
    }

    /// Where the models of a fold are kept.
    fn fold_folder(&self, fold: usize) -> PathBuf {
        if self.folds == 1 { self.folder.clone() } else { self.folder.join(format!("fold-{fold}")) }
    }

    /// Makes the systems of every fold and scores each on its fold's windows.
    fn scored(&self, systems: impl Fn(&Fold<'_>) -> Result<Vec<System>>) -> Result<Scored> {
        let mut scored: Option<Scored> = None;
        for number in 1..=self.folds {
            let of_fold = self.fold(number, &systems).map_err(|error| self.interrupted(error))?;
            scored = Some(match scored {
                None => of_fold,
                Some(earlier) => earlier.pooled(of_fold)?,
            });
        }
        scored.context("the split has no fold")
    }

    fn fold(&self, number: usize, systems: &impl Fn(&Fold<'_>) -> Result<Vec<System>>) -> Result<Scored> {
        self.note(&self.machine.terminal, number, 1, FULL);
        let folder = self.fold_folder(number);
        let mut run = RunArgs { out: Some(folder.join("gnp")), ..self.run.clone() };
        run.set.push(Setting { key: "split.fold".to_owned(), text: number.to_string() });
        let session = pipeline::trained(&run, self.machine.clone(), &self.resume)?;
        let set = session.windows()?;
        let split = Split::load(&set, &session.folder.path("split.json"))?;
        let fold = Fold { session: &session, set: &set, split: &split, folder, table: self, number };
        let systems = systems(&fold)?;
        let evaluate = &session.config.evaluate;
        let evaluation = systems::score(&set, split.subset(evaluate.part), &systems, evaluate, session.terminal())?;
        drop(set);
        Ok(Scored::new(&systems, evaluation, &split, session))
    }

    fn note(&self, terminal: &Terminal, fold: usize, number: usize, name: &str) {
        let fold = if self.folds == 1 { String::new() } else { format!("fold {fold} of {}, ", self.folds) };
        terminal.note(&format!("{}: {fold}{number} of {}, {name}", self.stem, self.total));
    }

    /// Says how to go on, where the user stopped the work.
    fn interrupted(&self, error: anyhow::Error) -> anyhow::Error {
        if error.is::<Interrupted>() {
            error.context(format!("what is done is kept; go on with `{}`", self.resume))
        } else {
            error
        }
    }
}

/// The trained model of a run.
fn gnp(session: &Session) -> Result<Gnp> {
    let neighbours = session.config.predict.neighbours.without_future();
    let gnp = Gnp::load(session.folder.root(), neighbours, &session.machine.device)?;
    Ok(gnp.selecting(session.config.predict.selection))
}

/// The predictors without a network; the filter's noise is that of the training part.
fn rules(set: &WindowSet<'_>, split: &Split) -> Result<Vec<System>> {
    let step = split.train().len().div_ceil(KALMAN_WINDOWS).max(1);
    let training: Vec<Window<'_>> = split.train().iter().step_by(step).filter_map(|id| set.get(*id)).collect();
    let kalman = Kalman::fit(&training).context("Kalman filter")?;
    Ok(vec![
        System::predictor("constant velocity", ConstantVelocity::default()),
        System::predictor("constant acceleration", ConstantAcceleration::default()),
        System::predictor("Kalman filter", kalman),
        System::predictor("IDM", Idm::default()),
    ])
}
