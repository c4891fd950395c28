//! Tracks in any plane: tables, plain files, Argoverse 2.

mod argoverse;
mod bad_tables;
mod parquet;
mod plain;
mod tables;

use gnp_data::{DataError, Dataset, IngestReport, Recording, TrackOptions, TrackProblem, TrackTable};

/// A vehicle of made-up traffic on a road through the origin: its offset to the left, m, where it begins, m, its speed
/// along the road, m/s, and its lane.
#[derive(Clone, Copy)]
struct Vehicle {
    left: f64,
    from: f64,
    speed: f64,
    lane: i16,
}

/// Traffic on three lanes of 3.6 m, the left one first, for `frames` frames of `rate_hz`, on a road at `heading`, rad.
fn traffic(heading: f64, rate_hz: f64, frames: u32) -> TrackTable {
    let vehicles: Vec<Vehicle> = (0..9)
        .map(|i| {
            let lane = i % 3;
            let left = 9. - 3.6 * f64::from(lane) + 0.2 * f64::from(i % 2);
            Vehicle { left, from: 25. * f64::from(i), speed: 30. - 3. * f64::from(lane), lane: lane as i16 + 1 }
        })
        .collect();
    table(&vehicles, heading, rate_hz, frames)
}

fn table(vehicles: &[Vehicle], heading: f64, rate_hz: f64, frames: u32) -> TrackTable {
    let mut table = TrackTable::new(Dataset::TRACKS, "A 9", "monday");
    let rows = || (0..frames).flat_map(|frame| vehicles.iter().enumerate().map(move |it| (frame, it)));
    let names: Vec<String> = rows().map(|(_, (i, _))| format!("car {i}")).collect();
    table.set_names(names.iter().map(String::as_str));
    let (sin, cos) = heading.sin_cos();
    for (frame, (_, vehicle)) in rows() {
        let time = f64::from(frame) / rate_hz;
        let along = vehicle.from + vehicle.speed * time;
        table.time_s.push(time);
        table.x.push(along * cos - vehicle.left * sin);
        table.y.push(along * sin + vehicle.left * cos);
    }
    table.lane = Some(rows().map(|(_, (_, vehicle))| vehicle.lane).collect());
    table
}

fn read_table(table: &TrackTable) -> Result<(Recording, IngestReport), DataError> {
    Ok(table.recordings(&TrackOptions::default())?.remove(0))
}

/// The fault of a table, and its message.
fn fault(table: &TrackTable) -> (TrackProblem, String) {
    fault_with(table, &TrackOptions::default())
}

fn fault_with(table: &TrackTable, options: &TrackOptions) -> (TrackProblem, String) {
    match table.recordings(options) {
        Err(error @ DataError::Tracks { problem, .. }) => (problem, error.to_string()),
        other => panic!("{other:?}"),
    }
}
