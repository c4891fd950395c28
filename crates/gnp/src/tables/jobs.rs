//! The jobs of a comparison: one training each, of one system on one fold with one seed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fmt, fs};

use gnp_file::{Lock, Seal};
use serde::{Deserialize, Serialize};

use crate::error::{Context as _, Result, bail};
use crate::inside::inside;
use crate::machine::Machine;
use crate::run::lock::alone;

/// How far a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum JobState {
    /// Nobody has started it.
    ToDo,
    /// It was started and goes on, or was interrupted: it goes on from its checkpoint.
    Begun,
    /// It is trained.
    Done,
}

impl JobState {
    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ToDo => "to do",
            Self::Begun => "begun",
            Self::Done => "done",
        }
    }
}

/// A job as a list of them shows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct JobReport {
    /// What it is called by, such as `fold-2/cs_lstm/seed-0`.
    pub id: String,
    /// How far it is.
    pub state: JobState,
    /// Folder below that of the table which it reads; preparation made it. Jobs do not need each other.
    pub needs: PathBuf,
    /// Folder below that of the table where its files go; no other job has files of the same names there.
    pub writes: PathBuf,
}

/// One training.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Job {
    /// From 1.
    pub(super) fold: usize,
    pub(super) stem: &'static str,
    /// Added to the seeds of recipes and of the parts of GNP.
    pub(super) seed: u64,
}

/// Folder of what is noted of jobs, below that of their fold.
pub(super) const FOLDER: &str = "jobs";

/// What a job leaves beside its models.
#[derive(Serialize, Deserialize)]
struct Note {
    state: JobState,
    /// Of the last attempt.
    seconds: f64,
    /// What a job that is done left, by names below the folder of its fold; of one that trains a run, the run says it.
    files: BTreeMap<String, Seal>,
}

/// How far a job is, and what is wrong with what it left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Standing {
    pub(super) state: JobState,
    /// In words; a job that was done and of which a file is missing or differs is to be done again.
    pub(super) damage: Vec<String>,
}

impl fmt::Display for Job {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "fold-{}/{}/seed-{}", self.fold, self.stem, self.seed)
    }
}

impl Job {
    fn note(&self, fold: &Path) -> PathBuf {
        fold.join(FOLDER).join(format!("{}-seed-{}.json", self.stem, self.seed))
    }

    /// How far it is, in the folder of its fold. One whose note is damaged was begun: it finds what it left.
    pub(super) fn standing(&self, fold: &Path) -> Standing {
        let path = self.note(fold);
        if !path.exists() {
            return Standing { state: JobState::ToDo, damage: Vec::new() };
        }
        let note: Note = match gnp_file::load_json(&path, "the job is looked after again") {
            Ok(note) => note,
            Err(error) => return Standing { state: JobState::Begun, damage: vec![error.to_string()] },
        };
        let mut damage = Vec::new();
        for (name, seal) in &note.files {
            match inside(fold, name).map_err(std::io::Error::other).and_then(|path| seal.fits(&path)) {
                Ok(true) => {}
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => damage.push(format!("{name} is missing")),
                _ => damage.push(format!("{name} differs from what was written")),
            }
        }
        let state = if damage.is_empty() { note.state } else { JobState::Begun };
        Standing { state, damage }
    }

    /// Removes files that differ from what the job left, so that they are made anew.
    ///
    /// # Errors
    /// When one cannot be removed.
    pub(super) fn discard(&self, fold: &Path) -> Result<()> {
        let Ok(note) = gnp_file::load_json::<Note>(&self.note(fold), "") else { return Ok(()) };
        for (name, seal) in &note.files {
            let path = inside(fold, name)?;
            if path.exists() && !seal.fits(&path).unwrap_or(false) {
                fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            }
        }
        Ok(())
    }

    /// Waits until no other process does it, and keeps others out until the lock is dropped or the process ends: the
    /// training of a worker that is given up may go on for a while. Where files cannot be locked nobody is kept out.
    ///
    /// # Errors
    /// As [`alone`].
    pub(super) fn lock(&self, fold: &Path, machine: &Machine) -> Result<Lock> {
        alone(&self.note(fold).with_extension("lock"), &self.to_string(), machine)
    }

    /// Notes how far it is, with the `names` of what it left below the folder of its fold.
    ///
    /// # Errors
    /// When a file cannot be read or the note not be written; [`Job::lock`] makes its folder.
    pub(super) fn set(&self, fold: &Path, state: JobState, seconds: f64, names: Vec<String>) -> Result<()> {
        let mut files = BTreeMap::new();
        for name in names {
            let seal = Seal::of(&fold.join(&name)).with_context(|| format!("cannot read {name}"))?;
            files.insert(name, seal);
        }
        Ok(gnp_file::save_json(&self.note(fold), &Note { state, seconds: (seconds * 100.).round() / 100., files })?)
    }
}

/// The job that is called `id`.
///
/// # Errors
/// When there is none; names the one that is written most alike.
pub(super) fn named<'a>(id: &str, jobs: &'a [Job]) -> Result<&'a Job> {
    if let Some(job) = jobs.iter().find(|job| job.to_string() == id) {
        return Ok(job);
    }
    match jobs.iter().min_by_key(|job| strsim::levenshtein(id, &job.to_string())) {
        Some(nearest) => bail!(
            Config,
            "there is no job {id}; the nearest is {nearest} (`gnp compare --plan --out DIR` lists all {})",
            jobs.len()
        ),
        None => bail!(Config, "there is no job {id}: the table has none"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs() -> Vec<Job> {
        let of = |stem| (1..=2).flat_map(move |fold| (0..2).map(move |seed| Job { fold, stem, seed }));
        ["gnp", "cs_lstm", "cs_lstm_m"].into_iter().flat_map(of).collect()
    }

    #[test]
    fn a_job_is_found_by_its_name_and_a_slip_names_the_nearest() {
        let jobs = jobs();
        assert_eq!(named("fold-2/cs_lstm/seed-1", &jobs).unwrap(), &Job { fold: 2, stem: "cs_lstm", seed: 1 });
        let message = named("fold-2/cs_lstn_m/seed-1", &jobs).unwrap_err().to_string();
        assert!(message.contains("nearest is fold-2/cs_lstm_m/seed-1") && message.contains("all 12"), "{message}");
        assert!(named("gnp", &[]).is_err());
    }

    #[test]
    fn a_job_remembers_how_far_it_is() {
        let folder = tempfile::TempDir::new().unwrap();
        let [one, other] = [jobs()[0].clone(), jobs()[1].clone()];
        let state = |job: &Job| job.standing(folder.path()).state;
        assert_eq!(state(&one), JobState::ToDo);
        let held = one.lock(folder.path(), &Machine::default()).unwrap();
        assert!(Lock::take(&one.note(folder.path()).with_extension("lock")).is_err());
        // Who waits for it can be stopped.
        let machine = Machine::default();
        machine.stop.request();
        assert!(one.lock(folder.path(), &machine).unwrap_err().is_stopped());
        drop(held);
        one.lock(folder.path(), &machine).unwrap();
        one.set(folder.path(), JobState::Begun, 0., Vec::new()).unwrap();
        assert_eq!(state(&one), JobState::Begun);
        one.set(folder.path(), JobState::Done, 1.234, Vec::new()).unwrap();
        assert_eq!(state(&one), JobState::Done);
        assert_eq!(state(&other), JobState::ToDo);
    }

    #[test]
    fn a_job_whose_files_are_not_what_it_left_is_to_be_done_again() {
        let folder = tempfile::TempDir::new().unwrap();
        let (job, machine) = (jobs()[0].clone(), Machine::default());
        let _held = job.lock(folder.path(), &machine).unwrap();
        let weights = folder.path().join("a.safetensors");
        fs::write(&weights, "weights").unwrap();
        job.set(folder.path(), JobState::Done, 1., vec!["a.safetensors".to_owned()]).unwrap();
        assert_eq!(job.standing(folder.path()), Standing { state: JobState::Done, damage: Vec::new() });
        job.discard(folder.path()).unwrap();
        assert!(weights.exists());
        fs::write(&weights, "weighty").unwrap();
        let standing = job.standing(folder.path());
        assert_eq!(standing.state, JobState::Begun);
        assert_eq!(standing.damage, ["a.safetensors differs from what was written"]);
        job.discard(folder.path()).unwrap();
        assert_eq!(job.standing(folder.path()).damage, ["a.safetensors is missing"]);
        // A note that cannot be believed says nothing.
        let note = job.note(folder.path());
        fs::write(&note, fs::read_to_string(&note).unwrap().replace("done", "to_do")).unwrap();
        let standing = job.standing(folder.path());
        assert_eq!(standing.state, JobState::Begun);
        assert!(standing.damage[0].contains("differs from what was written"), "{standing:?}");
    }
}
