//! A scene driven by the simulator.
use super::{Actor, Path, Scene, Trace};
use crate::error::SimulationError;
use gnp_data::VehicleClass;
use gnp_force::{Drive, Extent, Limits, Simulator, SimulatorParams, State, Vehicle, VehicleId};

/// How far beyond the end of the section those who left it are seen by those behind, in m.
const BEYOND_M: f64 = 300.0;
/// Room before and behind a vehicle that enters, in m.
const ENTRY_ROOM_M: f64 = 0.5;

/// What decides in a scene.
pub(super) trait Decides {
    /// A driver for an actor that comes in.
    fn vehicle(&mut self, scene: &Scene, index: usize, base: Vehicle<f64>) -> Vehicle<f64>;

    /// Says where actors are to be at the next frame, for those that are moved; the others drive.
    fn plan(&mut self, _world: &World<'_>, _moves: &mut Vec<(usize, State<f64>)>) -> Result<(), SimulationError> {
        Ok(())
    }

    /// Frames in which another one had to drive.
    fn stood_in(&self) -> usize {
        0
    }
}

/// A scene in a simulator, and where everybody was so far.
#[derive(Debug)]
pub(super) struct World<'a> {
    pub(super) scene: &'a Scene,
    /// Frame now, counted from the start.
    pub(super) frame: usize,
    simulator: Simulator<f64>,
    ids: Vec<Option<VehicleId>>,
    paths: Vec<Path>,
    waited: Vec<usize>,
}

/// Drives a scene to its end.
pub(super) fn drive(scene: &Scene, seed: u64, decides: &mut impl Decides) -> Result<Trace, SimulationError> {
    let params = SimulatorParams { seed, ..SimulatorParams::motorway(scene.dt()) };
    let simulator = Simulator::new(params, scene.road()?)?;
    let count = scene.actors.len();
    let paths = vec![Path::default(); count];
    let mut world = World { scene, frame: 0, simulator, ids: vec![None; count], paths, waited: vec![0; count] };
    world.enter(decides)?;
    world.take_down();
    let mut moves = Vec::new();
    while world.frame < scene.frames {
        moves.clear();
        decides.plan(&world, &mut moves)?;
        world.step(&moves)?;
        world.enter(decides)?;
        world.take_down();
    }
    Ok(world.finish(decides.stood_in()))
}

impl World<'_> {
    /// The states of an actor so far, from when it came in.
    pub(super) fn path(&self, index: usize) -> &Path {
        &self.paths[index]
    }

    /// Whether an actor is there now.
    pub(super) fn is_there(&self, index: usize) -> bool {
        self.ids[index].is_some()
    }

    /// The state of an actor now.
    pub(super) fn now(&self, index: usize) -> Option<&State<f64>> {
        self.ids[index].and_then(|id| self.simulator.vehicle(id)).map(|vehicle| &vehicle.state)
    }

    fn step(&mut self, moves: &[(usize, State<f64>)]) -> Result<(), SimulationError> {
        for (index, _) in moves {
            let Some(id) = self.ids[*index] else { continue };
            if self.simulator.vehicle(id).is_some_and(|vehicle| vehicle.drive != Drive::Steady) {
                self.simulator.set_drive(id, Drive::Steady)?;
            }
        }
        self.simulator.step();
        self.frame += 1;
        for (index, state) in moves {
            if let Some(id) = self.ids[*index] {
                self.simulator.set_state(id, *state)?;
            }
        }
        let end = self.scene.section[1];
        for (index, actor) in self.scene.actors.iter().enumerate() {
            let Some(id) = self.ids[index] else { continue };
            let state = match &actor.motion {
                Some(motion) => match motion.get(self.frame - actor.enters) {
                    Some(state) => {
                        self.simulator.set_state(id, *state)?;
                        *state
                    }
                    None => {
                        self.remove(index)?;
                        continue;
                    }
                },
                None => match self.simulator.vehicle(id) {
                    Some(vehicle) => vehicle.state,
                    None => continue,
                },
            };
            if state.position.x > end + BEYOND_M {
                self.remove(index)?;
            } else if actor.is_driven() && state.position.x > end {
                let along = State::new(state.position.x, state.position.y, state.velocity.x.max(0.0), 0.0);
                self.simulator.set_drive(id, Drive::Steady)?;
                self.simulator.set_state(id, along)?;
            }
        }
        Ok(())
    }

    fn remove(&mut self, index: usize) -> Result<(), SimulationError> {
        if let Some(id) = self.ids[index].take() {
            self.simulator.remove(id)?;
        }
        Ok(())
    }

    /// Lets in who is due: those present and those who are moved at once, the others when their place is free.
    fn enter(&mut self, decides: &mut impl Decides) -> Result<(), SimulationError> {
        for (index, actor) in self.scene.actors.iter().enumerate() {
            let due = actor.enters <= self.frame && self.ids[index].is_none() && self.paths[index].states.is_empty();
            if !due || (!actor.is_driven() && actor.enters != self.frame) {
                continue;
            }
            if actor.is_driven() && self.frame > 0 && !self.is_free(actor) {
                self.waited[index] += 1;
                continue;
            }
            let base = Vehicle {
                extent: Extent { length: f64::from(actor.size[0]), width: f64::from(actor.size[1]) },
                limits: if actor.class == VehicleClass::Truck { Limits::truck() } else { Limits::car() },
                ..Vehicle::car(actor.start, Drive::Steady)
            };
            let vehicle = if actor.is_driven() { decides.vehicle(self.scene, index, base) } else { base };
            self.ids[index] = Some(self.simulator.place(vehicle)?);
            self.paths[index].first = self.frame;
        }
        Ok(())
    }

    /// Whether the place of an actor that comes in is free.
    fn is_free(&self, actor: &Actor) -> bool {
        self.simulator.vehicles().all(|(_, other)| {
            let apart = other.state.position - actor.start.position;
            let along = (other.extent.length + f64::from(actor.size[0])) / 2.0 + ENTRY_ROOM_M;
            let across = (other.extent.width + f64::from(actor.size[1])) / 2.0;
            apart.x.abs() >= along || apart.y.abs() >= across
        })
    }

    fn take_down(&mut self) {
        for (index, path) in self.paths.iter_mut().enumerate() {
            if let Some(vehicle) = self.ids[index].and_then(|id| self.simulator.vehicle(id)) {
                path.states.push(vehicle.state);
            }
        }
    }

    fn finish(self, stood_in: usize) -> Trace {
        let came = |index: usize| !self.paths[index].states.is_empty();
        let waited = self.waited.iter().enumerate().filter(|(_, frames)| **frames > 0);
        let (late, never): (Vec<_>, Vec<_>) = waited.partition(|(index, _)| came(*index));
        Trace {
            waited_s: self.waited.iter().sum::<usize>() as f64 * self.scene.dt(),
            late: late.len(),
            never: never.len(),
            stood_in,
            paths: self.paths,
        }
    }
}
