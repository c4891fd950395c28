//! Benchmarks: what our code needs, ratios that gate, a whole frame, and ours beside PyTorch and JAX.
//!
//! The criterion benchmarks of the crates (`cargo bench`) say how long each part takes. What is
//! compared is measured here, in one run and in turn, so that a busy machine slows both sides.

mod check;
mod clock;
mod floor;
mod frame;
mod gpu;
mod limits;
mod networks;
mod peer;
mod roofline;
mod speed;
mod traffic;
mod training;

use gnp_cli::Terminal;
use std::process::Command;
use std::thread::available_parallelism;

use anyhow::{Context as _, Result, bail};
use comfy_table::{CellAlignment, Table, presets};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::cli::BenchArgs;
use crate::process::own_file;
use crate::project;

pub(crate) use check::Profile;
pub(crate) use clock::Sample;

/// Where candle reads, at every product, how many threads it may use; a pool of fewer does not tell it,
/// and products that ask for more threads than there are take several times as long.
const THREADS: &str = "RAYON_NUM_THREADS";

/// Runs what the command line asks for.
///
/// # Errors
/// When a limit is missed, a reference program cannot be run, or a benchmark fails.
pub(crate) fn run(args: &BenchArgs, terminal: &Terminal) -> Result<()> {
    if args.gpu {
        return gpu::run(args.python.as_deref(), args.seconds, args.json, terminal);
    }
    if args.roofline {
        roofline::run(terminal);
        return Ok(());
    }
    let threads = args.threads.map_or(if args.frame { 1 } else { cores() }, usize::from);
    if std::env::var(THREADS).ok() != Some(threads.to_string()) {
        return again(threads);
    }
    if args.check {
        return check(if args.quick { Profile::Quick } else { Profile::Full }, terminal);
    }
    if args.frame {
        frame::run(threads, args.precision, terminal)
    } else {
        speed::run(&speed::Plan::new(threads, args), terminal)
    }
}

/// Starts this program anew with the number of threads in its environment, and what else the commands of `gnp` run with.
fn again(threads: usize) -> Result<()> {
    let mut command = Command::new(own_file()?);
    command.args(std::env::args_os().skip(1)).envs(gnp_cli::variables(threads));
    let status = command.status().context("cannot start this program anew")?;
    if !status.success() {
        bail!("the benchmark on {threads} thread(s) failed ({status}); see its message above");
    }
    Ok(())
}

/// Measures the ratios and holds them against `configs/bench.toml`.
///
/// # Errors
/// Names every limit that is missed.
pub(crate) fn check(profile: Profile, terminal: &Terminal) -> Result<()> {
    let path = project::root().join("configs/bench.toml");
    let rows = check::measure(&limits::Limits::read(&path)?, profile, terminal)?;
    let missed: Vec<&str> = rows.iter().filter(|row| !row.holds()).map(|row| row.what).collect();
    if missed.is_empty() {
        return Ok(());
    }
    bail!(
        "missed, twice each: {}; if nothing was made slower, see that the machine is free and run it again, and only \
         then change {}",
        missed.join(", "),
        path.display()
    )
}

/// Cores that this program may use.
fn cores() -> usize {
    available_parallelism().map_or(1, usize::from)
}

/// A pool of that many threads, on which candle's products and our operations run.
fn pool(threads: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new().num_threads(threads).build().with_context(|| format!("cannot start {threads} threads"))
}

/// A table in markdown, numbers to the right.
pub(crate) fn table(header: Vec<String>, rows: Vec<Vec<String>>) -> String {
    let mut table = Table::new();
    table.load_preset(presets::ASCII_MARKDOWN).set_header(header).add_rows(rows);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string()
}

/// Name and caches of the processor, where the system tells.
pub(crate) fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or("an unknown processor", |(_, name)| name.trim());
    let cache = |index: usize| {
        let folder = format!("/sys/devices/system/cpu/cpu0/cache/index{index}");
        let of = |what: &str| std::fs::read_to_string(format!("{folder}/{what}")).ok();
        let (level, kind, size) = (of("level")?, of("type")?, of("size")?);
        (kind.trim() != "Instruction").then(|| format!(", L{} {}", level.trim(), size.trim()))
    };
    (0..5).filter_map(cache).fold(name.to_owned(), |all, cache| all + &cache)
}

/// What else the machine was doing: the load average of the last minute, where the system tells.
pub(crate) fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().filter(|load| !load.is_empty()).unwrap_or("unknown").to_owned()
}
