//! All vehicles of a moment with their observed past: what is predicted where no window is cut, also vehicles whose past
//! is short.

use std::collections::BTreeMap;

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

/// Positions of at least this time tell how a velocity changes, s.
const BENT_FROM_S: f64 = 0.5;

/// The last observed frames of all vehicles present at a moment, as a small recording: nothing later is in it.
///
/// A vehicle that was not there for all observed frames is predicted all the same: before its first frame it is taken to
/// have driven at constant velocity. That is the velocity recorded in that frame; or else, of the positions in the
/// [`FILL_FROM_S`] after it, the slope there of a parabola along the road and of a line across it. Its neighbours see the same
/// past: on the scenes of NGSIM forecasts are better for it, those for vehicles behind one that has just come among them,
/// because networks know few vehicles ahead without a past. Where nobody's past is short the forecast is that of the
/// recording, bit by bit.
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
    pub(crate) recording: Recording,
    shape: WindowShape,
    /// Number of the moment in `recording`.
    pub(crate) frame: u32,
    /// By track: each vehicle has one.
    pub(crate) pasts: Vec<Past>,
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
    /// The last `observed_s`, s, and no others: where a past is left as it is, such a vehicle is not predicted.
    Short {
        /// Time from its first frame to the moment, s.
        observed_s: f64,
    },
    /// The last frame alone, in which its velocity is not recorded: it cannot be predicted.
    NoVelocity,
}

/// A vehicle that is present at the moment of a [`Snapshot`].
#[derive(Clone, Copy, Debug)]
pub struct Present<'a> {
    snapshot: &'a Snapshot,
    index: usize,
}

impl<'a> Present<'a> {
    /// Number of the vehicle.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        self.track().vehicle
    }

    /// Its track in the recording of the snapshot.
    #[must_use]
    pub fn track(&self) -> &'a Track {
        &self.snapshot.recording.tracks[self.index]
    }

    /// How much of its past was seen.
    #[must_use]
    pub fn past(&self) -> Past {
        self.snapshot.pasts[self.index]
    }

    /// What a predictor may see of it; `None` with [`Past::Short`] and [`Past::NoVelocity`].
    #[must_use]
    pub fn observation(&self) -> Option<Observation<'a>> {
        if self.past() == Past::NoVelocity {
            return None;
        }
        self.window().ok()
    }

    /// The same, or why there is none.
    pub(crate) fn window(&self) -> Result<Observation<'a>, WindowError> {
        let Snapshot { recording, shape, .. } = self.snapshot;
        Observation::new(recording, *shape, self.index, self.track().rows.end - 1)
    }

    /// Centre at the moment, m, road frame.
    #[must_use]
    pub fn at(&self) -> [f32; 2] {
        let now = self.snapshot.recording.state(self.track().rows.end - 1);
        [now.x, now.y]
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
        self.cut(recording, frame, None, true);
        Ok(())
    }

    /// The vehicles on the carriageway of `seen`, with their pasts as they are.
    pub(crate) fn as_seen(seen: &Observation<'_>) -> Self {
        let Observation { recording, shape, .. } = *seen;
        let mut snapshot = Self::without_vehicles(recording.meta.clone(), recording.roads.clone(), shape);
        snapshot.cut(recording, seen.frame(), Some(seen.road()), false);
        snapshot
    }

    /// Takes the vehicles of a moment, those of a carriageway or all of them; short pasts are filled or left as they are.
    fn cut(&mut self, recording: &Recording, frame: u32, road: Option<u16>, fills: bool) {
        let recording_hz = recording.meta.rate_hz;
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
        let shift = if fills { (needed as u32 - 1).saturating_sub(frame) } else { 0 };
        self.frame = frame + shift;
        self.recording.meta.start_s = recording.meta.start_s - f64::from(shift) / recording_hz;
        let on_road = |index: &usize| road.is_none_or(|road| recording.tracks[*index].road == road);
        let kept = || recording.present(frame).iter().map(|index| *index as usize).filter(on_road);
        for index in kept() {
            let from = &recording.tracks[index];
            let Some(last) = from.row_at(frame) else { continue };
            // The velocity in a frame needs the one before.
            let first = from.rows.start.max(last.saturating_sub(needed));
            let start = self.recording.columns.x.len();
            let columns = &mut self.recording.columns;
            columns.x.extend_from_slice(&all.x[first..=last]);
            columns.y.extend_from_slice(&all.y[first..=last]);
            columns.lane.extend_from_slice(&all.lane[first..=last]);
            // The last stored velocity may know the next row.
            let now = recording.velocity_one_sided(index, last);
            let [vx, vy] = now.unwrap_or_default();
            columns.vx.extend(all.vx[first..last].iter().chain([&vx]));
            columns.vy.extend(all.vy[first..last].iter().chain([&vy]));
            if let (Some(leaders), Some(all)) = (&mut columns.named_leader, &all.named_leader) {
                leaders.extend_from_slice(&all[first..=last]);
            }
            columns.neighbours.resize(columns.x.len(), [NO_TRACK; SLOTS]);
            let recorded = recording.meta.velocities == VelocitySource::Recorded && now.is_some();
            if fills {
                self.add(from.clone(), start, recorded.then(|| [all.vx[first], all.vy[first]]));
            } else {
                self.add_as_seen(from.clone(), start, now.is_some());
            }
        }
        let name = |track: &Track| (track.vehicle, track.segment);
        for (i, index) in kept().enumerate() {
            let Some(row) = recording.tracks[index].row_at(frame) else { continue };
            let own = &self.recording.tracks;
            let place = |track: u32| own.binary_search_by_key(&name(&recording.tracks[track as usize]), name).ok();
            let named = all.neighbours[row].map(|track| if track == NO_TRACK { None } else { place(track) });
            self.set_neighbours(i, named);
        }
        self.index();
    }

    /// The vehicles present at the moment, in the order of the recording's tracks.
    pub fn vehicles(&self) -> impl ExactSizeIterator<Item = Present<'_>> {
        (0..self.pasts.len()).map(|index| Present { snapshot: self, index })
    }

    /// A vehicle of them by its number.
    #[must_use]
    pub fn vehicle(&self, vehicle: u32) -> Option<Present<'_>> {
        let index = self.recording.tracks.binary_search_by_key(&vehicle, |track| track.vehicle).ok()?;
        Some(Present { snapshot: self, index })
    }

    /// The shape of its windows.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.shape
    }

    /// The vehicles with their last frames, the observed ones of a window and, where it was seen, one before them. Neighbours and presence stand in the last frame alone. Numbers of
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
        Ok(Self::without_vehicles(meta, roads, shape))
    }

    pub(crate) fn without_vehicles(meta: RecordingMeta, roads: Vec<Road>, shape: WindowShape) -> Self {
        let recording = Recording {
            meta,
            roads,
            tracks: Vec::new(),
            columns: Columns::default(),
            frames: FrameIndex::default(),
            lane_order: None,
            without_velocity: Vec::new(),
            names: BTreeMap::new(),
            unchanged: None,
        };
        let (pasts, places, neighbours) = (Vec::new(), Vec::new(), Neighbours::default());
        Self { recording, shape, frame: 0, pasts, places, neighbours }
    }

    /// Recorded frames that the observed ones span.
    pub(crate) fn needed(&self) -> usize {
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
        self.pasts.clear();
    }

    /// Adds a track of the rows from `start` on, as long as its past should be: what is missing before them is filled.
    /// `measured` is the velocity of its first row, m/s, where that is not derived.
    fn add(&mut self, track: Track, start: usize, measured: Option<[f32; 2]>) {
        let (needed, rate_hz) = (self.needed(), self.recording.meta.rate_hz);
        let seen = self.recording.columns.x.len() - start;
        let past = match measured.or_else(|| self.first_velocity(start)) {
            _ if seen >= needed => Past::Full,
            None => Past::NoVelocity,
            Some(velocity) => {
                self.fill(start, needed - seen, velocity);
                Past::Filled { observed_s: (seen - 1) as f64 / rate_hz }
            }
        };
        let rows = start..self.recording.columns.x.len();
        let first_frame = self.frame + 1 - rows.len() as u32;
        self.put(Track { first_frame, rows, ..track }, past);
    }

    /// Adds a track of the rows from `start` on, whose past stays as it is.
    fn add_as_seen(&mut self, track: Track, start: usize, moves: bool) {
        let rows = start..self.recording.columns.x.len();
        let (seen, rate_hz) = (rows.len(), self.recording.meta.rate_hz);
        let past = if seen >= self.needed() {
            Past::Full
        } else if moves {
            Past::Short { observed_s: (seen - 1) as f64 / rate_hz }
        } else {
            Past::NoVelocity
        };
        self.put(Track { first_frame: self.frame + 1 - seen as u32, rows, ..track }, past);
    }

    /// Adds a track whose rows are there.
    pub(crate) fn put(&mut self, track: Track, past: Past) {
        if past == Past::NoVelocity {
            self.recording.without_velocity.push(self.pasts.len() as u32);
        }
        self.recording.tracks.push(track);
        self.pasts.push(past);
    }

    /// Puts `missing` rows before those from `start` on, at constant velocity.
    fn fill(&mut self, start: usize, missing: usize, [vx, vy]: [f32; 2]) {
        let period = 1. / self.recording.meta.rate_hz;
        let Columns { x, y, vx: own_vx, vy: own_vy, lane, neighbours, named_leader } = &mut self.recording.columns;
        let (x0, y0, lane0) = (x[start], y[start], lane[start]);
        let before = |at: f32, v: f32| move |back: usize| (f64::from(at) - f64::from(v) * back as f64 * period) as f32;
        put_before(x, start, missing, before(x0, vx));
        put_before(y, start, missing, before(y0, vy));
        put_before(own_vx, start, missing, |_| vx);
        put_before(own_vy, start, missing, |_| vy);
        put_before(lane, start, missing, |_| lane0);
        put_before(neighbours, start, missing, |_| [NO_TRACK; SLOTS]);
        if let Some(leaders) = named_leader {
            put_before(leaders, start, missing, |_| NamedLeader::default());
        }
    }

    /// Velocity in row `start` by the positions from it on, m/s; `None` of a single row.
    fn first_velocity(&self, start: usize) -> Option<[f32; 2]> {
        let Recording { meta, columns, .. } = &self.recording;
        let frames = |seconds: f64| ((seconds * meta.rate_hz).round() as usize).max(1);
        let count = (columns.x.len() - start).min(frames(FILL_FROM_S).saturating_add(1));
        if count < 2 {
            return None;
        }
        let time = |i: usize| i as f64 - (count - 1) as f64 / 2.;
        // Around the middle 1, t and t² less its mean are orthogonal: sums, no system.
        let mean_square = (count * count - 1) as f64 / 12.;
        let (mut slope, mut bend, mut squares, mut fourths) = ([0f64; 2], 0., 0., 0.);
        for i in 0..count {
            let (t, q) = (time(i), time(i).powi(2) - mean_square);
            let at = [&columns.x, &columns.y].map(|column| f64::from(column[start + i]));
            slope = [0, 1].map(|axis| slope[axis] + t * at[axis]);
            bend += q * at[0];
            squares += t * t;
            fourths += q * q;
        }
        let mut slope = slope.map(|sum| sum / squares);
        if count > frames(BENT_FROM_S).max(2) {
            slope[0] += 2. * bend / fourths * time(0);
        }
        Some(slope.map(|slope| (slope * meta.rate_hz) as f32))
    }

    /// Names the neighbours of vehicle `i` at the moment, each by its place among the vehicles.
    pub(crate) fn set_neighbours(&mut self, i: usize, slots: [Option<usize>; SLOTS]) {
        if let Some(track) = self.recording.tracks.get(i) {
            let named = slots.map(|other| other.map_or(NO_TRACK, |other| other as u32));
            self.recording.columns.neighbours[track.rows.end - 1] = named;
        }
    }

    /// Every vehicle is present at the moment.
    pub(crate) fn index(&mut self) {
        self.recording.frames.set_only(self.frame, 0..self.pasts.len() as u32);
    }
}

/// Puts `count` values before those from `start` on; the value is asked for by how far before them it is.
fn put_before<T: Copy>(column: &mut Vec<T>, start: usize, count: usize, value: impl Fn(usize) -> T) {
    let end = column.len();
    column.extend((0..count).map(|_| value(1)));
    column.copy_within(start..end, start + count);
    for (i, place) in column[start..start + count].iter_mut().enumerate() {
        *place = value(count - i);
    }
}

/// Copies where it differs, so that nothing is allocated where it does not.
fn keep_equal<T: Clone + PartialEq>(own: &mut T, other: &T) {
    if own != other {
        own.clone_from(other);
    }
}
