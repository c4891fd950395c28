//! Arguments of the tables: comparison and ablations.

use std::path::PathBuf;

use clap::Args;

use super::{MachineArgs, RunArgs};

/// Which table.
#[derive(Clone, Debug, Args)]
pub struct TableArgs {
    /// Data, configuration of GNP, and folder of the table.
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// On what.
    #[command(flatten)]
    pub(crate) machine: MachineArgs,
}

/// The table of all systems.
#[derive(Clone, Debug, Args)]
pub struct CompareArgs {
    /// Which table.
    #[command(flatten)]
    pub(crate) table: TableArgs,
    /// Recipes of the neural baselines [default: those of configs/neural-baselines.toml].
    #[arg(long, value_name = "FILE")]
    pub(crate) recipes: Option<PathBuf>,
    /// Seeds that everything learned is trained with, from that of the configuration on [default: 1]; a row is the mean
    /// over them, and intervals draw them. GNP as published is trained with the first alone.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) seeds: Option<u16>,
    /// Also train GNP as published on the same windows: as this configuration says [default: paper/NAME].
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(clippy::option_option, reason = "absent, given, given with a file")]
    pub(crate) published: Option<Option<PathBuf>>,
    /// Trainings at a time, each on one thread [default: as many as there are threads]; results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) workers: Option<u16>,
    /// Prepare the folder, print its jobs and how far each is, and end there. A folder that is prepared is listed.
    #[arg(long, group = "step", conflicts_with = "workers")]
    pub(crate) plan: bool,
    /// With --plan: print the jobs as JSON.
    #[arg(long, requires = "plan")]
    pub(crate) json: bool,
    /// Do one job of the prepared folder --out, such as fold-2/cs_lstm/seed-0, and nothing else.
    #[arg(long, value_name = "ID", group = "step", requires = "out", conflicts_with_all = PREPARING)]
    pub(crate) job: Option<String>,
    /// Score what is trained in the prepared folder --out and write the table.
    #[arg(long, group = "step", requires = "out", conflicts_with_all = PREPARING)]
    pub(crate) gather: bool,
    /// With --gather: leave rows out that are not trained yet, and say so in the table.
    #[arg(long, requires = "gather")]
    pub(crate) allow_missing: bool,
}

/// What only preparation reads; a prepared folder has its own.
const PREPARING: [&str; 11] =
    ["dataset", "data_dir", "config", "set", "road", "lines", "resume", "recipes", "seeds", "published", "workers"];
