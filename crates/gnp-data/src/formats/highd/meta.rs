//! What highD's two meta files state of a recording and its vehicles.

use gnp_force::MarkingKind;
use gnp_road::ReferenceLine;

use crate::assemble::VehicleBody;
use crate::error::DataError;
use crate::formats::table::{Kind, Table, Values};
use crate::limits::{self, MAX_LANE_WIDTH, MAX_LINES, MAX_POSITION, MAX_RATE_HZ, MIN_RATE_HZ};
use crate::recording::{LaneMarking, Road, VehicleClass};

/// Columns of `NN_recordingMeta.csv` that need not be there, and what they count.
pub(super) const COUNTS: [&str; 5] = ["id", "numVehicles", "numCars", "numTrucks", "duration"];

/// Columns of `NN_tracksMeta.csv` that need not be there: frames of a vehicle.
pub(super) const FRAMES: [&str; 3] = ["initialFrame", "finalFrame", "numFrames"];

/// What the recording's meta file states.
pub(super) struct Stated {
    pub(super) rate_hz: f64,
    pub(super) site: String,
    pub(super) roads: Vec<Road>,
    /// Values of [`COUNTS`], where they are there.
    pub(super) counts: [Option<f32>; COUNTS.len()],
    /// What cannot be compared, a sentence each.
    pub(super) notes: Vec<String>,
}

/// A vehicle as `NN_tracksMeta.csv` lists it.
pub(super) struct Listed {
    pub(super) vehicle: u32,
    /// Row of the table.
    pub(super) row: usize,
    pub(super) body: VehicleBody,
    /// Values of [`FRAMES`], where they are there.
    pub(super) frames: [Option<i32>; FRAMES.len()],
}

/// Reads the one row of a recording's meta file.
///
/// # Errors
/// Those of [`Table::read`]; when there are more rows, or a value cannot be.
pub(super) fn recording(table: &Table) -> Result<Stated, DataError> {
    let rate = table.want("frameRate", Kind::Real)?;
    let location = table.want("locationId", Kind::Word)?;
    let [upper, lower] = ["upperLaneMarkings", "lowerLaneMarkings"].map(|name| table.want(name, Kind::Word));
    let (upper, lower) = (upper?, lower?);
    let mut values = table.read(&[rate, location, upper, lower])?.into_iter();
    let rates = values.next().map(Values::real).unwrap_or_default();
    if rates.len() > 1 {
        return Err(DataError::Contradiction {
            file: table.file.clone(),
            place: format!("line {}", table.line_of(1)?),
            what: format!("{} rows describe one recording", rates.len()),
            remedy: "keep the row of this recording and remove the others",
        });
    }
    let rate_hz = rates.first().copied().map_or(0., f64::from);
    if !limits::is_rate(rate_hz) {
        let reason = format!("is no frame rate: it must be from {MIN_RATE_HZ} to {MAX_RATE_HZ} Hz; repair it");
        return Err(table.bad_value(0, rate, rate_hz, &reason));
    }
    let mut word = || values.next().map(Values::words).and_then(|words| words.1.into_iter().next()).unwrap_or_default();
    let site = format!("highd-{}", word().trim().to_ascii_lowercase());
    let (upper, lower) = (word(), word());
    let roads =
        vec![markings(table, "upperLaneMarkings", &upper, 1)?, markings(table, "lowerLaneMarkings", &lower, 2)?];
    // In the image's frame the upper carriageway has y = y', the lower one y = -y'.
    let bottom_of_upper = roads[0].lines.last().map(|line| line.y);
    let top_of_lower = roads[1].lines.last().map(|line| -line.y);
    if bottom_of_upper > top_of_lower {
        return Err(DataError::Contradiction {
            file: table.file.clone(),
            place: format!("line {}, columns `upperLaneMarkings`, `lowerLaneMarkings`", table.line_of(0)?),
            what: format!("the carriageways overlap or are exchanged: {upper:?} is not above {lower:?}"),
            remedy: "take the original file: y grows downwards, and the upper markings come first",
        });
    }
    let (mut counts, mut notes) = ([None; COUNTS.len()], Vec::new());
    for (count, name) in counts.iter_mut().zip(COUNTS) {
        let values = optional(table, name, Kind::Real, &mut notes)?;
        *count = values.and_then(|values| values.real().first().copied());
    }
    Ok(Stated { rate_hz, site, roads, counts, notes })
}

/// A column that need not be there, nor be right: then a note says so.
fn optional(table: &Table, name: &str, kind: Kind, notes: &mut Vec<String>) -> Result<Option<Values>, DataError> {
    let Some(column) = table.find(&[name], kind)? else { return Ok(None) };
    match table.read(&[column]) {
        Ok(mut values) => Ok(values.pop()),
        Err(wrong) => {
            notes.push(format!("{name} is not compared: {wrong}"));
            Ok(None)
        }
    }
}

/// A carriageway from its markings, `a;b;c` in m downwards in the image.
fn markings(table: &Table, column: &str, text: &str, driving_direction: u8) -> Result<Road, DataError> {
    let fail = |reason: &str| match table.line_of(0) {
        Ok(line) => DataError::Markings {
            file: table.file.clone(),
            line,
            column: column.to_owned(),
            value: gnp_file::excerpt(text, 60),
            reason: reason.to_owned(),
        },
        Err(e) => e,
    };
    let parts = || text.trim().trim_matches('"').split(';');
    let count = parts().count();
    if count > MAX_LINES {
        return Err(fail(&format!("are {count}, more than the {MAX_LINES} of a carriageway of 16 lanes")));
    }
    let positions: Result<Vec<f32>, _> = parts().map(|y| y.trim().parse()).collect();
    let positions: Vec<f32> = positions.map_err(|_| fail("do not parse"))?;
    if positions.len() < 2 || positions.iter().any(|y| !y.is_finite() || y.abs() > MAX_POSITION) {
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
    // Lengths in the image grow to the right and down; carriageway 1 drives to the left.
    let heading = if driving_direction == 1 { std::f64::consts::PI } else { 0. };
    let axis = ReferenceLine::straight([0., 0.], heading).mirrored();
    Ok(Road { driving_direction, lines, fitted: false, axis: Some(axis) })
}

/// The vehicles that are listed, by number, and a sentence for each thing that is repeated or cannot be compared.
///
/// # Errors
/// Those of [`Table::read`]; for a value that cannot be, and for two rows of one vehicle that differ.
pub(super) fn vehicles(table: &Table) -> Result<(Vec<Listed>, Vec<String>), DataError> {
    let id = table.want("id", Kind::Whole)?;
    let width = table.want("width", Kind::Real)?;
    let height = table.want("height", Kind::Real)?;
    let class = table.want("class", Kind::Word)?;
    let direction = table.want("drivingDirection", Kind::Whole)?;
    let needed = [id, width, height, class, direction];
    let (mut frames, mut notes) = ([const { None::<Vec<i32>> }; FRAMES.len()], Vec::new());
    for (column, name) in frames.iter_mut().zip(FRAMES) {
        *column = optional(table, name, Kind::Whole, &mut notes)?.map(Values::whole);
    }
    let mut values = table.read(&needed)?.into_iter();
    let vehicles = table.natural(values.next().map(Values::whole).unwrap_or_default(), id)?;
    let lengths = table.positive(values.next().map(Values::real).unwrap_or_default(), width)?;
    let widths = table.positive(values.next().map(Values::real).unwrap_or_default(), height)?;
    let (codes, words) = values.next().map(Values::words).unwrap_or_default();
    let directions = values.next().map(Values::whole).unwrap_or_default();
    let mut listed = Vec::with_capacity(vehicles.len());
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
        let body = VehicleBody { class: kind, length: lengths[row], width: widths[row], road };
        let frames = frames.each_ref().map(|column| column.as_ref().and_then(|column| column.get(row).copied()));
        listed.push(Listed { vehicle, row, body, frames });
    }
    listed.sort_by_key(|it| (it.vehicle, it.row));
    let rows = listed.len();
    let same = |a: &Listed, b: &Listed| a.vehicle == b.vehicle && a.body == b.body && a.frames == b.frames;
    listed.dedup_by(|next, kept| same(next, kept));
    if let Some(pair) = listed.windows(2).find(|pair| pair[0].vehicle == pair[1].vehicle) {
        return Err(DataError::Contradiction {
            file: table.file.clone(),
            place: format!("lines {} and {}", table.line_of(pair[0].row)?, table.line_of(pair[1].row)?),
            what: format!("vehicle {} is listed twice with different values", pair[0].vehicle),
            remedy: "remove the wrong row, or take the original file",
        });
    }
    let repeated = rows - listed.len();
    match repeated {
        0 => {}
        1 => notes.push("1 row of tracksMeta repeats one before".to_owned()),
        rows => notes.push(format!("{rows} rows of tracksMeta repeat one before")),
    }
    Ok((listed, notes))
}
