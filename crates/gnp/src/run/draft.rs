//! Folders that appear whole: filled beside their place, then moved there.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use gnp_file::LockError;

use crate::error::{Context as _, Result, bail};
use crate::machine::Machine;

/// A folder being filled beside its place; dropped before it is published it vanishes.
#[derive(Debug)]
pub(crate) struct Draft {
    folder: gnp_file::Draft,
    place: PathBuf,
    remedy: String,
}

impl Draft {
    /// Starts a folder that will stand at `place`. Drafts for it that a killed program left go.
    ///
    /// # Errors
    /// When `place` exists and is not an empty folder, which [`Draft::publish`] finds out, too; the message ends with
    /// `remedy`. When another program makes it.
    pub(crate) fn start(place: &Path, remedy: &str, machine: &Machine) -> Result<Self> {
        let place = &target(place)?;
        if occupied(place)? {
            bail!(Folder, "{} exists and is not empty; {remedy}", place.display());
        }
        let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        sweep_drafts(place, machine)?;
        let folder = match gnp_file::Draft::start(place) {
            Err(LockError::Held { owner, .. }) => {
                let owner = owner.map_or_else(|| "another process".to_owned(), |owner| owner.to_string());
                bail!(
                    Folder,
                    "{} is being made by {owner}; wait until that ends, or take another place",
                    place.display()
                )
            }
            Err(LockError::Io { source, .. }) => {
                return Err(source).with_context(|| format!("cannot make a folder in {}", parent.display()));
            }
            started => started?,
        };
        Ok(Self { folder, place: place.to_owned(), remedy: remedy.to_owned() })
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
        let Self { folder, place, remedy } = self;
        match folder.publish(&place) {
            Err(error) if matches!(error.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists) => {
                bail!(Folder, "{} was made by another program meanwhile; {remedy}", place.display())
            }
            done => done.with_context(|| format!("cannot move the finished folder to {}", place.display()))?,
        };
        Ok(place)
    }
}

/// What `place` leads to: a folder cannot be moved to where a link is, and is filled beside that.
fn target(place: &Path) -> Result<PathBuf> {
    // With a separator at its end a link would be taken for what it leads to.
    let place: PathBuf = place.components().collect();
    if !place.is_symlink() {
        return Ok(place);
    }
    fs::canonicalize(&place).with_context(|| format!("{} is a link that leads nowhere; remove it", place.display()))
}

/// Removes what killed programs left of drafts for `place`, or for what it links to, and says so.
///
/// # Errors
/// When it is a link that leads nowhere.
pub(crate) fn sweep_drafts(place: &Path, machine: &Machine) -> Result<()> {
    let place = target(place)?;
    let left = gnp_file::sweep_drafts(&place);
    if left > 0 {
        let place = place.display();
        machine.progress.note(&format!("unfinished folders for {place} that killed programs left: {left} removed"));
    }
    Ok(())
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

    #[test]
    fn a_second_one_is_refused_at_once_and_one_that_comes_too_late_says_so() {
        let parent = TempDir::new().unwrap();
        let place = parent.path().join("run");
        let draft = Draft::start(&place, "give --resume", &Machine::default()).unwrap();
        let message = Draft::start(&place, "", &Machine::default()).unwrap_err().to_string();
        let (owner, ours) = ("is being made by", format!("process {}", std::process::id()));
        assert!(message.contains(owner) && message.contains(&ours), "{message}");
        // As by one that started in the same moment.
        fs::create_dir(&place).unwrap();
        fs::write(place.join("theirs"), "x").unwrap();
        let message = draft.publish().unwrap_err().to_string();
        assert!(message.contains("made by another program meanwhile; give --resume"), "{message}");
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
        assert!(place.join("theirs").exists());
    }

    /// They lie beside the folder, whether that is named with a separator at its end or not, and not beside the link.
    #[cfg(unix)]
    #[test]
    fn a_run_that_is_resumed_through_a_link_has_its_own_drafts_swept() {
        use std::os::unix::fs::symlink;
        let (disk, links) = (TempDir::new().unwrap(), TempDir::new().unwrap());
        let (folder, link) = (disk.path().join("us101"), links.path().join("run"));
        fs::create_dir(&folder).unwrap();
        symlink(&folder, &link).unwrap();
        let drafts = |parent: &TempDir| {
            let names = fs::read_dir(parent.path()).unwrap().map(|entry| entry.unwrap().file_name());
            names.filter(|name| name.to_string_lossy().contains(".unfinished-")).count()
        };
        // What a killed program leaves: its lock is free.
        let leave = |place: &Path| {
            let draft = gnp_file::Draft::start(place).unwrap();
            let kept = draft.path().with_extension("kept");
            let name = draft.path().to_owned();
            fs::rename(&name, &kept).unwrap();
            drop(draft);
            fs::rename(&kept, &name).unwrap();
        };
        for named in [link.clone(), link.join("")] {
            leave(&folder);
            leave(&links.path().join("us101"));
            assert_eq!((drafts(&disk), drafts(&links)), (1, 1));
            // There is no run to go on with; what is unfinished goes before that is said.
            let error = crate::Run::resume(&named, &Machine::default()).unwrap_err().to_string();
            assert!(error.contains("is not a run folder"), "{error}");
            assert_eq!((drafts(&disk), drafts(&links)), (0, 1), "{}", named.display());
            assert_eq!(gnp_file::sweep_drafts(&links.path().join("us101")), 1);
        }
        fs::remove_dir(&folder).unwrap();
        let error = crate::Run::resume(&link, &Machine::default()).unwrap_err().to_string();
        assert!(error.contains("leads nowhere"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_an_empty_folder_leads_to_what_is_made() {
        use std::os::unix::fs::symlink;
        let parent = TempDir::new().unwrap();
        let (folder, link) = (parent.path().join("disk"), parent.path().join("run"));
        symlink(&folder, &link).unwrap();
        let message = Draft::start(&link, "", &Machine::default()).unwrap_err().to_string();
        assert!(message.contains("leads nowhere"), "{message}");
        fs::create_dir(&folder).unwrap();
        let draft = Draft::start(&link, "", &Machine::default()).unwrap();
        fs::write(draft.path().join("a"), "x").unwrap();
        draft.publish().unwrap();
        assert!(link.is_symlink() && link.join("a").exists());
    }
}
