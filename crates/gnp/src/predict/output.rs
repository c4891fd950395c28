//! Where forecasts go: parts beside the place, of which the output is made when they are whole, and which tell a later call
//! what is done.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::UNIX_EPOCH;

use gnp_data::Source;
use gnp_eval::{Provenance, join_forecasts};
use gnp_file::{Draft, Lock, LockError, load_json, save_json, sha256};
use serde::{Deserialize, Serialize};

use super::Counts;
use super::input::Input;
use super::job::Job;
use crate::error::{Context as _, Result, bail};
use crate::inside::inside;
use crate::machine::Machine;
use crate::run::draft::sweep;

const JOB: &str = "job.json";
/// Folder of the parts, in an output that is a folder.
const PARTS: &str = ".parts";

/// An output that is being made.
pub(super) struct Output {
    place: PathBuf,
    /// Whether every recording has a file of its own in the folder `place`.
    by_recording: bool,
    parts: PathBuf,
    pub(super) provenance: Provenance,
    /// Recordings that have a file, with the source that has them.
    names: Mutex<BTreeMap<String, String>>,
    lock: Lock,
}

/// A file of tracks as it was when it was read.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Stamp {
    name: String,
    bytes: u64,
    modified_ns: u64,
}

/// `KEY.json`: a source and what became of it.
#[derive(Debug, Serialize, Deserialize)]
struct Note {
    files: Vec<Stamp>,
    /// Nothing as long as it is worked on.
    done: Option<Done>,
}

/// What a finished source left.
#[derive(Debug, Serialize, Deserialize)]
struct Done {
    counts: Counts,
    /// Files, and how long they are: parts, or those of its recordings.
    left: Vec<(String, u64)>,
}

/// A part that is there, or is to be made.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Its recording.
    pub(super) recording: String,
    /// The Parquet file; not there where nothing of the part was predicted.
    pub(super) path: PathBuf,
}

impl Part {
    fn note(&self) -> PathBuf {
        self.path.with_extension("json")
    }

    /// What is in it; `None` unless it is finished.
    pub(super) fn finished(&self) -> Option<Counts> {
        load_json(&self.note(), "").ok()
    }

    /// Notes that it is finished.
    ///
    /// # Errors
    /// When that cannot be written.
    pub(super) fn finish(&self, counts: &Counts) -> Result<()> {
        Ok(save_json(&self.note(), counts)?)
    }
}

impl Output {
    /// Begins an output, or goes on with one that a call for the same job left. What was left of another job goes, which is
    /// said.
    ///
    /// # Errors
    /// When the place cannot be written to, is of another kind, or another process writes there.
    pub(super) fn begin(
        place: &Path,
        job: &Job,
        input: &Input,
        provenance: Provenance,
        machine: &Machine,
    ) -> Result<Self> {
        let by_recording = match place.extension().and_then(|end| end.to_str()) {
            Some("parquet") if !place.is_dir() => false,
            _ if place.is_dir() || !place.exists() && place.extension().is_none() => true,
            _ => bail!(
                Config,
                "{} is no place for forecasts, which are Parquet: give NAME.parquet, or a folder for a file a recording",
                place.display()
            ),
        };
        let Some(name) = place.file_name().and_then(|name| name.to_str()) else {
            bail!(Config, "{} is no name of a file or folder", place.display());
        };
        let parts = if by_recording { place.join(PARTS) } else { place.with_file_name(format!(".{name}.parts")) };
        fs::create_dir_all(&parts).with_context(|| format!("cannot make the folder {}", parts.display()))?;
        let lock = match Lock::take(&parts.join(Draft::LOCK)) {
            Err(LockError::Held { owner, .. }) => {
                let owner = owner.map_or_else(|| "another process".to_owned(), |owner| owner.to_string());
                bail!(
                    Folder,
                    "{} is being written by {owner}; wait for its end, or take another --output",
                    place.display()
                )
            }
            lock => lock?,
        };
        let names = Mutex::default();
        let output = Self { place: place.to_owned(), by_recording, parts, provenance, names, lock };
        sweep(&[output.parts.clone(), output.folder().to_owned()], machine);
        output.settle(job, machine)?;
        if by_recording {
            for source in &input.sources {
                let done = output.note(input, source).and_then(|note| note.done);
                let key = key(input, source);
                done.iter().flat_map(|done| &done.left).try_for_each(|(name, _)| output.take_name(name, &key))?;
            }
        }
        Ok(output)
    }

    /// The folder in which the output appears.
    fn folder(&self) -> &Path {
        let beside = self.place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if self.by_recording { &self.place } else { beside }
    }

    /// Sees that what is in the folder of parts is of this job.
    fn settle(&self, job: &Job, machine: &Machine) -> Result<()> {
        let path = self.parts.join(JOB);
        let earlier: Option<Job> = if path.exists() { load_json(&path, "").ok() } else { None };
        let differs = match &earlier {
            Some(earlier) => job.difference(earlier),
            None if path.exists() => Some("a program that cannot be told"),
            None => None,
        };
        if let Some(what) = differs {
            machine.progress.note(&format!("{}: what is there is of {what}; starting anew", self.place.display()));
        }
        if earlier.is_none() || differs.is_some() {
            self.remove(|name| name != Draft::LOCK)?;
            save_json(&path, job)?;
        }
        Ok(())
    }

    /// Removes what bears such a name from the folder of parts.
    fn remove(&self, unwanted: impl Fn(&str) -> bool) -> Result<()> {
        let cannot = || format!("cannot clear {}", self.parts.display());
        for entry in fs::read_dir(&self.parts).with_context(cannot)? {
            let entry = entry.with_context(cannot)?;
            if entry.file_name().to_str().is_some_and(&unwanted) {
                fs::remove_file(entry.path()).with_context(cannot)?;
            }
        }
        Ok(())
    }

    fn note(&self, input: &Input, source: &Source) -> Option<Note> {
        load_json(&self.parts.join(format!("{}.json", key(input, source))), "").ok()
    }

    /// Begins with a source: what is in it, where it is finished. Parts of it that were made from other files go.
    ///
    /// # Errors
    /// When its files cannot be looked at or the folder of parts not be written to.
    pub(super) fn begin_source(&self, input: &Input, source: &Source) -> Result<Option<Counts>> {
        let (key, files) = (key(input, source), stamps(source)?);
        match self.note(input, source) {
            Some(Note { files: earlier, done: Some(done) }) if earlier == files => {
                let place = if self.by_recording { &self.place } else { &self.parts };
                let there = |(name, bytes): &(String, u64)| {
                    fs::metadata(place.join(name)).is_ok_and(|found| found.len() == *bytes)
                };
                if done.left.iter().all(there) {
                    return Ok(Some(done.counts));
                }
            }
            Some(Note { files: earlier, done: None }) if earlier == files => return Ok(None),
            _ => {}
        }
        self.remove(|name| name.starts_with(&key))?;
        save_json(&self.parts.join(format!("{key}.json")), &Note { files, done: None })?;
        Ok(None)
    }

    /// A part of a recording of a source.
    pub(super) fn part(&self, input: &Input, source: &Source, recording: (usize, &str), piece: usize) -> Part {
        let (number, name) = recording;
        let path = self.parts.join(format!("{}-{number:05}-{piece:06}.parquet", key(input, source)));
        Part { recording: name.to_owned(), path }
    }

    /// Notes that a source is finished, with its parts in order; where each recording has a file of its own, makes these.
    ///
    /// # Errors
    /// When a file cannot be written; when two recordings have one name.
    pub(super) fn finish_source(&self, input: &Input, source: &Source, parts: &[Part], counts: Counts) -> Result<()> {
        let key = key(input, source);
        let mut left = Vec::new();
        let length = |path: &Path| {
            let found = fs::metadata(path).with_context(|| format!("cannot look at {}", path.display()))?;
            Ok::<u64, crate::Error>(found.len())
        };
        let there: Vec<&Part> = parts.iter().filter(|part| part.path.exists()).collect();
        if self.by_recording {
            for of_recording in there.chunk_by(|a, b| a.recording == b.recording) {
                let Some(first) = of_recording.first() else { continue };
                let name = format!("{}.parquet", first.recording.replace(['/', '\\'], "_"));
                self.take_name(&name, &key)?;
                let to = inside(&self.place, &name)?;
                let paths: Vec<PathBuf> = of_recording.iter().map(|part| part.path.clone()).collect();
                join_forecasts(&paths, &to)?;
                left.push((name, length(&to)?));
            }
        } else {
            for part in there {
                let name = part.path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                left.push((name, length(&part.path)?));
            }
        }
        let note = Note { files: stamps(source)?, done: Some(Done { counts, left }) };
        save_json(&self.parts.join(format!("{key}.json")), &note)?;
        if self.by_recording {
            self.remove(|name| name.strip_prefix(&key).is_some_and(|rest| rest.starts_with('-')))?;
        }
        Ok(())
    }

    /// Sees that a file of a recording is of one source.
    fn take_name(&self, name: &str, key: &str) -> Result<()> {
        let Ok(mut names) = self.names.lock() else { return Ok(()) };
        match names.insert(name.to_owned(), key.to_owned()) {
            Some(other) if other != key => bail!(
                Recordings,
                "two recordings are called {}: rename a file, or write one file for all (--output NAME.parquet)",
                name.trim_end_matches(".parquet")
            ),
            _ => Ok(()),
        }
    }

    /// Makes the output of the parts of all sources, unless there is a file a recording already.
    ///
    /// # Errors
    /// When a part is missing or the file cannot be written.
    pub(super) fn finish(self, input: &Input) -> Result<()> {
        if self.by_recording {
            return Ok(());
        }
        let done = input.sources.iter().filter_map(|source| self.note(input, source)?.done);
        let parts: Vec<PathBuf> = done.flat_map(|done| done.left).map(|(name, _)| self.parts.join(name)).collect();
        join_forecasts(&parts, &self.place)?;
        let Self { parts, lock, .. } = self;
        drop(lock);
        fs::remove_dir_all(&parts).with_context(|| format!("cannot remove {}", parts.display()))
    }

    /// Where an interrupted call leaves what is done.
    pub(super) fn kept(&self) -> PathBuf {
        self.parts.clone()
    }
}

/// Names a source among those of an input: by where its first file lies in it.
fn key(input: &Input, source: &Source) -> String {
    let file = source.files.first().map_or(Path::new(&source.name), PathBuf::as_path);
    let place = file.strip_prefix(&input.root).ok().filter(|rest| !rest.as_os_str().is_empty());
    let place = place.or_else(|| file.file_name().map(Path::new)).unwrap_or(file);
    sha256([place.to_string_lossy().as_bytes()])[..16].to_owned()
}

/// The files of a source as they are now.
fn stamps(source: &Source) -> Result<Vec<Stamp>> {
    let stamp = |path: &PathBuf| {
        let found = fs::metadata(path).with_context(|| format!("cannot look at {}", path.display()))?;
        let modified = found.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Ok(Stamp {
            name: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            bytes: found.len(),
            modified_ns: modified.map_or(0, |since| since.as_nanos().try_into().unwrap_or(u64::MAX)),
        })
    };
    source.files.iter().map(stamp).collect()
}
