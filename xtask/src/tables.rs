//! `table1` and `table2`: every system trained where it is not yet, scored on the same windows.
//!
//! A table has a folder: `gnp/` is the run of the full model, `learned/` has the learned baselines,
//! `variants/` the runs of ablations. What is trained there stays; a table that is started again with
//! `--resume` trains what is missing and scores everything anew.

mod learned;
mod printed;
mod report;
pub(crate) mod systems;
mod variants;

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use gnp_baselines::{ConstantAcceleration, ConstantVelocity, Idm, Kalman};
use gnp_data::{Forecast, Observation, PredictError, Predictor, Split, Window, WindowSet};
use gnp_learned::LearnedKind;
use gnp_model::{Gnp, NeighbourFuture};

use crate::cli::{RunArgs, TableArgs};
use crate::config::RunConfig;
use crate::pipeline;
use crate::project;
use crate::run_folder::occupied;
use crate::session::{Machine, Session};
use crate::stop::Interrupted;
use crate::tables::report::{Report, write_report};
use crate::tables::systems::System;
use crate::tables::variants::{FULL, VARIANTS};

/// Most windows of the training part that the Kalman filter's noise is fitted to.
const KALMAN_WINDOWS: usize = 2000;

/// `table1`: all systems.
///
/// # Errors
/// When a training or a score fails; [`Interrupted`].
pub(crate) fn table1(args: &TableArgs) -> Result<()> {
    let recipes = learned::read(&args.recipes.clone().unwrap_or_else(|| project::root().join("configs/learned.toml")))?;
    let table = Table::start("table1", args)?;
    let kinds: Vec<LearnedKind> =
        LearnedKind::ALL.into_iter().filter(|kind| recipes.contains_key(kind.stem())).collect();
    let missing: Vec<String> = LearnedKind::ALL
        .into_iter()
        .filter(|kind| !kinds.contains(kind))
        .map(|kind| format!("{}: has no recipe ([{}])", kind.name(), kind.stem()))
        .collect();
    let total = 6 + kinds.len();
    let session = table.train("gnp", 1, total)?;
    let set = session.windows()?;
    let split = Split::load(&set, &session.folder.path("split.json"))?;
    let mut systems = vec![System::blind(FULL, gnp(&session)?), System::blind("goal head", GoalHead(gnp(&session)?))];
    systems.extend(rules(&set, &split)?);
    for (done, kind) in kinds.into_iter().enumerate() {
        table.progress(&session, 7 + done, total, kind.name());
        let recipe = &recipes[kind.stem()];
        let folder = table.folder.join("learned");
        systems.push(learned::system(kind, recipe, &session, &set, &split, &folder).map_err(|e| table.interrupted(e))?);
    }
    let report = Report {
        stem: "table1",
        title: "Table 1: all systems on the same windows",
        about: "Every system was trained and scored here. Below stand the figures that the papers print, which rest \
                on other windows, other splits and in part on other quantities.",
        ours: FULL,
        systems: &systems,
        missing: &missing,
        printed: printed::table1(session.config.dataset),
    };
    write_report(&report, &session, &set, &table.folder).map_err(|error| table.interrupted(error))
}

/// `table2`: ablations.
///
/// # Errors
/// As [`table1`].
pub(crate) fn table2(args: &TableArgs) -> Result<()> {
    let table = Table::start("table2", args)?;
    let session = table.train("gnp", 1, VARIANTS.len())?;
    // As written: a session has the run's seed added to the parts' own.
    let config = RunConfig::read(&session.folder.path("config.toml"), &[])?;
    let (mut systems, mut missing) = (Vec::new(), Vec::new());
    for (done, variant) in VARIANTS.iter().enumerate() {
        if variant.is_the_full_model(session.folder.root(), &config)? {
            missing.push(format!("{}: the configuration is like that", variant.name));
            continue;
        }
        let place = match variant.folder(&config) {
            None => session.folder.root().to_owned(),
            Some(name) => {
                table.progress(&session, done + 1, VARIANTS.len(), variant.name);
                let place = table.folder.join("variants").join(name);
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
    let set = session.windows()?;
    let report = Report {
        stem: "table2",
        title: "Table 2: what the parts of GNP do",
        about: "Each row changes one thing in the full model (first row, neighbours going straight on); parts that the \
                change does not reach are shared. *No modes* is a single mode, the mean future, hence one goal made \
                of the observation alone.",
        ours: FULL,
        systems: &systems,
        missing: &missing,
        printed: printed::table2(session.config.dataset),
    };
    write_report(&report, &session, &set, &table.folder).map_err(|error| table.interrupted(error))
}

/// A table being made.
struct Table {
    stem: &'static str,
    folder: PathBuf,
    run: RunArgs,
    machine: Machine,
    /// The command that goes on after an interruption.
    resume: String,
}

impl Table {
    /// Refuses a folder in use unless it is to be resumed.
    fn start(stem: &'static str, args: &TableArgs) -> Result<Self> {
        let (_, name) = RunConfig::resolve(&args.run)?;
        let folder = args.run.out.clone().unwrap_or_else(|| pipeline::default_out(&format!("{stem}-{name}")));
        if !args.run.resume && occupied(&folder)? {
            bail!("{} exists and is not empty; go on with it by --resume, or take another --out", folder.display());
        }
        let gnp = folder.join("gnp");
        if occupied(&folder)? && !occupied(&gnp)? {
            bail!("{} is not the folder of a table; take another --out", folder.display());
        }
        let dataset = args.run.dataset.map_or_else(String::new, |dataset| format!(" --dataset {}", dataset.as_str()));
        let resume = format!("cargo xtask {stem}{dataset} --resume --out {}", folder.display());
        let run = RunArgs { out: Some(gnp), ..args.run.clone() };
        Ok(Self { stem, folder, run, machine: Machine::start(&args.machine)?, resume })
    }

    /// The full model, trained unless it was before.
    fn train(&self, name: &str, number: usize, total: usize) -> Result<Session> {
        self.machine.terminal.note(&format!("{}: {number} of {total}, {name}", self.stem));
        pipeline::trained(&self.run, self.machine.clone(), &self.resume)
    }

    fn progress(&self, session: &Session, number: usize, total: usize, name: &str) {
        session.terminal().note(&format!("{}: {number} of {total}, {name}", self.stem));
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

/// The trained model of a run; neighbours go straight on where the run would be told their paths.
fn gnp(session: &Session) -> Result<Gnp> {
    let neighbours = match session.config.predict.neighbours {
        NeighbourFuture::Oracle => NeighbourFuture::ConstantVelocity,
        other => other,
    };
    let gnp = Gnp::load(session.folder.root(), neighbours, &session.machine.device)?;
    Ok(gnp.selecting(session.config.predict.selection))
}

/// The predictors without a network; the filter's noise is that of the training part.
fn rules(set: &WindowSet<'_>, split: &Split) -> Result<Vec<System>> {
    let step = split.train().len().div_ceil(KALMAN_WINDOWS).max(1);
    let training: Vec<Window<'_>> = split.train().iter().step_by(step).filter_map(|id| set.get(*id)).collect();
    let kalman = Kalman::fit(&training).context("Kalman filter")?;
    Ok(vec![
        System::blind("constant velocity", ConstantVelocity::default()),
        System::blind("constant acceleration", ConstantAcceleration::default()),
        System::blind("Kalman filter", kalman),
        System::blind("IDM", Idm::default()),
    ])
}

/// The goal network's own futures, whole.
struct GoalHead(Gnp);

impl Predictor for GoalHead {
    fn name(&self) -> &str {
        "goal head"
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        self.0.goal_head().predict(observations, k)
    }
}
