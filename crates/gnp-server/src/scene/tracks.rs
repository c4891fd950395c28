//! Tracks that a request brings.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::limits::{self, MAX_POSITION};
use gnp_data::{
    DataError, Dataset, LaneMarking, MarkingKind, Recording, TableVehicle, TrackOptions, TrackProblem, TrackTable,
    VehicleClass,
};
use gnp_road::{ReferenceLine, check_lane_lines};
use serde::Deserialize;

use crate::object::Object;
use crate::problem::{Problem, ProblemKind};

/// Longest name of a vehicle, characters.
pub(super) const LONGEST_NAME: usize = 64;

/// A lane line.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LineRequest {
    y: f64,
    kind: LineKind,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum LineKind {
    Boundary,
    Divider,
}

/// A vehicle and where it was.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VehicleRequest {
    id: String,
    class: Option<VehicleClass>,
    size: Option<[f64; 2]>,
    /// Time, s, and centre, m.
    track: Vec<[f64; 3]>,
}

/// The recording of a request's tracks; and its vehicles that are not there at the last moment, each with why.
///
/// # Errors
/// A problem with field and row.
pub(super) fn recording(
    vehicles: &[Object<VehicleRequest>],
    lines: Option<&[Object<LineRequest>]>,
    axis: Option<&[[f64; 2]]>,
) -> Result<(Recording, Vec<(String, String)>), Problem> {
    check(vehicles)?;
    let road = match axis {
        Some(points) => ReferenceLine::from_points(points)
            .map_err(|error| Problem::at(ProblemKind::InvalidTracks, "scene.axis", error.to_string()))?,
        // x of the tracks is that of the road.
        None => ReferenceLine::straight([0.; 2], 0.),
    };
    let options = TrackOptions { rate_hz: None, road: Some(road), lines: lines.map(markings).transpose()? };
    let table = table(vehicles);
    let mut made = table.recordings(&options).map_err(|error| problem(vehicles, &error))?;
    let Some((recording, report)) = made.pop() else {
        return Err(Problem::at(ProblemKind::InvalidTracks, "scene.vehicles", "there are no tracks"));
    };
    let [_, last] = crate::recordings::ends(&recording);
    let there: BTreeSet<u32> =
        recording.present(last).iter().filter_map(|i| Some(recording.tracks().get(*i as usize)?.vehicle)).collect();
    let left_out: Vec<&str> = report.vehicles_left_out.keys().map(String::as_str).collect();
    let why = |name: &str| match recording.vehicle_named(name) {
        Some(number) if there.contains(&number) => None,
        Some(_) => Some("it is not there at the last moment of the scene".to_owned()),
        None => Some(format!("vehicles were left out that {}", left_out.join(", or "))),
    };
    let missing = vehicles.iter().filter_map(|vehicle| Some((vehicle.id.clone(), why(&vehicle.id)?))).collect();
    Ok((recording, missing))
}

/// Refuses what no table of tracks can have, by field and row.
fn check(vehicles: &[Object<VehicleRequest>]) -> Result<(), Problem> {
    let mut known: BTreeMap<&str, usize> = BTreeMap::new();
    if vehicles.is_empty() {
        return Err(Problem::at(ProblemKind::InvalidTracks, "scene.vehicles", "a scene has at least one vehicle"));
    }
    for (i, vehicle) in vehicles.iter().enumerate() {
        let field = |name: &str| format!("scene.vehicles[{i}].{name}");
        let wrong = |name: &str, detail: String| Err(Problem::at(ProblemKind::InvalidTracks, field(name), detail));
        let name = vehicle.id.as_str();
        if name.is_empty() || name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
            return wrong("id", format!("a name has 1 to {LONGEST_NAME} characters, none of control"));
        }
        if let Some(first) = known.insert(name, i) {
            return wrong("id", format!("scene.vehicles[{first}] has the same name, {name}"));
        }
        if let Some(size) = vehicle.size.filter(|size| !limits::is_size(size.map(|it| it as f32))) {
            return wrong("size", format!("{size:?} m is no length and width of a vehicle"));
        }
        if vehicle.track.is_empty() {
            return wrong("track", "a track has at least one row: time, x and y".to_owned());
        }
        let mut before = f64::NEG_INFINITY;
        for (row, [time, x, y]) in vehicle.track.iter().enumerate() {
            let problem = if *time <= before {
                format!("the time {time} s is not after that of the row before, {before} s")
            } else if x.abs().max(y.abs()) > 1e9 {
                format!("({x}, {y}) m is no place; positions are within {MAX_POSITION} m of the beginning of the road")
            } else {
                before = *time;
                continue;
            };
            let field = format!("scene.vehicles[{i}].track[{row}]");
            return Err(Problem::new(ProblemKind::InvalidTracks, String::new()).and(field, Some(row), problem));
        }
    }
    Ok(())
}

fn markings(lines: &[Object<LineRequest>]) -> Result<Vec<LaneMarking>, Problem> {
    let offsets: Vec<f64> = lines.iter().map(|line| line.y).collect();
    check_lane_lines(&offsets)
        .map_err(|error| Problem::at(ProblemKind::InvalidTracks, "scene.lines", error.to_string()))?;
    let kind = |kind: LineKind| match kind {
        LineKind::Boundary => MarkingKind::Boundary,
        LineKind::Divider => MarkingKind::LaneDivider,
    };
    Ok(lines.iter().map(|line| LaneMarking { kind: kind(line.kind), y: line.y as f32 }).collect())
}

fn table(vehicles: &[Object<VehicleRequest>]) -> TrackTable {
    let mut table = TrackTable::new(Dataset::TRACKS, "request", "request");
    for (vehicle, index) in vehicles.iter().zip(0..) {
        let mut known = TableVehicle::named(&vehicle.id);
        known.class = vehicle.class;
        known.length = vehicle.size.map(|[length, _]| length as f32);
        known.width = vehicle.size.map(|[_, width]| width as f32);
        table.vehicles.push(known);
        for [time, x, y] in &vehicle.track {
            table.vehicle.push(index);
            table.time_s.push(*time);
            table.x.push(*x);
            table.y.push(*y);
        }
    }
    table
}

/// What tracks are refused for, with the vehicle and its row where one is at fault.
fn problem(vehicles: &[Object<VehicleRequest>], error: &DataError) -> Problem {
    let kind = ProblemKind::InvalidTracks;
    let DataError::Tracks { problem, row, what, remedy, .. } = error else {
        return Problem::at(kind, "scene.vehicles", error.to_string());
    };
    let detail = format!("{what}; {remedy}");
    let mut row = match row {
        Some(row) => *row,
        None if *problem == TrackProblem::Road => return Problem::at(kind, "scene.axis", detail),
        None => return Problem::at(kind, "scene.vehicles", detail),
    };
    // Rows of the table are those of the vehicles, one after the other.
    for (i, vehicle) in vehicles.iter().enumerate() {
        if row < vehicle.track.len() {
            let field = format!("scene.vehicles[{i}].track[{row}]");
            return Problem::new(kind, String::new()).and(field, Some(row), detail);
        }
        row -= vehicle.track.len();
    }
    Problem::at(kind, "scene.vehicles", detail)
}
