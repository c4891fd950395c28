//! Finding recordings in a folder by what is in the files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::error::DataError;
use crate::format::{FORMATS, Format, Source};

/// A file of this name marks every recording below its folder as made by a simulator.
const SIMULATED: &str = "SIMULATED";

/// Recordings of `format` in a file, or in a folder and its sub-folders, sorted by name. Files are
/// recognised by what is in them, not by their names; the three files of a highD recording are put
/// together by what their names have in common up to the last `_`. Where a table lies there twice
/// under one name (`.csv` and `.txt`, plain and `.gz`), the first is taken and the source's notes name
/// the other.
///
/// # Errors
/// When nothing is found, a file cannot be read, or a file is a recording but for a column, its
/// delimiter or its partner files.
pub fn discover_with(path: &Path, format: &dyn Format) -> Result<Vec<Source>, DataError> {
    let found = FoundFiles::of(path, format)?;
    let mut sources = format.sources(&found)?;
    if sources.is_empty() {
        let (folder, expected) = (path.into(), format.files().to_owned());
        return Err(DataError::NoRecordings { folder, expected, seen: found.seen(format) });
    }
    shorten(&mut sources);
    sources.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(sources)
}

/// Whether a folder or one above it is marked as simulated.
fn marked(folder: &Path) -> Result<bool, DataError> {
    let whole = folder.canonicalize().map_err(|source| DataError::Io { file: folder.into(), source })?;
    Ok(whole.ancestors().any(|folder| folder.join(SIMULATED).is_file()))
}

/// Files of a folder that may hold recordings, as [`Format::sources`] is given them.
#[derive(Clone, Debug)]
pub struct FoundFiles {
    root: PathBuf,
    files: Vec<FoundFile>,
    passed_over: usize,
}

/// A file that may hold a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct FoundFile {
    /// The file.
    pub path: PathBuf,
    /// Marked as made by a simulator.
    pub simulated: bool,
    /// Whether the file or its folder was asked for. Where a single file was, the others of its
    /// folder are there too, because a recording may need them.
    pub asked: bool,
}

impl FoundFile {
    /// Name of the file without `.gz` and what stands before it after the last dot.
    #[must_use]
    pub fn stem(&self) -> String {
        let name = self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned()
    }
}

impl FoundFiles {
    /// The files, by path.
    #[must_use]
    pub fn files(&self) -> &[FoundFile] {
        &self.files
    }

    /// `stem` behind the folders from the folder searched to `file`, so that files of one name in
    /// several folders have different names.
    #[must_use]
    pub fn name(&self, file: &FoundFile, stem: &str) -> String {
        let folder = file.path.parent().and_then(|folder| folder.strip_prefix(&self.root).ok());
        let parts =
            folder.into_iter().flat_map(Path::components).map(|part| part.as_os_str().to_string_lossy().into_owned());
        parts.chain([stem.to_owned()]).collect::<Vec<_>>().join("/")
    }

    /// A source for each file asked for that `format` recognises; of two files of one name the first.
    ///
    /// # Errors
    /// As [`Format::recognise`].
    pub fn one_per_file<F: Format + ?Sized>(&self, format: &F) -> Result<Vec<Source>, DataError> {
        let mut sources: Vec<Source> = Vec::new();
        for file in self.files.iter().filter(|file| file.asked) {
            if !format.recognise(&file.path)? {
                continue;
            }
            let name = self.name(file, &file.stem());
            if let Some(twin) = sources.iter_mut().find(|source| source.name == name) {
                twin.notes.push(format!("{} has the same name and was not read", file.path.display()));
                continue;
            }
            let mut source = Source::new(format.dataset(), name, vec![file.path.clone()]);
            source.site = format.site(&file.path);
            source.simulated = file.simulated;
            sources.push(source);
        }
        Ok(sources)
    }

    /// Files below `path`, or beside it where it is a file.
    fn of(path: &Path, format: &dyn Format) -> Result<Self, DataError> {
        let metadata = std::fs::metadata(path).map_err(|source| DataError::Io { file: path.into(), source })?;
        let only = metadata.is_file().then_some(path);
        let root = match only {
            Some(file) => file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")),
            None => path,
        };
        let mut found = Self { root: root.to_owned(), files: Vec::new(), passed_over: 0 };
        found.folder(root, marked(root)?, only, format)?;
        Ok(found)
    }

    /// Adds the files of a folder, and those of its sub-folders unless `only` a file is asked for.
    fn folder(
        &mut self,
        folder: &Path,
        simulated: bool,
        only: Option<&Path>,
        format: &dyn Format,
    ) -> Result<(), DataError> {
        let io = |source| DataError::Io { file: folder.into(), source };
        let listed = std::fs::read_dir(folder).map_err(io)?;
        let mut entries =
            listed.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>().map_err(io)?;
        entries.sort();
        let simulated =
            simulated || entries.iter().any(|entry| entry.file_name().is_some_and(|name| name == SIMULATED));
        for path in entries {
            let named = only.is_some_and(|only| only.file_name() == path.file_name());
            let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if hidden && !named {
                continue;
            }
            if path.is_dir() {
                if only.is_none() {
                    self.folder(&path, simulated, only, format)?;
                }
            } else if named || may_be(&path, format) {
                self.files.push(FoundFile { path, simulated, asked: only.is_none() || named });
            } else {
                self.passed_over += 1;
            }
        }
        Ok(())
    }

    /// What was there instead of recordings.
    fn seen(&self, wanted: &dyn Format) -> String {
        let others = || FORMATS.iter().filter(|format| format.dataset() != wanted.dataset());
        let of_other = |file: &FoundFile| others().find(|format| matches!(format.recognise(&file.path), Ok(true)));
        match self.files.iter().find_map(of_other) {
            Some(format) => format!("the tables there are of {}: choose that dataset", format.title()),
            None => format!("{} tables of another kind, {} other files", self.files.len(), self.passed_over),
        }
    }
}

/// Whether a file's name ends as those of `format` do.
fn may_be(file: &Path, format: &dyn Format) -> bool {
    let name = file.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.rsplit_once('.').is_some_and(|(_, extension)| format.extensions().contains(&extension))
}

/// Drops the folders from names that are unique without them, and makes the others fit for files.
fn shorten(sources: &mut [Source]) {
    let last = |name: &str| name.rsplit('/').next().unwrap_or(name).to_owned();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for source in sources.iter() {
        *counts.entry(last(&source.name)).or_default() += 1;
    }
    let mut taken = BTreeSet::new();
    for source in sources {
        let short = last(&source.name);
        let name = if counts.get(&short) == Some(&1) { short } else { source.name.replace('/', "-") };
        let numbered = std::iter::once(name.clone()).chain((2..).map(|i| format!("{name}-{i}")));
        source.name = numbered.into_iter().find(|name| taken.insert(name.clone())).unwrap_or(name);
    }
}
