//! Finding recordings in a folder by what is in the files.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use crate::error::DataError;
use crate::foreign::{self, Foreign};
use crate::format::{FORMATS, Format, Source};

mod walk;

use self::walk::accompanies;
pub(crate) use self::walk::only_a_file;

/// Most files that are named in [`Discovery::notes`]; the others are counted.
const NAMED: usize = 5;

/// What was found in a folder.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Discovery {
    /// The recordings, sorted by name.
    pub sources: Vec<Source>,
    /// What was met and not read, other datasets first. Nothing is said of what accompanies data: hidden files, pictures,
    /// PDF, Markdown, files called readme, licence and the like, and the mark `SIMULATED`.
    pub not_read: Vec<NotRead>,
}

/// A file, link or folder that was met and not read.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct NotRead {
    /// The place.
    pub file: PathBuf,
    /// What it is and, where something can be done, what to do.
    pub what: String,
}

impl fmt::Display for NotRead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not read: {}", self.file.display(), self.what)
    }
}

impl Discovery {
    /// A sentence for each of the first files that are not read, and one for the others.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.not_read.iter().take(NAMED).map(NotRead::to_string).collect();
        match self.not_read.len().saturating_sub(NAMED) {
            0 => {}
            1 => notes.push("1 more file is not read".to_owned()),
            more => notes.push(format!("{more} more files are not read")),
        }
        notes
    }
}

/// The recordings of [`search`].
///
/// # Errors
/// As [`search`].
pub fn discover_with(path: &Path, format: &dyn Format) -> Result<Vec<Source>, DataError> {
    Ok(search(path, format)?.sources)
}

/// Recordings of `format` in a file, or in a folder and its sub-folders, and what else is there. Files are
/// recognised by what is in them, not by their names; the three files of a highD recording are put
/// together by what their names have in common up to the last `_`. Where a table lies there twice
/// under one name (`.csv` and `.txt`, plain and `.gz`), the first is taken and the source's notes name
/// the other. What links lead to is read once, wherever it lies. Pipes, sockets and devices are not opened.
///
/// # Errors
/// When nothing is found, a file cannot be read, or a file is a recording but for a column, its
/// delimiter or its partner files; when a single file is asked for that is something else.
pub fn search(path: &Path, format: &dyn Format) -> Result<Discovery, DataError> {
    let mut found = FoundFiles::of(path, format)?;
    found.set_aside(format)?;
    let mut sources = format.sources(&found)?;
    let not_read = found.not_read(&sources, format);
    if sources.is_empty() {
        let (folder, expected) = (path.into(), format.files().to_owned());
        let seen = match (Discovery { sources, not_read }).notes() {
            notes if notes.is_empty() => "there are no tables".to_owned(),
            notes => notes.join("; "),
        };
        return Err(DataError::NoRecordings { folder, expected, seen });
    }
    shorten(&mut sources);
    sources.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(Discovery { sources, not_read })
}

/// Files of a folder that may hold recordings, as [`Format::sources`] is given them.
#[derive(Clone, Debug)]
pub struct FoundFiles {
    root: PathBuf,
    /// Whether a single file was asked for.
    single: bool,
    files: Vec<FoundFile>,
    /// Links, pipes and tables of other datasets.
    aside: Vec<NotRead>,
    /// Files whose names end otherwise than those of the format.
    others: Vec<PathBuf>,
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

    /// Files that lie in the folder of `file` and end as those of the format do, among them those that are known to be
    /// something else: a recording may need them.
    pub fn beside<'a>(&'a self, file: &'a Path) -> impl Iterator<Item = &'a Path> {
        let all = self.files.iter().map(|it| it.path.as_path()).chain(self.aside.iter().map(|it| it.file.as_path()));
        all.filter(move |it| *it != file && it.parent() == file.parent())
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

    /// Takes out the files that the format does not recognise and that are known to be something else.
    ///
    /// # Errors
    /// [`DataError::Foreign`] where such a file alone was asked for.
    fn set_aside(&mut self, format: &dyn Format) -> Result<(), DataError> {
        let mut kept = Vec::with_capacity(self.files.len());
        for file in std::mem::take(&mut self.files) {
            // What a format refuses with a reason of its own is not told by its first bytes alone.
            let of_format = |found| matches!(found, Ok(true) | Err(DataError::Table { .. } | DataError::Tracks { .. }));
            if !file.asked || of_format(format.recognise(&file.path)) {
                kept.push(file);
                continue;
            }
            // What another format reads is named in the end, with that format.
            if FORMATS.iter().any(|other| matches!(other.recognise(&file.path), Ok(true))) {
                kept.push(file);
                continue;
            }
            let empty = || foreign::empty(&file.path).filter(|_| !self.single);
            let foreign = foreign::of_file(&file.path).or_else(empty);
            match foreign {
                Some(Foreign { what, remedy }) if self.single => {
                    return Err(DataError::Foreign { file: file.path, what, remedy });
                }
                _ if !self.single && accompanies(&file.path) => {}
                Some(foreign) => self.aside.push(NotRead { file: file.path, what: foreign.to_string() }),
                None => kept.push(file),
            }
        }
        self.files = kept;
        Ok(())
    }

    /// What is not read: what was set aside, tables that are in no source, files of other names.
    fn not_read(self, sources: &[Source], format: &dyn Format) -> Vec<NotRead> {
        let read: BTreeSet<&Path> = sources.iter().flat_map(|source| &source.files).map(PathBuf::as_path).collect();
        let others = || FORMATS.iter().filter(|other| other.dataset() != format.dataset());
        let mut not_read = self.aside;
        not_read.retain(|it| !read.contains(it.file.as_path()));
        for file in self.files.into_iter().filter(|file| file.asked && !read.contains(file.path.as_path())) {
            // What the format recognises and leaves is named in the notes of a source.
            if !matches!(format.recognise(&file.path), Ok(false) | Err(DataError::Foreign { .. })) {
                continue;
            }
            let of_other = others().find(|other| matches!(other.recognise(&file.path), Ok(true)));
            let what = match of_other {
                Some(other) => format!("a table of {}; choose that dataset", other.title()),
                None => format!("a table or text of another kind than {}'s", format.title()),
            };
            not_read.push(NotRead { file: file.path, what });
        }
        let left = NAMED.saturating_sub(not_read.len());
        not_read.extend(self.others.into_iter().enumerate().map(|(i, file)| {
            // Only what will be named is opened.
            let foreign = if i < left { foreign::of_file(&file) } else { None };
            let what = foreign.map_or_else(|| "its name ends otherwise".to_owned(), |foreign| foreign.to_string());
            NotRead { file, what }
        }));
        not_read
    }
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
