//! Arguments of the commands about traffic.

use std::path::PathBuf;

use clap::Args;
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::{dataset, seconds};

/// What to simulate.
#[derive(Clone, Debug, Args)]
pub struct SimulateArgs {
    /// A scene file, or the name of a scene that comes with the program.
    #[arg(value_name = "SCENE", required_unless_present_any = ["print", "dataset"])]
    pub(crate) scene: Option<String>,
    /// Folder to write [default: runs/ and the name of the scene]; files there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// From which chance comes; repeatable [default: those of the scene].
    #[arg(long, value_name = "NUMBER")]
    pub(crate) seed: Vec<u64>,
    /// Write SUMO's floating car data as well, fcd.xml, which is large.
    #[arg(long)]
    pub(crate) fcd: bool,
    /// Print a scene that comes with the program, and do nothing else.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["scene", "out", "seed", "fcd", "dataset"])]
    pub(crate) print: Option<String>,
    /// Instead of a scene: drive on from a recording of this kind, everybody but the foremost, whose motion is recorded.
    #[arg(long, value_parser = dataset, value_name = "NAME", conflicts_with = "scene")]
    pub(crate) dataset: Option<Dataset>,
    /// Folder (or file) of recordings [default: those embedded in the project].
    #[arg(long, value_name = "DIR", requires = "dataset", conflicts_with = "scene")]
    pub(crate) data_dir: Option<PathBuf>,
    /// On which road, of recordings.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Which recording [default: the one with most rows].
    #[arg(long, value_name = "NAME", requires = "dataset", conflicts_with = "scene")]
    pub(crate) recording: Option<String>,
    /// When to start, s after the first frame that has 3 s of past.
    #[arg(long, value_name = "SECONDS", default_value_t = 0., value_parser = seconds, requires = "dataset", conflicts_with = "scene")]
    pub(crate) at: f64,
    /// How long to drive at most, s; no longer than is recorded.
    #[arg(long, value_name = "SECONDS", default_value_t = 30., value_parser = seconds, requires = "dataset", conflicts_with = "scene")]
    pub(crate) seconds: f64,
    /// Draw drivers fitted to the other vehicles of the site, those more often who explain the 3 s before the start
    /// [default: standard drivers of the intelligent driver model].
    #[arg(long, requires = "dataset", conflicts_with_all = ["scene", "run"])]
    pub(crate) fitted: bool,
    /// Drive with a trained run, which predicts anew every half second and draws among its futures; one that was trained on
    /// these vehicles is not tested by that.
    #[arg(long, value_name = "DIR", requires = "dataset", conflicts_with = "scene")]
    pub(crate) run: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Which systems drive on from what.
#[derive(Clone, Debug, Args)]
pub struct RealismArgs {
    /// Kind of data.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) dataset: Dataset,
    /// Folder (or file) of recordings as downloaded; without it the data embedded in the project is used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// A trained run as one more system; repeatable, for runs of several folds.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: Vec<PathBuf>,
    /// Folder of scenes for SUMO: they are written there, and its courses read from there.
    #[arg(long, value_name = "DIR")]
    pub(crate) sumo: Option<PathBuf>,
    /// Roll-outs of a scene by a system that draws.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) roll_outs: u16,
    /// Folder to write [default: runs/realism-NAME].
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to measure.
#[derive(Clone, Debug, Args)]
pub struct MeasureArgs {
    /// Kind of data.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) dataset: Dataset,
    /// Folder (or file) of recordings as downloaded; without it the data embedded in the project is used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data_dir: Option<PathBuf>,
    /// On which road.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Folder to write [default: runs/measured-NAME]; files there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}
