//! The command line of GNP. The program `gnp` and the project's own `cargo xtask` run the same commands.

mod arguments;
mod commands;
mod environment;
mod names;
mod planned;
mod processes;
mod program;
mod terminal;

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use candle_core::Device;
use clap::Parser;
use gnp::{Machine, Stop};

pub use crate::arguments::{Command, MachineArgs};
pub use crate::environment::variables;
use crate::names::DeviceName;
pub use crate::program::Program;
pub use crate::terminal::Terminal;

/// Exit code of an interrupted program: 128 and the number of SIGINT.
const INTERRUPTED: u8 = 130;

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

/// The program `gnp`: runs the command that `arguments` name, of which the first is the program. It ends the process where
/// they make no sense or ask for help.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    processes::note_launcher(arguments.len().saturating_sub(1));
    run(&Cli::parse_from(arguments).command, &Program::default())
}

/// Runs a command, prints what goes wrong, and says how the program ends.
pub fn run(command: &Command, program: &Program) -> ExitCode {
    match commands::dispatch(command, program) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => report(&error, program, |folder| commands::to_go_on(command, folder)),
    }
}

/// Prints an error and says how the program ends; `to_go_on` is the command that goes on from a folder.
pub fn report(error: &anyhow::Error, program: &Program, to_go_on: impl FnOnce(&Path) -> Option<String>) -> ExitCode {
    let text = format!("{error:#}");
    let known = error.chain().find_map(|cause| cause.downcast_ref::<gnp::Error>());
    match known.and_then(gnp::Error::kept) {
        None => {
            let full = known.is_some_and(gnp::Error::is_disk_full);
            let hint = if full { "; the disk is full: free some of it, and do the same again" } else { "" };
            eprintln!("error: {}{hint}", program.named(&text));
            ExitCode::FAILURE
        }
        Some(kept) => {
            let hint = kept.and_then(|folder| to_go_on(folder)).map(|command| format!("; go on with `{command}`"));
            eprintln!("{}", program.named(&(text + &hint.unwrap_or_default())));
            ExitCode::from(INTERRUPTED)
        }
    }
}

/// The machine that the arguments ask for, shown on a terminal and stopped by Ctrl-C; once a program, before it does
/// anything, as it may start anew (see [`variables`]).
///
/// # Errors
/// When the device is not in this build or not in this computer.
pub fn machine(args: &MachineArgs, program: &Program) -> Result<Machine> {
    environment::settle(args.threads);
    let terminal = Terminal::start(args.quiet, args.verbose, program);
    let stop = on_ctrl_c()?;
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
        pool.build_global().context("cannot set the number of threads")?;
    }
    Ok(Machine::new(device(args.device, program)?, Arc::new(terminal), stop))
}

fn device(name: DeviceName, program: &Program) -> Result<Device> {
    let (device, feature, built) = match name {
        DeviceName::Cpu => return Ok(Device::Cpu),
        DeviceName::Cuda => (Device::new_cuda(0), "cuda", cfg!(feature = "cuda")),
        DeviceName::Metal => (Device::new_metal(0), "metal", cfg!(feature = "metal")),
    };
    device.with_context(|| {
        let remedy = if built {
            "see that this computer has a GPU and that its driver works (for CUDA: nvidia-smi)".to_owned()
        } else {
            format!("build with `{} ...` on a computer that has one", program.with_feature(feature))
        };
        format!("--device {feature} cannot be used; {remedy}, or take --device cpu")
    })
}

/// What the first Ctrl-C asks to stop; the second ends the program at once.
fn on_ctrl_c() -> Result<Stop> {
    let stop = Stop::new();
    let asked = stop.clone();
    let set = ctrlc::set_handler(move || {
        if asked.request() {
            std::process::exit(i32::from(INTERRUPTED));
        }
        eprintln!("\nstopping at the next safe point; press Ctrl-C again to stop at once");
    });
    set.context("cannot listen for Ctrl-C")?;
    Ok(stop)
}
