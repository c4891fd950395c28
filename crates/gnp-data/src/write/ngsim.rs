//! NGSIM's layout: feet, the front centre of the vehicle, one carriageway a file, 10 frames a second.

use std::io::{self, Write};
use std::path::Path;

use super::{Written, frame, frames_since_zero, neighbour, numbered, renamed, to_file};
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::recording::{Recording, Road, Track, VehicleClass, VelocitySource};
use crate::slot::Slot;
use crate::window_shape::same_rate;

/// m.
const FOOT: f64 = 0.3048;

/// Frames per second of the layout.
const RATE: f64 = 10.;

/// Time headway of who stands, s, as NGSIM has it.
const STANDING: f64 = 9999.99;

/// Writes a recording in the 18 columns of a period, `.txt` without a header and with blanks between fields, else with a
/// header and commas. Carriageways go into files of their own, numbered behind the name.
///
/// # Errors
/// [`DataError::Unwritable`] at another rate than 10 Hz; when a file cannot be written.
pub(crate) fn write(recording: &Recording, to: &Path) -> Result<Written, DataError> {
    let rate = recording.meta().rate_hz;
    if !same_rate(rate, RATE) {
        return Err(DataError::Unwritable {
            recording: recording.meta().name.clone(),
            layout: "NGSIM".to_owned(),
            reason: format!("it has {rate} frames a second where the layout has {RATE}; write plain tracks instead"),
        });
    }
    let used = |road: usize| recording.tracks().iter().any(|track| usize::from(track.road) == road);
    let roads: Vec<usize> = (0..recording.roads().len()).filter(|road| used(*road)).collect();
    let mut written = Written::default();
    for &road in &roads {
        let file = if roads.len() > 1 { numbered(to, &(road + 1).to_string()) } else { to.to_owned() };
        let part = Part::of(recording, road);
        written.rows += part.tracks.iter().map(|track| track.rows.len() as u64).sum::<u64>();
        let mut vehicles: Vec<u32> = part.tracks.iter().map(|track| track.vehicle).collect();
        vehicles.dedup();
        written.vehicles += vehicles.len() as u64;
        written.lose("lane lines are not in the layout: they are fitted when it is read", part.road.lines.len());
        let moved = [part.left > 0., part.start < 0.].iter().any(|moved| *moved);
        written.lose("carriageways are moved so that Local_X and Local_Y are not below 0", usize::from(moved));
        let blanks = file.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().contains(".txt"));
        to_file(&file, |out| part.write(out, if blanks { "   " } else { "," }, !blanks))?;
        written.files.push(file);
    }
    written.lose("names of vehicles become numbers", renamed(recording));
    if recording.meta().velocities == VelocitySource::Recorded {
        written.lose("recorded velocities become speeds without a direction, of rows", recording.len());
    }
    Ok(written)
}

/// A carriageway.
struct Part<'a> {
    recording: &'a Recording,
    road: &'a Road,
    tracks: Vec<&'a Track>,
    /// What is added to frames.
    since: u32,
    /// Where the left edge is, to the left of the axis, m; 0 where everybody drives to the right of that.
    left: f64,
    /// Where the road begins, m along it; 0 where everybody drives after that.
    start: f64,
}

impl<'a> Part<'a> {
    fn of(recording: &'a Recording, road: usize) -> Self {
        let tracks: Vec<&Track> = recording.tracks().iter().filter(|track| usize::from(track.road) == road).collect();
        let rows = || tracks.iter().flat_map(|track| track.rows.clone());
        let [x, y] = [&recording.columns().x, &recording.columns().y];
        let line = recording.roads()[road].lines.last().map_or(0., |line| line.y);
        let left = rows().map(|row| y[row]).fold(0f32, f32::max);
        let start = f64::from(rows().map(|row| x[row]).fold(0f32, f32::min).floor());
        let left = if left > 0. { f64::from(left.max(line).ceil()) } else { 0. };
        let since = frames_since_zero(recording).unwrap_or(0);
        Self { recording, road: &recording.roads()[road], tracks, since, left, start }
    }

    fn write(&self, out: &mut dyn Write, between: &str, header: bool) -> io::Result<()> {
        if header {
            writeln!(out, "{}", crate::formats::NGSIM_COLUMNS.join(between))?;
        }
        for runs in self.tracks.chunk_by(|a, b| a.vehicle == b.vehicle) {
            let total: usize = runs.iter().map(|track| track.rows.len()).sum();
            for track in runs {
                for row in track.rows.clone() {
                    let [first, rest] = self.fields(track, row, total);
                    writeln!(out, "{}", [first, rest].concat().join(between))?;
                }
            }
        }
        Ok(())
    }

    /// The fields of a row, in two halves.
    fn fields(&self, track: &Track, row: usize, total: usize) -> [Vec<String>; 2] {
        let (recording, c) = (self.recording, self.recording.columns());
        let feet = |metres: f64| format!("{:.3}", metres / FOOT);
        let front = |row: usize, length: f32| f64::from(c.x[row]) + f64::from(length) / 2.;
        let (frame, here) = (frame(track, row), front(row, track.length));
        let right = self.left - f64::from(c.y[row]);
        let speed = |row: usize| f64::from(c.vx[row].hypot(c.vy[row]));
        let [before, after] = [row.saturating_sub(1).max(track.rows.start), (row + 1).min(track.rows.end - 1)];
        let acceleration = (speed(after) - speed(before)) * RATE / (after - before).max(1) as f64;
        // Of NGSIM's own numbers two are ramps, which have one place in the order.
        let own = recording.meta().dataset == Dataset::NGSIM;
        let lane = if own { c.lane[row] } else { super::lane(recording, self.road, row) };
        let ahead = recording.neighbour(row, Slot::Preceding).map(|track| &recording.tracks()[track]);
        let gap = ahead.and_then(|it| Some(front(it.row_at(frame)?, it.length) - here)).unwrap_or(0.);
        let headway = match (gap > 0., speed(row)) {
            (false, _) => 0.,
            (_, speed) if speed < 0.1 => STANDING,
            (_, speed) => gap / speed,
        };
        let class = match track.class {
            VehicleClass::Motorcycle => 1,
            VehicleClass::Car => 2,
            VehicleClass::Truck => 3,
        };
        let [x, y] = recording.in_plane(usize::from(track.road), [here, f64::from(c.y[row])]);
        let time = (recording.meta().time_s(frame) * 1000.).round() as i64;
        let first = vec![
            track.vehicle.to_string(),
            (self.since + frame).to_string(),
            total.to_string(),
            time.to_string(),
            feet(right),
            feet(here - self.start),
            feet(x),
            feet(y),
            feet(track.length.into()),
        ];
        let rest = vec![
            feet(track.width.into()),
            class.to_string(),
            feet(speed(row)),
            feet(acceleration),
            lane.to_string(),
            neighbour(recording, row, Slot::Preceding).to_string(),
            neighbour(recording, row, Slot::Following).to_string(),
            feet(gap),
            format!("{headway:.2}"),
        ];
        [first, rest]
    }
}
