//! Windows: a target vehicle's observed past and its future, as views into a recording.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::parts::track_at;
use crate::recording::{LaneMarking, Recording, Track, TrackState, Unchanged, VehicleClass};
use crate::slot::{BySlot, Slot};
use crate::window_shape::{WindowError, WindowShape, same_rate};

/// Names a window among recordings: the key of every prediction and score.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WindowKey {
    /// Name of the recording.
    pub recording: String,
    /// Vehicle of the file.
    pub vehicle: u32,
    /// Gap-free stretch of that vehicle.
    pub segment: u16,
    /// Frame number of the last observed frame.
    pub t0: u32,
}

/// A window by index: recording of a set, track of that recording, last observed row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WindowId {
    /// Index of the recording in its set.
    pub recording: u32,
    /// Index of the target's track.
    pub track: u32,
    /// Row of the last observed frame.
    pub row: u32,
}

/// Everything a predictor may see of a window: nothing recorded after the last observed frame.
///
/// Positions are in the window's frame: the road frame moved so that the target's last observed
/// centre is the origin. Velocities of the last observed frame are one-sided. The lane lines and the
/// size of a vehicle do not change with time and count as known, also where a recording's lines were
/// fitted to all of it.
#[derive(Clone, Copy)]
pub struct Observation<'a> {
    pub(crate) recording: &'a Recording,
    pub(crate) shape: WindowShape,
    pub(crate) track: usize,
    pub(crate) row: usize,
}

/// What really happened after the last observed frame. Scoring and training take it; a
/// [`Predictor`](crate::Predictor) is never handed one.
#[derive(Clone, Copy)]
pub struct Truth<'a> {
    observation: Observation<'a>,
}

/// A window: an [`Observation`] and its [`Truth`].
#[derive(Clone, Copy)]
pub struct Window<'a> {
    observation: Observation<'a>,
}

impl<'a> Window<'a> {
    /// The view of `track` of `recording` whose last observed row is `row`.
    ///
    /// # Errors
    /// As [`Observation::new`]; [`WindowError::NoFuture`] when the track ends within the window.
    pub fn new(recording: &'a Recording, shape: WindowShape, track: usize, row: usize) -> Result<Self, WindowError> {
        let observation = Observation::new(recording, shape, track, row)?;
        let track = &recording.tracks()[track];
        let (found, needed) = (track.rows.end - 1 - row, shape.t_pred.saturating_mul(shape.step));
        if found < needed {
            return Err(WindowError::NoFuture { vehicle: track.vehicle, found, needed });
        }
        Ok(Self { observation })
    }

    /// What may be seen.
    #[must_use]
    pub fn observation(&self) -> Observation<'a> {
        self.observation
    }

    /// What happened.
    #[must_use]
    pub fn truth(&self) -> Truth<'a> {
        Truth { observation: self.observation }
    }

    /// Its name.
    #[must_use]
    pub fn key(&self) -> WindowKey {
        self.observation.key()
    }
}

impl<'a> Observation<'a> {
    /// The view of `track` whose last observed row is `row`. No future is needed: this is what
    /// online use builds.
    ///
    /// # Errors
    /// [`WindowError`] when `shape` is none, its rate is not that of every `step`th frame of the recording,
    /// there is no such track or row, the track does not hold all observed frames (`TooShort`, `Gap`), or
    /// the target's velocity is not known.
    pub fn new(recording: &'a Recording, shape: WindowShape, track: usize, row: usize) -> Result<Self, WindowError> {
        shape.check()?;
        let recording_hz = recording.meta().rate_hz;
        if !same_rate(recording_hz, shape.rate_hz * shape.step as f64) {
            return Err(WindowError::Rate { recording_hz, shape });
        }
        let tracks = recording.tracks().len();
        let found = recording.tracks().get(track).ok_or(WindowError::NoTrack { track, tracks })?;
        let &Track { vehicle, segment, ref rows, .. } = found;
        if !rows.contains(&row) {
            return Err(WindowError::NoRow { row, vehicle, rows: rows.clone() });
        }
        let (found, needed) = (row - rows.start + 1, (shape.t_obs - 1).saturating_mul(shape.step).saturating_add(1));
        match (found < needed, segment) {
            (true, 0) => Err(WindowError::TooShort { vehicle, found, needed }),
            (true, _) => Err(WindowError::Gap { vehicle, found, needed }),
            _ if recording.velocity_one_sided(track, row).is_none() => Err(WindowError::NoVelocity { vehicle }),
            _ => Ok(Self { recording, shape, track, row }),
        }
    }

    /// Its name.
    #[must_use]
    pub fn key(&self) -> WindowKey {
        let track = self.track();
        WindowKey {
            recording: self.recording.meta().name.clone(),
            vehicle: track.vehicle,
            segment: track.segment,
            t0: self.frame(),
        }
    }

    /// The window's shape.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.shape
    }

    /// The target's track. Its rows reach into the future, so no caller may follow them.
    pub(crate) fn track(&self) -> &'a Track {
        &self.recording.tracks()[self.track]
    }

    /// Where the scene is changed ([`EditedScene`](crate::EditedScene)): `vehicle` as it drove before, in which its driver can
    /// be known. `None` where nothing is changed, or the speed of `vehicle` is; for one that was added, and of an added target.
    #[must_use]
    pub fn before_changes(&self, vehicle: u32) -> Option<Neighbour<'a>> {
        let Unchanged { scene, speeds } = self.recording.unchanged.as_ref()?;
        let observation = scene.vehicle(self.vehicle())?.window().ok()?;
        let track =
            track_at(scene.recording().tracks(), vehicle, scene.frame()).filter(|_| !speeds.contains(&vehicle))?;
        Some(Neighbour { observation, track })
    }

    /// Index of the target's track in its recording.
    #[must_use]
    pub fn track_index(&self) -> usize {
        self.track
    }

    /// Vehicle of the file.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        self.track().vehicle
    }

    /// Index of the target's carriageway in [`Recording::roads`].
    #[must_use]
    pub fn road(&self) -> u16 {
        self.track().road
    }

    /// Site of the recording.
    #[must_use]
    pub fn site(&self) -> &'a str {
        &self.recording.meta().site
    }

    /// Name of the recording.
    #[must_use]
    pub fn recording_name(&self) -> &'a str {
        &self.recording.meta().name
    }

    /// Frame number of the last observed frame.
    #[must_use]
    pub fn frame(&self) -> u32 {
        let track = self.track();
        track.first_frame + (self.row - track.rows.start) as u32
    }

    /// The window's origin in the road frame: the target's last observed centre, m.
    #[must_use]
    pub fn origin(&self) -> [f32; 2] {
        let state = self.recording.state(self.row);
        [state.x, state.y]
    }

    /// Length and width of the target, m.
    #[must_use]
    pub fn size(&self) -> [f32; 2] {
        let track = self.track();
        [track.length, track.width]
    }

    /// Kind of vehicle of the target.
    #[must_use]
    pub fn class(&self) -> VehicleClass {
        self.track().class
    }

    /// State of the target in observed frame `i` of `0..t_obs`, window frame; all zero for any
    /// other `i`. The velocity of the last one is one-sided.
    #[must_use]
    pub fn target(&self, i: usize) -> TrackState {
        self.state_of(self.track, i).unwrap_or_default()
    }

    /// Lane number of the target at the last observed frame; 0 where unknown.
    #[must_use]
    pub fn lane(&self) -> i16 {
        self.recording.columns().lane[self.row]
    }

    /// The vehicle in neighbour slot `slot` at the last observed frame.
    #[must_use]
    pub fn neighbour(&self, slot: Slot) -> Option<Neighbour<'a>> {
        let track = self.recording.neighbour(self.row, slot)?;
        Some(Neighbour { observation: *self, track })
    }

    /// Neighbours by slot.
    #[must_use]
    pub fn neighbours(&self) -> BySlot<Option<Neighbour<'a>>> {
        BySlot::from_fn(|slot| self.neighbour(slot))
    }

    /// Every other vehicle of the target's carriageway present at the last observed frame.
    pub fn others(&self) -> impl Iterator<Item = Neighbour<'a>> + use<'a> {
        let this = *self;
        let road = this.track().road;
        this.recording.present(this.frame()).iter().map(|track| *track as usize).filter_map(move |track| {
            let same_road = this.recording.tracks()[track].road == road;
            (track != this.track && same_road).then_some(Neighbour { observation: this, track })
        })
    }

    /// Lane lines from right to left, in the window's frame.
    pub fn lines(&self) -> impl ExactSizeIterator<Item = LaneMarking> + use<'a> {
        let y0 = self.origin()[1];
        let road = usize::from(self.track().road);
        self.recording.roads()[road].lines.iter().map(move |line| LaneMarking { y: line.y - y0, ..*line })
    }

    /// Frame number of observed frame `i` of `0..t_obs`.
    pub(crate) fn observed_frame(&self, i: usize) -> Option<u32> {
        let back = (self.shape.t_obs - 1).checked_sub(i)? * self.shape.step;
        self.frame().checked_sub(back as u32)
    }

    /// State of `track` in observed frame `i`, window frame; `None` where it is absent.
    pub(crate) fn state_of(&self, track: usize, i: usize) -> Option<TrackState> {
        let frame = self.observed_frame(i)?;
        let row = self.recording.tracks()[track].row_at(frame)?;
        let mut state = self.recording.state(row);
        if frame == self.frame() {
            // An unknown velocity is assumed to be the target's, which `new` has seen to be known.
            let own = self.recording.velocity_one_sided(track, row);
            let velocity = own.or_else(|| self.recording.velocity_one_sided(self.track, self.row));
            [state.vx, state.vy] = velocity.unwrap_or_default();
        }
        let [x0, y0] = self.origin();
        Some(TrackState { x: state.x - x0, y: state.y - y0, ..state })
    }
}

impl fmt::Debug for Observation<'_> {
    /// The window's name and shape: printing the recording would print the future.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Observation").field("key", &self.key()).field("shape", &self.shape).finish()
    }
}

impl fmt::Debug for Truth<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Truth").field(&self.observation).finish()
    }
}

impl fmt::Debug for Window<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Window").field(&self.observation).finish()
    }
}

/// A vehicle near the target, seen up to the target's last observed frame.
#[derive(Clone, Copy)]
pub struct Neighbour<'a> {
    pub(crate) observation: Observation<'a>,
    pub(crate) track: usize,
}

impl<'a> Neighbour<'a> {
    /// State in observed frame `i` of `0..t_obs`, in the **target's** window frame; `None` where it
    /// is absent.
    ///
    /// A vehicle that comes into the recording in the last observed frame has no past, and where
    /// velocities are not recorded its own is not known ([`Neighbour::velocity`] is `None`). Its
    /// state then has the target's velocity: an assumption, that traffic moves together, under
    /// which it keeps its place beside the target.
    #[must_use]
    pub fn state(&self, i: usize) -> Option<TrackState> {
        self.observation.state_of(self.track, i)
    }

    /// Its own velocity at the target's last observed frame, m/s, from rows up to that frame;
    /// `None` where none tells it.
    #[must_use]
    pub fn velocity(&self) -> Option<[f32; 2]> {
        let this = &self.observation;
        this.recording.velocity_one_sided(self.track, this.recording.tracks()[self.track].row_at(this.frame())?)
    }

    /// State at the target's last observed frame, in the target's window frame.
    #[must_use]
    pub fn now(&self) -> TrackState {
        self.state(self.observation.shape.t_obs - 1).unwrap_or_default()
    }

    /// Its own observation at the same frame, if its track is long enough: what predicts it in turn.
    #[must_use]
    pub fn observation(&self) -> Option<Observation<'a>> {
        let this = &self.observation;
        let row = this.recording.tracks()[self.track].row_at(this.frame())?;
        Observation::new(this.recording, this.shape, self.track, row).ok()
    }

    /// Index of its track in the recording.
    #[must_use]
    pub fn track_index(&self) -> usize {
        self.track
    }

    /// Vehicle of the file.
    #[must_use]
    pub fn vehicle(&self) -> u32 {
        self.observation.recording.tracks()[self.track].vehicle
    }

    /// Kind of vehicle.
    #[must_use]
    pub fn class(&self) -> VehicleClass {
        self.observation.recording.tracks()[self.track].class
    }

    /// Length and width, m.
    #[must_use]
    pub fn size(&self) -> [f32; 2] {
        let track = &self.observation.recording.tracks()[self.track];
        [track.length, track.width]
    }
}

impl fmt::Debug for Neighbour<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Neighbour").field("vehicle", &self.vehicle()).field("of", &self.observation).finish()
    }
}

impl Truth<'_> {
    /// State of the target in predicted frame `j` of `0..t_pred`, window frame; all zero for any
    /// other `j`.
    #[must_use]
    pub fn target(&self, j: usize) -> TrackState {
        self.state_of(self.observation.track, j).unwrap_or_default()
    }

    /// Position in the last predicted frame, m, window frame: the true goal.
    #[must_use]
    pub fn goal(&self) -> [f32; 2] {
        let end = self.target(self.observation.shape.t_pred - 1);
        [end.x, end.y]
    }

    /// Recorded state of the vehicle in `slot` in predicted frame `j`; `None` where it is absent.
    #[must_use]
    pub fn neighbour(&self, slot: Slot, j: usize) -> Option<TrackState> {
        let track = self.observation.recording.neighbour(self.observation.row, slot)?;
        self.state_of(track, j)
    }

    /// Recorded state in predicted frame `j` of a vehicle that [`Observation::others`] of the same
    /// window gave; `None` where it is absent.
    #[must_use]
    pub fn other(&self, neighbour: &Neighbour<'_>, j: usize) -> Option<TrackState> {
        (neighbour.track < self.observation.recording.tracks().len()).then(|| self.state_of(neighbour.track, j))?
    }

    /// Boxes (state, length and width) of all other vehicles of the carriageway in predicted
    /// frame `j`, those that came after the last observed frame included.
    pub fn others(&self, j: usize) -> impl Iterator<Item = (TrackState, [f32; 2])> {
        let o = &self.observation;
        let (tracks, road) = (o.recording.tracks(), o.track().road);
        let present = o.recording.present(self.frame(j)).iter().map(|track| *track as usize);
        let others = present.filter(move |track| *track != o.track && tracks[*track].road == road);
        others.filter_map(move |track| Some((self.state_of(track, j)?, [tracks[track].length, tracks[track].width])))
    }

    /// Lane number in predicted frame `j` of `0..t_pred`; 0 where unknown and for any other `j`.
    #[must_use]
    pub fn lane(&self, j: usize) -> i16 {
        let o = &self.observation;
        let row = (j < o.shape.t_pred).then(|| o.row + (j + 1) * o.shape.step);
        row.map_or(0, |row| o.recording.columns().lane[row])
    }

    /// Frame number of predicted frame `j`.
    fn frame(&self, j: usize) -> u32 {
        let o = &self.observation;
        o.frame() + ((j + 1) * o.shape.step) as u32
    }

    fn state_of(&self, track: usize, j: usize) -> Option<TrackState> {
        let o = &self.observation;
        if j >= o.shape.t_pred {
            return None;
        }
        let row = o.recording.tracks()[track].row_at(self.frame(j))?;
        let state = o.recording.state(row);
        let [x0, y0] = o.origin();
        Some(TrackState { x: state.x - x0, y: state.y - y0, ..state })
    }
}
