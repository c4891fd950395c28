//! A run being worked on: its folder, its configuration, its recordings, the machine.

pub(crate) mod folder;
pub(crate) mod origin;

use std::cell::OnceCell;
use std::path::Path;

use gnp_data::{Recording, Split, WindowSet};
use gnp_model::{Features, Gnp, ReferencePath};

use crate::config::RunConfig;
use crate::data::ingest::IngestSummary;
use crate::error::{Result, bail};
use crate::evaluation::rules;
use crate::machine::Machine;
use crate::run::folder::{RunFolder, RunState, Stage, write_state};
use crate::run::origin::Finished;

/// A run: a folder with everything that was made from some recordings by one configuration.
#[derive(Debug)]
pub struct Run {
    pub(crate) folder: RunFolder,
    /// As written, with the run's seed added to the parts' own.
    pub(crate) config: RunConfig,
    pub(crate) machine: Machine,
    recordings: OnceCell<Vec<Recording>>,
}

impl Run {
    /// Opens the folder of a run, whatever is finished of it.
    ///
    /// # Errors
    /// When it is not a run folder, or a file of it cannot be read.
    pub fn open(folder: &Path, machine: &Machine) -> Result<Self> {
        let folder = RunFolder::open(folder)?;
        let config = RunConfig::read(&folder.path("config.toml"), &[])?;
        Ok(Self::new(folder, &config, machine))
    }

    /// Opens the folder of a run that has scores.
    ///
    /// # Errors
    /// As [`Run::open`]; when the run is not finished.
    pub fn finished(folder: &Path, machine: &Machine) -> Result<Self> {
        let run = Self::open(folder, machine)?;
        if !run.folder.has(Stage::Evaluate) {
            bail!(Folder, "{} is not finished; run `gnp pipeline --resume --out {0}` first", folder.display());
        }
        Ok(run)
    }

    pub(crate) fn new(folder: RunFolder, config: &RunConfig, machine: &Machine) -> Self {
        Self { folder, config: config.seeded(), machine: machine.clone(), recordings: OnceCell::new() }
    }

    /// The same with recordings that are in memory already.
    #[must_use]
    pub(crate) fn with_recordings(self, recordings: Option<Vec<Recording>>) -> Self {
        Self { recordings: recordings.map_or_else(OnceCell::new, OnceCell::from), ..self }
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.root()
    }

    /// Its configuration, with the run's seed added to the seeds of modes and trainings.
    #[must_use]
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// What is finished of it.
    #[must_use]
    pub fn state(&self) -> &RunState {
        &self.folder.state
    }

    pub(crate) fn note(&self, text: &str) {
        self.machine.progress.note(text);
    }

    pub(crate) fn result(&self, text: &str) {
        self.machine.progress.result(text);
    }

    /// The recordings that ingest kept, read once.
    ///
    /// # Errors
    /// When one is missing or damaged.
    pub fn recordings(&self) -> Result<&[Recording]> {
        if let Some(recordings) = self.recordings.get() {
            return Ok(recordings);
        }
        let report: IngestSummary = self.folder.read_json("ingest.json")?;
        let recordings = report.load(self.folder.root(), &self.machine)?;
        Ok(self.recordings.get_or_init(|| recordings))
    }

    /// All windows of the recordings.
    ///
    /// # Errors
    /// As [`Run::recordings`] and [`WindowSet::cut`].
    pub fn windows(&self) -> Result<WindowSet<'_>> {
        Ok(WindowSet::cut(self.recordings()?, &self.config.windows)?.0)
    }

    /// The split of the run's windows.
    ///
    /// # Errors
    /// When it is missing, damaged or not that of the run.
    pub fn split(&self, set: &WindowSet<'_>) -> Result<Split> {
        let path = self.folder.path("split.json");
        let split = Split::load(set, &path)?;
        if split.hash() != self.folder.state.split_hash {
            bail!(Folder, "{} is not the split of this run; start a new run", path.display());
        }
        Ok(split)
    }

    /// Makes it start from the modes, feature statistics and weights of the finished run in `folder`, which has the same
    /// form; they are copied.
    ///
    /// # Errors
    /// When that run is not finished or has another form; when this one has modes already, or starts from another run.
    pub fn start_from(&mut self, folder: &Path) -> Result<()> {
        let origin = Finished::open(folder)?;
        if let Some(before) = &self.folder.state.origin {
            return origin.expect(before, self.folder.root());
        }
        if self.folder.has(Stage::Modes) {
            bail!(
                Folder,
                "{} has modes of its own; start over from {} by --again",
                self.folder.root().display(),
                folder.display()
            );
        }
        let config = RunConfig::read(&self.folder.path("config.toml"), &[])?;
        self.folder.state.origin = Some(origin.copy(&config, self.folder.root())?);
        write_state(self.folder.root(), &self.folder.state)
    }

    /// The split of the run and the features of its training part; a fine-tuned run keeps the statistics that its networks
    /// were trained with.
    ///
    /// # Errors
    /// As [`Run::split`].
    pub(crate) fn features<'a>(&'a self, set: &WindowSet<'a>) -> Result<(Split, Features)> {
        let split = self.split(set)?;
        let training = split.train().iter().filter_map(|id| set.get(*id)).map(|window| window.observation());
        let platoon = match self.config.features.reference {
            ReferencePath::Platoon => Some(rules::platoon(self)?),
            ReferencePath::ConstantVelocity => None,
        };
        let features = match (origin::features(&self.folder)?, platoon) {
            (Some(features), Some(platoon)) => features.with_platoon(&platoon),
            (Some(features), None) => features,
            (None, platoon) => Features::fit(&self.config.features, set.shape(), platoon.as_ref(), training)?,
        };
        Ok((split, features))
    }

    /// The trained model, as `[predict]` of its configuration asks for it; everything that shows or scores the run's
    /// forecasts loads it here. Where the configuration hands it the neighbours' recorded paths, which no predictor
    /// has, neighbours keep their velocity instead.
    ///
    /// # Errors
    /// When a training is not finished or a file of it cannot be used.
    pub fn model(&self) -> Result<Gnp> {
        self.folder.require(Stage::Evaluate)?;
        let predict = &self.config.predict;
        let gnp = Gnp::load(self.folder.root(), predict.neighbours.without_future(), &self.machine.device)?;
        Ok(gnp.selecting(predict.selection).trusting(predict.trust)?)
    }
}
