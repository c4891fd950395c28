//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use gnp_data::{Dataset, DatasetNameError, format_of};
use gnp_eval::Protocol;

use crate::config::Setting;

/// GNP: goal-based neural physics for predicting vehicles on motorways.
///
/// Recordings go in (NGSIM or highD, as they are downloaded); a trained model, its intention modes,
/// trajectories with the forces behind them, and a table of errors come out.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, max_term_width = 100)]
#[command(after_help = "\
Examples:
  cargo xtask pipeline --dataset ngsim                 the embedded real NGSIM scenes, everything
  cargo xtask pipeline --dataset highd --data-dir D    a folder of real highD recordings
  cargo xtask eval --run runs/ngsim --data-dir D --out scores
  cargo xtask ci                                       the project's own checks")]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run everything: ingest, modes, goal, attraction, repulsion, evaluation.
    #[command(after_help = "\
Examples:
  cargo xtask pipeline --dataset ngsim
  cargo xtask pipeline --dataset ngsim --out runs/short --set goal.epochs=3 --set modes.modes=40
  cargo xtask pipeline --resume --out runs/short       go on after Ctrl-C or a power cut
  cargo xtask pipeline --config configs/paper/highd.toml --data-dir D --device cuda

Exit code: 0 done, 1 error, 2 wrong use, 130 interrupted (a checkpoint is kept).")]
    Pipeline {
        /// Which run.
        #[command(flatten)]
        run: RunArgs,
        /// On what.
        #[command(flatten)]
        machine: MachineArgs,
    },
    /// Read recordings, report their quality and count their windows: starts a run folder.
    #[command(after_help = "\
Examples:
  cargo xtask ingest --dataset ngsim --out runs/ngsim
  cargo xtask ingest --dataset highd --data-dir D --describe")]
    Ingest {
        /// Which run.
        #[command(flatten)]
        run: RunArgs,
        /// Print which files and columns are read, with their units, and what is found; write nothing.
        #[arg(long)]
        describe: bool,
        /// On what.
        #[command(flatten)]
        machine: MachineArgs,
    },
    /// Split the windows and cluster the futures of the training part into intention modes.
    Modes(StageArgs),
    /// Train the goal network.
    Goal(StageArgs),
    /// Train the goal attraction, the first half of the neural social force.
    Attraction(StageArgs),
    /// Train the repulsion of vehicles and lane lines, the second half.
    Repulsion(StageArgs),
    /// Score the trained model and the baselines on the test part of the run.
    Evaluate(StageArgs),
    /// Score a finished run on other recordings; all of their windows are test windows.
    #[command(after_help = "\
Example:
  cargo xtask eval --run runs/ngsim --data-dir D --out scores")]
    Eval(EvalArgs),
    /// Score anyone's predictions, in the Parquet schema of predictions.parquet, beside constant velocity.
    #[command(after_help = "\
Examples:
  cargo xtask score --predictions theirs.parquet --dataset ngsim --run runs/ngsim --out scores
  cargo xtask score --predictions theirs.parquet --dataset highd --data-dir D --protocol av2

With --run the windows are the run's test part, without it all windows of the data. A file that lacks
a window is refused. docs/architecture.md names the columns.")]
    Score(ScoreArgs),
    /// Train what is missing and score every system on the same windows: the paper's Table 1, ours.
    #[command(after_help = "\
Examples:
  cargo xtask table1 --dataset ngsim
  cargo xtask table1 --dataset highd --data-dir D --out runs/table1-highd
  cargo xtask table1 --dataset ngsim --resume          go on; a finished model is not trained again

Writes table1.md, table1.csv, table1.json, differences.json and the figures table1-*.svg and .png to --out
[default: runs/table1-NAME].")]
    Table1(TableArgs),
    /// Train and score the ablations of GNP: the paper's Table 2, ours.
    #[command(after_help = "\
Example:
  cargo xtask table2 --dataset ngsim --resume")]
    Table2(TableArgs),
    /// Draw the figures of a finished run, as SVG and PNG.
    #[command(after_help = "\
Examples:
  cargo xtask figures --run runs/ngsim
  cargo xtask figures --run runs/ngsim --data-dir D --out figures-of-d")]
    Figures(FigureArgs),
    /// Write report.html of a finished run: what was run, quality, scores, figures, a scene player.
    #[command(after_help = "\
Example:
  cargo xtask report --run runs/ngsim

One file that needs no network: open runs/ngsim/report.html in a browser.")]
    Report(ReportArgs),
    /// Redraw the pictures of docs/gallery.md and README from a run and tables that are there.
    #[command(after_help = "\
Example:
  cargo xtask gallery --run runs/ngsim --table1 runs/table1-ngsim --table2 runs/table2-ngsim

Writes report.html of the run as well. Pictures of the report need Chromium; without it they stay.")]
    Gallery(GalleryArgs),
    /// Write the minute of the scene player as a file for the Rerun viewer; needs a build with the feature `rerun`.
    #[command(after_help = "\
Example:
  cargo run --package xtask --features rerun -- replay --run runs/ngsim --rrd ngsim.rrd
  rerun ngsim.rrd                         the viewer, from `pip install rerun-sdk` of the version that is printed")]
    Replay(ReplayArgs),
    /// Measure speed: ours and the floor; with a flag ratios that gate, a whole frame, or PyTorch and JAX beside it.
    #[command(after_help = "\
Examples:
  cargo xtask bench                       milliseconds per window at the published sizes, and the floor
  cargo xtask bench --check --quick       ratios against configs/bench.toml, as in `cargo xtask ci`
  cargo xtask bench --frame               p50 and p99 of a frame of 25 vehicles on one core
  cargo xtask bench --against-torch --json --threads 2

Exit code: 0 all limits hold, 1 one is missed or an error, 2 wrong use.")]
    Bench(BenchArgs),
    /// Run the project's checks: format, tidy, clippy, docs, ratios of times, tests.
    Ci {
        /// Also check and test what writes files for the Rerun viewer; the first time that compiles for many minutes.
        #[arg(long)]
        rerun: bool,
    },
    /// Check what the compiler cannot: the map in docs/architecture.md, who depends on whom, file headers.
    Tidy,
}

/// Which data, which configuration, where to.
#[derive(Clone, Debug, Args)]
pub(crate) struct RunArgs {
    /// Kind of data; picks configs/ngsim.toml or configs/highd.toml unless --config is given.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) dataset: Option<Dataset>,
    /// Folder (or file) of recordings as downloaded; without it the data embedded in the project is used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// Configuration; every key must be written in it.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Run folder to write [default: runs/ and the name of the configuration].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Go on with an unfinished run folder: finished stages are skipped, a training continues.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Override a key of the configuration, such as goal.epochs=3; repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Setting>,
}

/// A stage of an existing run folder.
#[derive(Clone, Debug, Args)]
pub(crate) struct StageArgs {
    /// The run folder; `cargo xtask ingest` starts one.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Do a finished stage over; stages that build on it must then be run again too.
    #[arg(long)]
    pub(crate) again: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to score, on what, where to.
#[derive(Clone, Debug, Args)]
pub(crate) struct EvalArgs {
    /// The finished run whose model is scored.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Folder (or file) of other recordings of the same kind and rate.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: PathBuf,
    /// Folder for the scores and predictions; must not exist or be empty.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to report on.
#[derive(Clone, Debug, Args)]
pub(crate) struct ReportArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What the gallery is made of.
#[derive(Clone, Debug, Args)]
pub(crate) struct GalleryArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Folder of a finished table1.
    #[arg(long, value_name = "DIR")]
    pub(crate) table1: Option<PathBuf>,
    /// Folder of a finished table2.
    #[arg(long, value_name = "DIR")]
    pub(crate) table2: Option<PathBuf>,
    /// Folder for the pictures [default: docs/pictures]; pictures there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to replay, where to.
#[derive(Clone, Debug, Args)]
pub(crate) struct ReplayArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// File to write; one that is there is replaced.
    #[arg(long, value_name = "FILE")]
    pub(crate) rrd: PathBuf,
    /// Vehicle whose forecasts are shown at first [default: of the test part the one that moves sideways most].
    #[arg(long, value_name = "NUMBER")]
    pub(crate) vehicle: Option<u32>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to draw, where to.
#[derive(Clone, Debug, Args)]
pub(crate) struct FigureArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Folder (or file) of other recordings of the same kind and rate to draw scenes of.
    #[arg(long, value_name = "DIR", requires = "out")]
    pub(crate) data_dir: Option<PathBuf>,
    /// Folder for the figures [default: figures in the run folder]; figures there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to measure.
#[derive(Clone, Copy, Debug, Args)]
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
    /// Run the programs in xtask/peer beside ours; installs them into target/peer-venv.
    #[arg(long, group = "what")]
    pub(crate) against_torch: bool,
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
    /// No progress, only tables.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "give a whole number from 1".to_owned())
}

/// Whose predictions, on which windows.
#[derive(Clone, Debug, Args)]
pub(crate) struct ScoreArgs {
    /// The file.
    #[arg(long, value_name = "FILE")]
    pub(crate) predictions: PathBuf,
    /// Kind of data.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) dataset: Dataset,
    /// A run whose test part is scored on.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["data_dir", "config", "set"])]
    pub(crate) run: Option<PathBuf>,
    /// Folder (or file) of recordings; without it and without --run the data embedded in the project.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// Configuration that says how windows are cut [default: configs/ and the data set's name].
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Override a key of the configuration, such as windows.stride_s=1.0; repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<Setting>,
    /// Protocol; repeatable [default: those of the configuration].
    #[arg(long, value_enum)]
    pub(crate) protocol: Vec<ProtocolName>,
    /// Folder for the scores, which must not exist or be empty; without it they are only printed.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Which table.
#[derive(Clone, Debug, Args)]
pub(crate) struct TableArgs {
    /// Data, configuration of GNP, and folder of the table.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Recipes of the learned baselines [default: configs/neural-baselines.toml]; table2 has none.
    #[arg(long, value_name = "FILE")]
    pub(crate) recipes: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// `--protocol`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProtocolName {
    /// No future input; top-1 and best of 6.
    Clean,
    /// Top-1 at the instant.
    Literature,
    /// Best of 20, averaged up to the horizon.
    Paper,
    /// Metrics of Argoverse 2.
    Av2,
    /// Metrics of nuScenes.
    Nuscenes,
    /// Metrics of Waymo motion.
    Waymo,
}

impl From<ProtocolName> for Protocol {
    fn from(name: ProtocolName) -> Self {
        match name {
            ProtocolName::Clean => Self::Clean,
            ProtocolName::Literature => Self::Literature,
            ProtocolName::Paper => Self::Paper,
            ProtocolName::Av2 => Self::Argoverse2,
            ProtocolName::Nuscenes => Self::NuScenes,
            ProtocolName::Waymo => Self::Waymo,
        }
    }
}

/// The machine, and how much is said.
#[derive(Clone, Debug, Args)]
pub(crate) struct MachineArgs {
    /// Where tensors live; cuda and metal need a build with the feature of that name.
    #[arg(long, value_enum, default_value_t = DeviceName::Cpu)]
    pub(crate) device: DeviceName,
    /// Number of threads [default: all cores]; results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// No progress, only warnings and tables.
    #[arg(long, short)]
    pub(crate) quiet: bool,
    /// Log what the libraries do, on stderr.
    #[arg(long, short, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
}

/// `--dataset`: a dataset whose files can be read.
fn dataset(text: &str) -> Result<Dataset, String> {
    let dataset: Dataset = text.parse().map_err(|error: DatasetNameError| error.to_string())?;
    format_of(dataset).map(|_| dataset).map_err(|error| error.to_string())
}

/// `--device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DeviceName {
    /// The processor.
    Cpu,
    /// The first NVIDIA GPU.
    Cuda,
    /// The GPU of an Apple computer.
    Metal,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn settings_and_flags_are_understood() {
        let cli = Cli::try_parse_from(["xtask", "pipeline", "--dataset", "highd", "--set", "goal.epochs=3", "--quiet"]);
        let Command::Pipeline { run, machine } = cli.unwrap().command else { panic!("not pipeline") };
        assert_eq!(run.dataset, Some(Dataset::HIGHD));
        assert_eq!(run.set, [Setting { key: "goal.epochs".into(), text: "3".into() }]);
        assert!(machine.quiet && machine.device == DeviceName::Cpu);
    }

    #[test]
    fn wrong_use_is_refused() {
        for line in [
            &["xtask"][..],
            &["xtask", "pipeline", "--dataset", "waymo"],
            &["xtask", "goal"],
            &["xtask", "pipeline", "--dataset", "ngsim", "--set", "goal.epochs"],
            &["xtask", "pipeline", "--dataset", "ngsim", "--threads", "0"],
            &["xtask", "bench", "--quick"],
            &["xtask", "bench", "--check", "--frame"],
            &["xtask", "bench", "--check", "--rounds", "2"],
            &["xtask", "bench", "--rounds", "0"],
        ] {
            assert!(Cli::try_parse_from(line).is_err(), "{line:?}");
        }
    }
}
