//! Fuzzing: a process for each target, so that what ends or stops one is seen from outside.

mod libfuzzer;
mod worker;

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail};
use gnp::{Progress as _, Work};
use gnp_cli::Terminal;
use gnp_fuzz::{Scratch, TARGETS, Target, catch_panics, execute};
use tempfile::TempDir;

use crate::cli::FuzzArgs;
use crate::project;

/// Time for each target where nothing else is asked for, s.
const SECONDS: u64 = 60;

/// An execution may take so long, s.
const LONGEST_S: u64 = 10;

/// Memory that a process may take, MB.
const MOST_MB: u64 = 700;

/// Characters that are shown of what is wrong; `--replay` shows all.
const SHOWN: usize = 600;

/// Where failures and libFuzzer's corpus are kept, below the workspace.
const KEPT: &str = "runs/fuzz";

/// Runs what the command line asks for.
///
/// # Errors
/// When something is found, a target is not known, or a process cannot be started.
pub(crate) fn run(args: &FuzzArgs, terminal: &Terminal) -> Result<()> {
    let targets = chosen(&args.targets)?;
    match (&args.replay, &args.worker, &targets[..]) {
        (Some(file), _, [target]) => replay(target, file, terminal),
        (_, Some(folder), [target]) => worker::run(target, folder, args).map(|never| match never {}),
        (Some(_), ..) | (_, Some(_), _) => bail!("give one --target"),
        _ => all(&targets, args, terminal),
    }
}

/// Seconds of each target in CI.
pub(crate) const SECONDS_IN_CI: u64 = 30;

/// Every target for [`SECONDS_IN_CI`], two at a time.
///
/// # Errors
/// As [`run`].
pub(crate) fn short(seed: u64, terminal: &Terminal) -> Result<()> {
    let jobs = NonZeroUsize::MIN.saturating_add(1);
    let targets = Vec::new();
    let seconds = Some(SECONDS_IN_CI);
    let args = FuzzArgs { targets, executions: None, seconds, jobs, seed, coverage: false, replay: None, worker: None };
    run(&args, terminal)
}

fn chosen(names: &[String]) -> Result<Vec<&'static Target>> {
    if names.is_empty() {
        return Ok(TARGETS.iter().collect());
    }
    let known = || TARGETS.iter().map(|target| target.name).collect::<Vec<_>>().join(", ");
    let find = |name: &String| Target::named(name).ok_or_else(|| anyhow!("no target `{name}`; there are {}", known()));
    names.iter().map(find).collect()
}

/// What `--target` takes, for `--help`.
pub(crate) fn targets_help() -> String {
    let list: String = TARGETS.iter().map(|target| format!("\n- {}: {}", target.name, target.about)).collect();
    format!("A target; several may be given [default: all]:{list}")
}

fn replay(target: &Target, file: &Path, terminal: &Terminal) -> Result<()> {
    let input = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    catch_panics();
    match execute(target, &Scratch::new()?, &input) {
        Ok(()) => {
            terminal.result(&format!("{}: nothing wrong with {}", target.name, file.display()));
            Ok(())
        }
        Err(what) => bail!("{}: {what}", target.name),
    }
}

/// A target that is being worked on.
struct Job {
    target: &'static Target,
    folder: TempDir,
    child: Child,
    started: Instant,
    shown: Box<dyn Work>,
}

/// What a process has done, and what it found.
struct Report {
    executions: u64,
    failures: Vec<Found>,
}

/// An input with which something goes wrong.
struct Found {
    what: String,
    /// None where the process left none.
    input: Option<Vec<u8>>,
}

fn all(targets: &[&'static Target], args: &FuzzArgs, terminal: &Terminal) -> Result<()> {
    let kept = project::root().join(KEPT);
    std::fs::create_dir_all(&kept).with_context(|| format!("cannot make the folder {}", kept.display()))?;
    let program = if args.coverage { Some(libfuzzer::build(terminal)?) } else { None };
    let mut waiting = targets.iter();
    let mut jobs: Vec<Job> = Vec::new();
    let mut failed = Vec::new();
    loop {
        while jobs.len() < args.jobs.get()
            && let Some(target) = waiting.next()
        {
            jobs.push(start(target, program.as_deref(), args, terminal)?);
        }
        if jobs.is_empty() {
            break;
        }
        sleep(Duration::from_millis(100));
        let mut running = Vec::new();
        for mut job in jobs {
            let Some(status) = job.child.try_wait().context("cannot wait for a process")? else {
                job.show(args);
                running.push(job);
                continue;
            };
            let report = if args.coverage { libfuzzer::report(&job, status) } else { worker::report(&job, status) }?;
            let seconds = job.started.elapsed().as_secs_f64();
            terminal.result(&format!(
                "{:14} {:>9} executions in {seconds:.0} s, {:.0}/s",
                job.target.name,
                report.executions,
                report.executions as f64 / seconds
            ));
            for found in &report.failures {
                tell(job.target, found, &kept, terminal)?;
            }
            if !report.failures.is_empty() {
                failed.push(job.target.name);
            }
        }
        jobs = running;
    }
    if failed.is_empty() { Ok(()) } else { bail!("fuzz: something is wrong with {}", failed.join(", ")) }
}

fn start(target: &'static Target, program: Option<&Path>, args: &FuzzArgs, terminal: &Terminal) -> Result<Job> {
    let folder = tempfile::tempdir_in(Scratch::place()).context("cannot make a folder for the files of cases")?;
    let mut command = match program {
        Some(program) => libfuzzer::command(program, target, folder.path(), args)?,
        None => worker::command(target, folder.path(), args)?,
    };
    // One thread each: what is tried is small.
    for threads in ["RAYON_NUM_THREADS", "POLARS_MAX_THREADS", "OMP_NUM_THREADS"] {
        command.env(threads, "1");
    }
    let child = command.spawn().context("cannot start a process")?;
    let (total, unit) = match args.executions {
        Some(executions) => (executions, "executions"),
        None => (args.seconds.unwrap_or(SECONDS), "s"),
    };
    let shown = terminal.start(target.name, 0, total, unit);
    Ok(Job { target, folder, child, started: Instant::now(), shown })
}

impl Job {
    fn show(&self, args: &FuzzArgs) {
        let done = if args.coverage { libfuzzer::executions(self) } else { worker::executions(self) };
        match args.executions {
            Some(_) => self.shown.at(done, ""),
            None => self.shown.at(self.started.elapsed().as_secs(), &format!("{done} executions")),
        }
    }
}

/// Keeps the input and says how to see it again.
fn tell(target: &Target, found: &Found, kept: &Path, terminal: &Terminal) -> Result<()> {
    let shown: String = found.what.chars().take(SHOWN).collect();
    terminal.result(&format!("{}: {shown}", target.name));
    let Some(input) = &found.input else { return Ok(()) };
    let file = kept.join(file_name(target, input));
    gnp_file::save(&file, input).with_context(|| format!("cannot write {}", file.display()))?;
    let shown = file.strip_prefix(project::root()).unwrap_or(&file);
    terminal.result(&format!("again: cargo xtask fuzz --target {} --replay {}", target.name, shown.display()));
    Ok(())
}

/// The same input has the same name.
fn file_name(target: &Target, input: &[u8]) -> PathBuf {
    let mut hasher = DefaultHasher::new();
    input.hash(&mut hasher);
    format!("{}-{:016x}", target.name, hasher.finish()).into()
}
