//! A run being worked on: its folder, its configuration, its recordings, the machine.

use std::cell::OnceCell;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use candle_core::Device;
use gnp_data::{Recording, Split, WindowSet};
use gnp_model::Features;

use crate::cli::{DeviceName, MachineArgs};
use crate::config::RunConfig;
use crate::ingest::IngestSummary;
use crate::run_folder::{RunFolder, Stage};
use crate::stop;
use crate::terminal::Terminal;

/// The machine as the command line asks for it.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    /// Where tensors live.
    pub(crate) device: Device,
    /// What the user sees.
    pub(crate) terminal: Terminal,
}

impl Machine {
    /// Sets up terminal, Ctrl-C, threads and device; once a program.
    ///
    /// # Errors
    /// When the device is not in this build or not in this computer.
    pub(crate) fn start(args: &MachineArgs) -> Result<Self> {
        let terminal = Terminal::start(args.quiet, args.verbose);
        stop::install()?;
        if let Some(threads) = args.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
            pool.build_global().context("cannot set the number of threads")?;
        }
        Ok(Self { device: device(args.device)?, terminal })
    }
}

fn device(name: DeviceName) -> Result<Device> {
    let (device, feature) = match name {
        DeviceName::Cpu => return Ok(Device::Cpu),
        DeviceName::Cuda => (Device::new_cuda(0), "cuda"),
        DeviceName::Metal => (Device::new_metal(0), "metal"),
    };
    device.with_context(|| {
        format!(
            "--device {feature} cannot be used; build with `cargo run --package xtask --features {feature} -- ...` \
             on a computer that has one, or take --device cpu"
        )
    })
}

/// A run being worked on.
#[derive(Debug)]
pub(crate) struct Session {
    /// Its folder.
    pub(crate) folder: RunFolder,
    /// What it was told.
    pub(crate) config: RunConfig,
    /// The machine.
    pub(crate) machine: Machine,
    recordings: OnceCell<Vec<Recording>>,
}

impl Session {
    /// Goes to work on a folder.
    pub(crate) fn new(folder: RunFolder, config: RunConfig, machine: Machine) -> Self {
        Self { folder, config: config.seeded(), machine, recordings: OnceCell::new() }
    }

    /// Goes to work on the folder of a finished run, with its own configuration.
    ///
    /// # Errors
    /// When it is not a run folder or the run is not finished, or the machine is not what is asked for.
    pub(crate) fn finished(run: &Path, machine: &MachineArgs) -> Result<Self> {
        let folder = RunFolder::open(run)?;
        if !folder.has(Stage::Evaluate) {
            bail!("{} is not finished; run `cargo xtask pipeline --resume --out {0}` first", run.display());
        }
        let config = RunConfig::read(&folder.path("config.toml"), &[])?;
        Ok(Self::new(folder, config, Machine::start(machine)?))
    }

    /// What the user sees.
    pub(crate) fn terminal(&self) -> &Terminal {
        &self.machine.terminal
    }

    /// The same with recordings that are in memory already.
    #[must_use]
    pub(crate) fn with_recordings(self, recordings: Option<Vec<Recording>>) -> Self {
        Self { recordings: recordings.map_or_else(OnceCell::new, OnceCell::from), ..self }
    }

    /// The recordings that ingest kept, read once.
    ///
    /// # Errors
    /// When one is missing or damaged.
    pub(crate) fn recordings(&self) -> Result<&[Recording]> {
        if let Some(recordings) = self.recordings.get() {
            return Ok(recordings);
        }
        let report: IngestSummary = self.folder.read_json("ingest.json")?;
        let recordings = report.load(self.folder.root(), self.terminal())?;
        Ok(self.recordings.get_or_init(|| recordings))
    }

    /// All windows of the recordings.
    ///
    /// # Errors
    /// As [`Session::recordings`] and [`WindowSet::cut`].
    pub(crate) fn windows(&self) -> Result<WindowSet<'_>> {
        Ok(WindowSet::cut(self.recordings()?, &self.config.windows)?.0)
    }

    /// The split of the run, its windows and the features of its training part.
    ///
    /// # Errors
    /// When the split is missing, damaged or not that of the run.
    pub(crate) fn parted<'a>(&'a self, set: &WindowSet<'a>) -> Result<(Split, Features)> {
        let path = self.folder.path("split.json");
        let split = Split::load(set, &path)?;
        if split.hash() != self.folder.state.split_hash {
            bail!("{} is not the split of this run; start a new run", path.display());
        }
        let training = split.train().iter().filter_map(|id| set.get(*id)).map(|window| window.observation());
        let features = Features::fit(&self.config.features, set.shape(), training)?;
        Ok((split, features))
    }
}
