//! The main job, stage by stage, on a run folder.

mod modes;
mod training;

use std::path::PathBuf;
use std::time::Instant;

use gnp_data::{Dataset, Recording};
use gnp_model::{Component, Gnp, ReferencePath};

pub(crate) use self::modes::kinds;
pub(crate) use self::training::Watch;
use crate::config::{PredictConfig, RunConfig};
use crate::data::{ingest, source};
use crate::error::{Context as _, Error, Result, bail};
use crate::evaluation::{self, rules};
use crate::machine::Machine;
use crate::needs;
use crate::report;
use crate::run::Run;
use crate::run::draft::{Draft, occupied};
use crate::run::folder::{RunFolder, RunState, Stage, write, write_state};
use crate::run::origin::{self, Finished};

/// A run that is to be there: started or resumed.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Plan {
    /// Kind of data of a run that is resumed, if that is to be checked.
    pub dataset: Option<Dataset>,
    /// Configuration of the run; without it only an existing run can be resumed.
    pub config: Option<RunConfig>,
    /// Folder or file of recordings; without it the data that comes with the project.
    pub data: Option<PathBuf>,
    /// The run folder.
    pub out: PathBuf,
    /// Whether an existing folder is resumed instead of refused.
    pub resume: bool,
    /// A finished run whose modes, feature statistics and weights the new one starts from.
    pub from: Option<PathBuf>,
}

impl Plan {
    /// A new run.
    #[must_use]
    pub fn new(config: RunConfig, data: Option<PathBuf>, out: impl Into<PathBuf>) -> Self {
        Self { dataset: None, config: Some(config), data, out: out.into(), resume: false, from: None }
    }

    /// To resume a run with its own configuration.
    #[must_use]
    pub fn resume(out: impl Into<PathBuf>) -> Self {
        Self { dataset: None, config: None, data: None, out: out.into(), resume: true, from: None }
    }

    /// Whether there is something in the folder.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn is_started(&self) -> Result<bool> {
        occupied(&self.out)
    }

    /// Starts the run with its first stage and the split, so that recordings that cannot be split leave nothing
    /// behind; or opens it.
    ///
    /// # Errors
    /// What is wrong with the recordings; when the folder is in use, or belongs to another configuration or other data.
    pub fn begin(&self, machine: &Machine) -> Result<Run> {
        self.begin_with(machine, true)
    }

    /// As [`Plan::begin`] with the first stage alone: the split is left to the next one.
    ///
    /// # Errors
    /// As [`Plan::begin`].
    pub fn ingest(&self, machine: &Machine) -> Result<Run> {
        self.begin_with(machine, false)
    }

    fn begin_with(&self, machine: &Machine, split: bool) -> Result<Run> {
        if self.resume && self.is_started()? {
            return self.go_on(machine);
        }
        match &self.config {
            Some(config) => start(config, self, machine, split),
            None => bail!(
                Config,
                "there is no run in {0} to go on with; to start one, say which data: `gnp pipeline --dataset NAME --out {0}`",
                self.out.display()
            ),
        }
    }

    fn go_on(&self, machine: &Machine) -> Result<Run> {
        let run = Run::resume(&self.out, machine)?;
        let (state, config) = (&run.folder.state, RunConfig::read(&run.folder.path("config.toml"), &[])?);
        if let Some(asked) = &self.config {
            asked.expect_same(&config, &self.out)?;
        }
        if let Some(asked) = self.dataset
            && asked != config.dataset
        {
            let is = config.dataset;
            bail!(Folder, "--dataset {asked} but {} is of {is}; take another --out", self.out.display());
        }
        if let Some(dir) = &self.data
            && *dir != state.data.dir
        {
            let then = state.data.dir.display();
            bail!(
                Folder,
                "{} was made from {then}; resume without --data-dir, or take another --out",
                self.out.display()
            );
        }
        if let Some(from) = &self.from {
            let from = Finished::open(from)?;
            match &state.origin {
                Some(origin) => from.expect(origin, &self.out)?,
                None => {
                    bail!(Folder, "{} did not start from another run; take another --out", self.out.display())
                }
            }
        }
        run.say_data();
        Ok(run)
    }
}

/// Ingests into a new run folder, which appears when everything is read.
fn start(config: &RunConfig, plan: &Plan, machine: &Machine, split: bool) -> Result<Run> {
    let PredictConfig { precision, neighbours, .. } = &config.predict;
    Gnp::check_precision(*precision, neighbours.without_future(), &machine.device)?;
    needs::check_before(config, machine)?;
    let draft = Draft::start(&plan.out, "go on with it by --resume, or take another --out", machine)?;
    let from = plan.from.as_deref().map(Finished::open).transpose()?;
    let origin = from.map(|from| from.copy(config, draft.path())).transpose()?;
    let found = source::find(config, plan.data.as_deref())?;
    machine.progress.result(&format!("Data: {}", found.data.description));
    let started = Instant::now();
    let report = ingest::run(found, config, draft.path(), machine)?;
    write(&draft.path().join("config.toml"), config.to_toml()?.as_bytes())?;
    // Only the split needs all recordings at once.
    let recordings: Option<Vec<Recording>> = if split { Some(report.load(draft.path(), machine)?) } else { None };
    let mut kept: Vec<String> = report.recordings.iter().map(|recording| recording.file.clone()).collect();
    kept.extend(origin.iter().flat_map(|_| origin::files()));
    let mut state = RunState { origin, ..RunState::new(config.seed, report.data) };
    if let Some(recordings) = &recordings {
        state.split_hash = modes::split(recordings, config, draft.path(), machine)?;
        kept.push(modes::SPLIT.to_owned());
    }
    // The folder appears with ingest finished, or not at all.
    state.record_stage(draft.path(), Stage::Ingest, kept)?;
    state.note(Stage::Ingest, started.elapsed().as_secs_f64());
    write_state(draft.path(), &state)?;
    let folder = RunFolder::open(&draft.publish_run()?)?;
    Ok(Run::new(folder, config, machine).with_recordings(recordings))
}

impl Run {
    /// Says which data it is of.
    pub fn say_data(&self) {
        self.result(&format!("Data: {}", self.folder.state.data.description));
        if let Some(origin) = &self.folder.state.origin {
            self.note(&format!("starts from {}", origin.folder.display()));
        }
    }

    /// Does every stage that is not finished yet.
    ///
    /// # Errors
    /// That of the first stage that fails.
    pub fn complete(&mut self) -> Result<()> {
        self.perform_all(&Stage::ALL)
    }

    /// Finds the modes and trains what is not trained yet.
    ///
    /// # Errors
    /// That of the first stage that fails.
    pub fn train(&mut self) -> Result<()> {
        let trained = Stage::ALL.into_iter().filter(|stage| *stage < Stage::Evaluate);
        self.perform_all(&trained.collect::<Vec<_>>())
    }

    /// As the only one that writes into the folder from the first stage to the last, unless there is nothing to do.
    fn perform_all(&mut self, stages: &[Stage]) -> Result<()> {
        let perform = |run: &mut Self| stages.iter().try_for_each(|stage| run.perform(*stage));
        if stages.iter().all(|stage| self.folder.has(*stage)) { perform(self) } else { self.writing(perform) }
    }

    /// Forgets a finished stage and all that were made from it, so that they can be done anew.
    ///
    /// # Errors
    /// When a file cannot be changed, or another process writes into the folder.
    pub fn forget(&mut self, stage: Stage) -> Result<()> {
        self.writing(|run| run.folder.forget(&[stage]))
    }

    /// Does a stage unless it is finished.
    ///
    /// # Errors
    /// When an earlier stage is missing, another process writes into the folder, or the stage fails; [`Error::Stopped`].
    pub fn perform(&mut self, stage: Stage) -> Result<()> {
        if self.is_finished(stage) { Ok(()) } else { self.writing(|run| run.perform_alone(stage)) }
    }

    fn is_finished(&self, stage: Stage) -> bool {
        let finished = self.folder.has(stage);
        if finished && stage != Stage::Ingest {
            self.note(&format!("{}: finished before", stage.name()));
        }
        finished
    }

    fn perform_alone(&mut self, stage: Stage) -> Result<()> {
        // By another process, before this one had the folder for itself.
        if self.is_finished(stage) {
            return Ok(());
        }
        let name = stage.name();
        self.folder.require(stage)?;
        needs::check_from(stage, self)?;
        let started = Instant::now();
        let root = self.folder.root().to_owned();
        let done = match stage {
            Stage::Ingest => {
                bail!(Folder, "{} has no recordings; start a new run with `gnp ingest`", root.display())
            }
            Stage::Modes => modes::find(self).map(|()| Vec::new()),
            Stage::Goal => self.trained(Component::Goal),
            Stage::Attraction => self.trained(Component::Attraction),
            Stage::Repulsion => self.trained(Component::Repulsion),
            Stage::Evaluate => rules::keep(self).and_then(|()| evaluation::own(self)),
            Stage::Report => report::write_with_figures(self),
        };
        let more = done
            .map_err(|error| if error.is_stopped() { Error::Stopped { kept: Some(root) } } else { error })
            .with_context(|| format!("{name} failed"))?;
        self.folder.finish(stage, started.elapsed().as_secs_f64(), more)
    }

    fn trained(&mut self, part: Component) -> Result<Vec<String>> {
        if self.config.features.reference == ReferencePath::Platoon {
            rules::keep(self)?;
        }
        training::train(self, part).map(|()| Vec::new())
    }
}
