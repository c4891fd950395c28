//! Arguments of `convert`.

use std::path::PathBuf;

use clap::Args;
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::dataset;

/// From what to what.
#[derive(Clone, Debug, Args)]
pub struct ConvertArgs {
    /// File or folder of tracks.
    #[arg(long, value_name = "PATH")]
    pub(crate) input: PathBuf,
    /// Format of the input [default: told by what is in it].
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) from: Option<Dataset>,
    /// Format to write.
    #[arg(long, value_parser = dataset, value_name = "NAME")]
    pub(crate) to: Dataset,
    /// File for one recording, with an ending of its format; else a folder, with a file for each recording. Files of these
    /// names are replaced.
    #[arg(long, value_name = "PATH")]
    pub(crate) output: PathBuf,
    /// On which road, for NGSIM and highD.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}
