//! One recording: every track of one file (or one period of a site), track-major, in SI units.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use gnp_force::MarkingKind;
use gnp_road::{LaneLinesError, ReferenceLine, check_lane_lines};
use serde::{Deserialize, Serialize};

use crate::dataset::Dataset;
use crate::leader::NAMED_LEADER_SIZE;
use crate::lookup::FrameIndex;
use crate::slot::{SLOTS, Slot};
use crate::snapshot::Snapshot;

/// What a vehicle is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VehicleClass {
    /// NGSIM class 1.
    Motorcycle,
    /// highD `Car`, NGSIM class 2; vans as well.
    Car,
    /// highD `Truck`, NGSIM class 3; buses as well.
    Truck,
}

impl VehicleClass {
    /// Length and width, m, that a vehicle is taken to have where its data does not say.
    #[must_use]
    pub const fn default_size(self) -> [f32; 2] {
        match self {
            Self::Motorcycle => [2.2, 0.8],
            Self::Car => NAMED_LEADER_SIZE,
            Self::Truck => [12., 2.5],
        }
    }
}

/// A lane line of a straight road.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LaneMarking {
    /// Edge or line between lanes.
    pub kind: MarkingKind,
    /// Lateral position in m, growing to the left of travel.
    pub y: f32,
}

impl LaneMarking {
    /// A line at `y`, m: the edge of the carriageway, or one between lanes.
    #[must_use]
    pub fn new(y: f32, boundary: bool) -> Self {
        let kind = if boundary { MarkingKind::Boundary } else { MarkingKind::LaneDivider };
        Self { kind, y }
    }

    /// The lines of a carriageway at `offsets`, m, from right to left, positive to the left; the outer two are its edges.
    ///
    /// # Errors
    /// [`LaneLinesError`] for offsets that make no lanes.
    pub fn of_carriageway(offsets: &[f64]) -> Result<Vec<Self>, LaneLinesError> {
        check_lane_lines(offsets)?;
        let edge = |i: usize| i == 0 || i + 1 == offsets.len();
        Ok(offsets.iter().enumerate().map(|(i, y)| Self::new(*y as f32, edge(i))).collect())
    }
}

/// A carriageway: the lanes of one driving direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Road {
    /// `drivingDirection` of highD (1 or 2); 2 where the data has a single direction.
    pub driving_direction: u8,
    /// Lines from right to left, that is with growing `y`.
    pub lines: Vec<LaneMarking>,
    /// Whether `lines` were fitted from lane numbers and positions instead of being given.
    pub fitted: bool,
    /// Where the carriageway's frame lies in the plane of the file it comes from, in m; `None` where that is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<ReferenceLine>,
}

/// Where the velocities of a recording come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VelocitySource {
    /// From the data: each row's velocity is taken as it stands. Where the data's authors smoothed their tracks, as those of
    /// highD did, rows near the last observed one depend on later positions; nothing here can undo that.
    Recorded,
    /// Differentiated from positions, centrally, so that a row's velocity knows the next row. At the
    /// last observed frame of a window it is differentiated anew, backwards.
    Derived,
}

/// Where a recording comes from and how it was sampled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RecordingMeta {
    /// The data family.
    pub dataset: Dataset,
    /// Site, lower case: `us-101`, `i-80`, `highd-2` (highD's `locationId`).
    pub site: String,
    /// Name of the recording, unique in its dataset: file stem, period or number.
    pub name: String,
    /// Frames per second.
    pub rate_hz: f64,
    /// Made by a simulator: must be said wherever a number made from it appears.
    pub simulated: bool,
    /// Where velocities come from.
    pub velocities: VelocitySource,
    /// Time of frame 0 in the clock of the data, s; 0 where the data counts frames alone.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub start_s: f64,
}

/// Recordings that start at 0 are kept as before there was a start.
#[expect(clippy::trivially_copy_pass_by_ref)] // serde hands out a reference
fn is_zero(value: &f64) -> bool {
    *value == 0.
}

impl RecordingMeta {
    /// A real recording whose velocities are derived from positions, unless said otherwise.
    #[must_use]
    pub fn new(dataset: Dataset, site: impl Into<String>, name: impl Into<String>, rate_hz: f64) -> Self {
        let (site, name, velocities) = (site.into(), name.into(), VelocitySource::Derived);
        Self { dataset, site, name, rate_hz, simulated: false, velocities, start_s: 0. }
    }

    /// Time of a frame in the clock of the data, s.
    #[must_use]
    pub fn time_s(&self, frame: u32) -> f64 {
        self.start_s + f64::from(frame) / self.rate_hz
    }

    /// The same, made by a simulator or not.
    #[must_use]
    pub fn with_simulated(self, simulated: bool) -> Self {
        Self { simulated, ..self }
    }

    /// The same with frame 0 at `start_s`, s.
    #[must_use]
    pub fn with_start(self, start_s: f64) -> Self {
        Self { start_s, ..self }
    }

    /// The same with velocities from elsewhere.
    #[must_use]
    pub fn with_velocities(self, velocities: VelocitySource) -> Self {
        Self { velocities, ..self }
    }
}

/// A gap-free stretch of one vehicle. A vehicle with a gap has several, numbered by `segment`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Track {
    /// Identifier in the file; unique in a recording together with `segment`.
    pub vehicle: u32,
    /// 0 for the first gap-free stretch of this vehicle, 1 for the next, ...
    pub segment: u16,
    /// Index of its carriageway in [`Recording::roads`].
    pub road: u16,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Extent along the road, in m.
    pub length: f32,
    /// Extent across the road, in m.
    pub width: f32,
    /// Frame number of the first row.
    pub first_frame: u32,
    /// Rows of this track in the columns, one a frame without a gap.
    pub rows: Range<usize>,
}

impl Track {
    /// The first stretch of a car of `size` (length and width, m) on the first carriageway; the
    /// other fields may be set afterwards.
    #[must_use]
    pub fn new(vehicle: u32, size: [f32; 2], first_frame: u32, rows: Range<usize>) -> Self {
        let [length, width] = size;
        Self { vehicle, segment: 0, road: 0, class: VehicleClass::Car, length, width, first_frame, rows }
    }

    /// Frame number of the last row.
    #[must_use]
    pub fn last_frame(&self) -> u32 {
        self.first_frame + self.rows.len().saturating_sub(1) as u32
    }

    /// Row of `frame`, if the track is present in it.
    #[must_use]
    pub fn row_at(&self, frame: u32) -> Option<usize> {
        let row = self.rows.start + frame.checked_sub(self.first_frame)? as usize;
        (row < self.rows.end).then_some(row)
    }
}

/// Position and velocity of a vehicle's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackState {
    /// Forward, m.
    pub x: f32,
    /// To the left, m.
    pub y: f32,
    /// Forward, m/s.
    pub vx: f32,
    /// To the left, m/s.
    pub vy: f32,
}

/// A vehicle that a row names as the one directly ahead in its lane, and that has no row of its own in that frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NamedLeader {
    /// Vehicle of the file; 0 where the row names none.
    pub vehicle: u32,
    /// From the front of the row's vehicle to its front, m.
    pub headway: f32,
}

/// No track in a slot of [`Columns::neighbours`].
pub(crate) const NO_TRACK: u32 = u32::MAX;

/// The rows of all tracks, one vector a quantity; row `i` of every vector is the same instant.
///
/// Positions are of the **centre of the box** in the travel-aligned road frame of the track's own
/// carriageway: x forward, y to the left, m. `neighbours` holds track indices, `u32::MAX` for none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Centre, forward, m.
    pub x: Vec<f32>,
    /// Centre, to the left, m.
    pub y: Vec<f32>,
    /// Velocity forward, m/s. Where it is derived it uses the next frame: see [`VelocitySource`].
    pub vx: Vec<f32>,
    /// Velocity to the left, m/s.
    pub vy: Vec<f32>,
    /// Lane number of the file; 0 where unknown.
    pub lane: Vec<i16>,
    /// Track in each of the eight slots at this row.
    pub neighbours: Vec<[u32; SLOTS]>,
    /// The vehicle ahead of each row that is known from this row alone; `None` where no row names one.
    pub named_leader: Option<Vec<NamedLeader>>,
}

/// One recording, immutable once built; windows are views into it.
#[derive(Clone, Debug)]
pub struct Recording {
    pub(crate) meta: RecordingMeta,
    pub(crate) roads: Vec<Road>,
    pub(crate) tracks: Vec<Track>,
    pub(crate) columns: Columns,
    pub(crate) frames: FrameIndex,
    /// Place of each lane number in the order from the left, 1 leftmost, where neighbours were found from lanes.
    pub(crate) lane_order: Option<LaneOrder>,
    /// Tracks of one row whose velocity is not known where others' are recorded: in a [`Snapshot`](crate::Snapshot) alone.
    pub(crate) without_velocity: Vec<u32>,
    /// Names of vehicles whose names in the data are no numbers.
    pub(crate) names: BTreeMap<u32, String>,
    /// What it was before it was changed: in an [`EditedScene`](crate::EditedScene) alone.
    pub(crate) unchanged: Option<Unchanged>,
}

/// A scene before its changes.
#[derive(Clone, Debug)]
pub(crate) struct Unchanged {
    pub(crate) scene: Arc<Snapshot>,
    /// Vehicles that were given another speed.
    pub(crate) speeds: BTreeSet<u32>,
}

/// Lane numbers of the data, each with its place in the order from the left.
pub(crate) type LaneOrder = BTreeMap<i16, i16>;

impl Recording {
    /// Where it comes from.
    #[must_use]
    pub fn meta(&self) -> &RecordingMeta {
        &self.meta
    }

    /// The carriageways.
    #[must_use]
    pub fn roads(&self) -> &[Road] {
        &self.roads
    }

    /// The gap-free tracks, by vehicle and segment.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The rows.
    #[must_use]
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Name of a vehicle in the data: the number itself where the data has numbers.
    #[must_use]
    pub fn vehicle_name(&self, vehicle: u32) -> Cow<'_, str> {
        self.names.get(&vehicle).map_or_else(|| vehicle.to_string().into(), |name| name.as_str().into())
    }

    /// The vehicle that has this name in the data.
    #[must_use]
    pub fn vehicle_named(&self, name: &str) -> Option<u32> {
        let named = self.names.iter().find(|(_, have)| *have == name).map(|(vehicle, _)| *vehicle);
        let numbered = || {
            let vehicle = name.trim().parse().ok().filter(|vehicle| !self.names.contains_key(vehicle))?;
            self.tracks.binary_search_by_key(&vehicle, |track| track.vehicle).ok().map(|_| vehicle)
        };
        named.or_else(numbered)
    }

    /// The same with names of vehicles, as [`Recording::vehicle_name`] gives them; of vehicles without a track none is
    /// kept.
    #[must_use]
    pub fn with_vehicle_names(mut self, mut names: BTreeMap<u32, String>) -> Self {
        names.retain(|vehicle, _| self.tracks.binary_search_by_key(vehicle, |track| track.vehicle).is_ok());
        self.names = names;
        self
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.columns.x.len()
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.columns.x.is_empty()
    }

    /// Tracks present in `frame`, in the order of [`Recording::tracks`].
    #[must_use]
    pub fn present(&self, frame: u32) -> &[u32] {
        self.frames.present(frame)
    }

    /// State in a row, road frame. For the velocity of the last observed frame take
    /// [`Recording::velocity_one_sided`].
    #[must_use]
    pub fn state(&self, row: usize) -> TrackState {
        let c = &self.columns;
        TrackState { x: c.x[row], y: c.y[row], vx: c.vx[row], vy: c.vy[row] }
    }

    /// Track in `slot` at `row`.
    #[must_use]
    pub fn neighbour(&self, row: usize, slot: Slot) -> Option<usize> {
        let track = self.columns.neighbours[row][slot.index()];
        (track != NO_TRACK).then_some(track as usize)
    }

    /// What `row` says of a vehicle ahead that has no row of its own.
    pub(crate) fn named_leader(&self, row: usize) -> Option<NamedLeader> {
        self.columns.named_leader.as_ref()?.get(row).copied().filter(|named| named.vehicle != 0)
    }
}
