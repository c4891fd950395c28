//! A run being worked on: its folder, its configuration, its recordings, the machine.

pub(crate) mod draft;
pub(crate) mod folder;
mod foreign;
pub(crate) mod lock;
pub(crate) mod manifest;
mod mend;
pub(crate) mod origin;
mod stage;

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gnp_data::{Recording, Split, WindowSet};
use gnp_file::Lock;
use gnp_model::{Features, Gnp, ReferencePath};

use crate::config::RunConfig;
use crate::data::ingest::{IngestSummary, RECORDINGS};
use crate::error::{Result, bail};
use crate::evaluation::rules;
use crate::figures::FIGURES;
use crate::machine::Machine;
use crate::run::draft::{sweep, sweep_drafts};
use crate::run::folder::{RunFolder, RunState, Stage};
use crate::run::lock::lock;
use crate::run::manifest::{Damage, EVENTS, Need, RunFile};
use crate::run::origin::Finished;

/// A run: a folder with everything that was made from some recordings by one configuration.
#[derive(Debug)]
pub struct Run {
    pub(crate) folder: RunFolder,
    /// As written, with the run's seed added to the parts' own.
    pub(crate) config: RunConfig,
    pub(crate) machine: Machine,
    recordings: OnceCell<Vec<Recording>>,
    /// While something is written into the folder.
    lock: Option<Lock>,
}

impl Run {
    /// Opens the folder of a run to read, whatever is finished of it. Every file is compared with what was written; of
    /// recordings the rest when they are read. What nobody needs, or says again what another file says, may be missing
    /// or differ, which is said.
    ///
    /// # Errors
    /// When it is not a run folder, or another file of it is missing or differs from what was written.
    pub fn open(folder: &Path, machine: &Machine) -> Result<Self> {
        Self::open_for(Need::All, folder, machine)
    }

    /// Opens the folder of a run to use its model: configuration, modes and weights must be there as they were written.
    /// Recordings and all that is not the model may be missing, as where recordings must not be passed on. Of what can
    /// be made again a file that differs from what was written is refused when it is used.
    ///
    /// # Errors
    /// When it is not a run folder, or a file of the model is missing; when one of it, or a recording, the split or a note
    /// of them, differs from what was written.
    pub fn open_model(folder: &Path, machine: &Machine) -> Result<Self> {
        Self::open_for(Need::Model, folder, machine)
    }

    /// Opens the folder of a run to use what it needs to be for; says what it does without.
    ///
    /// # Errors
    /// As [`Run::open`].
    pub(crate) fn open_for(need: Need, folder: &Path, machine: &Machine) -> Result<Self> {
        let folder = RunFolder::whole(folder, need)?;
        for told in Damage::grouped(folder.passed_over().iter().map(|one| (one, one.done_without()))) {
            machine.progress.note(&told);
        }
        let config = RunConfig::read(&folder.path("config.toml"), &[])?;
        Ok(Self::new(folder, &config, machine))
    }

    /// Opens the folder of a run to go on with it: what killed programs left in it goes; where files are missing or differ
    /// from what was written, their stages and what was made from them are to be done again, which is said.
    ///
    /// # Errors
    /// When it is not a run folder, or a link that leads nowhere, or a file is damaged that cannot be made again; when the
    /// folder is damaged and another process writes into it.
    pub fn resume(folder: &Path, machine: &Machine) -> Result<Self> {
        sweep_drafts(folder, machine)?;
        let (folder, damage) = RunFolder::look(folder, Need::All)?;
        sweep(&places(&folder), machine);
        if damage.is_empty() {
            let config = RunConfig::read(&folder.path("config.toml"), &[])?;
            return Ok(Self::new(folder, &config, machine));
        }
        Damage::check(&damage, folder.root())?;
        let _lock = lock(folder.root(), &damage)?;
        Self::mended(folder.root(), machine)
    }

    /// As [`Run::resume`], after the end of whoever writes into the folder, and as the only one that does until it is
    /// dropped.
    ///
    /// # Errors
    /// As [`Run::resume`]; [`Error::Stopped`](crate::Error) while it waits.
    pub(crate) fn resume_alone(folder: &Path, machine: &Machine) -> Result<Self> {
        // Before its lock would be made where there is no run.
        RunFolder::open(folder)?;
        let lock = lock::alone(&folder.join(gnp_file::Draft::LOCK), &folder.display().to_string(), machine)?;
        let run = Self::mended(folder, machine)?;
        Ok(Self { lock: Some(lock), ..run })
    }

    /// The run in `root`, made good by who holds its lock.
    fn mended(root: &Path, machine: &Machine) -> Result<Self> {
        let mut folder = RunFolder::open(root)?;
        sweep(&places(&folder), machine);
        mend::mend(&mut folder, machine)?;
        let config = RunConfig::read(&folder.path("config.toml"), &[])?;
        Ok(Self::new(folder, &config, machine))
    }

    /// Opens the folder of a run that has scores.
    ///
    /// # Errors
    /// As [`Run::open`]; when the run is not finished.
    pub fn finished(folder: &Path, machine: &Machine) -> Result<Self> {
        Self::open(folder, machine)?.with_scores()
    }

    /// The same, which has scores.
    ///
    /// # Errors
    /// When it has none.
    pub fn with_scores(self) -> Result<Self> {
        if !self.folder.has(Stage::Evaluate) {
            bail!(Folder, "{} is not finished; run `gnp pipeline --resume --out {0}` first", self.path().display());
        }
        Ok(self)
    }

    pub(crate) fn new(folder: RunFolder, config: &RunConfig, machine: &Machine) -> Self {
        Self { folder, config: config.seeded(), machine: machine.clone(), recordings: OnceCell::new(), lock: None }
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

    /// Says on which road recordings are that are read from now on, beside the run's own: the file of its line, and
    /// lane lines, m ([`DataConfig::set_road`](crate::DataConfig::set_road)).
    pub fn set_road(&mut self, file: Option<PathBuf>, lane_lines: Option<Vec<f64>>) {
        self.config.data.set_road(file, lane_lines);
    }

    /// What is finished of it.
    #[must_use]
    pub fn state(&self) -> &RunState {
        &self.folder.state
    }

    /// Keeps other processes from writing into the folder until the lock is dropped; for who writes files into it that are
    /// of no stage. Everything of this crate that writes does so by itself.
    ///
    /// # Errors
    /// When another one writes into it, naming it; when the folder cannot be written to.
    pub fn lock(&self) -> Result<Lock> {
        lock(self.path(), &[])
    }

    /// Does some work that writes into the folder, as the only one. What others did in it meanwhile is seen, and what they
    /// left damaged is made good.
    ///
    /// # Errors
    /// As [`Run::lock`], [`Run::resume`] and those of the work.
    pub(crate) fn writing<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let outermost = self.lock.is_none();
        if outermost {
            self.lock = Some(lock(self.path(), &[])?);
            let ready = match self.folder.need() {
                Need::All => Self::mended(self.path(), &self.machine).map(|run| run.folder),
                need => RunFolder::whole(self.path(), need),
            };
            match ready {
                Ok(folder) => self.folder = folder,
                Err(error) => {
                    self.lock = None;
                    return Err(error);
                }
            }
        }
        let result = work(self);
        if outermost {
            self.lock = None;
        }
        result
    }

    /// Writes files of a stage anew beside those that it left. A stage that was finished is not while they are written: who
    /// is killed in between finds it to be done.
    ///
    /// # Errors
    /// As [`Run::writing`].
    pub(crate) fn rewriting<T>(
        &mut self,
        stage: Stage,
        work: impl FnOnce(&Self) -> Result<(T, Vec<String>)>,
    ) -> Result<T> {
        self.writing(|run| {
            let state = &mut run.folder.state;
            let seconds = state.finished.remove(&stage);
            let (of_stage, others) =
                std::mem::take(&mut state.files).into_iter().partition(|(_, it)| it.stage == stage);
            state.files = others;
            let earlier: BTreeMap<String, RunFile> = of_stage;
            run.folder.write()?;
            let (made, names) = work(run)?;
            run.folder.state.files.extend(earlier);
            run.folder.record(stage, names)?;
            run.folder.state.finished.extend(seconds.map(|seconds| (stage, seconds)));
            run.folder.write()?;
            Ok(made)
        })
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
        self.writing(|run| {
            if let Some(before) = &run.folder.state.origin {
                return origin.expect(before, run.folder.root());
            }
            if run.folder.has(Stage::Modes) {
                bail!(
                    Folder,
                    "{} has modes of its own; start over from {} by --again",
                    run.folder.root().display(),
                    folder.display()
                );
            }
            let config = RunConfig::read(&run.folder.path("config.toml"), &[])?;
            run.folder.state.origin = Some(origin.copy(&config, run.folder.root())?);
            run.folder.record(Stage::Ingest, origin::files())?;
            run.folder.write()
        })
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
        if gnp.header().split_hash != self.folder.state.split_hash {
            bail!(
                Folder,
                "{} was trained on another split than that of the run; train it again",
                self.folder.path("goal.safetensors").display()
            );
        }
        Ok(gnp.selecting(predict.selection).trusting(predict.trust)?.with_precision(predict.precision)?)
    }
}

/// Folders of a run in which files appear.
fn places(folder: &RunFolder) -> Vec<PathBuf> {
    ["", RECORDINGS, EVENTS, FIGURES, origin::FOLDER].map(|name| folder.path(name)).into()
}
