//! The table of all systems: prepared once, trained job by job, gathered.
//!
//! After preparation a fold has recordings, split and fitted rules. A job reads these and writes into a folder that no
//! other job writes to under the same names, so jobs may run anywhere, in any order and at the same time. Only gathering
//! writes the table.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use gnp_neural_baselines::{ColumnNetwork, ColumnRecipe};

use super::asked::CompareRequest;
use super::derived::{TRAINED, beside};
use super::files::{Report, Scored, write_report};
use super::jobs::{self, Job, JobReport, JobState, Standing};
use super::place::{COMPARISON, Place};
use super::recipes::{self, Row};
use super::variants::FULL;
use super::{Fold, printed, published, scored_fold, workers};
use crate::config::{RunConfig, Setting};
use crate::error::{Result, bail};
use crate::evaluation::rules;
use crate::evaluation::systems::System;
use crate::machine::Machine;
use crate::run::Run;
use crate::run::draft::sweep;
use crate::run::folder::RunFolder;
use crate::run::manifest::Need;

/// Row and job of the goal network alone; it has no training of its own.
const GOAL_HEAD: &str = "goal head";
/// Stem of the job of GNP as published.
const PUBLISHED: &str = "published";

/// A comparison whose folds have recordings, split and fitted rules: its jobs can be done.
#[derive(Debug)]
pub struct PreparedTable {
    place: Place,
    asked: CompareRequest,
    learners: Vec<Learner>,
}

/// What is trained, once a fold and seed.
#[derive(Debug)]
enum Learner {
    Gnp,
    Column(ColumnRecipe),
    /// Rows that share a training.
    Network(Vec<Row>),
    Published(Box<RunConfig>),
}

impl Learner {
    fn stem(&self) -> &'static str {
        match self {
            Self::Gnp => FULL,
            Self::Column(_) => ColumnNetwork::STEM,
            Self::Network(rows) => rows.first().map_or("", Row::stem),
            Self::Published(_) => PUBLISHED,
        }
    }

    fn rows(&self) -> Vec<&'static str> {
        match self {
            Self::Gnp => vec![FULL, GOAL_HEAD],
            Self::Column(_) => vec![ColumnNetwork::NAME],
            Self::Network(rows) => rows.iter().map(Row::name).collect(),
            Self::Published(_) => vec![published::NAME],
        }
    }

    /// Folder of its files below that of the fold.
    fn folder(&self, seed: u64, first: bool) -> PathBuf {
        let stem = match self {
            Self::Gnp => "gnp",
            Self::Column(_) | Self::Network(_) => "learned",
            Self::Published(_) => PUBLISHED,
        };
        if first { stem.into() } else { format!("{stem}-seed-{seed}").into() }
    }

    /// Names of the files that it leaves in its folder; none where that is a run, which says it itself.
    fn files(&self) -> Vec<String> {
        let stem = self.stem();
        match self {
            Self::Gnp | Self::Published(_) => Vec::new(),
            Self::Column(_) => vec![format!("{stem}.safetensors")],
            Self::Network(_) => vec![format!("{stem}.safetensors"), format!("{stem}.last.safetensors")],
        }
    }

    /// Trains it unless it was before; its rows.
    fn systems(&self, fold: &Fold<'_>, seed: u64, folder: &Path) -> Result<Vec<System>> {
        Ok(match self {
            Self::Gnp => {
                let gnp = trained_gnp(fold.run, seed, folder)?.model()?;
                let goal_head = System::predictor(GOAL_HEAD, gnp.goal_head());
                vec![System::gnp(FULL, gnp), goal_head]
            }
            Self::Column(recipe) => vec![recipes::column(recipe, seed, fold, folder)?],
            Self::Network(rows) => {
                rows.iter().map(|row| recipes::system(row, seed, fold, folder)).collect::<Result<_>>()?
            }
            Self::Published(config) => {
                let run = published::trained(config, fold.run, folder)?;
                vec![System::predictor(published::NAME, run.model()?)]
            }
        })
    }
}

/// The run of GNP with a seed, trained in `folder` unless it was before.
fn trained_gnp(full: &Run, seed: u64, folder: &Path) -> Result<Run> {
    let mut run = if folder == full.path() {
        Run::resume_alone(folder, &full.machine)?
    } else {
        let setting = Setting { key: "seed".to_owned(), text: seed.to_string() };
        let config = RunConfig::read(&full.folder.path("config.toml"), &[setting])?;
        beside(&full.folder, &config, &TRAINED, folder, &full.machine)?
    };
    run.train()?;
    Ok(run)
}

impl PreparedTable {
    /// Makes the folder of a table, with recordings, split and fitted rules in every fold, unless they are there. The
    /// folder says from then on what it was asked for.
    ///
    /// # Errors
    /// When the folder is in use and not to be resumed, or of another configuration or other recordings; when there is no
    /// seed, or GNP as published is for other data; when models that are trained would have no row, or another recipe;
    /// what is wrong with the recordings; [`Error::Stopped`](crate::Error).
    pub fn prepare(asked: &CompareRequest, machine: &Machine) -> Result<Self> {
        if asked.seeds == 0 {
            bail!(Config, "a table needs at least one seed");
        }
        let place = Place::start(COMPARISON, &asked.plan)?;
        if let Some(published) = &asked.published {
            published::check(published, place.config.dataset)?;
        }
        if CompareRequest::is_in(&place.folder) {
            Self::open(&place.folder)?.expect_kept(asked, &place.config)?;
        }
        let table = Self::of(place, asked.clone());
        for fold in 1..=table.place.folds() {
            let prepare = || -> Result<()> {
                machine.stop.check()?;
                rules::keep(&mut table.place.begin(&asked.plan, fold, machine)?)
            };
            prepare().map_err(|error| table.place.error(error))?;
        }
        // Last, so that a folder that has it is prepared.
        table.asked.write(&table.place.config)?;
        Ok(table)
    }

    /// Refuses a request, with its configuration, by which something that is trained here would be lost or mixed.
    fn expect_kept(&self, asked: &CompareRequest, config: &RunConfig) -> Result<()> {
        let folder = &self.place.folder;
        let dir = folder.display();
        config.expect_same(&self.place.config, folder)?;
        if asked.seeds < self.asked.seeds {
            let seeds = self.asked.seeds;
            bail!(Folder, "{dir} has {seeds} seeds; ask for as many or more, or take another --out");
        }
        if asked.plan.data.is_some() && asked.plan.data != self.asked.plan.data {
            bail!(Folder, "{dir} was made of other recordings; go on without --data-dir, or take another --out");
        }
        let mut changed = self.asked.recipes.differing(&asked.recipes);
        if self.asked.published.is_some() && self.asked.published != asked.published {
            changed.push(PUBLISHED);
        }
        for job in self.list().iter().filter(|job| changed.contains(&job.stem)) {
            if job.standing(&self.place.of_fold(job.fold)).state != JobState::ToDo {
                let stem = job.stem;
                bail!(
                    Folder,
                    "{dir} has trainings of {stem} by another recipe; go on by `gnp compare --resume --out {dir}` alone, \
                     or take another --out"
                );
            }
        }
        Ok(())
    }

    /// The table that was prepared in a folder.
    ///
    /// # Errors
    /// When the folder is not prepared, or its file is damaged.
    pub fn open(folder: &Path) -> Result<Self> {
        let asked = CompareRequest::read(folder)?;
        let place = Place::start(COMPARISON, &asked.plan)?;
        Ok(Self::of(place, asked))
    }

    fn of(place: Place, asked: CompareRequest) -> Self {
        let mut learners = vec![Learner::Gnp];
        learners.extend(asked.recipes.column().cloned().map(Learner::Column));
        for row in asked.recipes.rows() {
            match learners.iter_mut().find(|learner| learner.stem() == row.stem()) {
                Some(Learner::Network(rows)) => rows.push(row),
                _ => learners.push(Learner::Network(vec![row])),
            }
        }
        learners.extend(asked.published.clone().map(|config| Learner::Published(Box::new(config))));
        Self { place, asked, learners }
    }

    /// Its folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.place.folder
    }

    /// Every job, and how far it is: by fold, system and seed.
    ///
    /// # Errors
    /// When what a job left cannot be looked at.
    pub fn jobs(&self) -> Result<Vec<JobReport>> {
        let report = |job: &Job| -> Result<JobReport> {
            let fold = self.place.of_fold(job.fold);
            let below = |path: &Path| path.strip_prefix(&self.place.folder).unwrap_or(path).to_owned();
            let writes = self.learner(job)?.folder(job.seed, job.seed == self.first());
            Ok(JobReport {
                id: job.to_string(),
                state: self.standing(job)?.state,
                needs: below(&fold.join("gnp")),
                writes: below(&fold.join(writes)),
            })
        };
        self.list().iter().map(report).collect()
    }

    /// The folder and [`PreparedTable::jobs`], for programs: `{"folder": ..., "jobs": [{"id", "state", "needs", "writes"}]}`.
    ///
    /// # Errors
    /// As [`PreparedTable::jobs`].
    pub fn json(&self) -> Result<serde_json::Value> {
        Ok(serde_json::json!({ "folder": self.folder(), "jobs": self.jobs()? }))
    }

    /// Does one job, unless it is done.
    ///
    /// # Errors
    /// When there is no such job, the fold is not prepared, or the training fails; [`Error::Stopped`](crate::Error).
    pub fn perform(&self, id: &str, machine: &Machine) -> Result<()> {
        self.train(jobs::named(id, &self.list())?, machine).map_err(|error| self.place.error(error))
    }

    /// Does all jobs that are not done, `workers` at a time, and says so line by line. `perform` does the one that is called
    /// so, by [`PreparedTable::perform`], best in a process of its own: candle's threads are of a process. Results do not
    /// depend on how many workers there are.
    ///
    /// # Errors
    /// [`Error::Jobs`](crate::Error) with those that failed after the others are done; [`Error::Stopped`](crate::Error).
    pub fn perform_all(
        &self,
        workers: usize,
        machine: &Machine,
        perform: impl Fn(&str) -> Result<()> + Sync,
    ) -> Result<()> {
        let all = self.list();
        let mut left = Vec::new();
        for job in &all {
            if self.standing(job)?.state != JobState::Done {
                left.push(job.clone());
            }
        }
        if left.len() < all.len() {
            let done = all.len() - left.len();
            machine.progress.note(&format!("{}: {done} of {} jobs were done before", self.place.stem, all.len()));
        }
        // What takes longest of all first, so that no worker ends long after the others.
        left.sort_by_key(|job| job.stem != PUBLISHED);
        workers::perform(self.place.stem, &left, workers, machine, |job| perform(&job.to_string()))
            .map_err(|error| self.place.error(error))
    }

    /// Scores every system and writes the table.
    ///
    /// # Errors
    /// When jobs are not done, which are named; with `allow_missing` only those of GNP must be, and rows without all of
    /// their jobs are left out and said to be. When an evaluation fails; [`Error::Stopped`](crate::Error).
    pub fn gather(&self, allow_missing: bool, machine: &Machine) -> Result<()> {
        let gather = || {
            let _alone = self.place.alone(machine)?;
            self.gathered(allow_missing, machine)
        };
        gather().map_err(|error| self.place.error(error))
    }

    fn gathered(&self, allow_missing: bool, machine: &Machine) -> Result<()> {
        let mut missing: Vec<Job> = Vec::new();
        let mut damage = BTreeMap::new();
        for job in self.list() {
            let standing = self.standing(&job)?;
            if standing.state != JobState::Done {
                damage.extend(standing.damage.first().map(|what| (job.to_string(), what.clone())));
                missing.push(job);
            }
        }
        let needed: Vec<&Job> = missing.iter().filter(|job| job.stem == FULL || !allow_missing).collect();
        if !needed.is_empty() {
            let named = |job: &&Job| match damage.get(&job.to_string()) {
                Some(what) => format!("{job} ({what})"),
                None => job.to_string(),
            };
            let names: Vec<String> = needed.iter().map(named).collect();
            let dir = self.place.folder.display();
            bail!(
                Folder,
                "{} of {} jobs are not done: {}; do each by `gnp compare --job ID --out {dir}`, or all by \
                 `gnp compare --resume --out {dir}`",
                needed.len(),
                self.list().len(),
                names.join(", ")
            );
        }
        let whole = |learner: &&Learner| missing.iter().all(|job| job.stem != learner.stem());
        let learners: Vec<&Learner> = self.learners.iter().filter(whole).collect();
        let scored = self.place.pooled(|fold| self.fold(fold, &learners, machine))?;

        let mut told = Vec::new();
        for learner in self.learners.iter().filter(|learner| !whole(learner)) {
            let jobs: Vec<String> =
                missing.iter().filter(|job| job.stem == learner.stem()).map(ToString::to_string).collect();
            told.extend(learner.rows().iter().map(|row| format!("{row}: not trained yet ({})", jobs.join(", "))));
        }
        if self.asked.published.is_none() {
            told.push(format!("{}: is trained where --published asks for it", published::NAME));
        }
        told.extend(self.asked.recipes.missing());
        let report = Report {
            stem: self.place.stem,
            title: "Table 1: all systems on the same windows",
            about: "Every system was trained and scored here, the networks with the same augmentations and sampling, the \
                    published ones with one budget of steps. *+ platoon*: the network's points are counted from the \
                    platoon's path, as GNP's are. Below stand the figures that the papers print, which rest on other \
                    windows, other splits and in part on other quantities.",
            ours: FULL,
            missing: &told,
            seeds: self.asked.seeds,
            one_seed: if self.asked.published.is_some() { &[published::NAME] } else { &[] },
            printed: printed::table1(scored.run.config.dataset),
        };
        write_report(&report, &scored, &self.place.folder)
    }

    /// What the systems of a fold got.
    fn fold(&self, number: usize, learners: &[&Learner], machine: &Machine) -> Result<Scored> {
        let folder = self.place.of_fold(number);
        let run = Run::open(&folder.join("gnp"), machine)?;
        let systems = |fold: &Fold<'_>, further: usize| -> Result<Vec<System>> {
            let seed = self.first().wrapping_add(further as u64);
            let mut systems = Vec::new();
            for learner in learners.iter().filter(|learner| further < self.seeds(learner)) {
                let place = folder.join(learner.folder(seed, further == 0));
                systems.extend(learner.systems(fold, seed, &place)?);
                if further == 0 && matches!(learner, Learner::Gnp) {
                    systems.extend(rules::systems(fold.run)?);
                }
            }
            let words = self.place.fold_words(number);
            machine.progress.note(&format!("{}: {words}seed {seed}, {} systems", self.place.stem, systems.len()));
            Ok(systems)
        };
        scored_fold(run, self.asked.seeds, true, systems)
    }

    /// The seed of the configuration.
    fn first(&self) -> u64 {
        self.place.config.seed
    }

    /// Seeds that a learner is trained with: GNP as published, which trains long, with the first alone.
    fn seeds(&self, learner: &Learner) -> usize {
        if matches!(learner, Learner::Published(_)) { 1 } else { self.asked.seeds }
    }

    fn list(&self) -> Vec<Job> {
        let mut jobs = Vec::new();
        for fold in 1..=self.place.folds() {
            for learner in &self.learners {
                let seeds = (0..self.seeds(learner)).map(|further| self.first().wrapping_add(further as u64));
                jobs.extend(seeds.map(|seed| Job { fold, stem: learner.stem(), seed }));
            }
        }
        jobs
    }

    fn learner(&self, job: &Job) -> Result<&Learner> {
        match self.learners.iter().find(|learner| learner.stem() == job.stem) {
            Some(learner) => Ok(learner),
            None => bail!(Config, "no system is called {}", job.stem),
        }
    }

    /// How far a job is: of what is done every file is as it was written.
    fn standing(&self, job: &Job) -> Result<Standing> {
        let folder = self.place.of_fold(job.fold);
        let learner = self.learner(job)?;
        let standing = job.standing(&folder);
        if standing.state != JobState::Done || !learner.files().is_empty() {
            return Ok(standing);
        }
        let place = folder.join(learner.folder(job.seed, job.seed == self.first()));
        if !place.exists() {
            return Ok(Standing { state: JobState::Begun, damage: vec![format!("{} is missing", place.display())] });
        }
        let (run, mut damage) = RunFolder::look(&place, Need::All)?;
        damage.retain(|one| Need::All.is_blocked_by(one));
        let whole = damage.is_empty() && TRAINED.into_iter().all(|stage| run.has(stage));
        let state = if whole { JobState::Done } else { JobState::Begun };
        let damage = damage.iter().map(|one| format!("{}: {}", place.display(), one.words())).collect();
        Ok(Standing { state, damage })
    }

    fn train(&self, job: &Job, machine: &Machine) -> Result<()> {
        let folder = self.place.of_fold(job.fold);
        let _alone = job.lock(&folder, machine)?;
        let standing = self.standing(job)?;
        if standing.state == JobState::Done {
            machine.progress.note(&format!("{job}: done before"));
            return Ok(());
        }
        for what in &standing.damage {
            machine.progress.note(&format!("{job}: {what}: it is done again"));
        }
        job.discard(&folder)?;
        let started = Instant::now();
        // What is damaged of its trainings the job of the run itself makes good, which may be at work.
        let run = Run::open_for(Need::Ingest, &folder.join("gnp"), machine)?;
        let learner = self.learner(job)?;
        let place = folder.join(learner.folder(job.seed, job.seed == self.first()));
        sweep(&[folder.join(jobs::FOLDER), place.clone()], machine);
        job.set(&folder, JobState::Begun, 0., Vec::new())?;
        let set = run.windows()?;
        let split = run.split(&set)?;
        learner.systems(&Fold { run: &run, set: &set, split: &split }, job.seed, &place)?;
        let below = learner.folder(job.seed, job.seed == self.first());
        let names = learner.files().iter().map(|name| format!("{}/{name}", below.display())).collect();
        job.set(&folder, JobState::Done, started.elapsed().as_secs_f64(), names)
    }
}
