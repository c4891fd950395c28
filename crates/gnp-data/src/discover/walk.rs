//! The files of a folder: what links lead to is met once, and what is no file is never opened.

use std::collections::BTreeSet;
use std::fs::{FileType, Metadata};
use std::path::{Path, PathBuf};

use super::{FoundFile, FoundFiles, NotRead};
use crate::error::DataError;
use crate::format::Format;

/// A file of this name marks every recording below its folder as made by a simulator.
const SIMULATED: &str = "SIMULATED";

/// Beginnings of names, in lower case, of files that come with data and are none.
const COMPANIONS: [&str; 10] =
    ["readme", "license", "licence", "copying", "notice", "citation", "changelog", "authors", "terms", "simulated"];

/// Ends of names of pictures and writings, in lower case.
const WRITINGS: [&str; 14] =
    ["md", "markdown", "rst", "pdf", "bib", "png", "jpg", "jpeg", "gif", "svg", "tif", "tiff", "bmp", "webp"];

/// Refuses what is no regular file, such as a pipe, whose reading may never end.
///
/// # Errors
/// [`DataError::NotAFile`]; [`DataError::Io`] where there is nothing.
pub(crate) fn only_a_file(path: &Path) -> Result<(), DataError> {
    let kind = metadata(path)?.file_type();
    if kind.is_file() { Ok(()) } else { Err(DataError::NotAFile { file: path.into(), what: name_of(kind) }) }
}

/// Whether a file comes with data and is none, by its name.
pub(super) fn accompanies(file: &Path) -> bool {
    let name = file.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let writing = name.rsplit_once('.').is_some_and(|(_, end)| WRITINGS.contains(&end));
    writing || COMPANIONS.iter().any(|start| name.starts_with(start))
}

fn metadata(path: &Path) -> Result<Metadata, DataError> {
    std::fs::metadata(path).map_err(|source| DataError::Io { file: path.into(), source })
}

/// The place that a path leads to, without links.
fn canonical(path: &Path) -> Result<PathBuf, DataError> {
    path.canonicalize().map_err(|source| DataError::Io { file: path.into(), source })
}

/// What is neither file nor folder, with its article.
#[cfg(unix)]
fn name_of(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt as _;

    if kind.is_fifo() {
        "a named pipe"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_dir() {
        "a folder"
    } else {
        "a device"
    }
}

/// What is neither file nor folder, with its article.
#[cfg(not(unix))]
fn name_of(kind: FileType) -> &'static str {
    if kind.is_dir() { "a folder" } else { "a device" }
}

/// Whether a folder, given without links, or one above it is marked as simulated.
fn marked(folder: &Path) -> bool {
    folder.ancestors().any(|folder| folder.join(SIMULATED).is_file())
}

/// A walk through folders.
struct Walk<'a> {
    format: &'a dyn Format,
    /// The file that alone is asked for.
    only: Option<&'a Path>,
    /// Folders and files met, without links.
    met: BTreeSet<PathBuf>,
    /// Links, which are followed last, so that what lies in the folder keeps the name it has there.
    links: Vec<(PathBuf, bool)>,
    found: FoundFiles,
}

impl FoundFiles {
    /// Files below `path`, or beside it where it is a file.
    pub(super) fn of(path: &Path, format: &dyn Format) -> Result<Self, DataError> {
        let kind = metadata(path)?.file_type();
        if !kind.is_file() && !kind.is_dir() {
            return Err(DataError::NotAFile { file: path.into(), what: name_of(kind) });
        }
        let only = kind.is_file().then_some(path);
        let root = match only {
            Some(file) => file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")),
            None => path,
        };
        let found = Self {
            root: root.to_owned(),
            single: only.is_some(),
            files: Vec::new(),
            aside: Vec::new(),
            others: Vec::new(),
        };
        let mut walk = Walk { format, only, met: BTreeSet::new(), links: Vec::new(), found };
        let whole = canonical(root)?;
        let simulated = marked(&whole);
        walk.met.insert(whole);
        walk.folder(root, simulated)?;
        while !walk.links.is_empty() {
            for (link, simulated) in std::mem::take(&mut walk.links) {
                walk.link(link, simulated)?;
            }
        }
        walk.found.files.sort_by(|a, b| a.path.cmp(&b.path));
        Ok(walk.found)
    }
}

impl Walk<'_> {
    /// Adds the files of a folder, and those of its sub-folders unless a single file is asked for.
    fn folder(&mut self, folder: &Path, simulated: bool) -> Result<(), DataError> {
        let io = |source| DataError::Io { file: folder.into(), source };
        let listed = std::fs::read_dir(folder).map_err(io)?;
        let mut entries = listed
            .map(|entry| entry.and_then(|entry| Ok((entry.path(), entry.file_type()?))))
            .collect::<Result<Vec<_>, _>>()
            .map_err(io)?;
        entries.sort_by(|a, b| a.0.cmp(&b.0));
        let simulated =
            simulated || entries.iter().any(|(entry, _)| entry.file_name().is_some_and(|name| name == SIMULATED));
        for (path, kind) in entries {
            let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if hidden && !self.is_named(&path) {
                continue;
            }
            if kind.is_symlink() {
                self.links.push((path, simulated));
            } else {
                self.place(path, kind, simulated)?;
            }
        }
        Ok(())
    }

    /// Follows a link, unless what it leads to was met.
    fn link(&mut self, link: PathBuf, simulated: bool) -> Result<(), DataError> {
        let (Ok(whole), Ok(target)) = (link.canonicalize(), std::fs::metadata(&link)) else {
            self.aside(link, "a link to nothing".to_owned());
            return Ok(());
        };
        if self.only.is_none() && self.met.contains(&whole) {
            self.aside(link, format!("a link to {}, which was met already", whole.display()));
            return Ok(());
        }
        let simulated = simulated || marked(&whole);
        self.place(link, target.file_type(), simulated)
    }

    /// Takes a file, a folder or anything else.
    fn place(&mut self, path: PathBuf, kind: FileType, simulated: bool) -> Result<(), DataError> {
        if kind.is_dir() {
            // Beside a single file, folders do not matter.
            if self.only.is_none() && self.met.insert(canonical(&path)?) {
                self.folder(&path, simulated)?;
            }
            return Ok(());
        }
        if !kind.is_file() {
            self.aside(path, format!("{}, which is not opened", name_of(kind)));
            return Ok(());
        }
        let named = self.is_named(&path);
        if named || self.may_be(&path) {
            self.met.insert(canonical(&path)?);
            self.found.files.push(FoundFile { path, simulated, asked: self.only.is_none() || named });
        } else if self.only.is_none() && !accompanies(&path) {
            self.found.others.push(path);
        }
        Ok(())
    }

    fn aside(&mut self, file: PathBuf, what: String) {
        if self.only.is_none() {
            self.found.aside.push(NotRead { file, what });
        }
    }

    /// Whether it is the file that alone is asked for.
    fn is_named(&self, path: &Path) -> bool {
        self.only.is_some_and(|only| only.file_name() == path.file_name())
    }

    /// Whether a file's name ends as those of the format do.
    fn may_be(&self, file: &Path) -> bool {
        let name = file.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        name.rsplit_once('.').is_some_and(|(_, extension)| self.format.extensions().contains(&extension))
    }
}
