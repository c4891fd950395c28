//! Folders for the files of a case, in memory where the system has such a place.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Where Linux keeps files in memory.
const IN_MEMORY: &str = "/dev/shm";

/// Two folders: one that holds exactly the files of the present case, one for what the code under test writes.
#[derive(Debug)]
pub struct Scratch {
    given: TempDir,
    made: TempDir,
    names: RefCell<BTreeSet<String>>,
}

impl Scratch {
    /// Empty folders, in memory where there is such a place; they are deleted with this.
    ///
    /// # Errors
    /// When no folder can be made.
    pub fn new() -> io::Result<Self> {
        Self::within(&Self::place())
    }

    /// Empty folders in another one.
    ///
    /// # Errors
    /// When no folder can be made.
    pub fn within(folder: &Path) -> io::Result<Self> {
        let folder = || tempfile::tempdir_in(folder);
        Ok(Self { given: folder()?, made: folder()?, names: RefCell::default() })
    }

    /// Where folders for fuzzing are best made.
    #[must_use]
    pub fn place() -> PathBuf {
        if Path::new(IN_MEMORY).is_dir() { IN_MEMORY.into() } else { std::env::temp_dir() }
    }

    /// The folder of the case.
    #[must_use]
    pub fn given(&self) -> &Path {
        self.given.path()
    }

    /// A file of that name for what is written.
    #[must_use]
    pub fn made(&self, name: &str) -> PathBuf {
        self.made.path().join(name)
    }

    /// Makes the folder of the case hold these files, name and content, and no others.
    ///
    /// # Errors
    /// When a file cannot be written or deleted.
    pub fn put(&self, files: &[(&str, &[u8])]) -> io::Result<()> {
        let mut names = self.names.borrow_mut();
        for old in names.iter().filter(|old| files.iter().all(|(name, _)| name != old)) {
            std::fs::remove_file(self.given().join(old))?;
        }
        names.clear();
        for (name, content) in files {
            std::fs::write(self.given().join(name), content)?;
            names.insert((*name).to_owned());
        }
        Ok(())
    }

    /// As [`Scratch::put`] of one file, whose path it gives.
    ///
    /// # Errors
    /// As there.
    pub fn only(&self, name: &str, content: &[u8]) -> io::Result<PathBuf> {
        self.put(&[(name, content)])?;
        Ok(self.given().join(name))
    }
}
