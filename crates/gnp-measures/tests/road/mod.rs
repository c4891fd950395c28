//! Recordings made by hand.

#![allow(clippy::unwrap_used, dead_code)] // only tests call these, and not each of them all

use gnp_data::{Dataset, LaneMarking, NamedLeader, Recording, RecordingMeta, Road, Rows, VehicleBody, VehicleClass};

pub(crate) const RATE: f64 = 10.;

/// A row: vehicle, frame, x, y, vx, lane.
pub(crate) type Row = (u32, u32, f64, f64, f64, i16);

/// A recording of boxes of 5 m by 2 m on two carriageways at most; vehicles from 1000 on are on the second.
pub(crate) fn recording(rows: &[Row]) -> Recording {
    with_leaders(rows, None)
}

/// The same, in which each row may name a leader.
pub(crate) fn with_leaders(rows: &[Row], leader: Option<Vec<NamedLeader>>) -> Recording {
    let column = |of: fn(&Row) -> f64| rows.iter().map(|row| of(row) as f32).collect::<Vec<f32>>();
    let (vehicle, frame) = rows.iter().map(|row| (row.0, row.1)).unzip();
    let mut columns = Rows::new(vehicle, frame, column(|row| row.2), column(|row| row.3));
    columns.velocity = Some([column(|row| row.4), vec![0.; rows.len()]]);
    columns.lane = rows.iter().map(|row| row.5).collect();
    columns.leader = leader;
    let lines = [-7.5, -3.75, 0.].map(|y| LaneMarking::new(y, y != -3.75));
    let road = |driving_direction| Road { driving_direction, lines: lines.to_vec(), fitted: false, axis: None };
    let body = |row: usize| VehicleBody {
        class: VehicleClass::Car,
        length: 5.,
        width: 2.,
        road: u16::from(rows[row].0 >= 1000),
    };
    let meta = RecordingMeta::new(Dataset::LIVE, "nowhere", "by, hand", RATE).with_simulated(true);
    Recording::from_rows(meta, vec![road(2), road(1)], columns, body).unwrap().0
}

/// A vehicle in one lane from frame `first`, with its place and speed at each time after the recording's start.
pub(crate) fn drive(vehicle: u32, lane: i16, frames: std::ops::Range<u32>, at: impl Fn(f64) -> (f64, f64)) -> Vec<Row> {
    let y = -1.875 - 3.75 * f64::from(lane - 1);
    frames
        .map(|frame| {
            let (x, v) = at(f64::from(frame) / RATE);
            (vehicle, frame, x, y, v, lane)
        })
        .collect()
}

pub(crate) fn near(a: f64, b: f64, within: f64) {
    assert!((a - b).abs() <= within, "{a} is not {b} within {within}");
}
