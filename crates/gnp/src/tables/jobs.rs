//! The jobs of a comparison: one training each, of one system on one fold with one seed.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;
use crate::run::folder::write_json;

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

/// How often a job that another process does is asked after.
const PERIOD: Duration = Duration::from_millis(200);

/// What a job leaves beside its models.
#[derive(Serialize, Deserialize)]
struct Note {
    state: JobState,
    /// Of the last attempt.
    seconds: f64,
}

impl fmt::Display for Job {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "fold-{}/{}/seed-{}", self.fold, self.stem, self.seed)
    }
}

impl Job {
    fn note(&self, fold: &Path) -> PathBuf {
        fold.join("jobs").join(format!("{}-seed-{}.json", self.stem, self.seed))
    }

    /// How far it is, in the folder of its fold.
    ///
    /// # Errors
    /// When its note is damaged.
    pub(super) fn state(&self, fold: &Path) -> Result<JobState> {
        let path = self.note(fold);
        if !path.exists() {
            return Ok(JobState::ToDo);
        }
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let note: Note =
            serde_json::from_str(&text).with_context(|| format!("{} is damaged; remove it", path.display()))?;
        Ok(note.state)
    }

    /// Waits until no other process does it, and keeps others out until the file is dropped or the process ends: the
    /// training of a worker that is given up may go on for a while. Where files cannot be locked nobody is kept out.
    ///
    /// # Errors
    /// When the file cannot be made; [`Error::Stopped`](crate::Error) while it waits.
    pub(super) fn lock(&self, fold: &Path, machine: &Machine) -> Result<File> {
        let path = self.note(fold).with_extension("lock");
        let cannot = || format!("cannot make {}", path.display());
        fs::create_dir_all(fold.join("jobs")).with_context(cannot)?;
        let file = File::create(&path).with_context(cannot)?;
        let mut told = false;
        while matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            if !told {
                machine.progress.note(&format!("{self}: another process does it; waiting for its end"));
                told = true;
            }
            machine.stop.check()?;
            std::thread::sleep(PERIOD);
        }
        Ok(file)
    }

    /// Notes how far it is.
    ///
    /// # Errors
    /// When the note cannot be written; [`Job::lock`] makes its folder.
    pub(super) fn set(&self, fold: &Path, state: JobState, seconds: f64) -> Result<()> {
        write_json(&self.note(fold), &Note { state, seconds: (seconds * 100.).round() / 100. })
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
    match jobs.iter().min_by_key(|job| edits(id, &job.to_string())) {
        Some(nearest) => bail!(
            Config,
            "there is no job {id}; the nearest is {nearest} (`gnp compare --plan --out DIR` lists all {})",
            jobs.len()
        ),
        None => bail!(Config, "there is no job {id}: the table has none"),
    }
}

/// Characters to insert, remove or exchange to make one text of the other.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut next = vec![i + 1];
        for ((to, pair), left) in b.iter().zip(row.windows(2)).zip(1..) {
            let exchanged = pair[0] + usize::from(from != *to);
            next.push(exchanged.min(pair[1] + 1).min(next[left - 1] + 1));
        }
        row = next;
    }
    row.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs() -> Vec<Job> {
        let of = |stem| (1..=2).flat_map(move |fold| (0..2).map(move |seed| Job { fold, stem, seed }));
        ["gnp", "cs_lstm", "cs_lstm_m"].into_iter().flat_map(of).collect()
    }

    #[test]
    fn edits_are_counted() {
        for (a, b, count) in [("", "", 0), ("", "ab", 2), ("ab", "", 2), ("gnp", "gpn", 2), ("kitten", "sitting", 3)] {
            assert_eq!(edits(a, b), count, "{a} {b}");
        }
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
        assert_eq!(one.state(folder.path()).unwrap(), JobState::ToDo);
        let held = one.lock(folder.path(), &Machine::default()).unwrap();
        assert!(File::open(one.note(folder.path()).with_extension("lock")).unwrap().try_lock().is_err());
        // Who waits for it can be stopped.
        let machine = Machine::default();
        machine.stop.request();
        assert!(one.lock(folder.path(), &machine).unwrap_err().is_stopped());
        drop(held);
        one.lock(folder.path(), &machine).unwrap();
        one.set(folder.path(), JobState::Begun, 0.).unwrap();
        assert_eq!(one.state(folder.path()).unwrap(), JobState::Begun);
        one.set(folder.path(), JobState::Done, 1.234).unwrap();
        assert_eq!(one.state(folder.path()).unwrap(), JobState::Done);
        assert_eq!(other.state(folder.path()).unwrap(), JobState::ToDo);
    }
}
