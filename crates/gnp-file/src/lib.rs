//! Files that appear whole or not at all, that say what they should hold, and that one program writes at a time.
//!
//! - [`save`] and [`beside`] write under a temporary name beside the place, bring the bytes to the disk, then rename: a
//!   program that is killed, a power cut or a full disk leaves the old file or the new one. What a killed program leaves
//!   is recognised by [`sweep`].
//! - [`save_arrays`] and [`load_arrays`] are the one format of named arrays, checkpoints and modes, under a checksum;
//!   [`save_json`] and [`load_json`] are the same for what is not an array; [`Seal`] says what any other file holds.
//! - [`Lock`] keeps other programs out of a folder, and says who holds it. It is free when its program ends, however.
//!
//! ```
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("scores.json");
//! gnp_file::save(&path, b"[]")?;
//! assert_eq!(std::fs::read(&path)?, b"[]");
//! # Ok::<(), std::io::Error>(())
//! ```

mod json;
mod lock;
mod seal;
mod temporary;
mod tensors;

use std::path::{Path, PathBuf};

pub use crate::json::{json_line, load_json, parse_json, save_json};
pub use crate::lock::{Lock, LockError, Owner};
pub use crate::seal::{Seal, sha256};
pub use crate::temporary::{Draft, Temporary, beside, copy, save, sweep, sweep_drafts};
pub use crate::tensors::{Array, FileHeader, Values, load_arrays, parse_arrays, save_arrays};

/// A file that cannot be written, read or used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
#[non_exhaustive]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong, and what to do.
    pub problem: String,
}

impl FileError {
    /// `problem` follows the path and says what to do.
    pub fn new(path: &Path, problem: impl Into<String>) -> Self {
        Self { path: path.to_owned(), problem: problem.into() }
    }
}

/// The beginning of a text that may have no end, of at most `most` characters: what a message quotes of a file or a
/// command line.
///
/// ```
/// assert_eq!(gnp_file::excerpt("speed", 10), "speed");
/// assert_eq!(gnp_file::excerpt("velocity along the road", 8), "velocity...");
/// ```
#[must_use]
pub fn excerpt(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// The folder that `path` is in.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
