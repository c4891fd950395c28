//! What a dataset's files are and how they are read: the interface of every format, and the table
//! of those of this crate.

#[cfg(feature = "readers")]
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use crate::dataset::Dataset;
use crate::discover::{Discovery, FoundFiles, search};
use crate::error::{DataError, TrackProblem};
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::schema::Schema;
#[cfg(feature = "readers")]
use crate::time_parts::{Part, PartSize};
use crate::track_options::TrackOptions;
#[cfg(feature = "readers")]
use crate::tracks::{TrackFile, Tracks};
use crate::window_shape::same_rate;
#[cfg(feature = "readers")]
use crate::write::Written;

/// A dataset's files: how they are recognised, what they mean, and how they become recordings.
///
/// Everything that is said of a dataset (its name on the command line and in files, its title in
/// headings, the text of `--describe`) comes from here. [`FORMATS`] lists the formats of this crate;
/// a further one is a file beside theirs and a line there. A format of another crate is read through
/// [`search`] and [`Format::read`].
pub trait Format: Send + Sync {
    /// Name on the command line, in configurations and in files.
    fn dataset(&self) -> Dataset;

    /// Name in headings and messages, such as `highD`.
    fn title(&self) -> &str;

    /// Sites that are read, for headings, where there are a few.
    fn sites(&self) -> Option<&str> {
        None
    }

    /// Frames per second of the original data, Hz.
    fn rate_hz(&self) -> f64;

    /// The files that a folder must hold, for the message about a folder that does not.
    fn files(&self) -> &str;

    /// What is read of them, in which units, and what becomes of it.
    fn schema(&self) -> Schema;

    /// How names of files end that may be of this format, in lower case; a further `.gz` is allowed.
    fn extensions(&self) -> &[&str] {
        &["csv", "txt"]
    }

    /// Whether a file is of this format, by what is in it.
    ///
    /// # Errors
    /// When it is but for something that can be named: a missing column, a wrong delimiter; when it
    /// cannot be read or is empty.
    fn recognise(&self, file: &Path) -> Result<bool, DataError>;

    /// Site, where the name of a file tells it.
    fn site(&self, _file: &Path) -> Option<String> {
        None
    }

    /// The recordings among the files of a folder; one for each file that is recognised, unless a
    /// format says otherwise.
    ///
    /// # Errors
    /// As [`Format::recognise`].
    fn sources(&self, found: &FoundFiles) -> Result<Vec<Source>, DataError> {
        found.one_per_file(self)
    }

    /// The recordings of a source, with a report on each: most formats make their columns into
    /// [`Rows`](crate::Rows) and call [`Recording::from_rows`].
    ///
    /// # Errors
    /// Any [`DataError`] about a file; when `rate_hz` is given and is not that of the recording.
    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError>;

    /// The same with what else is known of the road: for formats whose tracks lie in any plane. Others have their road in
    /// their files.
    ///
    /// # Errors
    /// As [`Format::read`]; where a road or lines are given that the format does not take.
    fn read_with(&self, source: &Source, options: &TrackOptions) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        if options.road.is_some() || options.lines.is_some() {
            let (problem, place) = (TrackProblem::Road, source.file()?.display().to_string());
            let what = format!("a road or lane lines are given, and recordings of {} have their own", self.title());
            let remedy = "leave them out".to_owned();
            return Err(DataError::Tracks { problem, place, row: None, what, remedy });
        }
        self.read(source, options.rate_hz)
    }

    /// The file of a source whose tracks lie in a plane, to be read by tables; `None` where they lie along a road.
    ///
    /// # Errors
    /// When the file cannot be read or is of another format.
    #[cfg(feature = "readers")]
    fn track_file(&self, _source: &Source) -> Result<Option<Box<dyn TrackFile>>, DataError> {
        Ok(None)
    }

    /// Hands the recordings of a source to `take` until it breaks: files of tracks in a plane by stretches of time, so that
    /// they may be larger than memory, others whole. Clock, road, lanes and the numbers of vehicles are the same in all
    /// parts; they are found in a first pass, by the first million rows. Which vehicles are believed is judged by the rows
    /// of each part.
    ///
    /// # Errors
    /// As [`Format::read_with`]; when temporary files cannot be written.
    #[cfg(feature = "readers")]
    fn read_parts(
        &self,
        source: &Source,
        options: &TrackOptions,
        size: &PartSize,
        take: &mut dyn FnMut(Part) -> ControlFlow<()>,
    ) -> Result<(), DataError> {
        if let Some(file) = self.track_file(source)? {
            return crate::time_parts::read(&*file, source, options, size, take);
        }
        for (recording, report) in self.read_with(source, options)? {
            if take(Part { recording, report, asked: 0..u32::MAX }).is_break() {
                break;
            }
        }
        Ok(())
    }

    /// How the names of files end that this format is written to, without `.gz`; the first is taken where none is asked for.
    /// An empty end stands for the beginning of a name, which the format goes on with. Nothing where it is not written.
    fn written_as(&self) -> &[&str] {
        &[]
    }

    /// Writes tracks to `to`, each file whole or not at all, and says what of the tracks the layout does not hold.
    /// `options` are for tracks in a plane where the layout is along a road.
    ///
    /// # Errors
    /// [`DataError::Unwritable`] for tracks that the layout does not take, and by default; as [`TrackTable::recordings`];
    /// when a file cannot be written.
    ///
    /// [`TrackTable::recordings`]: crate::TrackTable::recordings
    #[cfg(feature = "readers")]
    fn write(&self, tracks: &Tracks, _options: &TrackOptions, _to: &Path) -> Result<Written, DataError> {
        Err(DataError::Unwritable {
            recording: tracks.name().to_owned(),
            layout: self.title().to_owned(),
            reason: "it is read and not written; take another format".to_owned(),
        })
    }
}

/// The formats of this crate, in the order in which they are described. Empty without the feature
/// `readers`.
pub const FORMATS: &[&dyn Format] = crate::formats::ALL;

/// The format of a dataset.
///
/// # Errors
/// [`DataError::UnknownDataset`] when [`FORMATS`] has none.
pub fn format_of(dataset: Dataset) -> Result<&'static dyn Format, DataError> {
    FORMATS.iter().copied().find(|format| format.dataset() == dataset).ok_or_else(|| {
        let known: Vec<String> = FORMATS.iter().map(|format| format.dataset().to_string()).collect();
        DataError::UnknownDataset { dataset, known: known.join(", ") }
    })
}

/// Files that hold one recording, or several where a file joins sites and periods.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Source {
    /// Name of the recording, or of the file where it holds several.
    pub name: String,
    /// Data family.
    pub dataset: Dataset,
    /// Site, where the name of the file tells it; a column of the data may overrule it.
    pub site: Option<String>,
    /// The files, in the order of the format: one table for NGSIM; tracks, tracks' meta and
    /// recording's meta for highD.
    pub files: Vec<PathBuf>,
    /// Marked as made by a simulator by a file `SIMULATED` in its folder or above.
    pub simulated: bool,
    /// What was passed over in finding it.
    pub notes: Vec<String>,
}

impl Source {
    /// Files of a real recording, whose site is not known; the other fields may be set afterwards.
    #[must_use]
    pub fn new(dataset: Dataset, name: impl Into<String>, files: Vec<PathBuf>) -> Self {
        Self { name: name.into(), dataset, site: None, files, simulated: false, notes: Vec::new() }
    }

    /// The first file.
    ///
    /// # Errors
    /// [`DataError::NoRecordings`] when there is none.
    pub fn file(&self) -> Result<&Path, DataError> {
        self.files.first().map(PathBuf::as_path).ok_or_else(|| DataError::NoRecordings {
            folder: self.name.clone().into(),
            expected: format!("a file of {}", self.dataset),
            seen: "a source without files".into(),
        })
    }
}

/// What the configuration expects of the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Data family.
    pub dataset: Dataset,
    /// Frames per second; any where `None`.
    pub rate_hz: Option<f64>,
}

/// Recordings of a dataset of [`FORMATS`] in a file, or in a folder and its sub-folders: see
/// [`search`].
///
/// # Errors
/// As [`format_of`] and [`search`].
pub fn discover(path: &Path, dataset: Dataset) -> Result<Vec<Source>, DataError> {
    Ok(survey(path, dataset)?.sources)
}

/// The same with what else is there: see [`search`].
///
/// # Errors
/// As [`format_of`] and [`search`].
pub fn survey(path: &Path, dataset: Dataset) -> Result<Discovery, DataError> {
    search(path, format_of(dataset)?)
}

/// The recordings of a source of a dataset of [`FORMATS`], with a report on each. One source is read
/// at a time, so that memory does not grow with their number.
///
/// NGSIM: one recording for each site and period of the file, named `FILE` or, where there are
/// several, `FILE-SITE-PERIOD`. highD: one recording.
///
/// # Errors
/// As [`format_of`] and [`Format::read`]; when the source is of another dataset.
pub fn read(source: &Source, expect: &Expectation) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    of_source(source, expect.dataset)?.read(source, expect.rate_hz)
}

/// As [`read()`], with what is known of the road.
///
/// # Errors
/// As [`read()`] and [`Format::read_with`].
pub fn read_with(
    source: &Source,
    dataset: Dataset,
    options: &TrackOptions,
) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    of_source(source, dataset)?.read_with(source, options)
}

fn of_source(source: &Source, dataset: Dataset) -> Result<&'static dyn Format, DataError> {
    let format = format_of(dataset)?;
    if source.dataset == dataset {
        return Ok(format);
    }
    Err(DataError::NoRecordings {
        folder: source.files.first().cloned().unwrap_or_default(),
        expected: format.title().to_owned(),
        seen: format!("a recording of {}", source.dataset),
    })
}

/// Refuses a rate that is not expected: for [`Format::read`].
///
/// # Errors
/// [`DataError::Rate`], which names `file`, in which the rate stands, and the recording.
pub fn check_rate(file: &Path, recording: &str, found_hz: f64, expected_hz: Option<f64>) -> Result<(), DataError> {
    match expected_hz {
        Some(expected_hz) if !same_rate(found_hz, expected_hz) => {
            Err(DataError::Rate { file: file.into(), recording: recording.to_owned(), found_hz, expected_hz })
        }
        _ => Ok(()),
    }
}
