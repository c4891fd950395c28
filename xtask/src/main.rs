//! The command line of GNP: the pipeline from recordings to scored trajectories, and the project's
//! own checks. `cargo xtask --help` lists the commands.

mod bench;
mod ci;
mod cli;
mod clip;
mod config;
mod describe;
mod evaluate;
mod figures;
mod gallery;
mod ingest;
mod memory;
mod modes;
mod pipeline;
mod project;
mod replay;
mod report;
mod run_folder;
mod score_file;
mod score_run;
mod session;
mod source;
mod stop;
mod tables;
mod terminal;
mod tidy;
mod training;

use std::process::ExitCode;

use anyhow::Result;
use clap::Parser as _;

use crate::cli::{Cli, Command, StageArgs};
use crate::run_folder::Stage;
use crate::terminal::Terminal;

fn main() -> ExitCode {
    match dispatch(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<stop::Interrupted>() => {
            eprintln!("{error:#}");
            ExitCode::from(stop::EXIT_CODE)
        }
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn dispatch(command: Command) -> Result<()> {
    match command {
        Command::Pipeline { run, machine } => pipeline::run(&run, &machine),
        Command::Ingest { run, describe: true, machine } => {
            describe::run(&run, &Terminal::start(machine.quiet, machine.verbose))
        }
        Command::Ingest { run, machine, .. } => pipeline::ingest_only(&run, &machine),
        Command::Modes(args) => stage(&args, Stage::Modes),
        Command::Goal(args) => stage(&args, Stage::Goal),
        Command::Attraction(args) => stage(&args, Stage::Attraction),
        Command::Repulsion(args) => stage(&args, Stage::Repulsion),
        Command::Evaluate(args) => stage(&args, Stage::Evaluate),
        Command::Eval(args) => score_run::run(&args),
        Command::Score(args) => score_file::run(&args),
        Command::Table1(args) => tables::table1(&args),
        Command::Table2(args) => tables::table2(&args),
        Command::Figures(args) => figures::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Gallery(args) => gallery::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Bench(args) => bench::run(&args, &Terminal::start(args.quiet, false)),
        Command::Ci { rerun } => ci::run(&project::root(), rerun, &Terminal::start(false, false)),
        Command::Tidy => tidy::run(&project::root()),
    }
}

fn stage(args: &StageArgs, stage: Stage) -> Result<()> {
    pipeline::one_stage(args, stage)
}
