//! Arguments of the commands that use a trained model.

use std::path::PathBuf;

use clap::Args;
use gnp::{At, Precision};
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::{dataset, positive_seconds};

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
    /// What the force's networks multiply in: f32, or bf16, which takes a processor with AVX512-BF16 and rounds what is multiplied
    /// to 8 bits: faster, and paths differ by millimetres [default: f32, or as the run says].
    #[arg(long, value_name = "P")]
    pub(crate) precision: Option<Precision>,
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
