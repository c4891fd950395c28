//! All vehicles of a moment with their observed past: what is predicted where no window is cut, also vehicles whose past
//! is short.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::live::{LiveError, check_lines};
use crate::lookup::FrameIndex;
use crate::neighbours::{LanePosition, Neighbours};
use crate::recording::{
    Columns, LaneMarking, NO_TRACK, NamedLeader, Recording, RecordingMeta, Road, Track, VelocitySource,
};
use crate::slot::SLOTS;
use crate::window::Observation;
use crate::window_shape::{WindowError, WindowShape, same_rate};

mod live;

/// A missing past is filled at the velocity that the positions of at most this time after it show, s: one frame's
/// difference would be noise.
pub const FILL_FROM_S: f64 = 1.;

/// The last observed frames of all vehicles present at a moment, as a small recording: nothing later is in it.
///
/// A vehicle that was not there for all observed frames is predicted all the same: before its first frame it is taken to
/// have driven at constant velocity, which is the velocity recorded in that frame or else the slope of its positions
/// in the [`FILL_FROM_S`] after it. That past is made up for its own prediction alone: as a neighbour it is there since
/// it was seen. So the forecast of a vehicle with a full past is that of the recording, bit by bit.
///
/// ```no_run
/// # fn example(recording: gnp_data::Recording, predictor: &dyn gnp_data::Predictor) -> Result<(), Box<dyn std::error::Error>> {
/// use gnp_data::{Snapshot, WindowShape};
///
/// let shape = WindowShape::new(31, 50, 1, 10.)?;
/// let mut snapshot = Snapshot::of(&recording, 100, shape)?;
/// for frame in 101..200 {
///     let observations: Vec<_> = snapshot.vehicles().filter_map(|it| it.observation()).collect();
///     let forecasts = predictor.predict(&observations, 6)?;
///     snapshot.take(&recording, frame)?; // keeps its buffers
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Snapshot {
    recording: Recording,
    shape: WindowShape,
    /// Number of the moment in `recording`.
    frame: u32,
    vehicles: Vec<Seen>,
    /// Where vehicles are in their lanes, and who is beside whom; both are room to work in.
    places: Vec<LanePosition>,
    neighbours: Neighbours,
}

/// How much of the observed frames of a window a vehicle was there for.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Past {
    /// All of them.
    Full,
    /// The last `observed_s`, s; 0 for the last frame alone. The others are filled at constant velocity.
    Filled {
        /// Time from its first frame to the moment, s.
        observed_s: f64,
    },
    /// The last frame alone, in which its velocity is not recorded: it cannot be predicted.
    NoVelocity,
}

/// A vehicle of a snapshot.
#[derive(Clone, Copy, Debug)]
struct Seen {
    past: Past,
    /// Its track as it was seen: what others see of it.
    track: usize,
    /// The track it is predicted from: the same one, or one with what is missing filled in.
    target: usize,
}

/// A vehicle that is present at the moment of a [`Snapshot`].
#[derive(Clone, Copy, Debug)]
pub struct Present<'a> {
    snapshot: &'a Snapshot,
    seen: Seen,
}

impl<'a> Present<'a> {
    /// Number of the vehicle.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        self.track().vehicle
    }

    /// Its track in the recording of the snapshot, as it was seen.
    #[must_use]
    pub fn track(&self) -> &'a Track {
        &self.snapshot.recording.tracks[self.seen.track]
    }

    /// How much of its past was seen.
    #[must_use]
    pub fn past(&self) -> Past {
        self.seen.past
    }

    /// What a predictor may see of it; `None` with [`Past::NoVelocity`].
    #[must_use]
    pub fn observation(&self) -> Option<Observation<'a>> {
        if self.seen.past == Past::NoVelocity {
            return None;
        }
        let Snapshot { recording, shape, .. } = self.snapshot;
        let target = self.seen.target;
        Observation::new(recording, *shape, target, recording.tracks[target].rows.end - 1).ok()
    }
}

impl Snapshot {
    /// The vehicles of `recording` present in `frame`, for windows of `shape`.
    ///
    /// # Errors
    /// [`WindowError::Shape`]; [`WindowError::Rate`] where every `step`th frame of the recording does not have the rate of
    /// the shape.
    pub fn of(recording: &Recording, frame: u32, shape: WindowShape) -> Result<Self, WindowError> {
        let mut snapshot = Self::empty(recording.meta.clone(), recording.roads.clone(), shape)?;
        snapshot.take(recording, frame)?;
        Ok(snapshot)
    }

    /// Makes it that of another moment, or of another recording; its buffers are used again.
    ///
    /// # Errors
    /// [`WindowError::Rate`]. Then nothing is changed.
    pub fn take(&mut self, recording: &Recording, frame: u32) -> Result<(), WindowError> {
        let (recording_hz, shape) = (recording.meta.rate_hz, self.shape);
        if !same_rate(recording_hz, shape.rate_hz * shape.step as f64) {
            return Err(WindowError::Rate { recording_hz, shape });
        }
        let own = &mut self.recording;
        keep_equal(&mut own.meta, &recording.meta);
        keep_equal(&mut own.roads, &recording.roads);
        keep_equal(&mut own.lane_order, &recording.lane_order);
        keep_equal(&mut own.names, &recording.names);
        self.clear();
        let (needed, all) = (self.needed(), &recording.columns);
        if all.named_leader.is_some() != self.recording.columns.named_leader.is_some() {
            self.recording.columns.named_leader = all.named_leader.as_ref().map(|_| Vec::new());
        }
        // A past is filled before the first frame of a recording, too.
        let shift = (needed as u32 - 1).saturating_sub(frame);
        self.frame = frame + shift;
        self.recording.meta.start_s = recording.meta.start_s - f64::from(shift) / recording_hz;
        for index in recording.present(frame) {
            let from = &recording.tracks[*index as usize];
            let Some(last) = from.row_at(frame) else { continue };
            // The velocity in a frame needs the one before.
            let first = from.rows.start.max(last.saturating_sub(needed));
            let start = self.recording.columns.x.len();
            let columns = &mut self.recording.columns;
            columns.x.extend_from_slice(&all.x[first..=last]);
            columns.y.extend_from_slice(&all.y[first..=last]);
            columns.lane.extend_from_slice(&all.lane[first..=last]);
            // The last stored velocity may know the next row.
            let now = recording.velocity_one_sided(*index as usize, last);
            let [vx, vy] = now.unwrap_or_default();
            columns.vx.extend(all.vx[first..last].iter().chain([&vx]));
            columns.vy.extend(all.vy[first..last].iter().chain([&vy]));
            if let (Some(leaders), Some(all)) = (&mut columns.named_leader, &all.named_leader) {
                leaders.extend_from_slice(&all[first..=last]);
            }
            columns.neighbours.resize(columns.x.len(), [NO_TRACK; SLOTS]);
            let recorded = recording.meta.velocities == VelocitySource::Recorded && now.is_some();
            let track = Track { first_frame: self.frame - (last - first) as u32, rows: start..start, ..from.clone() };
            self.add(track, recorded.then(|| [self.recording.columns.vx[start], self.recording.columns.vy[start]]));
        }
        for (i, index) in recording.present(frame).iter().enumerate() {
            let Some(row) = recording.tracks[*index as usize].row_at(frame) else { continue };
            let present = recording.present(frame);
            let place = |track: u32| present.binary_search(&track).ok();
            self.set_neighbours(i, all.neighbours[row].map(place));
        }
        self.index();
        Ok(())
    }

    /// The vehicles present at the moment, in the order of the recording's tracks.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = Present<'_>> {
        self.vehicles.iter().map(|seen| Present { snapshot: self, seen: *seen })
    }

    /// The shape of its windows.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.shape
    }

    /// The vehicles with their last frames, the observed ones of a window and one before them. Those with a filled past
    /// have two tracks, first as they were seen. Neighbours and presence stand in the last frame alone. Numbers of
    /// frames are those of the recording it was taken of, but in that one's first frames, where they are raised so
    /// that filled ones have a number; times ([`RecordingMeta::time_s`]) are the same.
    #[must_use]
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Number of the moment in [`Snapshot::recording`].
    #[must_use]
    pub fn frame(&self) -> u32 {
        self.frame
    }

    fn empty(meta: RecordingMeta, roads: Vec<Road>, shape: WindowShape) -> Result<Self, WindowError> {
        shape.check()?;
        let recording = Recording {
            meta,
            roads,
            tracks: Vec::new(),
            columns: Columns::default(),
            frames: FrameIndex::default(),
            lane_order: None,
            without_velocity: Vec::new(),
            names: BTreeMap::new(),
        };
        let (vehicles, places, neighbours) = (Vec::new(), Vec::new(), Neighbours::default());
        Ok(Self { recording, shape, frame: 0, vehicles, places, neighbours })
    }

    /// Recorded frames that the observed ones span.
    fn needed(&self) -> usize {
        (self.shape.t_obs - 1).saturating_mul(self.shape.step).saturating_add(1)
    }

    fn clear(&mut self) {
        let Recording { tracks, columns, without_velocity, .. } = &mut self.recording;
        let Columns { x, y, vx, vy, lane, neighbours, named_leader } = columns;
        [x, y, vx, vy].into_iter().for_each(Vec::clear);
        lane.clear();
        neighbours.clear();
        named_leader.iter_mut().for_each(Vec::clear);
        tracks.clear();
        without_velocity.clear();
        self.vehicles.clear();
    }

    /// Ends a track of the rows from `track.rows.start` on, and adds one with a full past where its own is short.
    /// `measured` is the velocity of its first row, m/s, where that is not derived.
    fn add(&mut self, track: Track, measured: Option<[f32; 2]>) {
        let (needed, rate_hz) = (self.needed(), self.recording.meta.rate_hz);
        let rows = track.rows.start..self.recording.columns.x.len();
        let index = self.recording.tracks.len();
        let velocity = measured.or_else(|| self.first_velocity(rows.clone()));
        self.recording.tracks.push(Track { rows: rows.clone(), ..track.clone() });
        let (past, target) = match velocity {
            _ if rows.len() >= needed => (Past::Full, index),
            None => {
                self.recording.without_velocity.push(index as u32);
                (Past::NoVelocity, index)
            }
            Some(velocity) => {
                let filled = self.fill(rows.clone(), needed - rows.len(), velocity);
                let first_frame = self.frame + 1 - needed as u32;
                self.recording.tracks.push(Track { rows: filled, first_frame, ..track });
                (Past::Filled { observed_s: (rows.len() - 1) as f64 / rate_hz }, index + 1)
            }
        };
        self.vehicles.push(Seen { past, track: index, target });
    }

    /// Adds `missing` rows before the first one, at constant velocity, and `rows` once more. Returns the new rows.
    fn fill(&mut self, rows: Range<usize>, missing: usize, [vx, vy]: [f32; 2]) -> Range<usize> {
        let period = 1. / self.recording.meta.rate_hz;
        let columns = &mut self.recording.columns;
        let start = columns.x.len();
        let (x, y, lane) = (columns.x[rows.start], columns.y[rows.start], columns.lane[rows.start]);
        let before = |at: f32, v: f32| {
            (1..=missing).rev().map(move |back| (f64::from(at) - f64::from(v) * back as f64 * period) as f32)
        };
        columns.x.extend(before(x, vx));
        columns.y.extend(before(y, vy));
        let end = start + missing;
        columns.vx.resize(end, vx);
        columns.vy.resize(end, vy);
        columns.lane.resize(end, lane);
        columns.x.extend_from_within(rows.clone());
        columns.y.extend_from_within(rows.clone());
        columns.vx.extend_from_within(rows.clone());
        columns.vy.extend_from_within(rows.clone());
        columns.lane.extend_from_within(rows.clone());
        columns.neighbours.resize(columns.x.len(), [NO_TRACK; SLOTS]);
        if let Some(leaders) = &mut columns.named_leader {
            leaders.resize(end, NamedLeader::default());
            leaders.extend_from_within(rows);
        }
        start..columns.x.len()
    }

    /// Slope of the positions in the first [`FILL_FROM_S`] of `rows`, m/s; `None` of a single row.
    fn first_velocity(&self, rows: Range<usize>) -> Option<[f32; 2]> {
        let Recording { meta, columns, .. } = &self.recording;
        let frames = ((FILL_FROM_S * meta.rate_hz).round() as usize).saturating_add(1).max(2);
        let rows = rows.start..rows.end.min(rows.start.saturating_add(frames));
        if rows.len() < 2 {
            return None;
        }
        let middle = (rows.len() - 1) as f64 / 2.;
        let (mut sum, mut squares) = ([0f64; 2], 0f64);
        for (i, row) in rows.enumerate() {
            let t = i as f64 - middle;
            sum[0] += t * f64::from(columns.x[row]);
            sum[1] += t * f64::from(columns.y[row]);
            squares += t * t;
        }
        Some(sum.map(|sum| (sum * meta.rate_hz / squares) as f32))
    }

    /// Names the neighbours of vehicle `i` at the moment, each by its place among the vehicles.
    fn set_neighbours(&mut self, i: usize, slots: [Option<usize>; SLOTS]) {
        let named = slots
            .map(|other| other.and_then(|other| self.vehicles.get(other)).map_or(NO_TRACK, |other| other.track as u32));
        let Some(Seen { track, target, .. }) = self.vehicles.get(i).copied() else { return };
        for track in [track, target] {
            let last = self.recording.tracks[track].rows.end - 1;
            self.recording.columns.neighbours[last] = named;
        }
    }

    /// Vehicles are present at the moment as they were seen.
    fn index(&mut self) {
        self.recording.frames.set_only(self.frame, self.vehicles.iter().map(|seen| seen.track as u32));
    }
}

/// Copies where it differs, so that nothing is allocated where it does not.
fn keep_equal<T: Clone + PartialEq>(own: &mut T, other: &T) {
    if own != other {
        own.clone_from(other);
    }
}
