//! What was written into a folder, in order, and every version of it: what a power cut needs to know to lose some of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, Result};

use crate::contents::{in_events, paths};
use crate::process::PERIOD;

/// A file as it was at some time.
#[derive(Clone, Debug)]
pub(super) struct Version {
    /// From the folder.
    pub(super) path: String,
    /// A second name of the same file, which stays when the first is replaced.
    kept: PathBuf,
}

/// Versions of the files in a folder, the oldest first. Left out are files that are not renamed into place: curves, which are
/// appended to, locks, and temporary files, which nobody reads.
#[derive(Debug)]
pub(super) struct History {
    folder: PathBuf,
    store: PathBuf,
    versions: Vec<Version>,
    /// Versions that were there before anything was watched.
    before: usize,
}

impl History {
    /// Notes what is in `folder`; versions are kept in `store`, which is on the same disk.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub(super) fn begin(folder: &Path, store: &Path) -> Result<Self> {
        fs::create_dir_all(store).with_context(|| format!("cannot make {}", store.display()))?;
        let mut history = Self { folder: folder.to_owned(), store: store.to_owned(), versions: Vec::new(), before: 0 };
        history.look()?;
        history.before = history.versions.len();
        Ok(history)
    }

    /// Notes what is written until `end` says so.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub(super) fn watch(mut self, end: &AtomicBool) -> Result<Self> {
        while !end.load(Ordering::Relaxed) {
            self.look()?;
            std::thread::sleep(PERIOD);
        }
        self.look()?;
        Ok(self)
    }

    /// Notes what is new.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub(super) fn look(&mut self) -> Result<()> {
        if !self.folder.exists() {
            return Ok(());
        }
        for path in paths(&self.folder)?.into_iter().filter(|path| is_renamed(path)) {
            let place = self.folder.join(&path);
            let known = self.last(&path, self.versions.len()).map(|version| version.kept.clone());
            if known.is_some_and(|kept| same_file(&kept, &place)) {
                continue;
            }
            let kept = self.store.join(self.versions.len().to_string());
            // It may have been removed by now.
            if fs::hard_link(&place, &kept).is_ok() {
                self.versions.push(Version { path, kept });
            }
        }
        Ok(())
    }

    /// The last version of `path` among the first `count`.
    fn last(&self, path: &str, count: usize) -> Option<&Version> {
        self.versions[..count].iter().rev().find(|version| version.path == path)
    }

    /// What was written while it was watched, the oldest first.
    pub(super) fn written(&self) -> &[Version] {
        &self.versions[self.before..]
    }

    /// Puts the folder into the state in which the rename of the `index`-th of [`History::written`] is lost: what stood there
    /// before stands there again.
    ///
    /// # Errors
    /// When a file cannot be changed.
    pub(super) fn lose(&self, index: usize) -> Result<()> {
        let lost = &self.versions[self.before + index];
        let place = self.folder.join(&lost.path);
        let cannot = || format!("cannot replace {}", place.display());
        if place.exists() {
            fs::remove_file(&place).with_context(cannot)?;
        }
        if let Some(earlier) = self.last(&lost.path, self.before + index) {
            fs::copy(&earlier.kept, &place).with_context(cannot)?;
        }
        Ok(())
    }
}

/// Whether a file of that path is written under a temporary name and renamed to this one.
fn is_renamed(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    let temporary = name.starts_with(".gnp-") && name.ends_with(".tmp");
    !temporary && !name.ends_with(".lock") && !in_events(path)
}

/// Whether two names are of one file.
fn same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let of = |path| fs::metadata(path).map(|data| (data.dev(), data.ino())).ok();
        of(a).is_some_and(|id| Some(id) == of(b))
    }
    #[cfg(not(unix))]
    {
        fs::read(a).ok() == fs::read(b).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_rename_brings_back_what_was_there() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("run");
        fs::create_dir(&folder).unwrap();
        let write = |name: &str, text: &str| gnp_file::save(&folder.join(name), text.as_bytes()).unwrap();
        let read = |name: &str| fs::read_to_string(folder.join(name)).ok();
        write("a", "0");
        let mut history = History::begin(&folder, &place.path().join("versions")).unwrap();
        // Nobody reads what is not renamed into place: tearing it would be no trouble.
        let unfinished = gnp_file::beside(&folder.join("c")).unwrap();
        fs::create_dir(folder.join("events")).unwrap();
        ["run.lock", "events/curve"].iter().for_each(|name| fs::write(folder.join(name), "").unwrap());
        for (name, text) in [("a", "1"), ("b", "1"), ("a", "2")] {
            write(name, text);
            history.look().unwrap();
        }
        drop(unfinished);
        let written: Vec<&str> = history.written().iter().map(|version| version.path.as_str()).collect();
        assert_eq!(written, ["a", "b", "a"]);
        history.lose(2).unwrap();
        assert_eq!((read("a").as_deref(), read("b").as_deref()), (Some("1"), Some("1")));
        history.lose(1).unwrap();
        history.lose(0).unwrap();
        assert_eq!((read("a").as_deref(), read("b")), (Some("0"), None));
    }
}
