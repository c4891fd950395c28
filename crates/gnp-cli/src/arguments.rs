//! The commands and their arguments.

mod convert;
mod explain;
mod model;
mod play;
mod road;
mod tables;
mod traffic;

use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand, ValueEnum};
use gnp::{Setting, Stage};
use gnp_data::Dataset;

pub(crate) use self::convert::ConvertArgs;
pub(crate) use self::explain::ExplainArgs;
pub(crate) use self::model::{ExportArgs, InfoArgs, PredictArgs};
pub(crate) use self::play::PlayArgs;
pub(crate) use self::road::RoadArgs;
pub(crate) use self::tables::{CompareArgs, TableArgs};
pub(crate) use self::traffic::{MeasureArgs, RealismArgs, SimulateArgs};
use crate::names::{DeviceName, ProtocolName, dataset};

/// The commands.
#[derive(Debug, Subcommand)]
#[non_exhaustive]
pub enum Command {
    /// Do everything: ingest, train, evaluate, figures, report.
    #[command(after_help = "\
Examples:
  gnp pipeline --dataset ngsim
  gnp pipeline --dataset ngsim --out runs/short --set goal.epochs=3 --set modes.modes=40
  gnp pipeline --resume --out runs/short       go on after Ctrl-C or a power cut
  gnp pipeline --from runs/ngsim --data-dir D --out runs/d --set goal.learning_rate=2e-4   fine-tune on other recordings
  gnp pipeline --config paper/highd --data-dir D --device cuda

Exit code: 0 done, 1 error, 2 wrong use, 130 interrupted (a checkpoint is kept).")]
    Pipeline(PipelineArgs),
    /// Read recordings, report their quality and count their windows: starts a run folder.
    #[command(after_help = "\
Examples:
  gnp ingest --dataset ngsim --out runs/ngsim
  gnp ingest --dataset highd --data-dir D --describe")]
    Ingest(IngestArgs),
    /// Find the intention modes and train the networks of a run, or one stage of that.
    #[command(after_help = "\
Examples:
  gnp train --run runs/ngsim
  gnp train --run runs/ngsim --stage goal --again
  gnp train --run runs/d --from runs/ngsim     fine-tune on the recordings of runs/d

modes: split the windows and cluster the futures of the training part. goal: the goal network.
attraction and repulsion: the two halves of the neural social force.")]
    Train(TrainArgs),
    /// Find the intention modes: `train --stage modes`.
    #[command(hide = true)]
    Modes(StageArgs),
    /// Train the goal network: `train --stage goal`.
    #[command(hide = true)]
    Goal(StageArgs),
    /// Train the goal attraction: `train --stage attraction`.
    #[command(hide = true)]
    Attraction(StageArgs),
    /// Train the repulsion: `train --stage repulsion`.
    #[command(hide = true)]
    Repulsion(StageArgs),
    /// Score a trained run on its own windows or on other recordings, or score anybody's predictions.
    #[command(aliases = ["eval", "score"])]
    #[command(after_help = "\
Examples:
  gnp evaluate --run runs/ngsim                          on the windows that its split left for testing
  gnp evaluate --run runs/ngsim --data-dir D --out scores
  gnp evaluate --predictions theirs.parquet --run runs/ngsim --out scores
  gnp evaluate --predictions theirs.parquet --dataset highd --data-dir D --protocol av2

A file of predictions is in the Parquet schema of predictions.parquet and is scored beside constant
velocity. With --run the windows are those that the run is evaluated on, without it all windows of the data. A file
that lacks a window, or has vehicles that are not in the data, is refused.")]
    Evaluate(EvaluateArgs),
    /// Train what is missing and score every system on the same windows: the paper's Table 1, ours.
    #[command(alias = "table1")]
    #[command(after_help = "\
Examples:
  gnp compare --dataset ngsim
  gnp compare --dataset highd --data-dir D --out runs/table1-highd
  gnp compare --dataset ngsim --resume         go on; a finished model is not trained again
  gnp compare --dataset ngsim --seeds 3        all that is learned three times; intervals over drivers and seeds
  gnp compare --dataset ngsim --resume --published   add a row for GNP as published, which trains long

Its trainings are jobs that need no other, here or on other machines that see the folder:
  gnp compare --dataset ngsim --out T --plan           prepare T, list the jobs
  gnp compare --out T --job fold-2/cs_lstm/seed-0      do one
  gnp compare --out T --gather                         the table, once all are done
  gnp compare --out T --resume                         all that are left, then the table

Writes table1.md, table1.csv, table1.json, differences.json and the figures table1-*.svg and .png to --out
[default: runs/table1-NAME].")]
    Compare(CompareArgs),
    /// Train and score the ablations of GNP: the paper's Table 2, ours.
    #[command(alias = "table2")]
    #[command(after_help = "\
Example:
  gnp ablate --dataset ngsim --resume")]
    Ablate(TableArgs),
    /// Draw the figures of a finished run, as SVG and PNG.
    #[command(after_help = "\
Examples:
  gnp figures --run runs/ngsim
  gnp figures --run runs/ngsim --data-dir D --out figures-of-d")]
    Figures(FigureArgs),
    /// Predict every vehicle of some tracks, also where no future is recorded: tracks in, forecasts with forces out.
    #[command(after_help = "\
Examples:
  gnp predict --input tracks.csv --output forecasts.parquet       in the last frame, by the model that comes with the program
  gnp predict --input tracks.csv --output forecasts.parquet --at 12.5
  gnp predict --input D --output forecasts --every 0.5 --model runs/d   a folder of recordings: a file for each

What is done of an interrupted prediction is kept beside the output; the same command again goes on with it.")]
    Predict(PredictArgs),
    /// Write the trained model of a run as a folder of its own, which needs no recordings: weights and a card.
    #[command(after_help = "\
Examples:
  gnp export --run runs/d --out models/d
  gnp export --run runs/d --out models/d --name motorway-d --card words.toml

words.toml has title, licence, limits (a list of sentences) and, if they are not those of the run, [scores].")]
    Export(ExportArgs),
    /// Say what a model is: data, settings, scores, limits, licence.
    #[command(after_help = "\
Examples:
  gnp info                     the model that comes with the program
  gnp info runs/ngsim --json   that of a run")]
    Info(InfoArgs),
    /// Say what is behind one forecast, cause by cause, and what it would be in a changed scene.
    #[command(after_help = "\
Examples:
  gnp explain --run runs/ngsim                                a forecast in which a leader moves the vehicle far
  gnp explain --run runs/ngsim --vehicle 554 --at 1200
  gnp explain --run runs/ngsim --vehicle 554 --without 549    the same beside the scene without vehicle 549
  gnp explain --run runs/ngsim --vehicle 554 --speed 549=5 --json
  gnp explain --run runs/ngsim --vehicle 554 --move 549=-10,0 with vehicle 549 10 m farther back
  gnp explain --run runs/ngsim --vehicle 554 --add 20,0,12    with a car 20 m ahead, at 12 m/s
  gnp explain --run runs/ngsim --vehicle 554 --add 20,0,12 --watch \"new 1\"   why that car itself goes where
  gnp explain --run runs/ngsim --vehicle 554 --goal 60,-3.6   drawn to 60 m ahead and 3.6 m to the right
  gnp explain --input tracks.csv --vehicle 7 --at 12.5        of tracks, by the model that comes with the program
  gnp explain --input fcd.xml --vehicle flow.3 --without flow.2   vehicles are called as the file calls them

Prints a table of displacements in m by cause, which add up to the predicted path, and a sentence; writes the figures
contributions and what-if, as SVG and PNG, to --out.")]
    Explain(Box<ExplainArgs>),
    /// Play recordings in the browser and change what is there: forecasts of every vehicle answer at once; the same by HTTP.
    #[command(after_help = "\
Examples:
  gnp play                                     the real scenes that come with the project, at http://127.0.0.1:8017/
  gnp play --input tracks.csv --port 0         tracks of your own, at any port that is free
  gnp play --recording us101-10_1 --model runs/d

Only this computer can reach it unless --listen says otherwise. Ctrl-C ends it. The HTTP API is described by /openapi.json
and docs/play.md.")]
    Play(Box<PlayArgs>),
    /// Write report.html of a finished run: what was run, quality, scores, figures, a scene player.
    #[command(after_help = "\
Example:
  gnp report --run runs/ngsim

One file that needs no network: open runs/ngsim/report.html in a browser.")]
    Report(ReportArgs),
    /// Drive a scene: traffic by a file that says road, drivers and demand; measure and draw what happens.
    #[command(after_help = "\
Examples:
  gnp simulate ring                            a scene that comes with the program: ring, lane-drop, motorway
  gnp simulate --print lane-drop > my.toml     a scene to start from
  gnp simulate my.toml --out runs/my --seed 1 --seed 2 --fcd
  gnp simulate --dataset ngsim --recording us101-24_1 --fitted     drive on from a recorded scene
  gnp simulate --dataset ngsim --run runs/ngsim                            with a trained run as driver

Writes to --out the scene, tracks.parquet, happenings.csv, detectors.csv, cells.csv, conflicts.csv, summary.json, figures
and report.html with a player; with --fcd SUMO's floating car data. The same scene and seed give the same files.")]
    Simulate(SimulateArgs),
    /// Measure recordings as traffic engineers do: flow, density, waves, conflicts, lane changes, distributions.
    #[command(after_help = "\
Examples:
  gnp measure --dataset ngsim
  gnp measure --dataset highd --data-dir D --out measured
  gnp measure --dataset sumo --data-dir fcd.xml --road centre-line.csv     of any format and rate, along its road

Writes a folder for each recording, with the same tables, figures and page as `simulate`.")]
    Measure(MeasureArgs),
    /// Ask how real closed-loop traffic is: systems drive on from recorded scenes, and are scored beside what happened.
    #[command(after_help = "\
Examples:
  gnp realism --dataset ngsim
  gnp realism --dataset ngsim --run t1/fold-1/gnp --run t1/fold-2/gnp --run t1/fold-3/gnp
  gnp realism --dataset ngsim --sumo scenes    writes scenes for SUMO, and scores its courses once they are there

Drivers are fitted to other vehicles than those they drive; a trained run drives only vehicles it was not trained on, which
takes the runs of all folds of `compare`. Writes realism.md, .csv and .json to --out.")]
    Realism(RealismArgs),
    /// Write tracks in another format: highD, NGSIM, plain tracks, SUMO's floating car data, Argoverse 2.
    #[command(after_help = "\
Examples:
  gnp convert --input 03_tracks.csv --to tracks --output 03.parquet
  gnp convert --input fcd.xml --to tracks --output tracks.csv       SUMO's floating car data as plain tracks
  gnp convert --input D --from ngsim --to sumo --output fcd         a folder, a file for each recording
  gnp convert --input tracks.csv --to highd --output D

Formats: ngsim (.csv with commas, .txt without a header), highd (three files a recording), tracks (.csv, .parquet), sumo
(.xml, and vehicle types in .add.xml beside), av2 (scenarios of 11 s). Text is packed where the name ends with .gz.
Prints what was left out in reading, and what the format written does not hold. NGSIM and highD lie along a road: for one
that curves give --road.")]
    Convert(ConvertArgs),
    /// Write the minute of the scene player as a file for the Rerun viewer; needs a build with the feature `rerun`.
    #[command(after_help = "\
Example:
  gnp replay --run runs/ngsim --rrd ngsim.rrd
  rerun ngsim.rrd                         the viewer, from `pip install rerun-sdk` of the version that is printed")]
    Replay(ReplayArgs),
}

/// A whole run.
#[derive(Clone, Debug, Args)]
pub struct PipelineArgs {
    /// Which run.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Start from the modes, feature statistics and weights of this finished run (fine-tuning); without --config its
    /// configuration is taken, too.
    #[arg(long, value_name = "RUN")]
    pub(crate) from: Option<PathBuf>,
    /// Print all tables of scores at the end, as in metrics.md.
    #[arg(long)]
    pub(crate) tables: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Recordings to read.
#[derive(Clone, Debug, Args)]
pub struct IngestArgs {
    /// Which run.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Print which files and columns are read, with their units, and what is found; write nothing.
    #[arg(long)]
    pub(crate) describe: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Which data, which configuration, where to.
#[derive(Clone, Debug, Args)]
pub(crate) struct RunArgs {
    /// Kind of data; picks the configuration of that name unless --config is given.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) dataset: Option<Dataset>,
    /// Folder (or file) of recordings as downloaded; without it the data embedded in the project is used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// Configuration: a file, in which every key must be written, or the name of one that comes with the program, such as
    /// ngsim or paper/highd.
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
    /// On which road.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
}

/// What to train.
#[derive(Clone, Debug, Args)]
pub struct TrainArgs {
    /// One stage instead of all that are not finished.
    #[arg(long, value_enum)]
    pub(crate) stage: Option<StageName>,
    /// Start from the modes, feature statistics and weights of this finished run (fine-tuning).
    #[arg(long, value_name = "RUN")]
    pub(crate) from: Option<PathBuf>,
    /// Where.
    #[command(flatten)]
    pub(crate) on: StageArgs,
}

/// `--stage`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StageName {
    /// The split and the intention modes.
    Modes,
    /// The goal network.
    Goal,
    /// The goal attraction.
    Attraction,
    /// The repulsion of vehicles and lane lines.
    Repulsion,
}

impl From<StageName> for Stage {
    fn from(name: StageName) -> Self {
        match name {
            StageName::Modes => Self::Modes,
            StageName::Goal => Self::Goal,
            StageName::Attraction => Self::Attraction,
            StageName::Repulsion => Self::Repulsion,
        }
    }
}

/// A stage of an existing run folder.
#[derive(Clone, Debug, Args)]
pub struct StageArgs {
    /// The run folder; `gnp ingest` starts one.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// Do what is finished over; stages that build on it must then be run again too.
    #[arg(long)]
    pub(crate) again: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to score, on what, where to.
#[derive(Clone, Debug, Args)]
#[command(group = ArgGroup::new("what").args(["run", "predictions"]).required(true).multiple(true))]
pub struct EvaluateArgs {
    /// The trained run: its model is scored, or others' predictions on the windows it is evaluated on.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: Option<PathBuf>,
    /// Predictions to score instead of a model's.
    #[arg(long, value_name = "FILE")]
    pub(crate) predictions: Option<PathBuf>,
    /// Folder (or file) of other recordings to score on.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// On which road, where it is not that of the run.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Folder for scores on other recordings or of others' predictions; must not exist or be empty.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Kind of data that the predictions are for.
    #[arg(long, value_parser = dataset, value_name = "NAME", requires = "predictions")]
    pub(crate) dataset: Option<Dataset>,
    /// Configuration that says how windows are cut for predictions [default: that of the data set].
    #[arg(long, value_name = "FILE", requires = "predictions", conflicts_with = "run")]
    pub(crate) config: Option<PathBuf>,
    /// Override a key of that configuration, such as windows.stride_s=1.0; repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "predictions", conflicts_with = "run")]
    pub(crate) set: Vec<Setting>,
    /// Protocol for predictions; repeatable [default: those of the configuration].
    #[arg(long, value_enum, requires = "predictions")]
    pub(crate) protocol: Vec<ProtocolName>,
    /// Score the run's own windows over.
    #[arg(long, conflicts_with_all = ["predictions", "data_dir"])]
    pub(crate) again: bool,
    /// Print all tables, as in metrics.md; those of predictions are always printed.
    #[arg(long, conflicts_with = "predictions")]
    pub(crate) tables: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to report on.
#[derive(Clone, Debug, Args)]
pub struct ReportArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to replay, where to.
#[derive(Clone, Debug, Args)]
pub struct ReplayArgs {
    /// The finished run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// File to write; one that is there is replaced.
    #[arg(long, value_name = "FILE")]
    pub(crate) rrd: PathBuf,
    /// Vehicle whose forecasts are shown at first [default: of the evaluated ones the one that moves sideways most].
    #[arg(long, value_name = "NUMBER")]
    pub(crate) vehicle: Option<u32>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to draw, where to.
#[derive(Clone, Debug, Args)]
pub struct FigureArgs {
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

/// The machine, and how much is said.
#[derive(Clone, Debug, Args)]
pub struct MachineArgs {
    /// Where tensors live; cuda and metal need a build with the feature of that name.
    #[arg(long, value_enum, default_value_t = DeviceName::Cpu)]
    pub(crate) device: DeviceName,
    /// Number of threads [default: all cores]; results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// No progress, only warnings and tables.
    #[arg(long, short)]
    pub(crate) quiet: bool,
    /// Log what the libraries do, on stderr.
    #[arg(long, short, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(subcommand)]
        command: Command,
    }

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn settings_and_flags_are_understood() {
        let cli = Cli::try_parse_from(["gnp", "pipeline", "--dataset", "highd", "--set", "goal.epochs=3", "--quiet"]);
        let Command::Pipeline(PipelineArgs { run, machine, .. }) = cli.unwrap().command else { panic!("not pipeline") };
        assert_eq!(run.dataset, Some(Dataset::HIGHD));
        assert_eq!(run.set, [Setting { key: "goal.epochs".into(), text: "3".into() }]);
        assert!(machine.quiet && machine.device == DeviceName::Cpu);
    }

    #[test]
    fn what_a_scene_file_does_not_need_is_refused_beside_one() {
        for line in [
            "gnp simulate ring --at 5",
            "gnp simulate ring --seconds 5",
            "gnp simulate ring --fitted",
            "gnp simulate ring --run r",
            "gnp simulate ring --dataset ngsim",
            "gnp simulate --dataset ngsim --fitted --run r",
            "gnp simulate --print ring --fcd",
            "gnp simulate",
        ] {
            assert!(Cli::try_parse_from(line.split(' ')).is_err(), "{line}");
        }
        for line in ["gnp simulate ring --seed 1 --seed 2 --fcd", "gnp simulate --dataset ngsim --at 5 --fitted"] {
            assert!(Cli::try_parse_from(line.split(' ')).is_ok(), "{line}");
        }
    }

    #[test]
    fn the_published_model_is_asked_for_with_a_configuration_or_without() {
        let published = |words: &[&str]| {
            let line = ["gnp", "compare", "--dataset", "ngsim"].iter().chain(words);
            let Command::Compare(args) = Cli::try_parse_from(line).unwrap().command else { panic!("not compare") };
            args.published
        };
        assert_eq!(published(&[]), None);
        assert_eq!(published(&["--published", "--resume"]), Some(None));
        assert_eq!(published(&["--published=a.toml"]), Some(Some("a.toml".into())));
    }

    #[test]
    fn earlier_names_are_understood() {
        for line in [
            &["gnp", "goal", "--run", "a", "--again"][..],
            &["gnp", "eval", "--run", "a", "--data-dir", "d", "--out", "o"],
            &["gnp", "score", "--predictions", "f", "--dataset", "ngsim", "--run", "a", "--protocol", "clean"],
            &["gnp", "score", "--predictions", "f", "--dataset", "highd", "--config", "c", "--set", "a.b=1"],
            &["gnp", "table1", "--dataset", "ngsim", "--recipes", "r"],
            &["gnp", "table2", "--dataset", "ngsim", "--resume"],
        ] {
            assert!(Cli::try_parse_from(line).is_ok(), "{line:?}");
        }
    }

    #[test]
    fn wrong_use_is_refused() {
        for line in [
            &["gnp"][..],
            &["gnp", "pipeline", "--dataset", "waymo"],
            &["gnp", "goal"],
            &["gnp", "pipeline", "--dataset", "ngsim", "--set", "goal.epochs"],
            &["gnp", "pipeline", "--dataset", "ngsim", "--threads", "0"],
            &["gnp", "pipeline", "--dataset", "ngsim", "--threads", "65535"],
            &["gnp", "compare", "--dataset", "ngsim", "--seeds", "65535"],
            &["gnp", "compare", "--dataset", "ngsim", "--workers", "65535"],
            &["gnp", "realism", "--dataset", "ngsim", "--roll-outs", "65535"],
            &["gnp", "simulate", "--dataset", "ngsim", "--seconds", "1e30"],
            &["gnp", "simulate", "--dataset", "ngsim", "--at", "nan"],
            &["gnp", "predict", "--input", "a"],
            &["gnp", "predict", "--input", "a", "--output", "b", "--at", "soon"],
            &["gnp", "predict", "--input", "a", "--output", "b", "--every", "0"],
            &["gnp", "predict", "--input", "a", "--output", "b", "--every", "2", "--at", "last"],
            &["gnp", "evaluate"],
            &["gnp", "evaluate", "--run", "a", "--protocol", "av2"],
            &["gnp", "evaluate", "--run", "a", "--data-dir", "d", "--again"],
            &["gnp", "train", "--run", "a", "--stage", "evaluate"],
            &["gnp", "ablate", "--dataset", "ngsim", "--recipes", "r"],
            &["gnp", "ablate", "--dataset", "ngsim", "--published"],
            &["gnp", "ablate", "--dataset", "ngsim", "--seeds", "2"],
            &["gnp", "compare", "--dataset", "ngsim", "--from", "r"],
            &["gnp", "compare", "--job", "fold-1/gnp/seed-0"],
            &["gnp", "compare", "--out", "t", "--job", "fold-1/gnp/seed-0", "--seeds", "2"],
            &["gnp", "compare", "--out", "t", "--job", "fold-1/gnp/seed-0", "--gather"],
            &["gnp", "compare", "--out", "t", "--gather", "--set", "goal.epochs=3"],
            &["gnp", "compare", "--dataset", "ngsim", "--json"],
            &["gnp", "compare", "--dataset", "ngsim", "--allow-missing"],
            &["gnp", "compare", "--dataset", "ngsim", "--workers", "0"],
        ] {
            assert!(Cli::try_parse_from(line).is_err(), "{line:?}");
        }
    }
}
