//! Files and folders under temporary names, and what killed programs left of them.
//!
//! A temporary file is locked by who writes it, a draft by who fills it. The lock ends with the program: what bears such a
//! name and can be locked has lost its owner. Where files cannot be locked nothing is swept. Some network file systems
//! lock within one computer alone; so the names have a mark of the computer, and those of others stay until nothing was
//! written there for [`FORGOTTEN`].

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::{NamedTempFile, TempDir};

use crate::lock::{acquire, host};
use crate::{Lock, LockError, parent, sha256};

/// Names of temporary files begin and end so.
const PREFIX: &str = ".gnp-";
const SUFFIX: &str = ".tmp";
/// How often a name is tried that a sweep took away between its making and its locking.
const TRIES: usize = 16;
/// After this long without a change another computer's file or draft has lost its owner.
const FORGOTTEN: Duration = Duration::from_hours(24 * 7);

/// A file under a temporary name; gone when it is dropped before it is persisted.
#[derive(Debug)]
pub struct Temporary {
    file: NamedTempFile,
}

/// A temporary file in the folder of `path`, as readable as any other new file; [`Temporary::persist`] it to
/// `path` once it is whole.
///
/// # Errors
/// When the folder is missing or cannot be written to.
pub fn beside(path: &Path) -> io::Result<Temporary> {
    let mut builder = tempfile::Builder::new();
    let prefix = format!("{PREFIX}{}", mark());
    builder.prefix(&prefix).suffix(SUFFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the umask
    for _ in 0..TRIES {
        let file = builder.tempfile_in(parent(path))?;
        let held = !matches!(file.as_file().try_lock(), Err(fs::TryLockError::WouldBlock));
        if held && file.path().exists() {
            return Ok(Temporary { file });
        }
    }
    Err(io::Error::other("temporary files are swept away before they are written"))
}

impl Temporary {
    /// The file, to write to. Its clones share its lock.
    pub fn as_file_mut(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Its temporary place.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Brings the bytes to the disk, then gives the file its name: after a power cut the old file is there or the whole
    /// new one.
    ///
    /// # Errors
    /// When it cannot be written or renamed; what stood at `path` is then still there.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        self.file.as_file().sync_data()?;
        self.file.persist(path).map_err(|error| error.error)?;
        sync_folder(parent(path));
        Ok(())
    }
}

impl Write for Temporary {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Brings the names in a folder to the disk, where the system can.
fn sync_folder(folder: &Path) {
    // Some systems open no folder, some file systems sync none; the file itself is safe.
    if cfg!(unix) {
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
}

/// Writes `bytes` to `path`, whole or not at all.
///
/// # Errors
/// When the file cannot be written or renamed; what stood at `path` is then still there.
pub fn save(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = beside(path)?;
    file.write_all(bytes)?;
    file.persist(path)
}

/// Copies the file `from` to `to`, whole or not at all.
///
/// # Errors
/// When it cannot be read or written.
pub fn copy(from: &Path, to: &Path) -> io::Result<()> {
    let mut file = beside(to)?;
    io::copy(&mut File::open(from)?, &mut file)?;
    file.persist(to)
}

/// Removes the temporary files in `folder`, not below it, whose program ended before they had their names; returns how
/// many. Files of other programs stay, and so does what cannot be removed.
#[must_use = "what was removed is to be said"]
pub fn sweep(folder: &Path) -> usize {
    let files = entries(folder, |name| name.starts_with(PREFIX) && name.ends_with(SUFFIX))
        .filter(|path| fs::symlink_metadata(path).is_ok_and(|found| found.is_file()));
    files.filter(|path| may_sweep(path, PREFIX) && remove_abandoned(path).unwrap_or(false)).count()
}

/// The mark of this computer in a temporary name, the same for all its programs.
fn mark() -> String {
    format!("{}-", &sha256([host().as_bytes()])[..8])
}

/// Whether a lock tells if the owner of `path` is gone, as it is of this computer, or nothing was written there for long.
fn may_sweep(path: &Path, prefix: &str) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix(prefix));
    if name.is_some_and(|name| name.starts_with(&mark())) {
        return true;
    }
    let changed = |path: &Path| fs::symlink_metadata(path).and_then(|found| found.modified()).ok();
    let inside = entries(path, |_| true).filter_map(|path| changed(&path));
    let newest = inside.chain(changed(path)).max();
    newest.is_some_and(|newest| newest.elapsed().is_ok_and(|age| age > FORGOTTEN))
}

fn remove_abandoned(path: &Path) -> io::Result<bool> {
    let file = File::options().read(true).write(true).open(path)?;
    Ok(file.try_lock().is_ok() && fs::remove_file(path).is_ok())
}

/// What is in `folder` under a name that fits.
fn entries<F: Fn(&str) -> bool>(folder: &Path, fits: F) -> impl Iterator<Item = PathBuf> + use<F> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(move |entry| entry.file_name().to_str().is_some_and(&fits)).map(|entry| entry.path())
}

/// A folder being filled beside its place; dropped without [`Draft::publish`] it vanishes.
#[derive(Debug)]
pub struct Draft {
    // Freed before the folder goes.
    lock: Lock,
    folder: TempDir,
}

impl Draft {
    /// Name of the file in a draft, and in what becomes of it, by which it is locked.
    pub const LOCK: &str = "run.lock";

    /// Starts a folder beside `place` for what will stand there.
    ///
    /// # Errors
    /// [`LockError::Held`] when another program fills one for the same place; [`LockError::Io`] when the folder that
    /// `place` is in is missing or cannot be written to.
    pub fn start(place: &Path) -> Result<Self, LockError> {
        let io = |source| LockError::Io { path: place.to_owned(), source };
        // Two that start at once do not see each other; then one fails where it is published.
        if let Some(held) = drafts(place).find_map(|folder| held(&folder.join(Self::LOCK))) {
            return Err(held);
        }
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777)); // less the umask
        let mut prefix = draft_prefix(place);
        prefix.push(mark());
        builder.prefix(&prefix);
        for _ in 0..TRIES {
            let folder = builder.tempdir_in(parent(place)).map_err(io)?;
            let path = folder.path().join(Self::LOCK);
            match Lock::take(&path) {
                Ok(lock) if path.exists() => return Ok(Self { lock, folder }),
                Ok(_) | Err(LockError::Held { .. }) => {}
                Err(LockError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Err(io(io::Error::other("drafts are swept away before they are filled")))
    }

    /// The folder as it is now.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Moves the folder to its `place`, where nothing or an empty folder may be; its lock goes on.
    ///
    /// # Errors
    /// When it cannot be moved there.
    pub fn publish(self, place: &Path) -> io::Result<Lock> {
        if place.is_dir() {
            fs::remove_dir(place)?; // empty, or this fails
        }
        sync_folder(self.folder.path());
        fs::rename(self.folder.path(), place)?;
        sync_folder(parent(place));
        // Nothing is left at the temporary name; forget it instead of cleaning it up.
        let _ = self.folder.keep();
        Ok(self.lock)
    }
}

/// `.NAME.unfinished-`.
fn draft_prefix(place: &Path) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(place.file_name().unwrap_or_default());
    prefix.push(".unfinished-");
    prefix
}

/// Removes the drafts of what was to stand at `place` whose program ended; returns how many. A folder that has other
/// files and no lock is of another program and stays.
#[must_use = "what was removed is to be said"]
pub fn sweep_drafts(place: &Path) -> usize {
    let prefix = draft_prefix(place);
    let Some(prefix) = prefix.to_str() else { return 0 };
    drafts(place).filter(|path| may_sweep(path, prefix) && remove_draft(path)).count()
}

/// The drafts of what is to stand at `place`, of all computers.
fn drafts(place: &Path) -> impl Iterator<Item = PathBuf> {
    let prefix = draft_prefix(place);
    let folders = entries(parent(place), move |name| prefix.to_str().is_some_and(|prefix| name.starts_with(prefix)));
    folders.filter(|path| fs::symlink_metadata(path).is_ok_and(|found| found.is_dir()))
}

/// That the lock at `path` is held, if it is.
fn held(path: &Path) -> Option<LockError> {
    let mut file = File::options().read(true).write(true).open(path).ok()?;
    acquire(&mut file, path).err()
}

fn remove_draft(folder: &Path) -> bool {
    let path = folder.join(Draft::LOCK);
    if !path.exists() {
        return fs::remove_dir(folder).is_ok(); // killed before it had its lock
    }
    let Ok(mut file) = File::options().read(true).write(true).open(&path) else { return false };
    if file.try_lock().is_err() {
        return false;
    }
    // A lock is empty or says who held it; anything else is not ours.
    let mut text = String::new();
    let ours = file.read_to_string(&mut text).is_ok()
        && (text.is_empty() || serde_json::from_str::<crate::Owner>(&text).is_ok());
    ours && fs::remove_dir_all(folder).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    /// Makes it as old as what is forgotten.
    fn age(path: &Path) {
        let then = std::time::SystemTime::now() - FORGOTTEN - Duration::from_hours(1);
        File::open(path).unwrap().set_modified(then).unwrap();
    }

    #[test]
    fn replaces_what_was_there_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        save(&path, b"one").unwrap();
        save(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        copy(&path, &folder.path().join("b.txt")).unwrap();
        assert_eq!(fs::read(folder.path().join("b.txt")).unwrap(), b"two");
        assert_eq!(count(folder.path()), 2);
    }

    #[test]
    fn what_is_dropped_half_written_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        save(&path, b"old").unwrap();
        let mut half = beside(&path).unwrap();
        half.write_all(b"new, but").unwrap();
        drop(half);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(count(folder.path()), 1);
        assert!(save(&folder.path().join("missing/a.txt"), b"x").is_err());
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_the_umask_lets_them() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        save(&ours, b"x").unwrap();
        fs::write(&plain, b"x").unwrap();
        let mode = |path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(ours), mode(plain));
    }

    #[test]
    fn only_what_nobody_writes_any_more_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut written = beside(&path).unwrap();
        // As a killed program leaves them: under such a name, locked by nobody.
        let (ours, theirs) = (format!(".gnp-{}a.tmp", mark()), ".gnp-01234567-a.tmp");
        let left = [&ours, ".gnp-01234567-old.tmp"].map(|name| folder.path().join(name));
        let others = [".tmpAbC", ".gnp-notes", "gnp-a.tmp", theirs].map(|name| folder.path().join(name));
        left.iter().chain(&others).for_each(|path| fs::write(path, "half").unwrap());
        age(&left[1]);
        fs::create_dir(folder.path().join(".gnp-folder.tmp")).unwrap();
        assert_eq!(sweep(folder.path()), left.len());
        assert!(left.iter().all(|path| !path.exists()) && others.iter().all(|path| path.exists()));
        written.write_all(b"whole").unwrap();
        written.persist(&path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(sweep(folder.path()), 0);
        assert_eq!(sweep(&folder.path().join("missing")), 0);
    }

    #[test]
    fn a_draft_stands_whole_at_its_place_and_keeps_its_lock() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("run");
        fs::create_dir(&place).unwrap();
        let draft = Draft::start(&place).unwrap();
        fs::write(draft.path().join("a"), "x").unwrap();
        assert_eq!(sweep_drafts(&place), 0);
        let lock = draft.publish(&place).unwrap();
        assert!(place.join("a").exists());
        assert!(matches!(Lock::take(&place.join(Draft::LOCK)), Err(LockError::Held { .. })));
        drop(lock);
        drop(Lock::take(&place.join(Draft::LOCK)).unwrap());
        // In use.
        let other = Draft::start(&place).unwrap();
        assert!(other.publish(&place).is_err());
        assert_eq!(count(folder.path()), 1);
    }

    #[test]
    fn only_drafts_of_this_place_whose_owner_is_gone_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("run");
        let filled = Draft::start(&place).unwrap();
        let make = |name: &str, file: &str, text: &str| {
            fs::create_dir(folder.path().join(name)).unwrap();
            fs::write(folder.path().join(name).join(file), text).unwrap();
        };
        let owner = r#"{"pid": 1, "host": "a", "program": "gnp", "since": "2026-11-26 03:50:12 UTC"}"#;
        make(&format!(".run.unfinished-{}killed", mark()), Draft::LOCK, owner);
        make(".run.unfinished-01234567-live", Draft::LOCK, owner);
        make(&format!(".run.unfinished-{}users", mark()), "notes.txt", "mine");
        make(&format!(".run.unfinished-{}foreign", mark()), Draft::LOCK, "mine");
        make(&format!(".other.unfinished-{}killed", mark()), Draft::LOCK, "");
        fs::create_dir(folder.path().join(format!(".run.unfinished-{}empty", mark()))).unwrap();
        assert_eq!(sweep_drafts(&place), 2);
        assert_eq!(count(folder.path()), 5);
        drop(filled);
        assert_eq!(count(folder.path()), 4);
        // On another computer something is written as long as any file in it is young.
        let theirs = folder.path().join(".run.unfinished-01234567-live");
        fs::write(theirs.join("young"), "x").unwrap();
        age(&theirs.join(Draft::LOCK));
        age(&theirs);
        assert_eq!(sweep_drafts(&place), 0);
        age(&theirs.join("young"));
        assert_eq!(sweep_drafts(&place), 1);
        assert!(!theirs.exists());
    }

    #[test]
    fn one_place_has_one_draft() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("run");
        let first = Draft::start(&place).unwrap();
        let Err(LockError::Held { owner: Some(owner), .. }) = Draft::start(&place) else { panic!("a second one") };
        assert_eq!(owner.pid, std::process::id());
        assert!(Draft::start(&folder.path().join("run2")).is_ok());
        drop(first);
        assert!(Draft::start(&place).is_ok());
    }
}
