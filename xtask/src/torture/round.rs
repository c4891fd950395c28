//! One round: a seed, a folder of its own, what came of it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use gnp::Stage;
use rand::Rng as _;
use rand::seq::IndexedRandom as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;

use super::Stand;
use super::job::{self, Job};
use crate::contents::{Contents, list};
use crate::process::Running;

/// What a try came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// It went on and wrote what an undisturbed run writes.
    Resumed,
    /// Damage was found, and what was damaged was made again, the same, or said to be needed no longer.
    Mended,
    /// It was refused with a sentence.
    Refused,
    /// This machine cannot make such trouble.
    Skipped(String),
    /// Something else.
    Failed(String),
}

/// A round being played.
#[derive(Debug)]
pub(super) struct Round<'a> {
    pub(super) stand: &'a Stand,
    pub(super) chance: ChaCha8Rng,
    /// Its folder.
    pub(super) place: PathBuf,
    /// What its tries came to.
    pub(super) outcomes: Vec<Outcome>,
}

impl<'a> Round<'a> {
    pub(super) fn begin(stand: &'a Stand, seed: u64, place: &Path) -> Result<Self> {
        fs::create_dir_all(place).with_context(|| format!("cannot make {}", place.display()))?;
        let chance = ChaCha8Rng::seed_from_u64(seed);
        Ok(Self { stand, chance, place: place.to_owned(), outcomes: Vec::new() })
    }

    /// A place for a run in a folder of its own, in which nothing else may be left.
    pub(super) fn folder(&self, name: &str) -> Result<PathBuf> {
        let parent = self.place.join(name);
        fs::create_dir_all(&parent).with_context(|| format!("cannot make {}", parent.display()))?;
        Ok(parent.join("run"))
    }

    /// Waits for a random moment of `job`: a stage, and a moment in it. Whether it still ran then.
    pub(super) fn random_moment(&mut self, job: &Job, running: &mut Running, folder: &Path) -> Result<bool> {
        let Some(stages) = job.stages()? else {
            let share = self.chance.random_range(0.0..1.0);
            return running.sleep(job.total.mul_f64(share));
        };
        let done: Vec<Stage> = job::finished(folder)?.into_iter().map(|(stage, _)| stage).collect();
        let open: Vec<_> = stages.into_iter().filter(|(stage, _)| !done.contains(stage)).collect();
        let asked = open.iter().find(|(stage, _)| Some(*stage) == self.stand.stage);
        let Some((stage, time)) = asked.or_else(|| open.choose(&mut self.chance)) else { return running.runs() };
        // A little longer, so that its last write and the beginning of the next stage are hit as well.
        let moment = time.mul_f64(self.chance.random_range(0.0..1.1));
        let begun = || {
            let done = job::finished(folder)?;
            Ok(done.len() >= Stage::ALL.iter().take_while(|earlier| *earlier != stage).count())
        };
        Ok(running.wait_until(begun)? && running.sleep(moment)?)
    }

    /// Goes on with a run in which the files `damaged` are, which is done or refused. What it came to.
    pub(super) fn mend(job: &Job, folder: &Path, damaged: &[String]) -> Result<Outcome> {
        let ended = job.start(folder)?.end()?;
        if !ended.status.success() {
            ended.refused(&[&folder.to_string_lossy()])?;
            if !damaged.iter().any(|path| is_irreplaceable(path)) {
                bail!("was refused, though it can be made again: {ended}");
            }
            return Ok(Outcome::Refused);
        }
        // May stay as it is, if that is said and nothing is made from it.
        let unneeded = |path: &&String| path.ends_with(".last.safetensors") || path.as_str() == "rules.json";
        let left: Vec<&str> =
            damaged.iter().filter(unneeded).map(String::as_str).filter(|path| ended.err.contains(path)).collect();
        let aside = if left.is_empty() { Vec::new() } else { [&left[..], &["run.json"]].concat() };
        job.expect_same_but(folder, &aside).context("was believed")?;
        if !left.is_empty() {
            Reading::Evaluate
                .of(job, folder, folder.parent().unwrap_or(folder), false)
                .context("was believed later")?;
        }
        Ok(Outcome::Mended)
    }

    /// Goes on to the end and compares.
    pub(super) fn finish(&mut self, job: &Job, folder: &Path, outcome: Outcome) -> Result<()> {
        Self::go_on(job, folder)?;
        self.outcomes.push(outcome);
        Ok(())
    }

    /// Goes on with an undamaged run, to its end and without doing again what is done, and compares.
    pub(super) fn go_on(job: &Job, folder: &Path) -> Result<()> {
        let before = job.done(folder)?;
        job.start(folder)?.end()?.well()?;
        job.expect_kept(&before, folder)?;
        job.expect_same(folder)
    }
}

/// Whether a file of a run is made from nothing in it, so that a run without it may be refused.
fn is_irreplaceable(path: &str) -> bool {
    let inputs = ["config.toml", "ingest.json", "split.json", "run.json"];
    inputs.contains(&path) || path.starts_with("recordings/") || path.starts_with("origin/")
}

/// A command that reads a finished run and writes somewhere else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reading {
    /// Scores on other recordings.
    Evaluate,
    /// What is behind a forecast.
    Explain,
}

impl Reading {
    /// All of them.
    pub(super) const ALL: [Self; 2] = [Self::Evaluate, Self::Explain];

    /// Its arguments.
    pub(super) fn arguments(self, run: &Path, data: &Path, out: &Path) -> Vec<String> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let words = match self {
            Self::Evaluate => vec!["evaluate".to_owned(), "--data-dir".to_owned(), text(data)],
            Self::Explain => vec!["explain".to_owned(), "--json".to_owned()],
        };
        words.into_iter().chain(["--run".to_owned(), text(run), "--out".to_owned(), text(out)]).collect()
    }

    /// What it writes of an undisturbed run.
    ///
    /// # Errors
    /// When it fails.
    pub(super) fn undisturbed(self, job: &Job, out: &Path) -> Result<Contents> {
        job.starter().run(&self.arguments(&job.folder, &job.data(), out))?.well()?;
        Contents::read(out)
    }

    /// Requires that it writes the same of `run`, or, where it `may_refuse`, refuses. What it came to.
    ///
    /// # Errors
    /// When it writes something else.
    pub(super) fn of(self, job: &Job, run: &Path, place: &Path, may_refuse: bool) -> Result<Outcome> {
        let (here, there) = (place.join("read"), place.join("read-undisturbed"));
        let ended = job.starter().run(&self.arguments(run, &job.data(), &here))?;
        if may_refuse && !ended.status.success() {
            ended.refused(&[&run.to_string_lossy()])?;
            return Ok(Outcome::Refused);
        }
        ended.well()?;
        let differences = self.undisturbed(job, &there)?.differences(&Contents::read(&here)?);
        for folder in [here, there] {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
        }
        if differences.is_empty() {
            return Ok(Outcome::Resumed);
        }
        bail!("{self:?} writes something else and says nothing: {}", differences.join(", "))
    }
}

/// Copies a folder with all that is in it.
///
/// # Errors
/// When a file cannot be copied.
pub(super) fn copy(from: &Path, to: &Path) -> Result<()> {
    let (files, empty) = list(from)?;
    for path in empty {
        fs::create_dir_all(to.join(&path)).with_context(|| format!("cannot make {path}"))?;
    }
    for path in files {
        let place = to.join(&path);
        let parent = place.parent().unwrap_or(to);
        fs::create_dir_all(parent).with_context(|| format!("cannot make {}", parent.display()))?;
        fs::copy(from.join(&path), &place).with_context(|| format!("cannot copy {path}"))?;
    }
    Ok(())
}
