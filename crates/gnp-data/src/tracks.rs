//! Tracks on their way from one format to another, and files of tracks that are read by tables.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

use crate::error::{DataError, TrackProblem};
use crate::format::{Format, Source};
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::track_options::TrackOptions;
use crate::track_table::TrackTable;

/// A file of tracks in a plane, which is read by tables.
pub trait TrackFile {
    /// Hands the tracks to `take` as the file has them, in its order, in tables of about `rows` rows with the same columns,
    /// until it breaks. Vehicles of the same name are the same in all tables.
    ///
    /// # Errors
    /// Any [`DataError`] about the file; what `take` returns.
    fn tables(
        &self,
        rows: usize,
        take: &mut dyn FnMut(TrackTable) -> Result<ControlFlow<()>, DataError>,
    ) -> Result<(), DataError>;
}

/// All tracks of a file, as it has them.
///
/// # Errors
/// As [`TrackFile::tables`]; [`TrackProblem::Empty`] for a file without rows.
pub(crate) fn whole(file: &dyn TrackFile, source: &Source) -> Result<TrackTable, DataError> {
    let mut all: Option<TrackTable> = None;
    file.tables(usize::MAX, &mut |table| {
        match &mut all {
            Some(all) => all.append(table),
            None => all = Some(table),
        }
        Ok(ControlFlow::Continue(()))
    })?;
    all.ok_or_else(|| without_rows(source))
}

/// The error for a source without rows.
pub(crate) fn without_rows(source: &Source) -> DataError {
    DataError::Tracks {
        problem: TrackProblem::Empty,
        place: source.files.first().map_or_else(|| source.name.clone(), |file| file.display().to_string()),
        row: None,
        what: "there are no tracks".to_owned(),
        remedy: "give a row for each vehicle and moment".to_owned(),
    }
}

/// Tracks as a format has them: in a plane, or along a road.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Tracks {
    /// In a plane.
    Table(TrackTable),
    /// Along a road.
    Recording(Recording),
}

impl Tracks {
    /// The tracks of a source as its format has them, with the report on a recording. Tracks in a plane are neither checked
    /// nor changed, and say themselves which rows are left out.
    ///
    /// # Errors
    /// As [`Format::read`] and [`TrackFile::tables`].
    pub fn of(
        format: &dyn Format,
        source: &Source,
        options: &TrackOptions,
    ) -> Result<Vec<(Self, Option<IngestReport>)>, DataError> {
        if let Some(file) = format.track_file(source)? {
            return Ok(vec![(Self::Table(whole(&*file, source)?), None)]);
        }
        let all = format.read_with(source, options)?.into_iter();
        Ok(all.map(|(recording, report)| (Self::Recording(recording), Some(report))).collect())
    }

    /// Name of the recording.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Table(table) => &table.name,
            Self::Recording(recording) => &recording.meta().name,
        }
    }

    /// Whether a simulator made them.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        match self {
            Self::Table(table) => table.simulated,
            Self::Recording(recording) => recording.meta().simulated,
        }
    }

    /// The tracks in a plane: see [`TrackTable::of`].
    #[must_use]
    pub fn table(&self) -> Cow<'_, TrackTable> {
        match self {
            Self::Table(table) => Cow::Borrowed(table),
            Self::Recording(recording) => Cow::Owned(TrackTable::of(recording)),
        }
    }

    /// The tracks along a road, each with what of them is left out there, and how often.
    ///
    /// # Errors
    /// As [`TrackTable::recordings`].
    pub(crate) fn recordings(&self, options: &TrackOptions) -> Result<Vec<(Cow<'_, Recording>, LeftOut)>, DataError> {
        match self {
            Self::Table(table) => {
                let made = table.recordings(options)?.into_iter();
                Ok(made.map(|(recording, report)| (Cow::Owned(recording), left_out(&report))).collect())
            }
            Self::Recording(recording) => Ok(vec![(Cow::Borrowed(recording), LeftOut::new())]),
        }
    }
}

/// What is left out, and how often.
type LeftOut = BTreeMap<String, u64>;

fn left_out(report: &IngestReport) -> LeftOut {
    let rows = report.skipped_rows.iter().map(|(why, count)| (format!("rows are left out: {why}"), *count));
    let vehicles =
        report.vehicles_left_out.iter().map(|(why, count)| (format!("vehicles are left out that {why}"), *count));
    let repeated = report.duplicates + report.conflicts;
    let repeats = (repeated > 0).then(|| ("rows are left out that repeat a vehicle and moment".to_owned(), repeated));
    rows.chain(vehicles).chain(repeats).collect()
}
