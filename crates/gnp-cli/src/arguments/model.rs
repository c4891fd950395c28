//! Arguments of the commands that use a trained model.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use gnp::{AddedCar, At};
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::{Place, added, dataset, moved, place, positive_seconds, speed};

/// Which tracks to predict, when, where to.
#[derive(Clone, Debug, Args)]
pub struct PredictArgs {
    /// A file of tracks, or a folder of such files.
    #[arg(long, value_name = "PATH")]
    pub(crate) input: PathBuf,
    /// NAME.parquet for one file, which is replaced, or a folder for a file a recording.
    #[arg(long, value_name = "PATH")]
    pub(crate) output: PathBuf,
    /// Model folder, run folder, or name of a model that comes with the program [default: ngsim].
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<PathBuf>,
    /// Format of the tracks [default: the one that fits].
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) format: Option<Dataset>,
    /// On which road.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// When: last (the last frame of a recording), every (a second apart, or --every), or times in s such as 12.5 or 10,20.
    #[arg(long, value_name = "WHEN", default_value = "last", allow_hyphen_values = true)]
    pub(crate) at: At,
    /// Seconds from one moment to the next; implies --at every.
    #[arg(long, value_name = "S", value_parser = positive_seconds, conflicts_with = "at")]
    pub(crate) every: Option<f64>,
    /// Futures a vehicle [default: as the model's card says].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) k: Option<u16>,
    /// Pieces of work at once, each on a thread of its own [default: all cores]; the output does not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) jobs: Option<u16>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// What to explain, what to change, where to.
#[derive(Clone, Debug, Args)]
#[command(group = ArgGroup::new("of").args(["run", "input"]).required(true))]
pub struct ExplainArgs {
    /// The trained run, one of whose forecasts is explained.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: Option<PathBuf>,
    /// Instead of a run: a file of tracks, or a folder of such files.
    #[arg(long, value_name = "PATH")]
    pub(crate) input: Option<PathBuf>,
    /// Model for the tracks: model folder, run folder, or name of one that comes with the program [default: ngsim].
    #[arg(long, value_name = "MODEL", requires = "input", conflicts_with = "run")]
    pub(crate) model: Option<PathBuf>,
    /// Format of the tracks [default: the one that fits].
    #[arg(long, value_parser = dataset, value_name = "NAME", requires = "input", conflicts_with = "run")]
    pub(crate) format: Option<Dataset>,
    /// On which road, of tracks.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Recording of the vehicle [default: any].
    #[arg(long, value_name = "NAME")]
    pub(crate) recording: Option<String>,
    /// The vehicle, by its number, or of tracks by its name [default: one that its leader moves far].
    #[arg(long, value_name = "VEHICLE")]
    pub(crate) vehicle: Option<String>,
    /// Of a run the last observed frame [default: of the vehicle's windows the one in which a leader moves it most]; of
    /// tracks the time, s [default: the last of the vehicle].
    #[arg(long, value_name = "FRAME|S", allow_hyphen_values = true)]
    pub(crate) at: Option<f64>,
    /// Leave a vehicle out of the scene; repeatable.
    #[arg(long, value_name = "NUMBER")]
    pub(crate) without: Vec<u32>,
    /// Give a vehicle another speed, such as 549=5 for 5 m/s; repeatable.
    #[arg(long, value_name = "NUMBER=MPS", value_parser = speed)]
    pub(crate) speed: Vec<(u32, f32)>,
    /// Put a vehicle elsewhere, such as 549=-10,3.5 for 10 m back and 3.5 m to the left, its past with it; repeatable.
    #[arg(long = "move", value_name = "NUMBER=DX,DY", value_parser = moved)]
    pub(crate) moved: Vec<(u32, [f32; 2])>,
    /// Add a car, such as 20,0,12 for one 20 m ahead of where the vehicle is, 0 m to the left, at 12 m/s; repeatable.
    #[arg(long, value_name = "X,Y,MPS", value_parser = added, allow_hyphen_values = true)]
    pub(crate) add: Vec<AddedCar>,
    /// Switch a term of the force off, such as neighbours; repeatable.
    #[arg(long, value_name = "NAME")]
    pub(crate) without_term: Vec<String>,
    /// Draw the vehicle to a place, m ahead and to the left of where it is, instead of where the network expects it.
    #[arg(long, value_name = "X,Y", value_parser = place, allow_hyphen_values = true)]
    pub(crate) goal: Option<Place>,
    /// Folder for the figures [default: in explain/ of the run folder; of tracks explain/]; figures there are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print JSON, with every step, instead of the table.
    #[arg(long)]
    pub(crate) json: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Which model to write, where to.
#[derive(Clone, Debug, Args)]
pub struct ExportArgs {
    /// The trained run.
    #[arg(long, value_name = "DIR")]
    pub(crate) run: PathBuf,
    /// The model folder to make; must not exist or be empty.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Name of the model [default: that of the run folder].
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// TOML with what its makers say of it: title, licence, limits, scores.
    #[arg(long, value_name = "FILE")]
    pub(crate) card: Option<PathBuf>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// Which model.
#[derive(Clone, Debug, Args)]
pub struct InfoArgs {
    /// Model folder, run folder, or name of a model that comes with the program [default: ngsim].
    #[arg(value_name = "MODEL")]
    pub(crate) model: Option<PathBuf>,
    /// Print the card as JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}
