//! highD: metres, the upper-left corner of the box in an image whose y points down, two
//! carriageways, three files a recording.
//!
//! The box is centred, y is flipped, and carriageway 1, which drives towards smaller x, is rotated
//! by pi: left stays left. So carriageway 1 has x' = -x, y' = y and carriageway 2 has x' = x,
//! y' = -y; velocities and lane markings go the same way.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use gnp_force::MarkingKind;

use super::periods::{Picked, out_of_order};
use super::table::sniff::{Head, Separator};
use super::table::{Kind, Table, Values, Wanted};
use crate::assemble::{NeighbourSource, Rows, VehicleBody};
use crate::dataset::Dataset;
use crate::discover::FoundFiles;
use crate::error::DataError;
use crate::format::{Format, Source, check_rate};
use crate::ingest_report::IngestReport;
use crate::lanes::MAX_LANE_WIDTH;
use crate::recording::{LaneMarking, Recording, RecordingMeta, Road, VehicleClass};
use crate::schema::{Column, Schema, TableSchema};
use crate::slot::SLOTS;

/// The format.
pub(super) struct HighD;

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
const TRACKS_META_READ: [Column; 5] = [
    Column::new("id", "-", "vehicle"),
    Column::new("width", "m", "length of the vehicle"),
    Column::new("height", "m", "width of the vehicle"),
    Column::new("class", "-", "Car, Van, Truck, Bus, Motorcycle"),
    Column::new("drivingDirection", "-", "1 upper carriageway, towards smaller x; 2 lower"),
];

/// Columns of `NN_recordingMeta.csv` that are described.
const RECORDING_META_READ: [Column; 4] = [
    Column::new("frameRate", "Hz", "frames per second"),
    Column::new("locationId", "-", "site"),
    Column::new("upperLaneMarkings", "m", "y of every marking of carriageway 1, `a;b;c`; the outer two are boundaries"),
    Column::new("lowerLaneMarkings", "m", "y of every marking of carriageway 2"),
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
            "The corner becomes the centre, y is flipped, and carriageway 1 is rotated by pi: its x' = -x, y' = y;\n\
             carriageway 2 has x' = x, y' = -y. Left stays left, velocities and markings turn with the positions.\n",
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

/// No vehicle is faster, m/s.
const MAX_SPEED: f32 = 70.;

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
        for column in needed {
            table.want(&column.to_ascii_lowercase(), Kind::Real)?;
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
    for file in found.files() {
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
            Entry::Occupied(_) => group.notes.push(format!("{} is there twice and was not read", path.display())),
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
    let [Some(tracks), Some(tracks_meta), Some(recording_meta)] = tables else {
        let file = source.files.first().cloned().unwrap_or_default();
        return Err(DataError::MissingPartner { file, partner: "tracks, tracksMeta or recordingMeta" });
    };
    let stated = read_recording_meta(&recording_meta)?;
    check_rate(&recording_meta.file, &source.name, stated.rate_hz, rate_hz)?;
    let bodies = read_bodies(&tracks_meta)?;
    let meta = RecordingMeta::new(Dataset::HIGHD, stated.site, source.name.clone(), stated.rate_hz)
        .with_simulated(source.simulated);
    let (rows, bodies) = read_tracks(&tracks, &tracks_meta, bodies)?;
    let (recording, mut quality) = Recording::from_rows(meta, stated.roads, rows, |row| bodies[row])?;
    quality.notes.extend(source.notes.iter().cloned());
    Ok(vec![(recording, quality)])
}

/// What the recording's meta file states.
struct Stated {
    rate_hz: f64,
    site: String,
    roads: Vec<Road>,
}

fn read_recording_meta(table: &Table) -> Result<Stated, DataError> {
    let rate = table.want("frameRate", Kind::Real)?;
    let location = table.want("locationId", Kind::Word)?;
    let [upper, lower] = ["upperLaneMarkings", "lowerLaneMarkings"].map(|name| table.want(name, Kind::Word));
    let mut values = table.read(&[rate, location, upper?, lower?])?.into_iter();
    let rate_hz = values.next().map(Values::real).and_then(|rates| rates.first().copied()).unwrap_or_default();
    if rate_hz <= 0. {
        return Err(table.bad_value(0, rate, rate_hz, "is no frame rate: it must be positive; repair it"));
    }
    let mut word = || values.next().map(Values::words).and_then(|words| words.1.into_iter().next()).unwrap_or_default();
    let site = format!("highd-{}", word().trim().to_ascii_lowercase());
    let roads =
        vec![markings(table, "upperLaneMarkings", &word(), 1)?, markings(table, "lowerLaneMarkings", &word(), 2)?];
    Ok(Stated { rate_hz: f64::from(rate_hz), site, roads })
}

/// A carriageway from its markings, `a;b;c` in m downwards in the image.
fn markings(table: &Table, column: &str, text: &str, driving_direction: u8) -> Result<Road, DataError> {
    let fail = |reason: &str| match table.line_of(0) {
        Ok(line) => DataError::Markings {
            file: table.file.clone(),
            line,
            column: column.to_owned(),
            value: text.to_owned(),
            reason: reason.to_owned(),
        },
        Err(e) => e,
    };
    let positions: Result<Vec<f32>, _> = text.trim().trim_matches('"').split(';').map(|y| y.trim().parse()).collect();
    let positions: Vec<f32> = positions.map_err(|_| fail("do not parse"))?;
    if positions.len() < 2 || positions.iter().any(|y| !y.is_finite()) {
        return Err(fail("make no lane"));
    }
    if positions.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err(fail("do not grow"));
    }
    if let Some(pair) = positions.windows(2).find(|pair| pair[1] - pair[0] > MAX_LANE_WIDTH) {
        return Err(DataError::Unit {
            file: table.file.clone(),
            place: format!("line {}, column `{column}`", table.line_of(0)?),
            what: format!("a lane is {:.2} m wide, more than {MAX_LANE_WIDTH} m", pair[1] - pair[0]),
            remedy: "highD is in metres; convert feet, or take the original file",
        });
    }
    let last = positions.len() - 1;
    let kind = |i: usize| if i == 0 || i == last { MarkingKind::Boundary } else { MarkingKind::LaneDivider };
    let mut lines: Vec<LaneMarking> = positions
        .iter()
        .enumerate()
        .map(|(i, y)| LaneMarking { kind: kind(i), y: if driving_direction == 1 { *y } else { -y } })
        .collect();
    if driving_direction != 1 {
        lines.reverse();
    }
    Ok(Road { driving_direction, lines, fitted: false })
}

/// Vehicles with their bodies, sorted by vehicle.
fn read_bodies(table: &Table) -> Result<Vec<(u32, VehicleBody)>, DataError> {
    let id = table.want("id", Kind::Whole)?;
    let width = table.want("width", Kind::Real)?;
    let height = table.want("height", Kind::Real)?;
    let class = table.want("class", Kind::Word)?;
    let direction = table.want("drivingDirection", Kind::Whole)?;
    let mut values = table.read(&[id, width, height, class, direction])?.into_iter();
    let vehicles = table.natural(values.next().map(Values::whole).unwrap_or_default(), id)?;
    let lengths = table.positive(values.next().map(Values::real).unwrap_or_default(), width)?;
    let widths = table.positive(values.next().map(Values::real).unwrap_or_default(), height)?;
    let (codes, words) = values.next().map(Values::words).unwrap_or_default();
    let directions = values.next().map(Values::whole).unwrap_or_default();
    let mut bodies = Vec::with_capacity(vehicles.len());
    for (row, vehicle) in vehicles.into_iter().enumerate() {
        let word = words[usize::from(codes[row])].trim();
        let kind = match word.to_ascii_lowercase().as_str() {
            "car" | "van" => VehicleClass::Car,
            "truck" | "bus" => VehicleClass::Truck,
            "motorcycle" => VehicleClass::Motorcycle,
            _ => {
                return Err(table.bad_value(
                    row,
                    class,
                    word,
                    "is none of Car, Van, Truck, Bus, Motorcycle; repair it",
                ));
            }
        };
        let road = match directions[row] {
            1 => 0,
            2 => 1,
            other => return Err(table.bad_value(row, direction, other, "is neither 1 nor 2; repair it")),
        };
        bodies.push((vehicle, VehicleBody { class: kind, length: lengths[row], width: widths[row], road }));
    }
    bodies.sort_by_key(|(vehicle, _)| *vehicle);
    Ok(bodies)
}

/// Rows in the road frame, and the body of every row.
fn read_tracks(
    table: &Table,
    meta: &Table,
    bodies: Vec<(u32, VehicleBody)>,
) -> Result<(Rows, Vec<VehicleBody>), DataError> {
    let kind = |name: &str| match name {
        "x" | "y" | "width" | "height" | "xVelocity" | "yVelocity" => Kind::Real,
        _ => Kind::Whole,
    };
    let wanted: Vec<Wanted> = TRACKS.iter().map(|name| table.want(name, kind(name))).collect::<Result<_, _>>()?;
    let mut values = table.read(&wanted)?.into_iter();
    let mut next = || values.next();
    let whole = |values: Option<Values>| values.map(Values::whole).unwrap_or_default();
    let real = |values: Option<Values>| values.map(Values::real).unwrap_or_default();
    let frame = table.frames(whole(next()), wanted[0])?;
    let vehicle = table.natural(whole(next()), wanted[1])?;
    let (mut x, mut y) = (real(next()), real(next()));
    let lengths = table.positive(real(next()), wanted[4])?;
    let widths = table.positive(real(next()), wanted[5])?;
    let (mut vx, mut vy) = (real(next()), real(next()));
    let neighbours: [Vec<i32>; SLOTS] = std::array::from_fn(|_| whole(next()));
    let lane = table.lane_numbers(whole(next()), wanted[16])?;

    if let Some(row) = (0..vx.len()).find(|row| vx[*row].hypot(vy[*row]) > MAX_SPEED) {
        return Err(DataError::Unit {
            file: table.file.clone(),
            place: format!("line {}, column `xvelocity`", table.line_of(row)?),
            what: format!("a vehicle moves at {:.1} m/s, more than {MAX_SPEED} m/s", vx[row].hypot(vy[row])),
            remedy: "highD is in metres and metres per second; convert feet, or take the original file",
        });
    }
    if let (_, Some((row, previous))) = out_of_order(&vehicle, &frame, &Picked::All) {
        return Err(table.frame_order("frame", row, vehicle[row], frame[row], previous));
    }
    let body_of_row = bodies_of_rows(table, meta, &vehicle, &bodies)?;
    for (row, body) in body_of_row.iter().enumerate() {
        // The corner becomes the centre before anything is turned.
        x[row] += lengths[row] / 2.;
        y[row] += widths[row] / 2.;
        if body.road == 0 {
            x[row] = -x[row];
            vx[row] = -vx[row];
        } else {
            y[row] = -y[row];
            vy[row] = -vy[row];
        }
    }
    let neighbours = NeighbourSource::Named(Box::new(neighbours));
    let rows = Rows { velocity: Some([vx, vy]), lane, neighbours, ..Rows::new(vehicle, frame, x, y) };
    Ok((rows, body_of_row))
}

fn bodies_of_rows(
    table: &Table,
    meta: &Table,
    vehicle: &[u32],
    bodies: &[(u32, VehicleBody)],
) -> Result<Vec<VehicleBody>, DataError> {
    let mut of_rows: Vec<VehicleBody> = Vec::with_capacity(vehicle.len());
    for (row, id) in vehicle.iter().enumerate() {
        if row > 0 && vehicle[row - 1] == *id {
            of_rows.push(of_rows[row - 1]);
            continue;
        }
        let Ok(place) = bodies.binary_search_by_key(id, |(vehicle, _)| *vehicle) else {
            return Err(DataError::UnknownVehicle {
                file: table.file.clone(),
                line: table.line_of(row)?,
                column: "id".into(),
                vehicle: *id,
                meta: meta.file.clone(),
            });
        };
        of_rows.push(bodies[place].1);
    }
    Ok(of_rows)
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
        assert!(described(&TRACKS_META, &TRACKS_META_READ));
        assert!(described(&RECORDING_META, &RECORDING_META_READ));
    }
}
