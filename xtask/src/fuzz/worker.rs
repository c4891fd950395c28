//! The process that tries inputs at random, watched by a thread of its own and by its parent.

use std::convert::Infallible;
use std::fs::File;
use std::io::{Seek as _, Write as _};
use std::path::Path;
use std::process::{Command, ExitStatus, exit};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use gnp_fuzz::{Limits, Scratch, Target};

use super::{Found, Job, LONGEST_S, MOST_MB, Report, SECONDS};
use crate::cli::FuzzArgs;
use crate::process::own_file;

/// Files by which the process tells its parent: the input that is being tried, behind its length; executions; and what is
/// wrong: numbered with the inputs that show it, without a number where the process could not go on.
const CURRENT: &str = "current";
const DONE: &str = "done";
const INPUT: &str = "input-";
const WHAT: &str = "what-";

/// How often the watching thread looks.
const LOOK: Duration = Duration::from_millis(10);

/// Executions so far, and tries of any kind.
static EXECUTIONS: AtomicU64 = AtomicU64::new(0);
static TRIES: AtomicU64 = AtomicU64::new(0);

/// This program as worker on a target.
pub(super) fn command(target: &Target, folder: &Path, args: &FuzzArgs) -> Result<Command> {
    let mut command = Command::new(own_file()?);
    command.args(["fuzz", "--target", target.name, "--seed", &args.seed.to_string(), "--worker"]).arg(folder);
    match args.executions {
        Some(executions) => command.args(["--executions", &executions.to_string()]),
        None => command.args(["--seconds", &args.seconds.unwrap_or(SECONDS).to_string()]),
    };
    Ok(command)
}

/// Tries inputs until a limit, leaves word of what was found in `folder`, and ends the process.
///
/// # Errors
/// When the corpus or the files of the folder cannot be had.
pub(super) fn run(target: &Target, folder: &Path, args: &FuzzArgs) -> Result<Infallible> {
    // What is done in parallel is done here: handing it to another thread and back takes longer than doing it.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().context("cannot make a pool of threads")?;
    let scratch = Scratch::within(folder)?;
    let corpus = target.corpus(&scratch)?;
    let current = File::create(folder.join(CURRENT)).context("cannot make a file")?;
    let time = args.seconds.map(Duration::from_secs);
    let limits = Limits { executions: args.executions, time, seed: args.seed };
    watch(folder.to_owned());
    let outcome = gnp_fuzz::run(target, &scratch, &corpus, &limits, &mut |done, input| {
        // Not written: then the parent names the input before.
        let _ = put(&current, input);
        EXECUTIONS.store(done, Ordering::Relaxed);
        TRIES.fetch_add(1, Ordering::Relaxed);
    });
    for (number, failure) in outcome.failures.iter().enumerate() {
        std::fs::write(folder.join(format!("{INPUT}{number}")), &failure.input)?;
        std::fs::write(folder.join(format!("{WHAT}{number}")), &failure.what)?;
    }
    EXECUTIONS.store(outcome.executions, Ordering::Relaxed);
    std::fs::write(folder.join(DONE), outcome.executions.to_string())?;
    exit(i32::from(!outcome.failures.is_empty()));
}

/// Writes an input behind its length, at the beginning of the file.
fn put(mut file: &File, input: &[u8]) -> std::io::Result<()> {
    file.rewind()?;
    file.write_all(&[&(input.len() as u64).to_le_bytes(), input].concat())
}

/// Ends the process when an input takes too long or too much memory, and writes now and then how far it is.
fn watch(folder: std::path::PathBuf) {
    spawn(move || {
        let (mut seen, mut since) = (0, Instant::now());
        let mut written = Instant::now();
        loop {
            sleep(LOOK);
            let tries = TRIES.load(Ordering::Relaxed);
            if tries != seen {
                (seen, since) = (tries, Instant::now());
            }
            let end = |what: String| {
                let _ = std::fs::write(folder.join(WHAT), what);
                let _ = std::fs::write(folder.join(DONE), EXECUTIONS.load(Ordering::Relaxed).to_string());
                exit(1);
            };
            if tries > 0 && since.elapsed() > Duration::from_secs(LONGEST_S) {
                end(format!("takes longer than {LONGEST_S} s"));
            }
            if let Some(megabytes) = peak_megabytes().filter(|peak| *peak > MOST_MB) {
                end(format!("takes more than {MOST_MB} MB of memory ({megabytes} MB)"));
            }
            if written.elapsed() > Duration::from_millis(500) {
                written = Instant::now();
                let _ = std::fs::write(folder.join(DONE), EXECUTIONS.load(Ordering::Relaxed).to_string());
            }
        }
    });
}

/// The most memory that this process ever had, where the system tells (Linux).
fn peak_megabytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = peak.trim().strip_suffix(" kB")?.trim().parse().ok()?;
    Some(kilobytes / 1024)
}

/// Executions as the process last wrote.
pub(super) fn executions(job: &Job) -> u64 {
    let text = std::fs::read_to_string(job.folder.path().join(DONE)).unwrap_or_default();
    text.parse().unwrap_or(0)
}

/// What an ended process has left.
///
/// # Errors
/// When it ended by itself without a word of a failure.
pub(super) fn report(job: &Job, status: ExitStatus) -> Result<Report> {
    let executions = executions(job);
    let file = |name: &str| std::fs::read(job.folder.path().join(name)).ok();
    let text = |name: &str| file(name).map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let numbered =
        (0..).map_while(|number| Some((text(&format!("{WHAT}{number}"))?, file(&format!("{INPUT}{number}")))));
    let mut failures: Vec<Found> = numbered.map(|(what, input)| Found { what, input }).collect();
    if !status.success() && failures.is_empty() {
        let what = text(WHAT);
        if what.is_none() && status.code().is_some() {
            bail!("the process on {} failed ({status}); see its message above", job.target.name);
        }
        // A signal ends it without a word: the input is the one that was being tried.
        let what = what.unwrap_or_else(|| format!("ends the process ({status})"));
        let current = file(CURRENT).unwrap_or_default();
        let input = current.split_first_chunk().and_then(|(length, rest)| {
            rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?).map(<[u8]>::to_vec)
        });
        failures.push(Found { what, input });
    }
    Ok(Report { executions, failures })
}
