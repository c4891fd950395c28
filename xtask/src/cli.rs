//! The command line of the workshop: the commands of `gnp`, and the project's own.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use gnp::Precision;
use gnp_cli::MachineArgs;

use crate::browser::{BrowserArgs, RecordingArgs};
use crate::c::CArgs;
use crate::determinism::DeterminismArgs;
use crate::load::LoadArgs;
use crate::torture::TortureArgs;

/// GNP: goal-based neural physics for predicting vehicles on motorways.
///
/// Recordings go in (NGSIM or highD, as they are downloaded); a trained model, its intention modes,
/// trajectories with the forces behind them, and a table of errors come out.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", version, max_term_width = 100)]
#[command(after_help = "\
Examples:
  cargo xtask pipeline --dataset ngsim                 the embedded real NGSIM scenes, everything
  cargo xtask pipeline --dataset highd --data-dir D    a folder of real highD recordings
  cargo xtask evaluate --run runs/ngsim --data-dir D --out scores
  cargo xtask ci                                       the project's own checks")]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The commands of `gnp`.
    #[command(flatten)]
    Product(gnp_cli::Command),
    /// Redraw the pictures of docs/gallery.md and README from a run and tables that are there.
    #[command(after_help = "\
Example:
  cargo xtask gallery --run runs/ngsim --table1 runs/table1-ngsim --table2 runs/table2-ngsim

Writes report.html of the run as well. Pictures of the report need Chromium; without it they stay.")]
    Gallery(GalleryArgs),
    /// Measure speed: ours and the floor; with a flag ratios that gate, a whole frame, or PyTorch and JAX beside it.
    #[command(after_help = "\
Examples:
  cargo xtask bench                       milliseconds per window at the published sizes, and the floor
  cargo xtask bench --check --quick       ratios against configs/bench.toml, as in `cargo xtask ci`
  cargo xtask bench --frame               p50 and p99 of a frame of 25 vehicles on one core
  cargo xtask bench --against-torch --json --threads 2
  cargo xtask bench --against-torch --python ~/torch/bin/python
  cargo xtask bench --roofline            what a core's arithmetic and caches allow, and our product beside it
  cargo run --package xtask --features cuda -- bench --gpu

Exit code: 0 all limits hold, 1 one is missed or an error, 2 wrong use.")]
    Bench(BenchArgs),
    /// Try made-up and damaged input on what reads files from strangers.
    #[command(after_help = "\
Examples:
  cargo xtask fuzz --seconds 60 --jobs 2              a minute of each target, two at a time
  cargo xtask fuzz --target ngsim --executions 1000000
  cargo xtask fuzz --target ngsim --coverage          libFuzzer; needs a C++ compiler
  cargo xtask fuzz --target ngsim --replay FILE       one input again

Inputs that fail are kept in runs/fuzz. Exit code: 0 nothing found, 1 something, 2 wrong use.")]
    Fuzz(FuzzArgs),
    /// Run the project's checks: format, tidy, supply chain, clippy, docs, features, packages, 64-bit ARM, ratios of times, determinism, crashes, fuzzing, tests.
    Ci {
        /// Also check and test what writes files for the Rerun viewer; the first time that compiles for many minutes.
        #[arg(long)]
        rerun: bool,
    },
    /// Check the C library: its header against the source, its examples and tests under AddressSanitizer, CMake, pkg-config.
    #[command(after_help = "\
Examples:
  cargo xtask c                       everything; what there is no compiler or CMake for is said to be skipped
  cargo xtask c --write               the header anew, after a change of crates/gnp-c/src/border.rs
  cargo xtask c --install DIR         header, library, CMake's and pkg-config's files below DIR")]
    C(CArgs),
    /// Drive the page of `play` in Chromium as a person does: drag, delete, undo, link, keyboard, touch.
    #[command(after_help = "\
Examples:
  cargo xtask browser                     as in `cargo xtask ci`
  cargo xtask browser --only drag --pictures pictures
  cargo xtask browser --full              then requests that schemathesis makes up

Needs Chromium and a Python with what xtask/browser/requirements.txt lists, named by GNP_PYTHON_BROWSER.")]
    Browser(BrowserArgs),
    /// Film the page of `play`, docs/pictures/play.gif: a leader is dragged back and deleted; needs what `browser` needs.
    Recording(RecordingArgs),
    /// Ask the server of `play` as much as it can answer, and as its page asks: answers a second, times, errors, memory.
    #[command(after_help = "\
Examples:
  cargo xtask load                        a minute of each part, for docs/performance.md
  cargo xtask load --seconds 5            as in `cargo xtask ci`

Needs h2load (Debian: nghttp2-client). Exit code: 0 no error and memory flat, 1 otherwise, 2 wrong use.")]
    Load(LoadArgs),
    /// Build the Python package and run its tests, types and notebook against the wheel; says so where a Python lacks what
    /// python/requirements-ci.txt lists.
    Python,
    /// Check each crate alone, without its features and with each of them (those of a GPU and MKL left out); takes many minutes.
    Features,
    /// Build physics, kernels, networks and modes for 64-bit ARM and run their tests in an emulator; takes minutes.
    #[command(after_help = "\
Needs Debian's gcc-aarch64-linux-gnu and qemu-user, and the standard library of the target: `rustup target add
aarch64-unknown-linux-gnu`, or the compiler that xtask/aarch64/toolchain.sh fetches, named by GNP_AARCH64_RUSTC.")]
    Aarch64,
    /// Kill runs, fill their disk, damage their files, let two at one folder; go on, and compare with an undisturbed run byte for byte.
    #[command(after_help = "\
Examples:
  cargo xtask torture                           each trouble once, as in `cargo xtask ci`
  cargo xtask torture --rounds 100
  cargo xtask torture --trouble kill --stage goal --rounds 20

A round that fails prints its seed and keeps its folder. Exit code: 0 all rounds passed, 1 one failed, 2 wrong use.")]
    Torture(TortureArgs),
    /// One run on 1, 2, 3 and 8 threads and on emulated processors with fewer instruction sets: which files are the same bytes.
    #[command(after_help = "\
Other processors need QEMU's user mode, package qemu-user; without it they are skipped.

Exit code: 0 what is promised holds, 1 it does not, 2 wrong use.")]
    Determinism(DeterminismArgs),
    /// Train the weights that come with the program and put them in place of those in models/; takes a minute.
    #[command(after_help = "\
Examples:
  cargo xtask pretrained             after a change of the networks, the training or the scenes
  cargo xtask pretrained --check     whether the committed weights are what their configuration makes, byte for byte

Exit code: 0 done, 1 a file differs or an error, 2 wrong use.")]
    Pretrained {
        /// Compare with the committed files; change none.
        #[arg(long)]
        check: bool,
        /// On what.
        #[command(flatten)]
        machine: MachineArgs,
    },
    /// Write the bill of materials anew, docs/sbom.cdx.json, from Cargo.lock and what cargo knows of each package.
    Sbom,
    /// Check what the compiler cannot: the map in docs/architecture.md, who depends on whom, file headers, bill of materials.
    Tidy,
}

/// What the gallery is made of.
#[derive(Clone, Debug, Args)]
pub(crate) struct GalleryArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Folder of a finished `compare`.
    #[arg(long, value_name = "DIR")]
    pub(crate) table1: Option<PathBuf>,
    /// Folder of a finished `ablate`.
    #[arg(long, value_name = "DIR")]
    pub(crate) table2: Option<PathBuf>,
    /// Folder for the pictures [default: docs/pictures]; pictures there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to measure.
#[derive(Clone, Debug, Args)]
pub(crate) struct BenchArgs {
    /// Hold ratios measured in one run against configs/bench.toml.
    #[arg(long, group = "what", conflicts_with = "threads")]
    pub(crate) check: bool,
    /// Reduced sizes, less than a minute.
    #[arg(long, requires = "check")]
    pub(crate) quick: bool,
    /// Predict whole frames of 25 vehicles; on one thread unless --threads says otherwise.
    #[arg(long, group = "what")]
    pub(crate) frame: bool,
    /// What a core's arithmetic and caches allow, and how near to it our matrix product comes.
    #[arg(long, group = "what", conflicts_with_all = ["json", "threads", "rounds", "windows"])]
    pub(crate) roofline: bool,
    /// Run the programs in xtask/peer beside ours; installs them into target/peer-venv.
    #[arg(long, group = "what")]
    pub(crate) against_torch: bool,
    /// Both networks on a GPU at several sizes of a batch beside PyTorch and JAX there; needs a build with `cuda`.
    #[arg(long, group = "what", conflicts_with_all = ["threads", "rounds", "windows"])]
    pub(crate) gpu: bool,
    /// Time for everybody on the GPU together, in s; what it does not suffice for is not measured.
    #[arg(long, value_name = "N", default_value_t = 150, requires = "gpu")]
    pub(crate) seconds: u64,
    /// Python that has PyTorch and JAX, instead of an environment in target/peer-venv.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["check", "frame"])]
    pub(crate) python: Option<PathBuf>,
    /// Print everything once more as JSON, in the last line.
    #[arg(long, conflicts_with_all = ["check", "frame"])]
    pub(crate) json: bool,
    /// Number of threads, of the other programs too [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// Times that everybody is measured in turn; medians are printed.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = positive, conflicts_with_all = ["check", "frame"])]
    pub(crate) rounds: usize,
    /// Windows in a batch; the published comparison has 64.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = positive, conflicts_with_all = ["check", "frame"])]
    pub(crate) windows: usize,
    /// What the force's networks multiply in when they predict: with bf16 a frame is predicted so, and roll-outs in both, in turn.
    #[arg(long, value_name = "P", default_value_t = Precision::F32, conflicts_with_all = ["check", "roofline", "gpu"])]
    pub(crate) precision: Precision,
    /// No progress, only tables.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

/// What to fuzz, and how long.
#[derive(Clone, Debug, Args)]
pub(crate) struct FuzzArgs {
    /// A target; several may be given [default: all].
    #[arg(long = "target", value_name = "NAME", long_help = crate::fuzz::targets_help())]
    pub(crate) targets: Vec<String>,
    /// Executions of each target.
    #[arg(long, value_name = "N", conflicts_with = "seconds")]
    pub(crate) executions: Option<u64>,
    /// Seconds for each target [default: 60].
    #[arg(long, value_name = "S")]
    pub(crate) seconds: Option<u64>,
    /// Targets at a time.
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN)]
    pub(crate) jobs: NonZeroUsize,
    /// From which the inputs are drawn; the same gives the same.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Let libFuzzer look for inputs that reach new code; its corpus grows in runs/fuzz/corpus.
    #[arg(long)]
    pub(crate) coverage: bool,
    /// Try the input in this file, and nothing else.
    #[arg(long, value_name = "FILE", requires = "targets", conflicts_with_all = ["executions", "seconds", "coverage"])]
    pub(crate) replay: Option<PathBuf>,
    /// Be the process that does the work on one target, with its files in this folder.
    #[arg(long, value_name = "DIR", hide = true)]
    pub(crate) worker: Option<PathBuf>,
}

fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "give a whole number from 1".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// The commands of `gnp` are called as they are here.
    #[test]
    fn help_has_the_name_of_the_program() {
        let program = gnp_cli::Program::new("cargo xtask", "xtask", "runs");
        let mut command = program.commands(Cli::command());
        let help = command.find_subcommand_mut("pipeline").unwrap().render_long_help().to_string();
        assert!(help.contains("  cargo xtask pipeline --dataset ngsim") && !help.contains("  gnp "), "{help}");
        let help = command.find_subcommand_mut("train").unwrap().render_long_help().to_string();
        assert!(help.contains("`cargo xtask ingest` starts one"), "{help}");
    }

    #[test]
    fn wrong_use_is_refused() {
        for line in [
            &["xtask"][..],
            &["xtask", "bench", "--quick"],
            &["xtask", "bench", "--check", "--frame"],
            &["xtask", "bench", "--check", "--rounds", "2"],
            &["xtask", "bench", "--rounds", "0"],
            &["xtask", "bench", "--roofline", "--threads", "2"],
        ] {
            assert!(Cli::try_parse_from(line).is_err(), "{line:?}");
        }
        assert!(Cli::try_parse_from(["xtask", "pipeline", "--dataset", "ngsim"]).is_ok());
    }
}
