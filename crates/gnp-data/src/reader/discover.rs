//! Finding recordings in a folder by what is in the files.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::Source;
use super::highd::{self, TableKind};
use super::ngsim;
use super::sniff::Head;
use crate::error::DataError;
use crate::recording::Dataset;

/// A file of this name marks every recording below its folder as made by a simulator.
const SIMULATED: &str = "SIMULATED";

/// Recordings in a file, or in a folder and its sub-folders, sorted by name. Files are recognised
/// by their headers and numbers of columns, not by their names; the three files of a highD
/// recording are put together by what their names share up to the last `_`. Where a table lies
/// there twice under one name (`.csv` and `.txt`, plain and `.gz`), the first is taken and the
/// source's notes name the other.
///
/// # Errors
/// When nothing is found, a file cannot be read, or a file is a recording but for a column, its
/// delimiter or its partner files.
pub fn discover(path: &Path, dataset: Dataset) -> Result<Vec<Source>, DataError> {
    let metadata = std::fs::metadata(path).map_err(|source| DataError::Io { file: path.into(), source })?;
    // A single file of highD needs its partners, which lie beside it.
    let only = metadata.is_file().then_some(path);
    let root = match only {
        Some(file) => file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")),
        None => path,
    };
    let mut found = Found::default();
    match (only, dataset) {
        (Some(file), Dataset::Ngsim) => found.files.push((file.to_owned(), marked(root)?)),
        (Some(_), Dataset::HighD) => found.folder(root, marked(root)?, false)?,
        (None, _) => found.folder(root, marked(root)?, true)?,
    }
    let mut sources = match dataset {
        Dataset::Ngsim => ngsim_sources(root, &mut found)?,
        Dataset::HighD => highd_sources(root, only, &mut found)?,
    };
    if sources.is_empty() {
        return Err(DataError::NoRecordings {
            folder: path.into(),
            expected: match dataset {
                Dataset::Ngsim => "NGSIM tables (.csv or .txt, plain or .gz) of 18 or 25 columns",
                Dataset::HighD => "highD's NN_tracks.csv, NN_tracksMeta.csv and NN_recordingMeta.csv, plain or .gz",
            },
            seen: found.seen(dataset),
        });
    }
    sources.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(sources)
}

/// Whether a folder or one above it is marked as simulated.
fn marked(folder: &Path) -> Result<bool, DataError> {
    let whole = folder.canonicalize().map_err(|source| DataError::Io { file: folder.into(), source })?;
    Ok(whole.ancestors().any(|folder| folder.join(SIMULATED).is_file()))
}

/// Files that may be tables, each with whether it is marked as simulated.
#[derive(Default)]
struct Found {
    files: Vec<(PathBuf, bool)>,
    passed_over: usize,
}

impl Found {
    fn folder(&mut self, folder: &Path, simulated: bool, deep: bool) -> Result<(), DataError> {
        let io = |source| DataError::Io { file: folder.into(), source };
        let listed = std::fs::read_dir(folder).map_err(io)?;
        let mut entries =
            listed.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>().map_err(io)?;
        entries.sort();
        let simulated =
            simulated || entries.iter().any(|entry| entry.file_name().is_some_and(|name| name == SIMULATED));
        for entry in entries {
            let hidden = entry.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if hidden {
                continue;
            }
            if entry.is_dir() {
                if deep {
                    self.folder(&entry, simulated, deep)?;
                }
            } else if is_table(&entry) {
                self.files.push((entry, simulated));
            } else {
                self.passed_over += 1;
            }
        }
        Ok(())
    }

    /// What was there instead of recordings.
    fn seen(&self, wanted: Dataset) -> String {
        let heads = self.files.iter().filter_map(|(file, _)| Some((file, Head::read(file).ok()??)));
        let other = heads.into_iter().any(|(file, head)| match wanted {
            Dataset::Ngsim => matches!(highd::recognise(file, &head), Ok(Some(_))),
            Dataset::HighD => matches!(ngsim::recognise(file, &head), Ok(Some(_))),
        });
        match (other, wanted) {
            (true, Dataset::Ngsim) => "the tables there are of highD: choose that dataset".into(),
            (true, Dataset::HighD) => "the tables there are of NGSIM: choose that dataset".into(),
            _ => format!("{} tables of another kind, {} other files", self.files.len(), self.passed_over),
        }
    }
}

fn is_table(file: &Path) -> bool {
    let name = file.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.ends_with(".csv") || name.ends_with(".txt")
}

/// Name of a file without `.gz` and `.csv` or `.txt`.
fn stem(file: &Path) -> String {
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let name = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    name.to_owned()
}

/// `name` for the files of a recording, with the folders from `root` to it.
fn place(root: &Path, file: &Path, name: &str) -> String {
    let folder = file.parent().and_then(|folder| folder.strip_prefix(root).ok());
    let parts =
        folder.into_iter().flat_map(Path::components).map(|part| part.as_os_str().to_string_lossy().into_owned());
    parts.chain([name.to_owned()]).collect::<Vec<_>>().join("/")
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

fn ngsim_sources(root: &Path, found: &mut Found) -> Result<Vec<Source>, DataError> {
    let mut sources: Vec<Source> = Vec::new();
    for (file, simulated) in &found.files {
        let Some(head) = Head::read(file)? else { return Err(DataError::Empty { file: file.clone() }) };
        if ngsim::recognise(file, &head)?.is_none() {
            continue;
        }
        let name = place(root, file, &stem(file));
        if let Some(twin) = sources.iter_mut().find(|source| source.name == name) {
            twin.notes.push(format!("{} has the same name and was not read", file.display()));
            continue;
        }
        sources.push(Source {
            dataset: Dataset::Ngsim,
            site: ngsim::site_of(file),
            name,
            files: vec![file.clone()],
            simulated: *simulated,
            notes: Vec::new(),
        });
    }
    shorten(&mut sources);
    Ok(sources)
}

fn highd_sources(root: &Path, only: Option<&Path>, found: &mut Found) -> Result<Vec<Source>, DataError> {
    #[derive(Default)]
    struct Group {
        parts: BTreeMap<TableKind, PathBuf>,
        simulated: bool,
        notes: Vec<String>,
    }
    let mut groups: BTreeMap<String, Group> = BTreeMap::new();
    let mut wanted: BTreeSet<String> = BTreeSet::new();
    for (file, simulated) in &found.files {
        let stem = stem(file);
        let name = place(root, file, stem.rsplit_once('_').map_or(stem.as_str(), |(name, _)| name));
        let asked = only.is_none_or(|only| only.file_name() == file.file_name());
        // Beside a single file that is asked for, other recordings are nobody's business.
        let head = match Head::read(file) {
            Ok(Some(head)) => head,
            Ok(None) if asked => return Err(DataError::Empty { file: file.clone() }),
            Err(e) if asked => return Err(e),
            _ => continue,
        };
        let part = match highd::recognise(file, &head) {
            Ok(Some((part, _))) => part,
            Err(e) if asked => return Err(e),
            _ => continue,
        };
        let group = groups.entry(name.clone()).or_default();
        group.simulated |= simulated;
        match group.parts.entry(part) {
            Entry::Vacant(place) => drop(place.insert(file.clone())),
            Entry::Occupied(_) => group.notes.push(format!("{} is there twice and was not read", file.display())),
        }
        if asked {
            wanted.insert(name);
        }
    }
    let mut sources = Vec::new();
    for (name, group) in groups.into_iter().filter(|(name, _)| wanted.contains(name)) {
        let partners = [
            (TableKind::Tracks, "tracks"),
            (TableKind::TracksMeta, "tracksMeta"),
            (TableKind::RecordingMeta, "recordingMeta"),
        ];
        for (part, partner) in partners {
            if !group.parts.contains_key(&part) {
                let file = group.parts.into_values().next().unwrap_or_default();
                return Err(DataError::MissingPartner { file, partner });
            }
        }
        sources.push(Source {
            name,
            dataset: Dataset::HighD,
            site: None,
            files: group.parts.into_values().collect(),
            simulated: group.simulated,
            notes: group.notes,
        });
    }
    shorten(&mut sources);
    Ok(sources)
}
