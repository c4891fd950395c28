//! One run on several numbers of threads and instruction sets: which files are the same bytes, and how far others differ.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use gnp::Progress as _;
use gnp_cli::Terminal;
use safetensors::{Dtype, SafeTensors};
use serde_json::Value;

use crate::contents::{Contents, SET_ASIDE};
use crate::process::Starter;
use crate::{bench, project};

/// Numbers of threads that are tried; the first is the reference.
const THREADS: [usize; 4] = [1, 2, 3, 8];

/// Processors that QEMU emulates, with the instruction sets that they have.
const PROCESSORS: [(&str, Instructions); 2] = [("Haswell", Instructions::Avx2), ("Nehalem", Instructions::Sse)];

/// Largest difference between instruction sets that is promised: of a weight, by the largest of its array; of a metric, by the
/// largest value of that metric.
const TOLERANCE: f64 = 1e-5;

/// Ends of the names of weights that add the same to all logits of a softmax, which does not see it: their gradient is rounding
/// error, of which Adam makes steps of full length, so that they may be anything.
const UNSEEN: [&str; 2] = ["prob.bias", "attn.k.bias"];

/// The emulator.
const QEMU: &str = "qemu-x86_64";

/// What is compared.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct DeterminismArgs {
    /// Numbers of threads only, which takes seconds.
    #[arg(long)]
    pub(crate) threads_only: bool,
    /// Print the widest instruction set that is found here, and end.
    #[arg(long, hide = true)]
    pub(crate) instructions: bool,
    /// No progress, only the table.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

/// Numbers of threads only.
///
/// # Errors
/// When one changes a byte.
pub(crate) fn threads(terminal: &Terminal) -> Result<()> {
    run(DeterminismArgs { threads_only: true, instructions: false, quiet: false }, terminal)
}

/// Instruction sets for which code is chosen at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    /// 512 bits.
    Avx512,
    /// 256 bits, with fused multiply-add.
    Avx2,
    /// 128 bits, with fused multiply-add.
    Neon,
    /// 128 bits, without; the compiler's own vectors.
    Sse,
}

impl Instructions {
    /// What the kernels find at run time.
    fn here() -> Self {
        match gnp_nn::kernels::lanes() {
            16 => Self::Avx512,
            8 => Self::Avx2,
            4 => Self::Neon,
            _ => Self::Sse,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "AVX-512",
            Self::Avx2 => "AVX2 and FMA",
            Self::Neon => "NEON",
            Self::Sse => "SSE",
        }
    }
}

/// How a run differs from the reference.
#[derive(Debug)]
struct Difference {
    what: String,
    files: usize,
    /// Files with other bytes, or in one of the two only.
    others: Vec<String>,
    weights: f64,
    metrics: f64,
}

/// Does the runs, and prints what is the same.
///
/// # Errors
/// When a number of threads changes a byte, or an instruction set more than [`TOLERANCE`].
pub(crate) fn run(args: DeterminismArgs, terminal: &Terminal) -> Result<()> {
    if args.instructions {
        terminal.for_programs(Instructions::here().name());
        return Ok(());
    }
    let place = tempfile::Builder::new().prefix("determinism-").tempdir().context("cannot make a temporary folder")?;
    let runs = Runs::prepare(place.path())?;
    let own = Starter::own()?;
    let here = Instructions::here().name();
    let mut rows = Vec::new();
    let reference = runs.whole(&own, THREADS[0])?;
    for threads in &THREADS[1..] {
        let other = runs.whole(&own, *threads)?;
        rows.push(difference(&reference, &other, format!("{here}, {threads} threads"))?);
    }
    let changed: Vec<&Difference> = rows.iter().filter(|row| !row.others.is_empty()).collect();
    let mut broken: Vec<String> =
        changed.iter().map(|row| format!("{}: {}", row.what, row.others.join(", "))).collect();
    if !args.threads_only {
        for row in emulated(&runs, &own, terminal)? {
            if row.weights > TOLERANCE || row.metrics > TOLERANCE {
                broken.push(format!("{}: weights by {:.1e}, metrics by {:.1e}", row.what, row.weights, row.metrics));
            }
            rows.push(row);
        }
    }
    print(&rows, &format!("{here}, {} thread", THREADS[0]), terminal);
    if broken.is_empty() {
        return Ok(());
    }
    bail!("not the same as on {} thread with {here}: {}", THREADS[0], broken.join("; "))
}

/// The same run on processors that QEMU emulates; none where there is no QEMU.
fn emulated(runs: &Runs<'_>, own: &Starter, terminal: &Terminal) -> Result<Vec<Difference>> {
    let mut rows = Vec::new();
    let mut reference = None;
    for (processor, instructions) in PROCESSORS {
        let emulator = own.by(&[QEMU, "-cpu", processor]);
        let found = emulator.run(&["determinism", "--instructions"]).map(|ended| ended.out.trim().to_owned());
        match found {
            Ok(found) if found == instructions.name() => {}
            Ok(found) => {
                terminal.note(&format!(
                    "determinism: {processor} skipped: `{found}` is found on it, not {}",
                    instructions.name()
                ));
                continue;
            }
            Err(_) => {
                terminal.note(&format!(
                    "determinism: {} skipped: there is no {QEMU} (package qemu-user) to run it on another processor",
                    instructions.name()
                ));
                continue;
            }
        }
        let reference = match &mut reference {
            Some(reference) => reference,
            none => none.insert(runs.to_scores(own, "as-it-is")?),
        };
        let other = runs.to_scores(&emulator, processor)?;
        rows.push(difference(reference, &other, format!("{}, 1 thread ({processor} in QEMU)", instructions.name()))?);
    }
    Ok(rows)
}

/// Runs of the smoke configuration on one recording.
#[derive(Debug)]
struct Runs<'a> {
    place: &'a Path,
    data: PathBuf,
}

impl<'a> Runs<'a> {
    fn prepare(place: &'a Path) -> Result<Self> {
        Ok(Self { place, data: project::one_recording(place)? })
    }

    fn arguments(&self, command: &str, run: &Path) -> Vec<String> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let config = text(&project::root().join("configs/smoke.toml"));
        let words = ["--config", &config, "--data-dir", &text(&self.data), "--out", &text(run)].map(str::to_owned);
        [command.to_owned()].into_iter().chain(words).collect()
    }

    /// A whole pipeline.
    fn whole(&self, starter: &Starter, threads: usize) -> Result<Contents> {
        let run = self.place.join(format!("threads-{threads}"));
        let mut words = self.arguments("pipeline", &run);
        words.extend(["--threads".to_owned(), threads.to_string()]);
        starter.run(&words)?.well()?;
        Contents::read(&run)
    }

    /// All but figures and report, which take most of the time in an emulator and compute nothing new.
    fn to_scores(&self, starter: &Starter, name: &str) -> Result<Contents> {
        let run = self.place.join(name);
        // All that it would start itself anew for, outside of the emulator.
        let starter =
            gnp_cli::variables(1).into_iter().fold(starter.clone(), |starter, (name, value)| starter.with(name, value));
        starter.run(&self.arguments("ingest", &run))?.well()?;
        for command in ["train", "evaluate"] {
            starter.run(&[command, "--run", &run.to_string_lossy()])?.well()?;
        }
        Contents::read(&run)
    }
}

fn difference(reference: &Contents, other: &Contents, what: String) -> Result<Difference> {
    let (mut weights, mut metrics) = (0f64, 0f64);
    for (path, bytes) in reference.files() {
        let Some(others) = other.files().get(path) else { continue };
        if path.ends_with(".safetensors") && !path.ends_with(".last.safetensors") {
            weights =
                weights.max(furthest(&arrays(bytes).context(path.clone())?, &arrays(others).context(path.clone())?));
        } else if path == "metrics.json" {
            metrics = furthest(&scores(bytes).context(path.clone())?, &scores(others).context(path.clone())?);
        }
    }
    Ok(Difference { what, files: reference.files().len(), others: reference.differences(other), weights, metrics })
}

/// Numbers by what they are.
type Numbers = BTreeMap<String, Vec<f64>>;

/// Largest difference of two numbers, by the largest of their group in `a`; infinite when the groups do not match or a number is
/// not finite.
fn furthest(a: &Numbers, b: &Numbers) -> f64 {
    let group = |(name, a): (&String, &Vec<f64>)| {
        let Some(b) = b.get(name).filter(|b| b.len() == a.len()) else { return f64::INFINITY };
        let largest = a.iter().fold(0f64, |largest, value| largest.max(value.abs()));
        // `f64::max` passes over NaN.
        if a.iter().chain(b).any(|value| !value.is_finite()) {
            return f64::INFINITY;
        }
        let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0f64, f64::max);
        if apart == 0. { 0. } else { apart / largest }
    };
    if a.len() == b.len() { a.iter().map(group).fold(0., f64::max) } else { f64::INFINITY }
}

/// Weights of a checkpoint, or centres of modes.
fn arrays(bytes: &[u8]) -> Result<Numbers> {
    let file = SafeTensors::deserialize(bytes)?;
    let mut arrays = Numbers::new();
    for (name, array) in file.tensors() {
        if UNSEEN.iter().any(|end| name.ends_with(end)) {
            continue;
        }
        let values: Vec<f64> = match array.dtype() {
            Dtype::F32 => array.data().as_chunks().0.iter().map(|four| f32::from_le_bytes(*four).into()).collect(),
            Dtype::F64 => array.data().as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect(),
            _ => continue,
        };
        arrays.insert(name, values);
    }
    Ok(arrays)
}

/// Values and ends of intervals by the metric's name.
fn scores(bytes: &[u8]) -> Result<Numbers> {
    let scores: Vec<Value> = serde_json::from_slice(bytes)?;
    let mut values = Numbers::new();
    for score in &scores {
        let name = score["metric"].as_str().context("a score has no metric")?;
        let numbers = ["value", "ci_low", "ci_high"].iter().filter_map(|key| score[key].as_f64());
        values.entry(name.to_owned()).or_default().extend(numbers);
    }
    Ok(values)
}

fn print(rows: &[Difference], reference: &str, terminal: &Terminal) {
    let head = ["run", "files", "other bytes", "weights", "metrics"].map(str::to_owned).to_vec();
    let size = |value: f64| if value == 0. { "0".to_owned() } else { format!("{value:.1e}") };
    let cells = |row: &Difference| {
        vec![
            row.what.clone(),
            row.files.to_string(),
            row.others.len().to_string(),
            size(row.weights),
            size(row.metrics),
        ]
    };
    terminal.for_programs(&bench::table(head, rows.iter().map(cells).collect()));
    for row in rows.iter().filter(|row| !row.others.is_empty()) {
        terminal.result(&format!("{}: {}", row.what, row.others.join(", ")));
    }
    terminal.note(&format!(
        "Beside {reference}. weights, metrics: largest difference, by the largest value of the array or metric; without {}, \
         which change nothing. {SET_ASIDE}",
        UNSEEN.join(" and ")
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(groups: &[(&str, &[f64])]) -> Numbers {
        groups.iter().map(|(name, values)| ((*name).to_owned(), values.to_vec())).collect()
    }

    #[test]
    fn differences_count_by_the_largest_of_their_group() {
        let a = numbers(&[("w", &[-10., 1.]), ("b", &[0.1])]);
        assert_eq!(furthest(&a, &a), 0.);
        assert!((furthest(&a, &numbers(&[("w", &[-10., 2.]), ("b", &[0.1])])) - 0.1).abs() < 1e-12);
        assert!((furthest(&a, &numbers(&[("w", &[-10., 1.]), ("b", &[0.15])])) - 0.5).abs() < 1e-12);
        assert!(furthest(&a, &numbers(&[("w", &[-10., 1.])])).is_infinite());
        for bad in [f64::NAN, f64::INFINITY] {
            let other = numbers(&[("w", &[-10., bad]), ("b", &[0.1])]);
            assert!(furthest(&a, &other).is_infinite() && furthest(&other, &a).is_infinite());
            assert!(furthest(&other, &other).is_infinite());
        }
        assert!(furthest(&a, &numbers(&[("w", &[-10.]), ("b", &[0.1])])).is_infinite());
    }

    #[test]
    fn scores_are_grouped_by_metric() {
        let text = r#"[{"metric": "a", "value": 1.0, "ci_low": 0.5, "ci_high": null}, {"metric": "a", "value": 3.0}]"#;
        assert_eq!(scores(text.as_bytes()).unwrap(), numbers(&[("a", &[1., 0.5, 3.])]));
    }
}
