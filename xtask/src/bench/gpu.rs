//! Both networks on a GPU at several sizes of a batch, beside PyTorch and JAX on the same one.
//!
//! Everybody computes in f32 without TF32, after runs that do not count, and waits for the GPU before the clock stops.
//! Ours is what training and prediction do, where roll-outs are recorded by themselves, as CUDA graphs; *recorded* is the
//! whole work as one such graph, *by operation* none at all. Programs run one after the other, each for its share of a time
//! that is given; start, compilation and recording count. What matters most is measured first, and printed at once.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use candle_core::{Device, Tensor};
use gnp::Progress as _;
use gnp_cli::Terminal;
use gnp_nn::DeviceThread;
use gnp_traj::Engine;
use serde::{Deserialize, Serialize};

use super::clock::Sample;
use super::networks::{Goal, HIGHD, NGSIM, Traj};
use super::peer::Python;
use super::table;

/// Windows in a batch, those that matter most first.
const WINDOWS: [usize; 4] = [64, 1024, 4096, 256];
/// A case is repeated until so much time has passed, but at least thrice.
const CASE: Duration = Duration::from_millis(200);
/// A program that is over its time by more is ended.
const GRACE: Duration = Duration::from_secs(4);

/// Who is measured: the columns of the table, and the weight of each in sharing the time.
const COLUMNS: [(&str, u32); 6] = [
    ("ours", 14),
    ("ours, recorded", 12),
    ("ours, by operation", 10),
    ("PyTorch", 24),
    ("PyTorch, recorded", 20),
    ("JAX", 20),
];

/// Takes what a case took, or why it failed.
type Add<'a> = dyn FnMut(String, Result<Cell>) + Send + 'a;

/// What one case took.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
struct Cell {
    /// Milliseconds for the whole batch; none where the memory did not suffice.
    ms: Option<f64>,
    /// Memory taken at most, MiB, where that is known.
    mib: Option<f64>,
}

/// By `ngsim.traj.train` and windows in the batch, as in `ngsim.traj.train@64`.
type Cells = BTreeMap<String, Cell>;

/// Measures within about `seconds` and prints one table, and the same as JSON where that is asked for.
///
/// # Errors
/// When there is no GPU for this build; after the table, when anybody failed for another reason than memory.
pub(super) fn run(python: Option<&Path>, seconds: u64, json: bool, terminal: &Terminal) -> Result<()> {
    let mut time =
        Time { end: Instant::now() + Duration::from_secs(seconds), weights: COLUMNS.map(|(_, weight)| weight).into() };
    let device = Device::new_cuda(0).context(
        "bench --gpu needs an NVIDIA GPU and a build for it: `cargo run --package xtask --features cuda -- bench --gpu`",
    )?;
    let python = Python::find(python, terminal)?;
    let mut results: [Cells; COLUMNS.len()] = Default::default();
    let mut failed = Vec::new();
    for ((name, _), cells) in COLUMNS.into_iter().zip(&mut results) {
        let until = time.share();
        terminal.note(&format!("bench: {name}, {:.0} s", (until - Instant::now()).as_secs_f64()));
        let mut failures = 0;
        let mut add = |key: String, cell: Result<Cell>| match cell {
            Ok(cell) => {
                terminal.note(&format!("bench: {name}, {key}: {}", text(&cell)));
                cells.insert(key, cell);
            }
            Err(error) => {
                terminal.note(&format!("bench: {name}, {key} failed: {error:#}"));
                failures += 1;
            }
        };
        let done = match name {
            "ours" => ours(&device, until, &mut add, &OurWay { engine: None, cases: &Case::ALL, launch: eager }),
            "ours, recorded" => {
                ours(&device, until, &mut add, &OurWay { engine: GRAPH, cases: &Case::ALL, launch: recorded })
            }
            "ours, by operation" => {
                ours(&device, until, &mut add, &OurWay { engine: GRAPH, cases: &Case::ALL[..2], launch: eager })
            }
            "PyTorch" => theirs(&python, "torch_gnp.py", &["bench"], until, &mut add),
            "PyTorch, recorded" => theirs(&python, "torch_gnp.py", &["bench", "--record"], until, &mut add),
            _ => theirs(&python, "jax_traj.py", &[], until, &mut add),
        };
        if let Err(error) = done {
            terminal.note(&format!("bench: {name} failed: {error:#}"));
            failures += 1;
        }
        if failures > 0 {
            failed.push(name);
        }
    }
    terminal.result(&format!(
        "Milliseconds per batch and, in brackets, MiB of memory at most; published sizes, f32, one GPU; {seconds} s for \
         everybody together. JAX has no goal network here.\n{}",
        rows(&results)
    ));
    if json {
        let named: BTreeMap<&str, &Cells> = COLUMNS.iter().map(|(name, _)| *name).zip(&results).collect();
        terminal.for_programs(&serde_json::to_string(&named)?);
    }
    if failed.is_empty() { Ok(()) } else { bail!("failed: {}; see the messages above", failed.join(", ")) }
}

/// The time that is left, and the weights of those who share it.
struct Time {
    end: Instant,
    weights: VecDeque<u32>,
}

impl Time {
    /// When the next one's share is over; what others left is shared, too.
    fn share(&mut self) -> Instant {
        let now = Instant::now();
        let all: u32 = self.weights.iter().sum();
        let own = self.weights.pop_front().unwrap_or(0);
        now + self.end.saturating_duration_since(now) * own / all.max(1)
    }
}

/// One row for each case, those of a network together.
fn rows(columns: &[Cells]) -> String {
    let mut sizes = WINDOWS;
    sizes.sort_unstable();
    let mut lines = Vec::new();
    for lengths in [NGSIM, HIGHD] {
        for name in Case::ALL.map(Case::name) {
            for windows in sizes {
                let case = format!("{}.{name}", lengths.name);
                let cell =
                    |cells: &Cells| cells.get(&format!("{case}@{windows}")).map_or("not measured".to_owned(), text);
                let cells: Vec<String> = columns.iter().map(cell).collect();
                lines.push([case.clone(), windows.to_string()].into_iter().chain(cells).collect());
            }
        }
    }
    let header = ["", "windows"].into_iter().chain(COLUMNS.map(|(name, _)| name)).map(str::to_owned).collect();
    table(header, lines)
}

fn text(cell: &Cell) -> String {
    let Some(ms) = cell.ms else { return "out of memory".to_owned() };
    match cell.mib {
        Some(mib) => format!("{ms:.2} ({mib:.0})"),
        None => format!("{ms:.2}"),
    }
}

/// What a reference program measures until its time is over.
fn theirs(python: &Python, program: &str, options: &[&str], until: Instant, add: &mut Add<'_>) -> Result<()> {
    let windows = WINDOWS.map(|windows| windows.to_string()).join(",");
    let (case, left) = (CASE.as_secs_f64(), until.saturating_duration_since(Instant::now()).as_secs_f64());
    let (case, left) = (case.to_string(), left.to_string());
    let common = ["--device", "cuda", "--batches", &windows, "--case-seconds", &case, "--seconds", &left];
    let options: Vec<String> = options.iter().chain(&common).map(|option| (*option).to_owned()).collect();
    python.follow(program, &options, until + GRACE, |line| {
        // Other lines are messages of libraries.
        for (key, cell) in serde_json::from_str::<Cells>(line).unwrap_or_default() {
            add(key, Ok(cell));
        }
    })
}

/// What is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Case {
    TrajTrain,
    TrajForward,
    GoalTrain,
    GoalForward,
}

impl Case {
    /// What matters most first.
    const ALL: [Self; 4] = [Self::TrajTrain, Self::TrajForward, Self::GoalTrain, Self::GoalForward];

    fn name(self) -> &'static str {
        match self {
            Self::TrajTrain => "traj.train",
            Self::TrajForward => "traj.forward",
            Self::GoalTrain => "goal.train",
            Self::GoalForward => "goal.forward",
        }
    }
}

/// A network's work, and how it is launched.
type Work<'a> = dyn Fn() -> Result<Vec<Tensor>> + 'a;
type Launch = fn(&Device, &Work<'_>) -> Result<Cell>;

/// How ours is run.
struct OurWay<'a> {
    /// Of roll-outs; that of training and prediction where none is named.
    engine: Option<Engine>,
    cases: &'a [Case],
    launch: Launch,
}

const GRAPH: Option<Engine> = Some(Engine::Graph);

/// Ours until the time is over, in a thread whose recordings end with it.
fn ours(device: &Device, until: Instant, add: &mut Add<'_>, way: &OurWay<'_>) -> Result<()> {
    DeviceThread::of(device)?.run(|| ours_here(device, until, add, way))
}

fn ours_here(device: &Device, until: Instant, add: &mut Add<'_>, way: &OurWay<'_>) -> Result<()> {
    for (lengths, windows) in [NGSIM, HIGHD].into_iter().flat_map(|lengths| WINDOWS.map(|windows| (lengths, windows))) {
        for cases in way.cases.chunks(2) {
            if Instant::now() >= until {
                return Ok(());
            }
            let (traj, goal) = match cases {
                [Case::TrajTrain, ..] => (Some(Traj::on(device, lengths, windows)?), None),
                _ => (None, Some(Goal::on(device, lengths, windows)?)),
            };
            for case in cases {
                let work = || -> Result<Vec<Tensor>> {
                    Ok(match (case, &traj, &goal) {
                        (Case::TrajTrain, Some(traj), _) => traj.gradients(way.engine)?,
                        (Case::TrajForward, Some(traj), _) => vec![traj.path(way.engine)?],
                        (Case::GoalTrain, _, Some(goal)) => goal.gradients(Engine::Graph)?,
                        (_, _, Some(goal)) => vec![goal.futures(Engine::Graph)?],
                        _ => Vec::new(),
                    })
                };
                if Instant::now() < until {
                    add(format!("{}.{}@{windows}", lengths.name, case.name()), (way.launch)(device, &work));
                }
            }
        }
    }
    Ok(())
}

/// Operation after operation.
fn eager(device: &Device, work: &Work<'_>) -> Result<Cell> {
    measured(device, || work().map(drop))
}

/// As one graph.
#[cfg(feature = "cuda")]
fn recorded(device: &Device, work: &Work<'_>) -> Result<Cell> {
    let work = |_: &[Tensor]| work().map_err(|error| candle_core::Error::Msg(format!("{error:#}")));
    match gnp_nn::Replay::record(device, &[], work) {
        Ok(replay) => measured(device, || Ok(replay.run(&[]).map(drop)?)),
        Err(error) if out_of_memory(&error.to_string()) => Ok(Cell::default()),
        Err(error) => Err(error).context("cannot be recorded"),
    }
}

#[cfg(not(feature = "cuda"))]
fn recorded(_: &Device, _: &Work<'_>) -> Result<Cell> {
    bail!("this build records nothing")
}

/// The median of runs after two that do not count, during which memory is watched.
fn measured(device: &Device, run: impl Fn() -> Result<()>) -> Result<Cell> {
    let once = || -> Result<f64> {
        let begun = Instant::now();
        run()?;
        device.synchronize()?;
        Ok(begun.elapsed().as_secs_f64())
    };
    let all = || -> Result<Cell> {
        device.synchronize()?;
        let (warm, mib) = memory::watched(device, || once().and_then(|_| once()));
        warm?;
        let (begun, mut seconds) = (Instant::now(), Vec::new());
        while seconds.len() < 3 || begun.elapsed() < CASE {
            seconds.push(once()?);
        }
        Ok(Cell { ms: Some(Sample::new(seconds).median() * 1e3), mib })
    };
    match all() {
        Err(error) if out_of_memory(&format!("{error:#}")) => Ok(Cell::default()),
        other => other,
    }
}

/// Whether an error of candle says that the memory of the GPU did not suffice.
fn out_of_memory(error: &str) -> bool {
    let error = error.to_lowercase();
    ["out_of_memory", "out of memory", "alloc_failed"].iter().any(|part| error.contains(part))
}

#[cfg(feature = "cuda")]
mod memory {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    use candle_core::Device;

    /// What `run` returns, and how many MiB more of the device were taken at a time than before it.
    pub(super) fn watched<T>(device: &Device, run: impl FnOnce() -> T) -> (T, Option<f64>) {
        let Ok(device) = device.as_cuda_device() else { return (run(), None) };
        let stream = device.cuda_stream();
        let free = || stream.context().mem_get_info().ok().map(|(free, _)| free);
        let (before, over) = (free(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            let watch = scope.spawn(|| {
                let mut least = before;
                while !over.load(Ordering::Relaxed) {
                    least = least.min(free());
                    std::thread::sleep(Duration::from_millis(1));
                }
                least
            });
            let made = run();
            over.store(true, Ordering::Relaxed);
            let taken = watch.join().ok().flatten().zip(before).map(|(least, before)| before.saturating_sub(least));
            (made, taken.map(|bytes| bytes as f64 / f64::from(1 << 20)))
        })
    }
}

#[cfg(not(feature = "cuda"))]
mod memory {
    use candle_core::Device;

    pub(super) fn watched<T>(_: &Device, run: impl FnOnce() -> T) -> (T, Option<f64>) {
        (run(), None)
    }
}

#[cfg(test)]
mod tests {
    use super::super::networks::Lengths;
    use super::*;

    #[test]
    fn rows_are_of_all_cases_and_say_what_was_not_measured_or_did_not_fit() {
        let cells = |text: &str| -> Cells { serde_json::from_str(text).unwrap() };
        let ours = cells(r#"{"ngsim.traj.train@64": {"ms": 12.345, "mib": 700}, "ngsim.traj.train@1024": {}}"#);
        let theirs = cells(r#"{"ngsim.traj.train@64": {"ms": 20.0, "mib": null}}"#);
        let text = rows(&[ours, Cells::new(), Cells::new(), theirs, Cells::new(), Cells::new()]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2 + 2 * 4 * WINDOWS.len(), "{text}");
        assert!(["12.35 (700)", "20.00", "not measured"].iter().all(|cell| lines[2].contains(cell)), "{text}");
        assert!(lines[4].contains("1024") && lines[4].contains("out of memory"), "{text}");
    }

    #[test]
    fn what_one_leaves_of_its_time_is_for_the_others() {
        let seconds = |until: Instant| (until - Instant::now()).as_secs_f64().round();
        let mut time = Time { end: Instant::now() + Duration::from_secs(100), weights: [50, 25, 25].into() };
        assert_eq!(seconds(time.share()), 50.);
        // The first took no time at all.
        assert_eq!((seconds(time.share()), seconds(time.share())), (50., 100.));
        time.end = Instant::now();
        assert!(time.share() <= Instant::now(), "there is nothing left");
    }

    #[test]
    fn what_lacks_memory_is_told_from_other_errors() {
        assert!(out_of_memory("DriverError(CUDA_ERROR_OUT_OF_MEMORY, \"out of memory\")"));
        assert!(!out_of_memory("DriverError(CUDA_ERROR_ILLEGAL_ADDRESS)"));
    }

    #[test]
    fn cases_run_on_any_device_and_none_after_the_time() {
        let traj = Traj::on(&Device::Cpu, Lengths { observed: 3, predicted: 2, modes: 7, ..NGSIM }, 2).unwrap();
        let cell = eager(&Device::Cpu, &|| Ok(vec![traj.path(None)?])).unwrap();
        assert!(cell.ms.is_some_and(|ms| ms > 0.) && cell.mib.is_none());
        let mut add = |key: String, _| panic!("{key} was measured");
        ours(&Device::Cpu, Instant::now(), &mut add, &OurWay { engine: None, cases: &Case::ALL, launch: eager })
            .unwrap();
    }
}
