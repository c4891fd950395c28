//! The main job, stage by stage, on a run folder.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use gnp_data::Recording;
use gnp_model::Component;

use crate::cli::{MachineArgs, RunArgs, StageArgs};
use crate::config::RunConfig;
use crate::run_folder::{Draft, RunFolder, RunState, Stage, occupied, write, write_state};
use crate::session::{Machine, Session};
use crate::stop::Interrupted;
use crate::terminal::duration;
use crate::{evaluate, ingest, memory, modes, project, source, training};

/// How a pipeline goes on.
const RESUME: &str = "cargo xtask pipeline --resume --out RUN";

/// `pipeline`: everything that is not finished yet.
///
/// # Errors
/// The first stage's that fails.
pub(crate) fn run(run: &RunArgs, machine: &MachineArgs) -> Result<()> {
    let started = Instant::now();
    let mut session = begin(run, Machine::start(machine)?, true)?;
    for stage in Stage::ALL {
        perform(&mut session, stage, RESUME)?;
    }
    let root = session.folder.root().display();
    session.terminal().note(&format!(
        "done in {}, peak memory {}: {root}\n  scores: {root}/metrics.md; curves: tensorboard --logdir {root}/events",
        duration(started.elapsed()),
        memory::peak_text()
    ));
    Ok(())
}

/// `ingest`: starts a run folder.
///
/// # Errors
/// What is wrong with the recordings.
pub(crate) fn ingest_only(run: &RunArgs, machine: &MachineArgs) -> Result<()> {
    let session = begin(run, Machine::start(machine)?, false)?;
    let root = session.folder.root().display();
    session.terminal().note(&format!("{root} is ready; next: cargo xtask modes --run {root}"));
    Ok(())
}

/// A stage command on an existing run folder.
///
/// # Errors
/// When an earlier stage is missing, or the stage fails.
pub(crate) fn one_stage(args: &StageArgs, stage: Stage) -> Result<()> {
    let folder = RunFolder::open(&args.run)?;
    let config = RunConfig::read(&folder.path("config.toml"), &[])?;
    let mut session = Session::new(folder, config, Machine::start(&args.machine)?);
    say_data(&session);
    if args.again {
        session.folder.forget(stage)?;
    }
    perform(&mut session, stage, RESUME)
}

/// Opens the run folder that the command line names, or starts it with ingest; with `part` also the
/// split, so that recordings that cannot be split leave nothing behind.
fn begin(run: &RunArgs, machine: Machine, part: bool) -> Result<Session> {
    let resumed = match &run.out {
        Some(out) if run.resume && occupied(out)? => Some(out.clone()),
        _ => None,
    };
    if let Some(root) = resumed {
        return resume(run, machine, &root);
    }
    if run.resume && run.out.is_none() {
        let (_, name) = RunConfig::resolve(run)?;
        let root = default_out(&name);
        if occupied(&root)? {
            return resume(run, machine, &root);
        }
    }
    let (config, name) = RunConfig::resolve(run)?;
    let root = run.out.clone().unwrap_or_else(|| default_out(&name));
    start(run, config, machine, &root, part)
}

pub(crate) fn default_out(name: &str) -> PathBuf {
    project::root().join("runs").join(name)
}

fn resume(run: &RunArgs, machine: Machine, root: &Path) -> Result<Session> {
    let folder = RunFolder::open(root)?;
    let config = RunConfig::read(&folder.path("config.toml"), &[])?;
    if run.config.is_some() || !run.set.is_empty() || run.dataset.is_some_and(|name| config.dataset != name.into()) {
        let (asked, _) = RunConfig::resolve(run)?;
        asked.expect_same(&config, root)?;
    }
    if let Some(dir) = &run.data_dir
        && *dir != folder.state.data.dir
    {
        let then = folder.state.data.dir.display();
        bail!("{} was made from {then}; resume without --data-dir, or take another --out", root.display());
    }
    let session = Session::new(folder, config, machine);
    say_data(&session);
    Ok(session)
}

/// Ingests into a new run folder, which appears when everything is read.
fn start(run: &RunArgs, config: RunConfig, machine: Machine, root: &Path, part: bool) -> Result<Session> {
    let draft = Draft::start(root, "go on with it by --resume, or take another --out")?;
    let found = source::find(&config, run.data_dir.as_deref())?;
    let terminal = &machine.terminal;
    terminal.result(&format!("Data: {}", found.data.words));
    let started = Instant::now();
    let filled = || -> Result<(RunState, Option<Vec<Recording>>)> {
        let report = ingest::run(found, &config, draft.path(), terminal)?;
        write(&draft.path().join("config.toml"), config.to_toml()?.as_bytes())?;
        // Only the split needs all recordings at once.
        let recordings = if part { Some(report.load(draft.path(), terminal)?) } else { None };
        let mut state = RunState::new(config.seed, report.data);
        if let Some(recordings) = &recordings {
            state.split_hash = modes::part(recordings, &config, draft.path(), terminal)?;
        }
        Ok((state, recordings))
    };
    let (state, recordings) = filled()
        .map_err(|error| if error.is::<Interrupted>() { error.context("nothing was written") } else { error })?;
    write_state(draft.path(), &state)?;
    let mut folder = RunFolder::open(&draft.publish()?)?;
    folder.finish(Stage::Ingest, started.elapsed().as_secs_f64())?;
    Ok(Session::new(folder, config, machine).with_recordings(recordings))
}

fn say_data(session: &Session) {
    session.terminal().result(&format!("Data: {}", session.folder.state.data.words));
}

/// A trained model in the run folder that `run` names, from where an earlier start of it stopped.
/// `resume` is the command that goes on after an interruption.
///
/// # Errors
/// As [`run`].
pub(crate) fn trained(run: &RunArgs, machine: Machine, resume: &str) -> Result<Session> {
    let mut session = begin(&RunArgs { resume: true, ..run.clone() }, machine, true)?;
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Evaluate) {
        perform(&mut session, stage, resume)?;
    }
    Ok(session)
}

/// Does a stage unless it is finished. `resume` is the command that goes on after an interruption;
/// `RUN` in it stands for the folder.
pub(crate) fn perform(session: &mut Session, stage: Stage, resume: &str) -> Result<()> {
    let name = stage.name();
    if session.folder.has(stage) {
        if stage != Stage::Ingest {
            session.terminal().note(&format!("{name}: finished before"));
        }
        return Ok(());
    }
    session.folder.require(stage)?;
    let started = Instant::now();
    let root = session.folder.root().display().to_string();
    let done = match stage {
        Stage::Ingest => bail!("{root} has no recordings; start a new run with `cargo xtask ingest`"),
        Stage::Modes => modes::run(session),
        Stage::Goal => training::run(session, Component::Goal),
        Stage::Attraction => training::run(session, Component::Attraction),
        Stage::Repulsion => training::run(session, Component::Repulsion),
        Stage::Evaluate => evaluate::run(session),
    };
    done.map_err(|error| {
        if error.is::<Interrupted>() {
            error.context(format!("what is done is kept; go on with `{}`", resume.replace("RUN", &root)))
        } else {
            error.context(format!("{name} failed"))
        }
    })?;
    session.folder.finish(stage, started.elapsed().as_secs_f64())
}
