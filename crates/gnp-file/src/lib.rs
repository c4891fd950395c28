//! Files that appear whole or not at all: written under a temporary name beside the place they
//! are for, then renamed. A program that is killed, or a disk that is full, leaves the old file.
//! [`save_arrays`] and [`load_arrays`] are the one format of named arrays: checkpoints and modes.
//!
//! ```
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("scores.json");
//! gnp_file::save(&path, b"[]")?;
//! assert_eq!(std::fs::read(&path)?, b"[]");
//! # Ok::<(), std::io::Error>(())
//! ```

mod tensors;

use std::io::{self, Write};
use std::path::Path;

pub use tempfile::NamedTempFile;

pub use crate::tensors::{Array, FileError, FileHeader, Values, load_arrays, save_arrays};

/// A temporary file in the folder of `path`, as readable as any other new file; `persist` it to
/// `path` once it is whole.
///
/// # Errors
/// When the folder is missing or cannot be written to.
pub fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the umask
    builder.tempfile_in(folder)
}

/// Writes `bytes` to `path`, whole or not at all.
///
/// # Errors
/// When the file cannot be written or renamed; what stood at `path` is then still there.
pub fn save(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = beside(path)?;
    file.write_all(bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_what_was_there_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        save(&path, b"one").unwrap();
        save(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_is_dropped_half_written_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        save(&path, b"old").unwrap();
        let mut half = beside(&path).unwrap();
        half.write_all(b"new, but").unwrap();
        drop(half);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(save(&folder.path().join("missing/a.txt"), b"x").is_err());
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_the_umask_lets_them() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        save(&ours, b"x").unwrap();
        std::fs::write(&plain, b"x").unwrap();
        let mode = |path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(ours), mode(plain));
    }
}
