//! Driving on from a moment of a recording, in closed loop.
//!
//! A [`Replay`] is a [`Scene`], which is all that a system is given, and the truth, which only scores see. A scene has who
//! is on the road at the start, with their past; who comes into the recording later, with the first state recorded; and
//! what is moved as it was recorded, because the file does not say whom it follows: the *boundary*. It is the same for every
//! system, and nobody is scored on it.
//!
//! - **Heads.** The foremost vehicle of each lane at the start follows somebody whom the file does not have. It moves as
//!   recorded.
//! - **Named leaders.** Where rows name a leader that has no rows (I-80), it is moved as the rows of its follower tell. Such
//!   a file is a sample of the traffic: others beside are not known, and nobody changes lanes ([`Scene::is_a_sample`]).
//! - **The end.** Who passes the end of the recorded section drives on at the speed that he has there, so that those behind
//!   follow somebody; beyond it nothing is scored.
//! - **The entry.** Who comes later is put in where and as he was recorded first, as soon as his place is free.
mod build;
mod learned;
mod matched;
mod sumo;
mod systems;
mod trace;
mod world;

pub use self::{
    learned::Learned,
    sumo::{Imported, export_sumo, import_sumo},
    systems::{ClosedLoop, ConstantVelocity, DrivenBy, Drivers, RuleDrivers},
    trace::{Path, Trace},
};
use crate::error::SimulationError;
use gnp_data::{Dataset, LaneMarking, Recording, VehicleClass, VelocitySource};
use gnp_force::{Line, Road, Side, State};

/// How a recording is cut into replays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplaySettings {
    /// Observed time before the start, in s.
    pub past_s: f64,
    /// Longest time driven, in s; less where the recording ends before.
    pub duration_s: f64,
    /// Time from one start to the next, in s.
    pub every_s: f64,
}

impl Default for ReplaySettings {
    /// 3 s observed, 30 s driven, a start every 30 s.
    fn default() -> Self {
        Self { past_s: 3.0, duration_s: 30.0, every_s: 30.0 }
    }
}

/// A scene and what happened in it.
#[derive(Clone, Debug)]
pub struct Replay {
    scene: Scene,
    truth: Trace,
}

/// All that a system is given: nothing in it comes from a row after the start but the boundary and the first states of those
/// who come later.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Scene {
    /// Unique among the scenes of a data set: recording, carriageway and start in s.
    pub name: String,
    /// The data family.
    pub dataset: Dataset,
    /// The site of the recording.
    pub site: String,
    /// Whether the recording was made by a simulator.
    pub simulated: bool,
    /// Where the velocities of the recording come from.
    pub velocities: VelocitySource,
    /// Frames a second.
    pub rate_hz: f64,
    /// Frames to be driven after the start.
    pub frames: usize,
    /// Lane lines from right to left.
    pub lines: Vec<LaneMarking>,
    /// Where the recorded section begins and ends, in m.
    pub section: [f64; 2],
    /// Everybody there is, by the order in which they come.
    pub actors: Vec<Actor>,
    /// Whether most vehicles of the traffic have no rows, so that nobody knows what is beside.
    pub is_a_sample: bool,
}

/// A vehicle of a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Actor {
    /// Its number in the file.
    pub vehicle: u32,
    /// Length and width, in m.
    pub size: [f32; 2],
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Frames after the start at which it comes; 0 for those present.
    pub enters: usize,
    /// Its state then: centre in m, velocity in m/s.
    pub start: State<f64>,
    /// States in the frames before and at the start, without a gap; the last is that of the start. Of those who come later,
    /// their first state alone.
    pub past: Vec<State<f64>>,
    /// Whether the file has rows of it; not so for leaders that others' rows name.
    pub has_rows: bool,
    /// Its motion from `enters` on, a state a frame, for one that is moved as recorded; gone after the last.
    pub motion: Option<Vec<State<f64>>>,
}

impl Actor {
    /// Whether a system drives it.
    #[must_use]
    pub fn is_driven(&self) -> bool {
        self.motion.is_none()
    }

    /// Whether its trajectory is scored: driven, and there from the start.
    #[must_use]
    pub fn is_scored(&self) -> bool {
        self.is_driven() && self.enters == 0
    }
}

impl Scene {
    /// Time of a frame, in s.
    #[must_use]
    pub fn dt(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// The road with its lanes; its lines do not push.
    ///
    /// # Errors
    /// When lines coincide.
    pub fn road(&self) -> Result<Road<f64>, SimulationError> {
        let line = |line: &LaneMarking| Line { kind: line.kind, y: f64::from(line.y), road: Side::Left, k: 0.0 };
        Ok(Road::new(self.lines.iter().map(line).collect())?)
    }

    /// The lane at `y` m, 0 the rightmost; the outermost beside the road.
    #[must_use]
    pub fn lane_at(&self, y: f64) -> usize {
        let inner = self.lines.get(1..self.lines.len().saturating_sub(1)).unwrap_or_default();
        inner.iter().filter(|line| f64::from(line.y) <= y).count()
    }

    /// The middle of a lane in m, and half its width; of the leftmost for a number beyond.
    #[must_use]
    pub fn lane(&self, lane: usize) -> [f64; 2] {
        let lane = lane.min(self.lines.len().saturating_sub(2));
        let [right, left] = [lane, lane + 1].map(|line| self.lines.get(line).map_or(0.0, |line| f64::from(line.y)));
        [(right + left) / 2.0, (left - right) / 2.0]
    }

    /// Where a driver who keeps his lane aims, in m: his own place in it, with the vehicle between the lines. One who is
    /// changing lanes at the start goes on to the lane that he reaches within a second.
    #[must_use]
    pub fn aim(&self, actor: &Actor) -> f64 {
        let ahead = actor.start.position.y + actor.start.velocity.y;
        let [middle, half] = self.lane(self.lane_at(ahead));
        let room = (half - f64::from(actor.size[1]) / 2.0).max(0.0);
        actor.start.position.y.clamp(middle - room, middle + room)
    }
}

impl Replay {
    /// The replay of carriageway `road` of a recording from frame `start` on.
    ///
    /// # Errors
    /// [`SimulationError::Replay`] when there is no such carriageway, it has no lanes, nothing is recorded after the start,
    /// or nobody is there to be driven.
    pub fn of(
        recording: &Recording,
        road: usize,
        start: u32,
        settings: &ReplaySettings,
    ) -> Result<Self, SimulationError> {
        build::replay(recording, road, start, settings)
    }

    /// Replays of all carriageways of a recording, a start every so often, each with its past; those in which nobody is to
    /// be driven are left out.
    ///
    /// # Errors
    /// [`SimulationError::Replay`] when a carriageway has no lanes.
    pub fn all(recording: &Recording, settings: &ReplaySettings) -> Result<Vec<Self>, SimulationError> {
        build::all(recording, settings)
    }

    /// What systems are given.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What happened, as far as it is recorded.
    #[must_use]
    pub fn truth(&self) -> &Trace {
        &self.truth
    }
}
