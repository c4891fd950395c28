//! One step, and what happened in it.
use super::{AfterGoal, Drive, Obstacle, Simulator, Vehicle, VehicleId, noise::normal};
use crate::{rule::PairRule, scalar::lit, state::State};
use nalgebra::{RealField, Vector2};

/// What happened in a step.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<T: RealField, R> {
    /// A vehicle's time was up and it left the scene; see [`Drive::Goal`].
    Arrived {
        /// Its number.
        id: VehicleId,
        /// How it arrived.
        vehicle: Box<Vehicle<T, R>>,
    },
    /// A vehicle passed the end of the road and left the scene; see [`Road::ending_at`](crate::Road::ending_at).
    Left {
        /// Its number.
        id: VehicleId,
        /// How it left.
        vehicle: Box<Vehicle<T, R>>,
    },
    /// The boxes of two vehicles began to overlap, or the front of one is beyond the place where its lane is closed.
    Contact {
        /// The vehicle; of two, that of the lower number.
        id: VehicleId,
        /// What it touches.
        with: Obstacle,
    },
    /// The centre of a vehicle crossed a line.
    LaneChange {
        /// Its number.
        id: VehicleId,
        /// The lane that it was in.
        from: usize,
        /// The lane that it is in now.
        to: usize,
    },
}

/// Vehicles from which a step is shared among threads.
#[cfg(feature = "parallel")]
const WORTH_SHARING: usize = 1024;

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// Moves all vehicles by one step and returns what happened in it, in the order of kinds as in [`Event`] and then of
    /// vehicles. Those that arrived or left are no longer in the scene.
    ///
    /// The events are borrowed from the scene: to act on it in the loop, take them first, `scene.step().to_vec()`.
    pub fn step(&mut self) -> &[Event<T, R>] {
        self.decide_lanes();
        self.order.refresh(&self.vehicles);
        self.draw_noise();
        let mut states = std::mem::take(&mut self.states);
        let mut workspace = std::mem::take(&mut self.workspace);
        states.clear();
        states.extend(self.vehicles.iter().map(|vehicle| vehicle.state));
        let time = self.time();
        self.params.integrator.step_all(&mut states, self.params.dt, &mut workspace, |states, elapsed, out| {
            self.accelerations(states, time + elapsed, out);
        });
        self.steps += 1;
        self.events.clear();
        let (time, dt) = (self.time(), self.params.dt);
        for ((vehicle, status), state) in self.vehicles.iter_mut().zip(&mut self.statuses).zip(&states) {
            vehicle.advance(*state, time, dt);
            vehicle.state.position.x = self.road.wrapped(vehicle.state.position.x);
            status.before = std::mem::replace(&mut status.after, vehicle.state.position.x);
            status.given_drive = false;
        }
        self.states = states;
        self.workspace = workspace;
        let lanes: Vec<(VehicleId, usize)> =
            self.ids.iter().enumerate().map(|(index, id)| (*id, self.order.lane(index))).collect();
        self.settle_goals();
        self.take_leavers();
        self.order.after_step(&self.vehicles, &self.road);
        self.find_contacts();
        let mut lanes = lanes.into_iter();
        for (index, id) in self.ids.iter().enumerate() {
            let to = self.order.lane(index);
            // Both are in the order of numbers; those that left are skipped.
            if let Some((id, from)) = lanes.by_ref().find(|(before, _)| before == id)
                && from != to
            {
                self.events.push(Event::LaneChange { id, from, to });
            }
        }
        &self.events
    }

    /// The acceleration of every vehicle among `states`.
    fn accelerations(&self, states: &[State<T>], time: T, out: &mut [Vector2<T>]) {
        #[cfg(feature = "parallel")]
        if out.len() >= WORTH_SHARING && rayon::current_num_threads() > 1 {
            use rayon::prelude::*;
            let share = out.par_iter_mut().enumerate().with_min_len(WORTH_SHARING / 4);
            share.for_each(|(vehicle, acceleration)| *acceleration = self.acceleration(vehicle, states, time));
            return;
        }
        for (vehicle, acceleration) in out.iter_mut().enumerate() {
            *acceleration = self.acceleration(vehicle, states, time);
        }
    }

    /// The unsteadiness of every driver for this step.
    pub(super) fn draw_noise(&mut self) {
        for index in 0..self.vehicles.len() {
            self.statuses[index].noise = self.next_noise(index);
        }
    }

    /// The unsteadiness of a driver in the next step, in m/s².
    pub(super) fn next_noise(&self, index: usize) -> T {
        let last = self.statuses[index].noise;
        let Some(noise) = &self.vehicles[index].noise else { return last };
        noise.after(last, self.params.dt, normal(self.params.seed, self.ids[index].0, self.steps))
    }

    /// Those whose goal is due leave, or drive on.
    fn settle_goals(&mut self) {
        let latest = self.time() + self.params.dt * lit(0.5);
        let mut leaves = false;
        for vehicle in &mut self.vehicles {
            let Drive::Goal { goal, due, then } = vehicle.drive else { continue };
            if due > latest {
                continue;
            }
            match then {
                AfterGoal::Leave => leaves = true,
                AfterGoal::Cruise => {
                    let speed = vehicle.state.velocity.x.max(T::zero()).min(self.params.max_speed);
                    vehicle.drive = Drive::Cruise { speed, y: goal.y };
                }
            }
        }
        if leaves {
            let arrived = |vehicle: &Vehicle<T, R>| matches!(vehicle.drive, Drive::Goal { due, .. } if due <= latest);
            self.let_go(arrived, |id, vehicle| Event::Arrived { id, vehicle });
        }
    }

    /// Those whose centre is beyond the end of the road leave.
    fn take_leavers(&mut self) {
        let Some(end) = self.road.end() else { return };
        let left = |vehicle: &Vehicle<T, R>| vehicle.state.position.x > end;
        if self.vehicles.iter().any(left) {
            self.let_go(left, |id, vehicle| Event::Left { id, vehicle });
        }
    }

    fn let_go(
        &mut self,
        goes: impl Fn(&Vehicle<T, R>) -> bool,
        event: impl Fn(VehicleId, Box<Vehicle<T, R>>) -> Event<T, R>,
    ) {
        let gone = self.ids.iter().zip(&self.vehicles).filter(|(_, vehicle)| goes(vehicle));
        self.events.extend(gone.map(|(id, vehicle)| event(*id, Box::new(vehicle.clone()))));
        self.retain(|_, vehicle| !goes(vehicle));
    }
}
