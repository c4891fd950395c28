//! From a scene to what happened.
mod drivers;

use self::drivers::Cast;
use crate::{
    error::SimulationError,
    recorder::Recorder,
    scene::{InflowSpec, Scene},
};
use gnp_data::Recording;
use gnp_force::{Drive, Event, Inflow, Obstacle, Road, Simulator, SimulatorParams, State, VehicleId};
use serde::Serialize;
use std::{collections::BTreeMap, ops::ControlFlow};

/// Least gap between vehicles at the start, m.
const LEAST_GAP_M: f64 = 0.5;
/// Time between looks at the speed limits, s.
const LOOK_S: f64 = 0.5;

/// What a simulation was.
#[derive(Debug)]
#[non_exhaustive]
pub struct Simulated {
    /// From which chance came.
    pub seed: u64,
    /// Every vehicle in every recorded frame; lanes are numbered from the left, vehicles from 1.
    pub recording: Recording,
    /// What happened, in the order of time, the warm-up left out.
    pub happenings: Vec<Happening>,
    /// How many.
    pub counts: Counts,
    /// Frames that were recorded, also those in which nobody was there.
    pub frames: u32,
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Happening {
    /// When, in s of recorded time.
    pub time_s: f64,
    /// What.
    pub kind: Kind,
    /// Number of the vehicle in the recording.
    pub vehicle: u64,
    /// Of a contact the other vehicle; 0 for the end of a lane.
    pub other: Option<u64>,
    /// Of a change of lanes the two lanes, as in the recording.
    pub lanes: Option<[usize; 2]>,
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A vehicle entered.
    Entered,
    /// A vehicle left at the end of the road.
    Left,
    /// Two vehicles began to touch, or one the end of its lane.
    Contact,
    /// A vehicle changed lanes.
    LaneChange,
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Entered => "entered",
            Self::Left => "left",
            Self::Contact => "contact",
            Self::LaneChange => "lane_change",
        })
    }
}

/// How many vehicles, and what they did; from the start on, the warm-up included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// There at the start.
    pub started: u64,
    /// Entered.
    pub entered: u64,
    /// Left at the end of the road.
    pub left: u64,
    /// On the road at the end.
    pub remain: u64,
    /// Wanted to enter and found no room to the end.
    pub waiting: u64,
    /// Contacts of two vehicles that began.
    pub contacts: u64,
    /// Vehicles that ran into the end of their lane.
    pub lane_ends: u64,
    /// Changes of lanes.
    pub lane_changes: u64,
}

impl Scene {
    /// The road of this scene.
    ///
    /// # Errors
    /// When the physics refuses it.
    pub fn build_road(&self) -> Result<Road<f64>, SimulationError> {
        let spec = &self.road;
        let mut road = Road::motorway(spec.lanes, spec.lane_width_m)?;
        road = if spec.ring { road.ring(spec.length_m)? } else { road.ending_at(spec.length_m)? };
        for closure in &spec.closures {
            road = road.closing(closure.lane, closure.from_m, closure.to_m)?;
        }
        Ok(road)
    }

    /// Drives the scene with one seed. `progress` is told the simulated time in s now and then, and may stop the work.
    ///
    /// The same scene and seed give the same recording, on any number of threads.
    ///
    /// # Errors
    /// When the scene is refused, when vehicles at the start would touch, when it is stopped, or when nobody was ever
    /// there.
    pub fn run(
        &self,
        seed: u64,
        progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
    ) -> Result<Simulated, SimulationError> {
        self.check()?;
        let road = self.build_road()?;
        let mut recorder = Recorder::new(&road, &self.name, &format!("{}-{seed}", self.name), self.record_hz);
        let params = SimulatorParams { seed, ..SimulatorParams::motorway(self.step_s) };
        let mut traffic = Traffic::new(self, Simulator::new(params, road)?, seed)?;
        let (steps, warm_up) = (self.steps(self.warm_up_s + self.duration_s), self.steps(self.warm_up_s));
        let every = self.steps(1.0 / self.record_hz).max(1);
        for step in 0..steps {
            let time = step as f64 * self.step_s;
            if step.is_multiple_of(self.steps(10.0).max(1)) && progress(time).is_break() {
                return Err(SimulationError::Stopped { seconds: time });
            }
            traffic.before_step(time, step.is_multiple_of(self.steps(LOOK_S).max(1)))?;
            if step >= warm_up && (step - warm_up).is_multiple_of(every) {
                recorder.take(&traffic.scene)?;
            }
            traffic.step();
        }
        let Traffic { scene, inflows, happenings, mut counts, .. } = traffic;
        counts.remain = scene.vehicles().len() as u64;
        counts.waiting = inflows.iter().map(Inflow::waiting).sum();
        let frames = recorder.frames();
        if counts.started + counts.entered == 0 {
            return Err(SimulationError::Nobody { seconds: self.warm_up_s + self.duration_s });
        }
        let recording = recorder.finish()?;
        if recording.is_empty() {
            return Err(SimulationError::Nobody { seconds: self.duration_s });
        }
        Ok(Simulated { seed, recording, happenings, counts, frames })
    }

    /// Steps in `seconds`.
    fn steps(&self, seconds: f64) -> u64 {
        (seconds / self.step_s).round() as u64
    }
}

/// A scene while it is driven.
struct Traffic<'a> {
    spec: &'a Scene,
    scene: Simulator<f64>,
    cast: Cast<'a>,
    inflows: Vec<Inflow<f64>>,
    /// The next change of the flow.
    flow_at: usize,
    wishes: BTreeMap<VehicleId, f64>,
    happenings: Vec<Happening>,
    counts: Counts,
}

impl<'a> Traffic<'a> {
    fn new(spec: &'a Scene, scene: Simulator<f64>, seed: u64) -> Result<Self, SimulationError> {
        let lanes = spec.road.lanes as u64;
        let headways = spec.inflow.as_ref().map(|inflow| inflow.headways);
        let inflows = headways.map(|headways| {
            let lane = |lane| Inflow::new(0.0, headways, seed.wrapping_mul(lanes).wrapping_add(lane));
            (0..lanes).map(lane).collect::<Result<Vec<_>, _>>()
        });
        let mut traffic = Self {
            spec,
            scene,
            cast: Cast::of(spec, seed)?,
            inflows: inflows.transpose()?.unwrap_or_default(),
            flow_at: 0,
            wishes: BTreeMap::new(),
            happenings: Vec::new(),
            counts: Counts::default(),
        };
        traffic.start()?;
        Ok(traffic)
    }

    /// Puts the vehicles of the start on the road, lane by lane, with equal gaps between bumpers.
    fn start(&mut self) -> Result<(), SimulationError> {
        let Some(start) = self.spec.start else { return Ok(()) };
        let (lanes, length) = (self.spec.road.lanes, self.spec.road.length_m);
        for lane in 0..lanes {
            let Some(y) = self.scene.road().lane_centre(lane) else { continue };
            let state = State::new(0.0, y, start.speed_mps, 0.0);
            let numbers = (lane..start.vehicles).step_by(lanes);
            let vehicles: Vec<_> = numbers.map(|number| self.cast.vehicle(lane, number as u64, state)).collect();
            let taken: f64 = vehicles.iter().map(|vehicle| vehicle.extent.length).sum();
            let gap = (length - taken) / vehicles.len().max(1) as f64;
            if gap < LEAST_GAP_M {
                return Err(SimulationError::Scene {
                    key: "start.vehicles".to_owned(),
                    value: start.vehicles.to_string(),
                    must: format!("fewer: lane {lane} has {length} m, its vehicles are {taken:.0} m long"),
                });
            }
            let mut front = 0.0;
            for (place, mut vehicle) in vehicles.into_iter().enumerate() {
                let half = vehicle.extent.length / 2.0;
                let off = if lane == 0 && place == 0 { start.first_off_m.clamp(-gap / 2.0, gap / 2.0) } else { 0.0 };
                vehicle.state.position.x = front + half + off;
                front += 2.0 * half + gap;
                let drive = vehicle.drive.clone();
                let id = self.scene.add(vehicle)?;
                self.note_wish(&drive, id);
                self.counts.started += 1;
            }
        }
        Ok(())
    }

    fn note_wish(&mut self, drive: &Drive<f64>, id: VehicleId) {
        if let Drive::Cruise { speed, .. } = drive {
            self.wishes.insert(id, *speed);
        }
    }

    /// Who enters and who has to slow down, at `time` s.
    fn before_step(&mut self, time: f64, look: bool) -> Result<(), SimulationError> {
        if let Some(InflowSpec { flow, .. }) = &self.spec.inflow {
            while let Some([_, flow]) = flow.get(self.flow_at).filter(|[from, _]| *from <= time) {
                self.inflows.iter_mut().try_for_each(|inflow| inflow.set_flow(*flow, time))?;
                self.flow_at += 1;
            }
        }
        for lane in 0..self.inflows.len() {
            let Some(y) = self.scene.road().lane_centre(lane) else { continue };
            let cast = &self.cast;
            // Those of the start were numbered before.
            let started = self.spec.start.map_or(0, |start| start.vehicles as u64);
            let make = |number| {
                let mut vehicle = cast.vehicle(lane, started + number, State::new(0.0, y, 0.0, 0.0));
                if let Drive::Cruise { speed, .. } = vehicle.drive {
                    vehicle.state.velocity.x = speed;
                }
                vehicle
            };
            let Some(id) = self.scene.admit(&mut self.inflows[lane], make)? else { continue };
            let drive = self.scene.vehicle(id).map(|vehicle| vehicle.drive.clone());
            if let Some(drive) = drive {
                self.note_wish(&drive, id);
            }
            self.counts.entered += 1;
            self.note(time, Kind::Entered, id, None, None);
        }
        if look && !self.spec.speed_limits.is_empty() {
            let (limits, wishes) = (&self.spec.speed_limits, &self.wishes);
            self.scene.steer(|_, id, vehicle| {
                let (Drive::Cruise { speed, y }, Some(wish)) = (&vehicle.drive, wishes.get(&id)) else { return None };
                let x = vehicle.state.position.x;
                let there = limits.iter().filter(|limit| {
                    (limit.from_m..limit.to_m).contains(&x) && (limit.from_s..limit.to_s).contains(&time)
                });
                let wanted = there.fold(*wish, |wanted, limit| wanted.min(limit.speed_mps));
                (wanted != *speed).then_some(Drive::Cruise { speed: wanted, y: *y })
            })?;
        }
        Ok(())
    }

    fn step(&mut self) {
        let mut events = Vec::new();
        for event in self.scene.step() {
            events.push(match event {
                Event::Left { id, .. } | Event::Arrived { id, .. } => (Kind::Left, *id, None, None),
                Event::Contact { id, with } => {
                    let other = if let Obstacle::Vehicle(other) = with { other.0 + 1 } else { 0 };
                    (Kind::Contact, *id, Some(other), None)
                }
                Event::LaneChange { id, from, to } => (Kind::LaneChange, *id, None, Some([*from, *to])),
            });
        }
        let time = self.scene.time();
        for (kind, id, other, lanes) in events {
            match kind {
                Kind::Left => {
                    self.counts.left += 1;
                    self.wishes.remove(&id);
                }
                Kind::Contact if other == Some(0) => self.counts.lane_ends += 1,
                Kind::Contact => self.counts.contacts += 1,
                Kind::LaneChange => self.counts.lane_changes += 1,
                Kind::Entered => {}
            }
            let from_left = |lane: usize| self.spec.road.lanes - lane;
            self.note(time, kind, id, other, lanes.map(|lanes| lanes.map(from_left)));
        }
    }

    fn note(&mut self, time: f64, kind: Kind, id: VehicleId, other: Option<u64>, lanes: Option<[usize; 2]>) {
        let time_s = time - self.spec.warm_up_s;
        if time_s >= 0.0 {
            self.happenings.push(Happening { time_s, kind, vehicle: id.0 + 1, other, lanes });
        }
    }
}
