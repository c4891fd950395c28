//! The workshop of GNP: the project's own checks, benchmarks and pictures, beside the commands of `gnp`.
//! `cargo xtask --help` lists the commands.

mod bench;
mod browser;
mod c;
mod ci;
mod cli;
mod contents;
mod determinism;
mod fuzz;
mod gallery;
mod load;
mod pretrained;
mod process;
mod project;
mod python;
mod sbom;
mod serve;
mod tidy;
mod torture;
mod workspace;

use std::process::ExitCode;

use anyhow::Result;
use clap::{CommandFactory as _, FromArgMatches as _};
use gnp_cli::{Program, Terminal};

use crate::cli::{Cli, Command};

fn main() -> ExitCode {
    let program = Program::new("cargo xtask", "xtask", project::root().join("runs"));
    let matches = program.commands(Cli::command()).get_matches();
    let command = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli.command,
        Err(error) => error.exit(),
    };
    let done = match command {
        Command::Product(command) => return gnp_cli::run(&command, &program),
        other => dispatch(&other, &program),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => gnp_cli::report(&error, &program, |_| None),
    }
}

fn dispatch(command: &Command, program: &Program) -> Result<()> {
    let terminal = |quiet| Terminal::start(quiet, false, program);
    match command {
        Command::Product(_) => Ok(()),
        Command::Gallery(args) => gallery::run(args, program),
        Command::Bench(args) => bench::run(args, &terminal(args.quiet)),
        Command::Fuzz(args) => fuzz::run(args, &terminal(false)),
        Command::Ci { rerun } => ci::run(&project::root(), *rerun, &terminal(false)),
        Command::C(args) => c::run(&project::root(), args, &terminal(false)),
        Command::Browser(args) => browser::run(&project::root(), args, &terminal(false)),
        Command::Recording(args) => browser::record(&project::root(), args, &terminal(false)),
        Command::Load(args) => load::run(*args, &terminal(false)),
        Command::Python => python::run(&project::root(), &terminal(false)),
        Command::Features => ci::features::run(&project::root(), ci::features::Extent::All, &terminal(false)),
        Command::Aarch64 => ci::aarch64::run(&project::root(), ci::aarch64::Extent::All, &terminal(false)),
        Command::Determinism(args) => determinism::run(*args, &terminal(args.quiet)),
        Command::Torture(args) => torture::run(args, &terminal(args.quiet)),
        Command::Pretrained { check, machine } => pretrained::run(*check, &gnp_cli::machine(machine, program)?),
        Command::Sbom => sbom::write(&project::root(), &terminal(false)),
        Command::Tidy => tidy::run(&project::root()),
    }
}
