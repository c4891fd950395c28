//! Folders that appear whole: filled beside their place, then moved there.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;

/// A folder being filled beside its place; dropped before it is published it vanishes.
#[derive(Debug)]
pub(crate) struct Draft {
    folder: gnp_file::Draft,
    place: PathBuf,
}

impl Draft {
    /// Starts a folder that will stand at `place`. Drafts for it that a killed program left go.
    ///
    /// # Errors
    /// When `place` exists and is not an empty folder; the message ends with `remedy`.
    pub(crate) fn start(place: &Path, remedy: &str, machine: &Machine) -> Result<Self> {
        if occupied(place)? {
            bail!(Folder, "{} exists and is not empty; {remedy}", place.display());
        }
        let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        sweep_drafts(place, machine);
        let folder =
            gnp_file::Draft::start(place).with_context(|| format!("cannot make a folder in {}", parent.display()))?;
        Ok(Self { folder, place: place.to_owned() })
    }

    /// The folder as it is now.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Moves the folder to its place; nobody writes into it any more.
    ///
    /// # Errors
    /// When it cannot be moved there.
    pub(crate) fn publish(self) -> Result<PathBuf> {
        let lock = self.path().join(gnp_file::Draft::LOCK);
        fs::remove_file(&lock).with_context(|| format!("cannot remove {}", lock.display()))?;
        self.publish_run()
    }

    /// Moves the folder of a run to its place; it keeps the file by which its writers keep each other out.
    ///
    /// # Errors
    /// When it cannot be moved there.
    pub(crate) fn publish_run(self) -> Result<PathBuf> {
        let Self { folder, place } = self;
        folder.publish(&place).with_context(|| format!("cannot move the finished folder to {}", place.display()))?;
        Ok(place)
    }
}

/// Removes what killed programs left of drafts for `place`, and says so.
pub(crate) fn sweep_drafts(place: &Path, machine: &Machine) {
    let left = gnp_file::sweep_drafts(place);
    if left > 0 {
        let place = place.display();
        machine.progress.note(&format!("unfinished folders for {place} that killed programs left: {left} removed"));
    }
}

/// Removes what killed programs left of files in `folders`, not below them, and says so.
pub(crate) fn sweep(folders: &[PathBuf], machine: &Machine) {
    for folder in folders {
        let left = gnp_file::sweep(folder);
        if left > 0 {
            let folder = folder.display();
            machine.progress.note(&format!("temporary files in {folder} that killed programs left: {left} removed"));
        }
    }
}

/// Whether something that must not be overwritten is at `place`.
pub(crate) fn occupied(place: &Path) -> Result<bool> {
    if !place.exists() {
        return Ok(false);
    }
    if !place.is_dir() {
        return Ok(true);
    }
    let mut entries = fs::read_dir(place).with_context(|| format!("cannot list {}", place.display()))?;
    Ok(entries.next().is_some())
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    #[test]
    fn an_abandoned_draft_leaves_nothing() {
        let parent = TempDir::new().unwrap();
        let draft = Draft::start(&parent.path().join("run"), "", &Machine::default()).unwrap();
        fs::write(draft.path().join("half"), "x").unwrap();
        drop(draft);
        assert!(!occupied(parent.path()).unwrap());
    }

    #[test]
    fn a_folder_in_use_is_refused_and_an_empty_one_is_taken() {
        let parent = TempDir::new().unwrap();
        let place = parent.path().join("run");
        fs::create_dir(&place).unwrap();
        let draft = Draft::start(&place, "", &Machine::default()).unwrap();
        fs::write(draft.path().join("a"), "x").unwrap();
        draft.publish().unwrap();
        assert_eq!(fs::read_dir(&place).unwrap().count(), 1, "no lock is left");
        let message = Draft::start(&place, "give --resume", &Machine::default()).unwrap_err().to_string();
        assert!(message.contains("not empty; give --resume"), "{message}");
    }
}
