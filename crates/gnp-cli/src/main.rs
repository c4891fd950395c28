//! The program `gnp`: the pipeline from recordings to scored trajectories. `gnp --help` lists the commands.

use std::process::ExitCode;

fn main() -> ExitCode {
    gnp_cli::main(std::env::args_os())
}
