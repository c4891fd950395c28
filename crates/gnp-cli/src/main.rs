//! The program `gnp`: the pipeline from recordings to scored trajectories. `gnp --help` lists the commands.

use std::process::ExitCode;

use clap::Parser;
use gnp_cli::{Command, Program};

/// GNP: goal-based neural physics for predicting vehicles on motorways.
///
/// Recordings go in (NGSIM or highD, as they are downloaded); a trained model, its intention modes,
/// trajectories with the forces behind them, and a table of errors come out.
#[derive(Debug, Parser)]
#[command(name = "gnp", version, max_term_width = 100)]
#[command(after_help = "\
Examples:
  gnp pipeline --dataset highd --data-dir D    a folder of highD recordings, everything
  gnp evaluate --run runs/highd --data-dir E --out scores")]
struct Cli {
    /// What to do.
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    gnp_cli::run(&Cli::parse().command, &Program::default())
}
