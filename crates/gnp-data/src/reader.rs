//! Recordings from files.

mod checks;
mod diagnosis;
mod discover;
mod gzip;
mod highd;
mod ngsim;
mod periods;
mod sniff;
mod table;

use std::path::{Path, PathBuf};

pub use self::discover::discover;
use crate::error::DataError;
use crate::ingest_report::IngestReport;
use crate::recording::{Dataset, Recording};

/// Files that hold one recording, or several where a file joins sites and periods.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Name of the recording, or of the file where it holds several.
    pub name: String,
    /// Data family.
    pub dataset: Dataset,
    /// Site, where the name of the file tells it; a `Location` column overrules it.
    pub site: Option<String>,
    /// The files: one table for NGSIM; tracks, tracks' meta and recording's meta for highD.
    pub files: Vec<PathBuf>,
    /// Marked as made by a simulator by a file `SIMULATED` in its folder or above.
    pub simulated: bool,
    /// What was passed over in finding it.
    pub notes: Vec<String>,
}

/// What the configuration expects of the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Data family.
    pub dataset: Dataset,
    /// Frames per second; any where `None`.
    pub rate_hz: Option<f64>,
}

/// The recordings of a source, with a report on each. One source is read at a time, so that memory
/// does not grow with their number.
///
/// NGSIM: one recording for each site and period of the file, named `FILE` or, where there are
/// several, `FILE-SITE-PERIOD`. highD: one recording.
///
/// # Errors
/// Any [`DataError`] about a file: see there.
pub fn read(source: &Source, expect: &Expectation) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    if source.dataset != expect.dataset {
        return Err(DataError::NoRecordings {
            folder: source.files.first().cloned().unwrap_or_default(),
            expected: match expect.dataset {
                Dataset::Ngsim => "NGSIM",
                Dataset::HighD => "highD",
            },
            seen: "a recording of the other dataset".into(),
        });
    }
    match source.dataset {
        Dataset::Ngsim => ngsim::read(source, expect),
        Dataset::HighD => highd::read(source, expect),
    }
}

/// Refuses a rate the configuration does not expect.
fn check_rate(file: &Path, recording: &str, found_hz: f64, expected_hz: Option<f64>) -> Result<(), DataError> {
    match expected_hz {
        Some(expected_hz) if (found_hz - expected_hz).abs() > 1e-6 * expected_hz => {
            Err(DataError::Rate { file: file.into(), recording: recording.to_owned(), found_hz, expected_hz })
        }
        _ => Ok(()),
    }
}

/// Columns the readers take of a dataset's tables.
#[cfg(test)]
pub(crate) fn columns_read(dataset: Dataset) -> Vec<&'static str> {
    match dataset {
        Dataset::Ngsim => ngsim::KNOWN.to_vec(),
        Dataset::HighD => [&highd::TRACKS[..], &highd::TRACKS_META, &highd::RECORDING_META].concat(),
    }
}
