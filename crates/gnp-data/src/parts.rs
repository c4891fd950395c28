//! A recording from its parts, checked.

use std::collections::BTreeMap;

use crate::error::DataError;
use crate::limits::{self, MAX_LINES, MAX_POSITION, MAX_RATE_HZ, MAX_SPEED, MIN_RATE_HZ};
use crate::lookup::FrameIndex;
use crate::recording::{Columns, NO_TRACK, NamedLeader, Recording, RecordingMeta, Road, Track, VelocitySource};

/// Longest span of frames a recording may have: a day at 100 Hz. The frame index is as long.
pub(crate) const MAX_FRAMES: u32 = 8_640_000;

impl Recording {
    /// A recording of `tracks` sorted by (vehicle, segment), whose rows follow one another in
    /// `columns` without a hole.
    ///
    /// # Errors
    /// [`DataError::Parts`] when the name is empty, the rate is not positive, columns differ in
    /// length, tracks do not cover the rows in order, a track names a carriageway that is not
    /// there, lines do not grow, a value is not finite, a neighbour is not a track that is present in that frame,
    /// or a named leader has a row of its own or no distance; when a position, a recorded velocity, a size, a rate
    /// or a number of lines is beyond its bound in [`limits`]. Derived velocities follow from
    /// positions, whose noise may exceed any speed.
    pub fn from_parts(
        meta: RecordingMeta,
        roads: Vec<Road>,
        tracks: Vec<Track>,
        columns: Columns,
    ) -> Result<Self, DataError> {
        let fail = |reason: String| DataError::Parts { recording: meta.name.clone(), reason };
        check_meta(&meta).map_err(fail)?;
        check_roads(&roads).map_err(fail)?;
        check_tracks(&tracks, roads.len(), columns.x.len()).map_err(fail)?;
        check_columns(&columns, &tracks, meta.velocities).map_err(fail)?;
        let spans: Vec<(u32, u32)> = tracks.iter().map(|track| (track.first_frame, track.last_frame())).collect();
        let frames = FrameIndex::new(&spans);
        Ok(Self {
            meta,
            roads,
            tracks,
            columns,
            frames,
            lane_order: None,
            without_velocity: Vec::new(),
            names: BTreeMap::new(),
            unchanged: None,
        })
    }
}

fn check_meta(meta: &RecordingMeta) -> Result<(), String> {
    if meta.name.is_empty() {
        return Err("the name is empty; give every recording a name".into());
    }
    if !limits::is_rate(meta.rate_hz) {
        return Err(format!("rate {} Hz; it must be from {MIN_RATE_HZ} to {MAX_RATE_HZ} Hz", meta.rate_hz));
    }
    if !meta.start_s.is_finite() {
        return Err(format!("frame 0 is at {} s; it must be at a finite time", meta.start_s));
    }
    Ok(())
}

fn check_roads(roads: &[Road]) -> Result<(), String> {
    for (r, road) in roads.iter().enumerate() {
        let grow = road.lines.windows(2).all(|pair| pair[0].y < pair[1].y);
        if !grow || road.lines.iter().any(|line| !limits::is_position([0., line.y])) {
            return Err(format!(
                "the lines of carriageway {r} must be finite, grow in y and be within {MAX_POSITION} m"
            ));
        }
        if road.lines.len() > MAX_LINES {
            return Err(format!("carriageway {r} has {} lines; it may have {MAX_LINES}", road.lines.len()));
        }
    }
    Ok(())
}

fn check_tracks(tracks: &[Track], roads: usize, rows: usize) -> Result<(), String> {
    let mut end = 0;
    for (t, track) in tracks.iter().enumerate() {
        let Track { vehicle, segment, .. } = track;
        if track.rows.start != end || track.rows.is_empty() {
            return Err(format!("track {t} has rows {:?}; they must follow row {end} and not be empty", track.rows));
        }
        end = track.rows.end;
        if t > 0 && (tracks[t - 1].vehicle, tracks[t - 1].segment) >= (*vehicle, *segment) {
            return Err(format!("track {t} (vehicle {vehicle}, segment {segment}) is out of order; sort the tracks"));
        }
        if usize::from(track.road) >= roads {
            return Err(format!("vehicle {vehicle} is on carriageway {}, there are {roads}", track.road));
        }
        if !limits::is_size([track.length, track.width]) {
            return Err(format!(
                "vehicle {vehicle} is {} m long and {} m wide; vehicles are {}",
                track.length,
                track.width,
                limits::sizes()
            ));
        }
        if u32::try_from(track.rows.len()).ok().and_then(|n| track.first_frame.checked_add(n)).is_none() {
            return Err(format!("vehicle {vehicle} has frames beyond {}", u32::MAX));
        }
    }
    if end != rows {
        return Err(format!("the tracks cover {end} rows of {rows}"));
    }
    let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = tracks.iter().map(Track::last_frame).max().unwrap_or(0);
    check_span(first, last)
}

/// Refuses frames further apart than [`MAX_FRAMES`].
pub(crate) fn check_span(first: u32, last: u32) -> Result<(), String> {
    if last - first > MAX_FRAMES {
        return Err(format!("frames {first} to {last} are more than {MAX_FRAMES} apart; check the frame column"));
    }
    Ok(())
}

fn check_columns(columns: &Columns, tracks: &[Track], velocities: VelocitySource) -> Result<(), String> {
    let rows = columns.x.len();
    let lengths = [columns.y.len(), columns.vx.len(), columns.vy.len(), columns.lane.len(), columns.neighbours.len()];
    if lengths.iter().any(|n| *n != rows) {
        return Err(format!("columns y, vx, vy, lane, neighbours have {lengths:?} rows where x has {rows}"));
    }
    for (name, column) in [("x", &columns.x), ("y", &columns.y), ("vx", &columns.vx), ("vy", &columns.vy)] {
        if let Some(row) = column.iter().position(|value| !value.is_finite()) {
            return Err(format!("column {name}, row {row} is {}; it must be finite", column[row]));
        }
    }
    let (x, y) = (columns.x.iter().zip(&columns.y), columns.vx.iter().zip(&columns.vy));
    let (mut positions, mut speeds) = (x.map(|(x, y)| [*x, *y]), y.map(|(vx, vy)| [*vx, *vy]));
    if let Some(row) = positions.position(|position| !limits::is_position(position)) {
        return Err(format!("row {row} is more than {MAX_POSITION} m from the origin; choose one nearer to the road"));
    }
    if velocities == VelocitySource::Recorded
        && let Some(row) = speeds.position(|velocity| !limits::is_velocity(velocity))
    {
        return Err(format!("row {row} moves at more than {MAX_SPEED} m/s; check the unit"));
    }
    for (t, track) in tracks.iter().enumerate() {
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            for neighbour in columns.neighbours[row].iter().filter(|n| **n != NO_TRACK) {
                let there = tracks.get(*neighbour as usize).and_then(|other| other.row_at(frame));
                if there.is_none() || *neighbour as usize == t {
                    return Err(format!(
                        "row {row} names track {neighbour} as neighbour, which is not another one in its frame"
                    ));
                }
            }
        }
    }
    check_named_leaders(columns, tracks)
}

fn check_named_leaders(columns: &Columns, tracks: &[Track]) -> Result<(), String> {
    let Some(named) = &columns.named_leader else { return Ok(()) };
    let rows = columns.x.len();
    if named.len() != rows {
        return Err(format!("column named_leader has {} rows where x has {rows}", named.len()));
    }
    for track in tracks {
        for row in track.rows.clone().filter(|row| named[*row].vehicle != 0) {
            let NamedLeader { vehicle, headway } = named[row];
            let frame = track.first_frame + (row - track.rows.start) as u32;
            if vehicle == track.vehicle || track_at(tracks, vehicle, frame).is_some() {
                return Err(format!(
                    "row {row} names vehicle {vehicle} as leader, which has a row of its own in its frame"
                ));
            }
            if !(headway.is_finite() && headway > 0.) {
                return Err(format!("row {row} has its leader {headway} m ahead; it must be positive"));
            }
        }
    }
    Ok(())
}

/// Index of the track of `vehicle` that is present in `frame`, of tracks by vehicle and segment.
pub(crate) fn track_at(tracks: &[Track], vehicle: u32, frame: u32) -> Option<usize> {
    let first = tracks.partition_point(|track| track.vehicle < vehicle);
    let own = tracks[first..].iter().take_while(|track| track.vehicle == vehicle);
    own.zip(first..).find(|(track, _)| track.row_at(frame).is_some()).map(|(_, index)| index)
}
