//! Tracks as Python has them, as a [`TrackTable`].

use std::collections::HashMap;

use gnp_data::{Dataset, LaneMarking, TableVehicle, TrackOptions, TrackTable};
use gnp_road::ReferenceLine;
use pyo3::prelude::*;

use crate::column::{Column, Values, columns};
use crate::error::{TracksError, tracks_error};

/// What is read of a table, as of files of plain tracks: the name of a column, and other names for it; upper and lower case
/// are the same.
const COLUMNS: [(&str, &[&str]); 14] = [
    ("id", &["track_id", "trackid", "vehicle_id", "vehicle", "agent_id"]),
    ("time", &["t", "time_s", "timestamp", "timestamp_s"]),
    ("time_ms", &["timestamp_ms"]),
    ("x", &["x_m", "pos_x", "position_x"]),
    ("y", &["y_m", "pos_y", "position_y"]),
    ("heading", &["yaw", "psi_rad", "heading_rad"]),
    ("heading_deg", &["yaw_deg"]),
    ("speed", &["v"]),
    ("vx", &["v_x", "velocity_x"]),
    ("vy", &["v_y", "velocity_y"]),
    ("length", &[]),
    ("width", &[]),
    ("lane", &["lane_id"]),
    ("class", &["type", "object_type", "vehicle_class", "agent_type"]),
];

/// The columns of a table that are read.
struct Table(Vec<Column>);

/// Reads tracks: see [`columns`] for what `source` may be.
///
/// # Errors
/// [`TracksError`], with row and column, for columns that are missing or not of numbers, and for ids that are none.
pub(crate) fn read(source: &Bound<'_, PyAny>) -> PyResult<TrackTable> {
    let py = source.py();
    let mut table = Table::of(source)?;
    let mut tracks = TrackTable::new(Dataset::TRACKS, "input", "input");
    let id = table.take("id").ok_or_else(|| table.missing("id"))?;
    set_vehicles(py, &mut tracks, &id)?;
    let time_s = table.scaled(py, "time", "time_ms", 1e-3)?;
    tracks.time_s = time_s.ok_or_else(|| table.missing("time"))?;
    for (name, values) in [("x", &mut tracks.x), ("y", &mut tracks.y)] {
        *values = table.numbers(py, name)?.ok_or_else(|| table.missing(name))?;
    }
    tracks.heading = table.scaled(py, "heading", "heading_deg", 1f64.to_radians())?;
    tracks.speed = table.numbers(py, "speed")?;
    tracks.velocity = match (table.numbers(py, "vx")?, table.numbers(py, "vy")?) {
        (Some(vx), Some(vy)) => Some([vx, vy]),
        (None, None) => None,
        (one, _) => {
            let (has, lacks) = if one.is_some() { ("vx", "vy") } else { ("vy", "vx") };
            let message = format!("tracks have a column `{has}` but no `{lacks}`: give both, or neither");
            return Err(tracks_error(py, message, None, Some(lacks)));
        }
    };
    tracks.lane = table.numbers(py, "lane")?.map(|lanes| lanes.into_iter().map(|lane| lane as i16).collect());
    let (length, width) = (table.numbers(py, "length")?, table.numbers(py, "width")?);
    let class = match table.take("class") {
        None => None,
        Some(Column { values: Values::Texts(words), .. }) => Some(words),
        Some(Column { values, .. }) if values.len() == 0 => None,
        Some(Column { name, .. }) => {
            let message = format!("column `{name}` has numbers: give words such as car, truck, motorcycle");
            return Err(tracks_error(py, message, None, Some(&name)));
        }
    };
    let class: Option<Vec<&str>> = class.as_ref().map(|words| words.iter().map(String::as_str).collect());
    tracks.set_bodies(length.as_deref(), width.as_deref(), class.as_deref());
    Ok(tracks)
}

/// What is known of the road: points of its line, m, and lateral positions of lane lines from right to left, m.
///
/// # Errors
/// [`TracksError`] for points that make no line, and for lines that make no lanes.
pub(crate) fn options(road: Option<Vec<[f64; 2]>>, lines: Option<Vec<f64>>) -> PyResult<TrackOptions> {
    let road = road.map(|points| ReferenceLine::from_points(&points)).transpose();
    let road = road.map_err(|error| TracksError::new_err(format!("road: {error}")))?;
    let lines = lines.map(|lines| LaneMarking::of_carriageway(&lines)).transpose();
    let lines = lines.map_err(|error| TracksError::new_err(format!("lines: {error}")))?;
    Ok(TrackOptions { road, lines, ..TrackOptions::default() })
}

impl Table {
    fn of(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        let known = |name: &str| {
            COLUMNS.iter().any(|(column, others)| is(name, column) || others.iter().any(|it| is(name, it)))
        };
        columns(source, known).map(Self)
    }

    /// Takes a column out, by its name or else the first of its other names.
    fn take(&mut self, name: &str) -> Option<Column> {
        let others = COLUMNS.iter().find(|(column, _)| *column == name).map_or(&[][..], |(_, others)| others);
        let names = std::iter::once(&name).chain(others);
        let index = names.filter_map(|name| self.0.iter().position(|column| is(&column.name, name))).next()?;
        Some(self.0.swap_remove(index))
    }

    /// Takes a column of numbers out.
    fn numbers(&mut self, py: Python<'_>, name: &str) -> PyResult<Option<Vec<f64>>> {
        match self.take(name) {
            None => Ok(None),
            Some(Column { values: Values::Numbers(values), .. }) => Ok(Some(values)),
            Some(Column { values: Values::Whole(values), .. }) => {
                Ok(Some(values.into_iter().map(|it| it as f64).collect()))
            }
            Some(Column { name, values: Values::Texts(values) }) => {
                let text = values.first().map_or("", String::as_str);
                let message =
                    format!("row 0, column `{name}`: `{text}` is a text; give numbers, such as by a cast to float");
                Err(tracks_error(py, message, (!values.is_empty()).then_some(0), Some(&name)))
            }
        }
    }

    /// Takes a column of numbers out, or else the column `other` of another unit, times `factor`.
    fn scaled(&mut self, py: Python<'_>, name: &str, other: &str, factor: f64) -> PyResult<Option<Vec<f64>>> {
        if let Some(values) = self.numbers(py, name)? {
            return Ok(Some(values));
        }
        let values = self.numbers(py, other)?;
        Ok(values.map(|values| values.into_iter().map(|value| value * factor).collect()))
    }

    fn missing(&self, name: &str) -> PyErr {
        let others = COLUMNS.iter().find(|(column, _)| *column == name).map_or(&[][..], |(_, others)| others);
        let others = if others.is_empty() { String::new() } else { format!(" (or {})", others.join(", ")) };
        TracksError::new_err(format!(
            "tracks have no column `{name}`{others}: a row is a vehicle at a moment, with columns id, time in s, x and y in m"
        ))
    }
}

fn is(name: &str, other: &str) -> bool {
    name.eq_ignore_ascii_case(other)
}

/// Sets the vehicles of a table and which one each row is of.
fn set_vehicles(py: Python<'_>, tracks: &mut TrackTable, id: &Column) -> PyResult<()> {
    let numbers: Vec<i64>;
    let whole = match &id.values {
        Values::Texts(names) => {
            tracks.set_names(names.iter().map(String::as_str));
            return Ok(());
        }
        Values::Whole(whole) => whole,
        Values::Numbers(values) => {
            let whole = |value: &f64| value.fract() == 0. && value.abs() < 2f64.powi(53);
            if let Some(row) = values.iter().position(|value| !whole(value)) {
                let message = format!(
                    "row {row}, column `{}`: {} is no id; give whole numbers or texts, one in each row",
                    id.name, values[row]
                );
                return Err(tracks_error(py, message, Some(row), Some(&id.name)));
            }
            numbers = values.iter().map(|value| *value as i64).collect();
            &numbers
        }
    };
    let mut known: HashMap<i64, u32> = HashMap::new();
    for number in whole {
        let next = known.len() as u32;
        let index = *known.entry(*number).or_insert(next);
        if index == next {
            tracks.vehicles.push(TableVehicle::named(number.to_string()));
        }
        tracks.vehicle.push(index);
    }
    Ok(())
}
