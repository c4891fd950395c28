//! Arguments of `play`.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::Args;
use gnp_data::Dataset;

use super::{MachineArgs, RoadArgs};
use crate::names::dataset;

/// What is played, where, and for whom.
#[derive(Clone, Debug, Args)]
pub struct PlayArgs {
    /// Model folder, run folder, or name of a model that comes with the program [default: ngsim].
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<PathBuf>,
    /// A file of tracks, or a folder of such files [default: real NGSIM scenes that come with the project].
    #[arg(long, value_name = "PATH")]
    pub(crate) input: Option<PathBuf>,
    /// Format of the tracks [default: the one that fits].
    #[arg(long, value_parser = dataset, value_name = "NAME", requires = "input")]
    pub(crate) format: Option<Dataset>,
    /// On which road.
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// One recording of several [default: all].
    #[arg(long, value_name = "NAME")]
    pub(crate) recording: Option<String>,
    /// Port; 0 for any that is free.
    #[arg(long, value_name = "N", default_value_t = 8017)]
    pub(crate) port: u16,
    /// Address to listen on; with another one than the loopback address others can reach it.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    pub(crate) listen: IpAddr,
    /// Name, with or without a port, under which it may be asked for beside localhost; repeatable.
    #[arg(long, value_name = "NAME")]
    pub(crate) allow_host: Vec<String>,
    /// Origin, such as https://example.org, whose pages may ask; repeatable.
    #[arg(long, value_name = "ORIGIN")]
    pub(crate) allow_origin: Vec<String>,
    /// Most vehicles of a scene.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) max_vehicles: u32,
    /// Largest body of a request, KiB.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub(crate) max_body_kb: u32,
    /// Requests a second that a client may make.
    #[arg(long, value_name = "N", default_value_t = 5000, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) rate: u32,
    /// Forecasts that are worked on at once [default: all cores].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) jobs: Option<u16>,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}
