//! Both networks on a GPU at several sizes of a batch, beside PyTorch and JAX on the same one.
//!
//! Everybody computes in f32 without TF32, after runs that do not count, and waits for the GPU before the clock stops.
//! *Recorded* is the same work launched as one CUDA graph.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use candle_core::{Device, Tensor};
use gnp::Progress as _;
use gnp_cli::Terminal;
use gnp_traj::Engine;
use serde::Deserialize;

use super::clock::Sample;
use super::networks::{Goal, HIGHD, Lengths, NGSIM, Traj};
use super::peer::Python;
use super::table;

/// Windows in a batch.
const WINDOWS: [usize; 4] = [64, 256, 1024, 4096];
/// A case is repeated until so much time has passed, but at least thrice.
const CASE: Duration = Duration::from_millis(250);
/// A program begins no further case after so many seconds.
const PROGRAM: u64 = 40;

/// What one case took.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
struct Cell {
    /// Milliseconds for the whole batch; none where the memory did not suffice.
    ms: Option<f64>,
    /// Memory taken at most, MiB, where that is known.
    mib: Option<f64>,
}

/// By `ngsim.traj.train` and windows in the batch, as in `ngsim.traj.train@64`.
type Cells = BTreeMap<String, Cell>;

/// Measures and prints one table.
///
/// # Errors
/// When there is no GPU for this build, or a network or a reference program fails for another reason than memory.
pub(super) fn run(python: Option<&Path>, terminal: &Terminal) -> Result<()> {
    let device = Device::new_cuda(0).context(
        "bench --gpu needs an NVIDIA GPU and a build for it: `cargo run --package xtask --features cuda -- bench --gpu`",
    )?;
    let python = Python::find(python, terminal)?;
    terminal.note("bench: ours on the GPU");
    let [eager, recorded] = ours(&device, terminal)?;
    let options = |more: &[&str]| -> Vec<String> {
        let windows = WINDOWS.map(|windows| windows.to_string()).join(",");
        let (case, program) = (CASE.as_secs_f64().to_string(), PROGRAM.to_string());
        let common = ["--device", "cuda", "--batches", &windows, "--case-seconds", &case, "--seconds", &program];
        more.iter().chain(&common).map(|option| (*option).to_owned()).collect()
    };
    terminal.note("bench: PyTorch on the GPU");
    let torch: Cells = python.measure("torch_gnp.py", &options(&["bench"]))?;
    terminal.note("bench: PyTorch on the GPU, recorded");
    let torch_recorded: Cells = python.measure("torch_gnp.py", &options(&["bench", "--record"]))?;
    terminal.note("bench: JAX on the GPU");
    let jax: Cells = python.measure("jax_traj.py", &options(&[]))?;
    let columns = [
        ("ours", &eager),
        ("ours, recorded", &recorded),
        ("PyTorch", &torch),
        ("PyTorch, recorded", &torch_recorded),
        ("JAX", &jax),
    ];
    terminal.result(&format!(
        "Milliseconds per batch and, in brackets, MiB of memory at most; published sizes, f32, one GPU. Empty: not measured, \
         as JAX has no goal network here and each program stops after {PROGRAM} s.\n{}",
        rows(&columns)
    ));
    Ok(())
}

/// One row for each case that anybody measured, smaller batches first.
fn rows(columns: &[(&str, &Cells)]) -> String {
    let mut keys: Vec<(&str, usize)> = Vec::new();
    for key in columns.iter().flat_map(|(_, cells)| cells.keys()) {
        let (case, windows) = key.split_once('@').unwrap_or((key, ""));
        keys.push((case, windows.parse().unwrap_or(0)));
    }
    keys.sort_unstable();
    keys.dedup();
    let row = |(case, windows): (&str, usize)| {
        let cells =
            columns.iter().map(|(_, cells)| cells.get(&format!("{case}@{windows}")).map_or_else(String::new, text));
        [case.to_owned(), windows.to_string()].into_iter().chain(cells).collect()
    };
    let header = ["", "windows"].into_iter().chain(columns.iter().map(|(name, _)| *name)).map(str::to_owned).collect();
    table(header, keys.into_iter().map(row).collect())
}

fn text(cell: &Cell) -> String {
    let Some(ms) = cell.ms else { return "out of memory".to_owned() };
    match cell.mib {
        Some(mib) => format!("{ms:.2} ({mib:.0})"),
        None => format!("{ms:.2}"),
    }
}

/// Ours as operation after operation, and recorded.
fn ours(device: &Device, terminal: &Terminal) -> Result<[Cells; 2]> {
    let begun = Instant::now();
    let mut all = [Cells::new(), Cells::new()];
    for (windows, lengths) in WINDOWS.into_iter().flat_map(|windows| [(windows, NGSIM), (windows, HIGHD)]) {
        let (traj, goal) = networks(device, lengths, windows)?;
        let cases: [(&str, &dyn Fn() -> Result<Vec<Tensor>>); 4] = [
            ("traj.forward", &|| Ok(vec![traj.path(Engine::Graph)?])),
            ("traj.train", &|| traj.gradients(Engine::Graph)),
            ("goal.forward", &|| Ok(vec![goal.futures(Engine::Graph)?])),
            ("goal.train", &|| goal.gradients(Engine::Graph)),
        ];
        for (name, case) in cases {
            // Twice the time of the others, for two columns.
            if begun.elapsed() > Duration::from_secs(2 * PROGRAM) {
                return Ok(all);
            }
            let key = format!("{}.{name}@{windows}", lengths.name);
            let measured = [measured(device, || case().map(drop)).map(Some)?, recorded(device, case, terminal)?];
            for (cells, cell) in all.iter_mut().zip(measured) {
                cells.extend(cell.map(|cell| (key.clone(), cell)));
            }
        }
    }
    Ok(all)
}

fn networks(device: &Device, lengths: Lengths, windows: usize) -> Result<(Traj, Goal)> {
    Ok((Traj::on(device, lengths, windows)?, Goal::on(device, lengths, windows)?))
}

/// The time of `case`, launched as one graph; none where that cannot be recorded.
#[cfg(feature = "cuda")]
fn recorded(device: &Device, case: &dyn Fn() -> Result<Vec<Tensor>>, terminal: &Terminal) -> Result<Option<Cell>> {
    let work = |_: &[Tensor]| case().map_err(|error| candle_core::Error::Msg(format!("{error:#}")));
    match gnp_nn::Replay::record(device, &[], work) {
        Ok(replay) => measured(device, || Ok(replay.run(&[]).map(drop)?)).map(Some),
        Err(error) if out_of_memory(&error.to_string()) => Ok(Some(Cell::default())),
        Err(error) => {
            terminal.note(&format!("bench: not recorded: {error}"));
            Ok(None)
        }
    }
}

#[cfg(not(feature = "cuda"))]
fn recorded(_: &Device, _: &dyn Fn() -> Result<Vec<Tensor>>, _: &Terminal) -> Result<Option<Cell>> {
    Ok(None)
}

/// The median of runs after two that do not count, during the first of which memory is watched.
fn measured(device: &Device, run: impl Fn() -> Result<()>) -> Result<Cell> {
    let once = || -> Result<f64> {
        let begun = Instant::now();
        run()?;
        device.synchronize()?;
        Ok(begun.elapsed().as_secs_f64())
    };
    let all = || -> Result<Cell> {
        device.synchronize()?;
        let (first, mib) = memory::watched(device, once);
        first?;
        once()?;
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
    use super::*;

    #[test]
    fn rows_are_of_all_columns_and_say_what_did_not_fit() {
        let cells = |text: &str| -> Cells { serde_json::from_str(text).unwrap() };
        let ours = cells(r#"{"ngsim.traj.train@64": {"ms": 12.345, "mib": 700}, "ngsim.traj.train@1024": {}}"#);
        let theirs = cells(r#"{"ngsim.traj.train@64": {"ms": 20.0, "mib": null}, "ngsim.goal.train@64": {"ms": 1}}"#);
        let text = rows(&[("ours", &ours), ("PyTorch", &theirs)]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 5, "{text}");
        assert!(lines[2].contains("goal") && lines[2].contains("1.00"), "{text}");
        assert!(lines[3].contains("12.35 (700)") && lines[3].contains("20.00"), "{text}");
        assert!(lines[4].contains("1024") && lines[4].contains("out of memory"), "{text}");
    }

    #[test]
    fn what_lacks_memory_is_told_from_other_errors() {
        assert!(out_of_memory("DriverError(CUDA_ERROR_OUT_OF_MEMORY, \"out of memory\")"));
        assert!(!out_of_memory("DriverError(CUDA_ERROR_ILLEGAL_ADDRESS)"));
    }

    #[test]
    fn cases_run_on_any_device() {
        let (traj, _) = networks(&Device::Cpu, Lengths { observed: 3, predicted: 2, modes: 7, ..NGSIM }, 2).unwrap();
        let cell = measured(&Device::Cpu, || traj.path(Engine::Graph).map(drop)).unwrap();
        assert!(cell.ms.is_some_and(|ms| ms > 0.) && cell.mib.is_none());
    }
}
