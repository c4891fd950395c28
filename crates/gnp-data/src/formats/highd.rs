//! highD: metres, the upper-left corner of the box in an image whose y points down, two
//! carriageways, three files a recording.
//!
//! The box is centred, y is flipped, and carriageway 1, which drives towards smaller x, is rotated
//! by pi: left stays left. So carriageway 1 has x' = -x, y' = y and carriageway 2 has x' = x,
//! y' = -y; velocities and lane markings go the same way.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use self::checks::Tables;
use super::findings::Findings;
use super::table::sniff::{Head, Separator};
use super::table::{Kind, Table};
use crate::dataset::Dataset;
use crate::discover::{FoundFile, FoundFiles};
use crate::error::DataError;
use crate::format::{Format, Source, check_rate};
use crate::ingest_report::IngestReport;
use crate::recording::{Recording, RecordingMeta};
use crate::schema::{Column, Schema, TableSchema};
use crate::track_options::TrackOptions;
use crate::tracks::Tracks;
use crate::write::{self, Written, along_road};

mod checks;
mod meta;
mod tracks;

/// The format.
pub(super) struct HighD;

impl HighD {
    /// What to do about values in other units.
    const UNITS: &str = "highD is in metres and metres per second; convert feet, or take the original file";
}

/// Columns of `NN_tracks.csv` that are described.
const TRACKS_READ: [Column; 17] = [
    Column::new("frame", "1/frameRate s", "frame"),
    Column::new("id", "-", "vehicle"),
    Column::new("x", "m", "upper-left corner of the box, to the right in the image"),
    Column::new("y", "m", "upper-left corner of the box, downwards in the image"),
    Column::new("width", "m", "extent along x: the vehicle's length"),
    Column::new("height", "m", "extent along y: the vehicle's width"),
    Column::new("xVelocity", "m/s", "velocity along x"),
    Column::new("yVelocity", "m/s", "velocity along y, downwards"),
    Column::new("precedingId", "-", "vehicle ahead in the lane; 0 or -1 none"),
    Column::new("followingId", "-", "vehicle behind in the lane"),
    Column::new("leftPrecedingId", "-", "vehicle ahead in the lane to the left of travel"),
    Column::new("leftAlongsideId", "-", "vehicle beside in the lane to the left"),
    Column::new("leftFollowingId", "-", "vehicle behind in the lane to the left"),
    Column::new("rightPrecedingId", "-", "vehicle ahead in the lane to the right of travel"),
    Column::new("rightAlongsideId", "-", "vehicle beside in the lane to the right"),
    Column::new("rightFollowingId", "-", "vehicle behind in the lane to the right"),
    Column::new("laneId", "-", "lane"),
];

/// Columns of `NN_tracksMeta.csv` that are described.
const TRACKS_META_READ: [Column; 8] = [
    Column::new("id", "-", "vehicle"),
    Column::new("width", "m", "length of the vehicle"),
    Column::new("height", "m", "width of the vehicle"),
    Column::new("class", "-", "Car, Van, Truck, Bus, Motorcycle"),
    Column::new("drivingDirection", "-", "1 upper carriageway, towards smaller x; 2 lower"),
    Column::new("initialFrame", "1/frameRate s", "first frame, where the file has it: checked, then left"),
    Column::new("finalFrame", "1/frameRate s", "last frame, likewise"),
    Column::new("numFrames", "-", "frames, likewise"),
];

/// Columns of `NN_recordingMeta.csv` that are described.
const RECORDING_META_READ: [Column; 9] = [
    Column::new("frameRate", "Hz", "frames per second"),
    Column::new("locationId", "-", "site"),
    Column::new("upperLaneMarkings", "m", "y of every marking of carriageway 1, `a;b;c`; the outer two are boundaries"),
    Column::new("lowerLaneMarkings", "m", "y of every marking of carriageway 2"),
    Column::new("id", "-", "recording, where the file has it: checked, then left"),
    Column::new("numVehicles", "-", "vehicles, likewise"),
    Column::new("numCars", "-", "cars, likewise"),
    Column::new("numTrucks", "-", "trucks, likewise"),
    Column::new("duration", "s", "length of the recording, likewise"),
];

impl Format for HighD {
    fn dataset(&self) -> Dataset {
        Dataset::HIGHD
    }

    fn title(&self) -> &str {
        "highD"
    }

    fn rate_hz(&self) -> f64 {
        25.
    }

    fn files(&self) -> &str {
        "highD's NN_tracks.csv, NN_tracksMeta.csv and NN_recordingMeta.csv, plain or .gz"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "highD: three tables a recording, plain or .gz, beside one another. Rate: frameRate, 25 in the original.\n",
            vec![
                TableSchema::new("Columns read of NN_tracks.csv", &TRACKS_READ),
                TableSchema::new("Columns read of NN_tracksMeta.csv", &TRACKS_META_READ),
                TableSchema::new("Columns read of NN_recordingMeta.csv", &RECORDING_META_READ),
            ],
            "The corner becomes the centre, y is flipped, and carriageway 1 is rotated by pi: its x' = -x, y' = y; carriageway 2 \
             has x' = x, y' = -y. Left stays left, velocities and markings turn with the positions.\n",
        )
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        Ok(Head::read(file)?.map(|head| recognise(file, &head)).transpose()?.flatten().is_some())
    }

    fn sources(&self, found: &FoundFiles) -> Result<Vec<Source>, DataError> {
        sources(found)
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        read(source, rate_hz)
    }

    fn written_as(&self) -> &[&str] {
        &[""]
    }

    fn write(&self, tracks: &Tracks, options: &TrackOptions, to: &Path) -> Result<Written, DataError> {
        along_road(tracks, options, |recording| write::highd::write(recording, to))
    }
}

/// Which of the three files of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum TableKind {
    Tracks,
    TracksMeta,
    RecordingMeta,
}

/// Columns that are read of `NN_tracks.csv`.
const TRACKS: [&str; 17] = [
    "frame",
    "id",
    "x",
    "y",
    "width",
    "height",
    "xVelocity",
    "yVelocity",
    "precedingId",
    "followingId",
    "leftPrecedingId",
    "leftAlongsideId",
    "leftFollowingId",
    "rightPrecedingId",
    "rightAlongsideId",
    "rightFollowingId",
    "laneId",
];

/// Columns that are read of `NN_tracksMeta.csv`.
const TRACKS_META: [&str; 5] = ["id", "width", "height", "class", "drivingDirection"];

/// Columns from which `NN_tracksMeta.csv` is recognised, should one of [`TRACKS_META`] be missing.
const TRACKS_META_KNOWN: [&str; 8] = [
    "class",
    "drivingDirection",
    "initialFrame",
    "finalFrame",
    "numFrames",
    "traveledDistance",
    "minTTC",
    "numLaneChanges",
];

/// Columns that are read of `NN_recordingMeta.csv`.
const RECORDING_META: [&str; 4] = ["frameRate", "locationId", "upperLaneMarkings", "lowerLaneMarkings"];

/// The part a file is, with its table.
fn recognise(file: &Path, head: &Head) -> Result<Option<(TableKind, Table)>, DataError> {
    let parts: [(TableKind, &[&str], &[&str], usize); 3] = [
        (TableKind::RecordingMeta, &RECORDING_META, &RECORDING_META, 2),
        (TableKind::TracksMeta, &TRACKS_META_KNOWN, &TRACKS_META, 4),
        (TableKind::Tracks, &TRACKS, &TRACKS, 9),
    ];
    for (part, known, needed, least) in parts {
        let (header, hits) = head.header(known);
        if hits < least {
            continue;
        }
        let other = match header.separator {
            Separator::Comma => None,
            Separator::Blank => Some(' '),
            Separator::Other(c) => Some(c),
        };
        if let Some(found) = other {
            return Err(DataError::Delimiter { file: file.into(), found, expected: "commas" });
        }
        let table = Table::new(file, header);
        // Of two columns of one name the other's is missing, and that is not the fault.
        for column in needed {
            table.find(&[column], Kind::Real)?;
        }
        for column in needed {
            table.want(column, Kind::Real)?;
        }
        return Ok(Some((part, table)));
    }
    Ok(None)
}

/// Recordings put together of their three files by what the names have in common up to the last `_`.
fn sources(found: &FoundFiles) -> Result<Vec<Source>, DataError> {
    #[derive(Default)]
    struct Group {
        parts: BTreeMap<TableKind, PathBuf>,
        simulated: bool,
        notes: Vec<String>,
    }
    let mut groups: BTreeMap<String, Group> = BTreeMap::new();
    let mut wanted: BTreeSet<String> = BTreeSet::new();
    let mut files: Vec<&FoundFile> = found.files().iter().collect();
    // Of two of one kind the one asked for, else the shorter name is read: `03_tracks (1).csv` is a browser's copy.
    files.sort_by_key(|file| (!file.asked, file.stem().len()));
    for file in files {
        let (stem, path, asked) = (file.stem(), &file.path, file.asked);
        let name = found.name(file, stem.rsplit_once('_').map_or(stem.as_str(), |(name, _)| name));
        // Beside a single file that is asked for, other recordings do not matter.
        let head = match Head::read(path) {
            Ok(Some(head)) => head,
            Ok(None) if asked => return Err(DataError::Empty { file: path.clone() }),
            Err(e) if asked => return Err(e),
            _ => continue,
        };
        let part = match recognise(path, &head) {
            Ok(Some((part, _))) => part,
            Err(e) if asked => return Err(e),
            _ => continue,
        };
        let group = groups.entry(name.clone()).or_default();
        group.simulated |= file.simulated;
        match group.parts.entry(part) {
            Entry::Vacant(place) => drop(place.insert(path.clone())),
            Entry::Occupied(first) => {
                let (path, first) = (path.display(), first.get().display());
                group.notes.push(format!("{path} is of the same recording as {first} and was not read"));
            }
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
        let mut source = Source::new(Dataset::HIGHD, name, group.parts.into_values().collect());
        source.simulated = group.simulated;
        source.notes = group.notes;
        sources.push(source);
    }
    Ok(sources)
}

/// The recording of a source.
fn read(source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let mut tables = [None, None, None];
    for file in &source.files {
        let head = Head::read(file)?.ok_or_else(|| DataError::Empty { file: file.clone() })?;
        if let Some((part, table)) = recognise(file, &head)? {
            tables[part as usize] = Some(table);
        }
    }
    let [Some(tracks), Some(tracks_meta), Some(recording_meta)] = &tables else {
        let file = source.files.first().cloned().unwrap_or_default();
        return Err(DataError::MissingPartner { file, partner: "tracks, tracksMeta or recordingMeta" });
    };
    let tables = Tables { tracks, tracks_meta, recording_meta };
    let stated = meta::recording(recording_meta)?;
    check_rate(&recording_meta.file, &source.name, stated.rate_hz, rate_hz)?;
    let (listed, notes) = meta::vehicles(tracks_meta)?;
    let mut findings = Findings::default();
    let all = tracks::read(tracks, tracks_meta, &listed)?;
    let rows = all.vehicle.len();
    checks::vehicles(&tables, &stated, &listed, &all, &mut findings)?;
    let mut kept = all.without(&findings.left_out());
    let rows_left_out = rows - kept.vehicle.len();
    checks::lanes(&tables, &stated.roads, &mut kept, &mut findings)?;
    let left_out = kept.names_of(&findings.left_out());
    let (rows, bodies, picked) = kept.into_rows();
    let meta = RecordingMeta::new(Dataset::HIGHD, stated.site.clone(), source.name.clone(), stated.rate_hz)
        .with_simulated(source.simulated);
    let (recording, mut quality, names) = Recording::with_names(meta, stated.roads.clone(), rows, |row| bodies[row])?;
    checks::neighbours(tracks, &names, left_out, recording.len(), |row| {
        picked.get(row).map_or(row, |row| *row as usize)
    })?;
    quality.notes = checks::counts(&tables, &stated, &listed, quality.frames)?;
    quality.notes.extend(stated.notes.into_iter().chain(notes));
    quality.notes.extend(source.notes.iter().cloned());
    findings.report(&mut quality, rows_left_out);
    Ok(vec![(recording, quality)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn describes_every_column_that_is_read() {
        let described = |read: &[&str], columns: &[Column]| {
            read.iter().all(|name| columns.iter().any(|column| column.name == *name))
        };
        assert!(described(&TRACKS, &TRACKS_READ));
        assert!(described(&TRACKS_META, &TRACKS_META_READ) && described(&meta::FRAMES, &TRACKS_META_READ));
        assert!(described(&RECORDING_META, &RECORDING_META_READ) && described(&meta::COUNTS, &RECORDING_META_READ));
    }
}
