//! NGSIM: feet, 10 frames per second, the front centre of the vehicle, no carriageway but one.
//!
//! Layouts: a period of a site in 18 columns, separated by commas or blanks, with or without a
//! header; the same with `Location`; the merged export of 25 columns. `Local_Y` runs along the
//! road, `Local_X` from its left edge to the right.

use std::collections::BTreeMap;
use std::path::Path;

use super::periods::{Group, Moments, Sites, out_of_order, separate};
use super::table::sniff::{Head, Header, Separator};
use super::table::{Kind, Table, Wanted};
use crate::assemble::{NeighbourSource, Rows, VehicleBody};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::format::{Format, Source, check_rate};
use crate::ingest_report::IngestReport;
use crate::lanes::{self, MAX_LANE_WIDTH};
use crate::recording::{NamedLeader, Recording, RecordingMeta, Road, VehicleClass};
use crate::schema::{Column, Schema, TableSchema};

/// The format.
pub(super) struct Ngsim;

/// Columns that are described.
const READ: [Column; 13] = [
    Column::new("Vehicle_ID", "-", "vehicle; begins again in every period, and may return after a gap"),
    Column::new("Frame_ID", "0.1 s", "frame; begins again in every period"),
    Column::new("Global_Time", "ms", "time; tells periods and the rate"),
    Column::new("Local_X", "ft", "front centre, from the left edge of the road to the right"),
    Column::new("Local_Y", "ft", "front centre, along the road"),
    Column::new("v_Length", "ft", "length of the vehicle"),
    Column::new("v_Width", "ft", "width of the vehicle"),
    Column::new("v_Class", "-", "1 motorcycle, 2 car, 3 truck"),
    Column::new("v_Vel", "ft/s", "speed, a scalar: checked, then left; velocities come from positions"),
    Column::new("Lane_ID", "-", "lane, 1 leftmost; 7 and 8 are ramps; 0 unknown"),
    Column::new("Preceding", "-", "vehicle directly ahead, where the file has it; 0 none"),
    Column::new("Space_Headway", "ft", "from its front to that of the vehicle ahead, where the file has it"),
    Column::new(
        "Location",
        "-",
        "site, where the file has it: us-101 and i-80 are read, streets are counted and skipped",
    ),
];

impl Format for Ngsim {
    fn dataset(&self) -> Dataset {
        Dataset::NGSIM
    }

    fn title(&self) -> &str {
        "NGSIM"
    }

    fn sites(&self) -> Option<&str> {
        Some("US-101 and I-80")
    }

    fn rate_hz(&self) -> f64 {
        RATE
    }

    fn files(&self) -> &str {
        "NGSIM tables (.csv or .txt, plain or .gz) of 18 or 25 columns"
    }

    fn schema(&self) -> Schema {
        Schema::new(
            "NGSIM: one table a period and site, .csv or .txt, plain or .gz, 18 columns separated by commas or\n\
             blanks, with or without a header; with `Location` as well; or the merged export of 25 columns.\n\
             Rate: 10 frames per second, measured from Global_Time.\n",
            vec![TableSchema::new("Columns read", &READ)],
            "feet become metres; the front centre becomes the centre, half a length back; x = Local_Y,\n\
             y = -Local_X. The data has no markings: lane lines are fitted midway between the lanes' median\n\
             positions, with edges 3.66 m beyond the outermost. Neighbours come from Lane_ID and x; Preceding\n\
             counts where the vehicle it names has no row of its own.\n",
        )
    }

    fn recognise(&self, file: &Path) -> Result<bool, DataError> {
        let head = Head::read(file)?.ok_or_else(|| DataError::Empty { file: file.into() })?;
        Ok(recognise(file, &head)?.is_some())
    }

    fn site(&self, file: &Path) -> Option<String> {
        site_of(file)
    }

    fn read(&self, source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
        read(source, rate_hz)
    }
}

/// Lane numbers from here on are ramps, which all lie to the right of the lane before, at different
/// places along the road.
const RAMP: i16 = 7;

/// The columns of a period's file, which has no header in the official text form.
const COLUMNS: [&str; 18] = [
    "Vehicle_ID",
    "Frame_ID",
    "Total_Frames",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "Global_X",
    "Global_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "v_Acc",
    "Lane_ID",
    "Preceding",
    "Following",
    "Space_Headway",
    "Time_Headway",
];

/// Columns from which a header is recognised: those that are read.
const KNOWN: [&str; 10] = [
    "Vehicle_ID",
    "Frame_ID",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "Lane_ID",
];

/// Names of the columns that tell the vehicle directly ahead, which a file need not have.
const LEADER: [&[&str]; 2] = [&["Preceding"], &["Space_Headway", "Space_Hdwy"]];

/// Headways from here on stand for none, ft.
const NO_HEADWAY: f32 = 9999.;

/// Columns that tell the merged export from a period's file.
const MERGED: [&str; 3] = ["O_Zone", "D_Zone", "Section_ID"];

/// Metres in a foot.
const FOOT: f64 = 0.3048;

/// Frames per second of NGSIM, taken where the times of a file do not tell.
const RATE: f64 = 10.;

/// No vehicle on a motorway is faster, m/s.
const MAX_SPEED: f32 = 70.;

/// Vehicles shorter than this in the median, or lanes narrower, were in metres already.
const MIN_LENGTH: f32 = 2.5;
const MIN_LANE_WIDTH: f32 = 2.;

/// Fraction of rows that may move faster than [`MAX_SPEED`]: single rows do by noise.
const FAST_FRACTION: f64 = 0.01;

/// Sites that are motorways. Lankershim and Peachtree are streets with junctions.
const SITES: [&str; 2] = ["us-101", "i-80"];

/// The table, if the file is one of NGSIM's.
fn recognise(file: &Path, head: &Head) -> Result<Option<Table>, DataError> {
    let (header, hits) = head.header(&KNOWN);
    if hits > KNOWN.len() / 2 {
        if let Separator::Other(found) = header.separator {
            return Err(DataError::Delimiter { file: file.into(), found, expected: "commas or blanks" });
        }
        let table = Table::new(file, header);
        for column in KNOWN {
            table.want(column, Kind::Real)?;
        }
        return Ok(Some(table));
    }
    let Some((separator, fields)) = head.numbers() else { return Ok(None) };
    if let Separator::Other(found) = separator {
        return Err(DataError::Delimiter { file: file.into(), found, expected: "commas or blanks" });
    }
    if fields != COLUMNS.len() {
        return Err(DataError::FieldCount { file: file.into(), line: 1, found: fields, expected: COLUMNS.len() });
    }
    let names = COLUMNS.map(str::to_ascii_lowercase).to_vec();
    Ok(Some(Table { has_header: false, ..Table::new(file, Header { separator, names }) }))
}

/// Site that the name of a file, or of the nearest folder above it, tells, as the official downloads
/// are named.
fn site_of(file: &Path) -> Option<String> {
    file.components().rev().find_map(|part| {
        let name = part.as_os_str().to_string_lossy().to_ascii_lowercase();
        let any = |hints: &[&str]| hints.iter().any(|hint| name.contains(hint));
        // Periods of the downloads: US-101 in the morning, I-80 in the afternoon.
        if any(&["us-101", "us101", "us_101", "0750am", "0805am", "0820am"]) {
            Some("us-101".to_owned())
        } else if any(&["i-80", "i80", "i_80", "0400-0415", "0400pm", "0500-0515", "0500pm", "0515-0530", "0515pm"]) {
            Some("i-80".to_owned())
        } else {
            None
        }
    })
}

/// What is read of a table, row by row.
struct Raw {
    vehicle: Vec<u32>,
    frame: Vec<u32>,
    time: Vec<i64>,
    /// m, to the right of the left edge.
    right: Vec<f32>,
    /// m, front of the vehicle.
    front: Vec<f32>,
    length: Vec<f32>,
    width: Vec<f32>,
    class: Vec<VehicleClass>,
    lane: Vec<i16>,
    site: Option<(Vec<u16>, Vec<String>)>,
    leader: Option<Vec<NamedLeader>>,
    /// What is wrong with the columns of the vehicle ahead, if they cannot be read.
    no_leader: Option<String>,
}

/// Recordings of a file: one for each site and period.
fn read(source: &Source, rate_hz: Option<f64>) -> Result<Vec<(Recording, IngestReport)>, DataError> {
    let file = source.file()?;
    let table = Head::read(file)?.map(|head| recognise(file, &head)).transpose()?.flatten();
    let table = table.ok_or_else(|| DataError::NoRecordings {
        folder: file.into(),
        expected: Ngsim.files().to_owned(),
        seen: "a table or text of another kind".to_owned(),
    })?;
    let merged = MERGED.iter().any(|column| table.find(&[column]).is_some());
    let raw = read_rows(&table)?;
    let (sites, mut skipped) = sites_of(&raw, source);
    let moments = Moments { vehicle: &raw.vehicle, frame: &raw.frame, time: &raw.time };
    let groups = separate(&moments, &sites);
    if groups.is_empty() {
        return Err(DataError::NoRecordings {
            folder: file.into(),
            expected: "rows of us-101 or i-80".into(),
            seen: format!("only {}", skipped.keys().cloned().collect::<Vec<_>>().join(", ")),
        });
    }
    let several = groups.len() > 1;
    let mut recordings = Vec::with_capacity(groups.len());
    for group in &groups {
        let name = match (&group.site, several) {
            (_, false) => source.name.clone(),
            (site, true) => format!("{}-{site}-{}", source.name, group.period),
        };
        let (recording, mut quality) = build(&table, &raw, group, name, source, rate_hz, merged)?;
        quality.skipped_rows = std::mem::take(&mut skipped);
        quality.notes.extend(source.notes.iter().cloned());
        quality
            .notes
            .extend(raw.no_leader.iter().map(|wrong| format!("vehicles ahead are not taken from the file: {wrong}")));
        recordings.push((recording, quality));
    }
    Ok(recordings)
}

fn read_rows(table: &Table) -> Result<Raw, DataError> {
    let columns = [
        table.want("Vehicle_ID", Kind::Whole)?,
        table.want("Frame_ID", Kind::Whole)?,
        table.want("Global_Time", Kind::Time)?,
        table.want("Local_X", Kind::Real)?,
        table.want("Local_Y", Kind::Real)?,
        table.want("v_Length", Kind::Real)?,
        table.want("v_Width", Kind::Real)?,
        table.want("v_Class", Kind::Whole)?,
        table.want("v_Vel", Kind::Real)?,
        table.want("Lane_ID", Kind::Whole)?,
    ];
    let [vehicle, frame, _, _, _, length, width, class, speed, lane] = columns;
    let location = table.find(&["Location"]).map(|index| Wanted { index, kind: Kind::Word });
    let place = |names, kind| table.find(names).map(|index| Wanted { index, kind });
    let leader = place(LEADER[0], Kind::Whole).zip(place(LEADER[1], Kind::Real));
    let needed: Vec<Wanted> = columns.into_iter().chain(location).collect();
    let wanted: Vec<Wanted> = needed.iter().copied().chain(leader.into_iter().flat_map(|(a, b)| [a, b])).collect();
    let (values, no_leader) = match table.read(&wanted) {
        // What need not be there need not be right.
        Err(wrong) if leader.is_some() => (table.read(&needed)?, Some(wrong.to_string())),
        read => (read?, None),
    };
    let mut values = values.into_iter();
    let mut next = || values.next();

    let whole = |values: Option<super::table::Values>| values.map(super::table::Values::whole).unwrap_or_default();
    let metres = |values: Option<super::table::Values>| {
        let mut values = values.map(super::table::Values::real).unwrap_or_default();
        values.iter_mut().for_each(|value| *value = (f64::from(*value) * FOOT) as f32);
        values
    };
    let raw_vehicle = table.natural(whole(next()), vehicle)?;
    let raw_frame = table.frames(whole(next()), frame)?;
    let time = next().map(super::table::Values::time).unwrap_or_default();
    let (right, front) = (metres(next()), metres(next()));
    let lengths = table.positive(metres(next()), length)?;
    let widths = table.positive(metres(next()), width)?;
    let classes = whole(next());
    let class_of = |code: &i32| match code {
        1 => Some(VehicleClass::Motorcycle),
        2 => Some(VehicleClass::Car),
        3 => Some(VehicleClass::Truck),
        _ => None,
    };
    if let Some(row) = classes.iter().position(|code| class_of(code).is_none()) {
        return Err(table.bad_value(row, class, classes[row], "is none of the classes 1, 2, 3; repair it"));
    }
    let speeds = metres(next());
    if let Some(row) = speeds.iter().position(|v| v.abs() > MAX_SPEED) {
        return Err(DataError::Unit {
            file: table.file.clone(),
            place: format!("line {}, column `{}`", table.line_of(row)?, table.columns[speed.index]),
            what: format!("{:.1} m/s read as feet per second, no vehicle is faster than {MAX_SPEED} m/s", speeds[row]),
            remedy: "NGSIM is in feet and feet per second; take the original file",
        });
    }
    let lanes = table.lane_numbers(whole(next()), lane)?;
    Ok(Raw {
        vehicle: raw_vehicle,
        frame: raw_frame,
        time,
        right,
        front,
        length: lengths,
        width: widths,
        class: classes.iter().filter_map(class_of).collect(),
        lane: lanes,
        site: location.and_then(|_| next()).map(super::table::Values::words),
        leader: next()
            .map(|vehicle| leaders(&vehicle.whole(), &next().map(super::table::Values::real).unwrap_or_default())),
        no_leader,
    })
}

/// The vehicle ahead of each row; headways in ft.
fn leaders(vehicles: &[i32], headways: &[f32]) -> Vec<NamedLeader> {
    let leader = |(vehicle, headway): (&i32, &f32)| NamedLeader {
        vehicle: u32::try_from(*vehicle).unwrap_or(0),
        headway: if *headway < NO_HEADWAY { (f64::from(*headway) * FOOT) as f32 } else { 0. },
    };
    vehicles.iter().zip(headways).map(leader).collect()
}

/// Site of every row by code, the list of sites with `None` for those that are not motorways, and
/// the rows of the latter.
fn sites_of<'a>(raw: &'a Raw, source: &Source) -> (Sites<'a>, BTreeMap<String, u64>) {
    let mut skipped = BTreeMap::new();
    let Some((codes, words)) = &raw.site else {
        let name = source.site.clone().unwrap_or_else(|| "ngsim".into());
        return (Sites { codes: &[], names: vec![Some(name)] }, skipped);
    };
    let mut rows = vec![0u64; words.len()];
    for code in codes {
        rows[usize::from(*code)] += 1;
    }
    let names = words.iter().zip(rows).map(|(word, rows)| {
        let site = word.trim().to_ascii_lowercase();
        if SITES.contains(&site.as_str()) {
            return Some(site);
        }
        *skipped.entry(format!("site {site} is not a motorway")).or_insert(0) += rows;
        None
    });
    let names = names.collect();
    (Sites { codes, names }, skipped)
}

/// The recording of one site and period.
fn build(
    table: &Table,
    raw: &Raw,
    group: &Group,
    name: String,
    source: &Source,
    expected_hz: Option<f64>,
    merged: bool,
) -> Result<(Recording, IngestReport), DataError> {
    let at = |i: usize| group.rows.get(i).map_or(i, |row| *row as usize);
    let count = group.rows.len(raw.vehicle.len());
    let moments = Moments { vehicle: &raw.vehicle, frame: &raw.frame, time: &raw.time };
    let steps = moments.steps(group);
    let rate_hz = steps.rate(RATE);
    check_rate(&table.file, &name, rate_hz, expected_hz)?;
    if let stride @ 2.. = steps.stride() {
        // Rows left out: the frames that remain are numbered as if none were missing.
        let found_hz = rate_hz / f64::from(stride);
        let expected_hz = expected_hz.unwrap_or(rate_hz);
        return Err(DataError::Rate { file: table.file.clone(), recording: name, found_hz, expected_hz });
    }
    let (out_of_order, first) = out_of_order(&raw.vehicle, &raw.frame, &group.rows);
    if let Some((row, previous)) = first.filter(|_| !merged) {
        return Err(table.frame_order("Frame_ID", row, raw.vehicle[row], raw.frame[row], previous));
    }

    let gather = |column: &[f32]| (0..count).map(|i| column[at(i)]).collect::<Vec<f32>>();
    let y: Vec<f32> = (0..count).map(|i| -raw.right[at(i)]).collect();
    let x: Vec<f32> = (0..count).map(|i| raw.front[at(i)] - raw.length[at(i)] / 2.).collect();
    let lane: Vec<i16> = (0..count).map(|i| raw.lane[at(i)]).collect();
    check_lengths(table, gather(&raw.length))?;
    let fit = lanes::fit_lanes(&lane, &y);
    check_lanes(table, fit.width)?;
    let vehicle = (0..count).map(|i| raw.vehicle[at(i)]).collect();
    let frame = (0..count).map(|i| raw.frame[at(i)]).collect();
    let neighbours = NeighbourSource::Lanes(|lane| lane.min(RAMP));
    let leader = raw.leader.as_ref().map(|leader| (0..count).map(|i| leader[at(i)]).collect());
    let rows = Rows { lane, neighbours, leader, ..Rows::new(vehicle, frame, x, y) };
    let body = |i: usize| {
        let row = at(i);
        VehicleBody { class: raw.class[row], length: raw.length[row], width: raw.width[row], road: 0 }
    };
    let meta = RecordingMeta::new(Dataset::NGSIM, group.site.clone(), name, rate_hz).with_simulated(source.simulated);
    let roads = vec![Road { driving_direction: 2, lines: fit.lines, fitted: true }];
    let (recording, mut quality) = Recording::from_rows(meta, roads, rows, body)?;
    quality.out_of_order = out_of_order;
    check_speeds(table, &recording)?;
    Ok((recording, quality))
}

fn check_lengths(table: &Table, mut lengths: Vec<f32>) -> Result<(), DataError> {
    let Some(median) = lanes::median(&mut lengths) else { return Ok(()) };
    if median >= MIN_LENGTH {
        return Ok(());
    }
    Err(DataError::Unit {
        file: table.file.clone(),
        place: "column `v_length`".into(),
        what: format!("half of the vehicles are shorter than {median:.2} m when read as feet"),
        remedy: "the table seems to be in metres; NGSIM is read in feet, take the original file",
    })
}

fn check_lanes(table: &Table, width: Option<f32>) -> Result<(), DataError> {
    let Some(width) = width else { return Ok(()) };
    let (what, remedy) = if width > MAX_LANE_WIDTH {
        (
            format!("lanes are {width:.1} m wide, more than {MAX_LANE_WIDTH} m"),
            "the values seem not to be feet; take the original file",
        )
    } else if width < MIN_LANE_WIDTH {
        (
            format!("lanes are {width:.1} m wide when read as feet"),
            "the table seems to be in metres; NGSIM is read in feet, take the original file",
        )
    } else {
        return Ok(());
    };
    Err(DataError::Unit { file: table.file.clone(), place: "column `local_x`".into(), what, remedy })
}

fn check_speeds(table: &Table, recording: &Recording) -> Result<(), DataError> {
    let c = recording.columns();
    let fast = c.vx.iter().zip(&c.vy).filter(|(vx, vy)| vx.hypot(**vy) > MAX_SPEED).count();
    if fast as f64 <= FAST_FRACTION * recording.len() as f64 {
        return Ok(());
    }
    Err(DataError::Unit {
        file: table.file.clone(),
        place: "columns `local_x`, `local_y`".into(),
        what: format!("{fast} of {} rows move faster than {MAX_SPEED} m/s", recording.len()),
        remedy: "the values seem not to be feet, or frames are missing; take the original file",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn describes_every_column_that_is_read() {
        assert!(KNOWN.iter().all(|known| READ.iter().any(|column| column.name == *known)));
    }
}
