//! Tracks larger than memory: recordings by stretches of time, all with one clock, road and numbering.

use std::collections::{BTreeMap, HashMap};
use std::ops::{ControlFlow, Range};
use std::path::PathBuf;

use self::row::{Row, Rows};
use self::spool::Spool;
use crate::error::{DataError, TrackProblem};
use crate::format::Source;
use crate::ingest_report::IngestReport;
use crate::recording::Recording;
use crate::track_options::TrackOptions;
use crate::track_table::{TableVehicle, TrackLayout, TrackTable};
use crate::tracks::{TrackFile, without_rows};

mod row;
mod spool;

/// Rows of the beginning of a file by which clock, road and lanes are found.
const HEAD_ROWS: usize = 1_000_000;

/// Rows that are read at a time.
const CHUNK_ROWS: usize = 1 << 16;

/// A recording, or a stretch of time of one.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Part {
    /// The rows of the stretch and of the time before it that forecasts look back on.
    pub recording: Recording,
    /// What was read, of these rows.
    pub report: IngestReport,
    /// The frames of the stretch: each frame of the recording is in that of one part.
    pub asked: Range<u32>,
}

/// How a source is cut into parts.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PartSize {
    /// Most rows of a part, where it is longer than `overlap_s`: a part of no more time than that is not cut.
    pub max_rows: usize,
    /// Time before the frames of a part that its recording holds as well, s: what windows look back on.
    pub overlap_s: f64,
    /// Folder for temporary files, which hold the rows of files that are not in the order of time; that of the system
    /// where `None`.
    pub spool: Option<PathBuf>,
}

impl PartSize {
    /// Parts of up to `max_rows` rows that hold `overlap_s` s before their frames as well.
    #[must_use]
    pub fn new(max_rows: usize, overlap_s: f64) -> Self {
        Self { max_rows, overlap_s, spool: None }
    }
}

/// What a first pass over a file finds: what all parts have in common.
struct Outline {
    layout: TrackLayout,
    /// Vehicles in the order of appearance.
    vehicles: Vec<TableVehicle>,
    known: HashMap<String, u32>,
    /// A table like those of the file, with its first rows.
    head: TrackTable,
    /// Whether the head is the whole file.
    whole: bool,
    /// Whether rows come in the order of time.
    ordered: bool,
    /// Rows by whole second.
    seconds: BTreeMap<i64, usize>,
}

/// Hands the parts of `file` to `take`, in the order of time, until it breaks.
///
/// # Errors
/// As [`TrackTable::recordings`]; when the file cannot be read, or temporary files not be written.
pub(crate) fn read(
    file: &dyn TrackFile,
    source: &Source,
    options: &TrackOptions,
    size: &PartSize,
    take: &mut dyn FnMut(Part) -> ControlFlow<()>,
) -> Result<(), DataError> {
    let mut outline = Outline::of(file, source, options)?;
    let stretches = stretches(&outline.seconds, size);
    let whole = (outline.whole && stretches.len() <= 1).then(|| outline.head.clone());
    outline.head = row::without_rows(outline.head);
    let mut parts = Parts { outline: &outline, stretches: &stretches, next: 0, given: 0, empty: None, take };
    if let Some(whole) = whole {
        let _ = parts.give(whole)?;
    } else if outline.ordered {
        in_order(file, size, &mut parts)?;
    } else {
        spooled(file, size, &mut parts)?;
    }
    match parts.empty {
        Some(error) if parts.given == 0 => Err(error),
        _ => Ok(()),
    }
}

impl Outline {
    fn of(file: &dyn TrackFile, source: &Source, options: &TrackOptions) -> Result<Self, DataError> {
        let (mut vehicles, mut known) = (Vec::<TableVehicle>::new(), HashMap::<String, u32>::new());
        let (mut seconds, mut ordered, mut latest) = (BTreeMap::<i64, usize>::new(), true, f64::NEG_INFINITY);
        let (mut head, mut ends) = (None::<TrackTable>, None::<[TrackTable; 2]>);
        let mut whole = true;
        file.tables(CHUNK_ROWS, &mut |table| {
            for vehicle in &table.vehicles {
                match known.get(&vehicle.name) {
                    Some(index) => row::complete(&mut vehicles[*index as usize], vehicle),
                    None => {
                        known.insert(vehicle.name.clone(), vehicles.len() as u32);
                        vehicles.push(vehicle.clone());
                    }
                }
            }
            for (row, time) in table.time_s.iter().enumerate() {
                ordered &= *time >= latest;
                latest = latest.max(*time);
                if time.is_finite() {
                    *seconds.entry(time.floor() as i64).or_default() += 1;
                }
                let outer = |ends: &[TrackTable; 2]| (*time < ends[0].time_s[0], *time > ends[1].time_s[0]);
                match &mut ends {
                    None => ends = Some([row::only(&table, row), row::only(&table, row)]),
                    Some(ends) => {
                        let (before, after) = outer(ends);
                        if before {
                            ends[0] = row::only(&table, row);
                        } else if after {
                            ends[1] = row::only(&table, row);
                        }
                    }
                }
            }
            match &mut head {
                None => head = Some(table),
                Some(head) if head.len() < HEAD_ROWS => head.append(table),
                Some(head) => {
                    whole = false;
                    head.append(row::without_rows(table));
                }
            }
            Ok(ControlFlow::Continue(()))
        })?;
        let Some(mut head) = head else { return Err(without_rows(source)) };
        // Numbers go by the order of appearance in the whole file, frames by its first and last moment. The vehicles of the head
        // are the first of all.
        head.vehicles.clone_from(&vehicles);
        let mut found = head.clone();
        if !whole {
            ends.into_iter().flatten().for_each(|end| found.append(end));
        }
        let layout = found.layout(options)?;
        Ok(Self { layout, vehicles, known, head, whole, ordered, seconds })
    }
}

/// Stretches of time, s from the zero of the clock, that have few enough rows with the time before them.
fn stretches(seconds: &BTreeMap<i64, usize>, size: &PartSize) -> Vec<Range<i64>> {
    let overlap = size.overlap_s.max(0.).ceil() as i64 + 1;
    let mut stretches: Vec<Range<i64>> = Vec::new();
    let (mut from, mut rows) = (i64::MIN, 0usize);
    for (second, count) in seconds {
        let begun = if from == i64::MIN { *seconds.keys().next().unwrap_or(second) } else { from };
        if rows + count > size.max_rows && *second >= begun.saturating_add(overlap) {
            stretches.push(from..*second);
            from = *second;
            rows = seconds.range(second - overlap..*second).map(|(_, count)| count).sum();
        }
        rows += count;
    }
    stretches.push(from..i64::MAX);
    stretches
}

/// The parts that are still to be given.
struct Parts<'a> {
    outline: &'a Outline,
    stretches: &'a [Range<i64>],
    next: usize,
    /// Parts that were given.
    given: usize,
    /// Why the first part without a vehicle has none.
    empty: Option<DataError>,
    take: &'a mut dyn FnMut(Part) -> ControlFlow<()>,
}

impl Parts<'_> {
    /// Gives the next stretch, whose rows with those before them are `table`.
    fn give(&mut self, mut table: TrackTable) -> Result<ControlFlow<()>, DataError> {
        let stretch = self.stretches[self.next].clone();
        self.next += 1;
        if table.is_empty() {
            return Ok(ControlFlow::Continue(()));
        }
        // What is left out of the file is told once.
        if self.given == 0 && table.skipped_rows.is_empty() {
            table.skipped_rows.clone_from(&self.outline.head.skipped_rows);
        }
        let layout = &self.outline.layout;
        let (recording, report) = match layout.recording(&table) {
            Ok(made) => made,
            // One who is alone in a stretch may be left out; only a file of such is at fault.
            Err(error @ DataError::Tracks { problem: TrackProblem::Empty, .. }) => {
                self.empty.get_or_insert(error);
                return Ok(ControlFlow::Continue(()));
            }
            Err(error) => return Err(error),
        };
        self.given += 1;
        let asked = frame_at(&recording, stretch.start)..frame_at(&recording, stretch.end);
        Ok((self.take)(Part { recording, report, asked }))
    }

    /// Rows of the stretch to be given next, and of the time before it, from `rows`.
    fn table(&self, rows: &[Row]) -> TrackTable {
        Rows { outline: (&self.outline.head, &self.outline.vehicles), rows }.table()
    }
}

/// The first frame not before a whole second.
fn frame_at(recording: &Recording, second: i64) -> u32 {
    match second {
        i64::MIN => 0,
        i64::MAX => u32::MAX,
        second => {
            let frames = (second as f64 - recording.meta().start_s) * recording.meta().rate_hz;
            // Times are uniform to a millisecond only.
            (frames - 0.05).ceil().clamp(0., f64::from(u32::MAX)) as u32
        }
    }
}

/// Time from which a stretch needs rows, s: what is looked back on, and a frame before it for velocities.
fn needed_from(stretch: &Range<i64>, size: &PartSize) -> f64 {
    if stretch.start == i64::MIN { f64::NEG_INFINITY } else { stretch.start as f64 - size.overlap_s.max(0.) - 1. }
}

/// Time up to which a stretch has rows, s.
fn end(stretch: &Range<i64>) -> f64 {
    if stretch.end == i64::MAX { f64::INFINITY } else { stretch.end as f64 }
}

/// Of a file in the order of time, whose rows are kept as long as they are needed.
fn in_order(file: &dyn TrackFile, size: &PartSize, parts: &mut Parts<'_>) -> Result<(), DataError> {
    let mut rows: Vec<Row> = Vec::new();
    let mut broken = false;
    file.tables(CHUNK_ROWS, &mut |table| {
        for row in Row::all(&table, &parts.outline.known) {
            while row.time_s >= end(&parts.stretches[parts.next]) {
                let table = parts.table(&rows);
                if parts.give(table)?.is_break() {
                    broken = true;
                    return Ok(ControlFlow::Break(()));
                }
                let from = needed_from(&parts.stretches[parts.next], size);
                rows.retain(|row| row.time_s >= from);
            }
            rows.push(row);
        }
        Ok(ControlFlow::Continue(()))
    })?;
    if !broken {
        let table = parts.table(&rows);
        let _ = parts.give(table)?;
    }
    Ok(())
}

/// Of a file in any order, whose rows are brought to temporary files by stretch first.
fn spooled(file: &dyn TrackFile, size: &PartSize, parts: &mut Parts<'_>) -> Result<(), DataError> {
    let mut spool = Spool::new(parts.stretches.len(), size.spool.as_deref())?;
    file.tables(CHUNK_ROWS, &mut |table| {
        for row in Row::all(&table, &parts.outline.known) {
            let first = parts.stretches.partition_point(|stretch| end(stretch) <= row.time_s);
            let needed = |index: &usize| row.time_s >= needed_from(&parts.stretches[*index], size);
            for index in (first..parts.stretches.len()).take_while(needed) {
                spool.add(index, &row)?;
            }
        }
        Ok(ControlFlow::Continue(()))
    })?;
    for index in 0..parts.stretches.len() {
        let table = parts.table(&spool.take(index)?);
        if parts.give(table)?.is_break() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_have_few_rows_and_cover_all_time_once() {
        let seconds: BTreeMap<i64, usize> = (0..60).chain(100..130).map(|second| (second, 10)).collect();
        let cut = |max_rows| stretches(&seconds, &PartSize::new(max_rows, 3.));
        assert_eq!(cut(10_000), vec![i64::MIN..i64::MAX; 1]);
        for max_rows in [0, 100, 150, 299] {
            let parts = cut(max_rows);
            assert!(parts.len() > 3 && parts[0].start == i64::MIN && parts[parts.len() - 1].end == i64::MAX);
            assert!(parts.windows(2).all(|pair| pair[0].end == pair[1].start), "{parts:?}");
            for part in &parts[1..parts.len() - 1] {
                assert!(part.end - part.start >= 4, "not shorter than what is read again: {parts:?}");
                let rows: usize = seconds.range(part.start - 4..part.end).map(|(_, count)| count).sum();
                assert!(rows <= max_rows.max(80), "{rows} of {max_rows}");
            }
        }
    }
}
