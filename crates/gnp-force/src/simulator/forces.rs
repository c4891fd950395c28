//! What acts on a vehicle of the scene.
use super::{LaneOrder, NeighbourSearch, Simulator, VehicleId, repulsion::Body};
use crate::{error::ForceError, field::Forces, goal::goal_force, state::State};
use nalgebra::{RealField, Vector2};

/// Forces on one vehicle with the names of those who push.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceBreakdown<T: RealField> {
    /// The forces, in m/s²; lines in the order of [`Road::lines`](crate::Road::lines).
    pub forces: Forces<T>,
    /// The neighbours, in the order of `forces.neighbours`.
    pub pushed_by: Vec<VehicleId>,
}

impl<T: RealField + Copy> Simulator<T> {
    /// The forces on a vehicle now, apart by source and with names: what the next step starts from.
    ///
    /// The neighbours' pushes are those that act, that is, shortened together where
    /// [`grip`](crate::SimulatorParams::grip) limits them. A [`Drive::Steady`](crate::Drive::Steady) vehicle feels none.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn explain(&self, id: VehicleId) -> Result<ForceBreakdown<T>, ForceError> {
        let index = self.index(id)?;
        let me = &self.vehicles[index];
        let Some(goal) = self.pull(index, &me.state, self.time()) else {
            let none = Forces { goal: Vector2::zeros(), neighbours: Vec::new(), lines: Vec::new() };
            return Ok(ForceBreakdown { forces: none, pushed_by: Vec::new() });
        };
        let mut pushed_by = Vec::new();
        let mut neighbours = Vec::new();
        self.for_each_neighbour(&self.current_order(), index, |other| {
            pushed_by.push(self.ids[other]);
            neighbours.push(self.params.repulsion.push(me.body(), self.vehicles[other].body(), &self.params));
        });
        let sum = neighbours.iter().fold(Vector2::zeros(), |sum, push| sum + push);
        let share = self.share(sum);
        neighbours.iter_mut().for_each(|push| *push *= share);
        let lines = self.road.lines().iter().map(|line| line.push(&me.state)).collect();
        Ok(ForceBreakdown { forces: Forces { goal, neighbours, lines }, pushed_by })
    }

    /// A speed in m/s that no vehicle exceeds, under either Euler step, whatever the scene.
    ///
    /// With `dt <= tau` the new velocity is an average of the old one and of `wish + tau push`. The wish is at most
    /// `max_speed` (across the road, for a cruising vehicle, `lateral_speed`), the push at most that of all lines and
    /// `grip` for the neighbours, so neither part of a velocity outgrows
    /// `max(fastest start, wish + tau (grip + lines))`.
    #[must_use]
    pub fn speed_bound(&self) -> T {
        let pushed = self.slowest_tau * (self.params.grip + self.road.strongest_push());
        let along = self.fastest.max(self.params.max_speed + pushed);
        let across = self.fastest.max(self.params.cruise.lateral_speed + pushed);
        (along * along + across * across).sqrt()
    }

    /// Acceleration of a vehicle among `states`, in m/s².
    pub(super) fn acceleration(&self, index: usize, states: &[State<T>], time: T) -> Vector2<T> {
        let state = &states[index];
        let Some(goal) = self.pull(index, state, time) else { return Vector2::zeros() };
        let me = Body { state: *state, extent: self.vehicles[index].extent };
        let mut sum = Vector2::zeros();
        self.for_each_neighbour(&self.order, index, |other| {
            let other = Body { state: states[other], extent: self.vehicles[other].extent };
            sum += self.params.repulsion.push(me, other, &self.params);
        });
        let lines = self.road.lines().iter().fold(Vector2::zeros(), |sum, line| sum + line.push(state));
        goal + sum * self.share(sum) + lines
    }

    /// Pull of the vehicle's goal, or none if it is steady.
    fn pull(&self, index: usize, state: &State<T>, time: T) -> Option<Vector2<T>> {
        let vehicle = &self.vehicles[index];
        let pull = vehicle.drive.attraction(state, vehicle.tau, time, &self.params)?;
        Some(goal_force(state.position, state.velocity, pull.goal, pull.time_left, pull.tau))
    }

    /// The factor that shortens a sum of pushes to `grip`.
    fn share(&self, sum: Vector2<T>) -> T {
        let length = sum.norm();
        if length > self.params.grip { self.params.grip / length } else { T::one() }
    }

    /// Calls `visit` for every vehicle that pushes, in an order that depends on their places alone.
    fn for_each_neighbour(&self, order: &LaneOrder, index: usize, mut visit: impl FnMut(usize)) {
        let x = self.vehicles[index].state.position.x;
        let NeighbourSearch { per_lane, range } = self.params.search;
        let near = |other: &usize| (self.vehicles[*other].state.position.x - x).abs() <= range;
        for beside in [0, 1, -1] {
            order.ahead(index, beside).take(per_lane).take_while(near).for_each(&mut visit);
            order.behind(index, beside).take(per_lane).take_while(near).for_each(&mut visit);
        }
    }
}
