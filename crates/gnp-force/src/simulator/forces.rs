//! What acts on a vehicle of the scene.
use super::{Simulator, VehicleId};
use crate::{
    boxes::Extent,
    error::ForceError,
    field::Forces,
    rule::{Ego, Other, PairRule, Place},
    state::State,
};
use nalgebra::{RealField, Vector2};

/// What pushes a vehicle, or what it ran into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Obstacle {
    /// Another vehicle.
    Vehicle(VehicleId),
    /// The place where a lane is closed, by its number in [`Road::closures`](crate::Road::closures).
    Closure(usize),
}

/// Forces on one vehicle with the names of those who push.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceBreakdown<T: RealField> {
    /// The forces, in m/s²; lines in the order of [`Road::lines`](crate::Road::lines). Of the goal, and of the speed that
    /// is wished for, what the limits of the vehicle leave.
    pub forces: Forces<T>,
    /// Who pushes, in the order of `forces.neighbours`.
    pub pushed_by: Vec<Obstacle>,
    /// What the driver's unsteadiness adds, in m/s².
    pub noise: Vector2<T>,
    /// What the limits of the vehicle take away from the sum, in m/s²; mostly 0.
    pub limits: Vector2<T>,
}

impl<T: RealField + Copy> ForceBreakdown<T> {
    /// Sum of everything: the acceleration of a vehicle with a wish; 0 for one that is moved.
    #[must_use]
    pub fn total(&self) -> Vector2<T> {
        self.forces.total() + self.noise + self.limits
    }
}

/// Index of what a vehicle sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sight {
    Vehicle(usize),
    Closure(usize),
}

/// What adds up to an acceleration, in m/s².
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums<T: RealField> {
    /// Of all neighbours, before it is shortened.
    pub(super) pushes: Vector2<T>,
    /// Of everything, before it is held within the limits.
    pub(super) total: Vector2<T>,
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// The forces on a vehicle now, apart by source and with names: what the next step starts from, unless its driver
    /// decides to change lanes.
    ///
    /// The neighbours' pushes are those that act, that is, shortened together where they exceed what the vehicle can do.
    /// A vehicle that is moved rather than pushed ([`Drive::has_a_wish`](crate::Drive::has_a_wish)) feels none.
    ///
    /// # Errors
    /// When there is none of that number.
    pub fn explain(&self, id: VehicleId) -> Result<ForceBreakdown<T>, ForceError> {
        let index = self.index(id)?;
        let vehicle = &self.vehicles[index];
        let me = vehicle.ego(&vehicle.state, self.time(), &self.params);
        let zero = Vector2::zeros();
        let Some(goal) = vehicle.drive.pull(&me, &vehicle.rule, self.time(), &self.params) else {
            let forces = Forces { goal: zero, neighbours: Vec::new(), lines: Vec::new() };
            return Ok(ForceBreakdown { forces, pushed_by: Vec::new(), noise: zero, limits: zero });
        };
        let (mut pushed_by, mut neighbours) = (Vec::new(), Vec::new());
        self.for_each_seen(index, &self.states(), |sight, other| {
            pushed_by.push(self.name(sight));
            neighbours.push(vehicle.rule.push(&me, &other));
        });
        let share = share(&me, neighbours.iter().fold(zero, |sum, push| sum + push));
        neighbours.iter_mut().for_each(|push| *push *= share);
        let lines = self.road.lines().iter().map(|line| line.push(&vehicle.state)).collect();
        let noise = Vector2::new(self.next_noise(index), T::zero());
        let forces = Forces { goal, neighbours, lines };
        let sum = forces.total() + noise;
        Ok(ForceBreakdown { forces, pushed_by, noise, limits: me.limits.hold(sum, me.state.velocity) - sum })
    }

    /// A speed in m/s that no vehicle exceeds, under either Euler step, whatever the scene.
    ///
    /// With `dt <= tau` the new velocity is at most `wish + tau (pull + push)`. The wish is at most `max_speed` (across the
    /// road, for a cruising vehicle, `lateral_speed`), the pull at most what the vehicle can do, the push that of all lines,
    /// of the noise, and `braking + acceleration` for the neighbours; neither part of a velocity outgrows that or the
    /// fastest start.
    #[must_use]
    pub fn speed_bound(&self) -> T {
        let pushed = self.slowest_tau * (self.most_push + self.road.strongest_push());
        let along = self.fastest.max(self.params.max_speed + pushed);
        let across = self.fastest.max(self.params.steering.lateral_speed.max(self.params.max_speed) + pushed);
        (along * along + across * across).sqrt()
    }

    /// Acceleration of a vehicle among `states`, in m/s².
    #[inline]
    pub(super) fn acceleration(&self, index: usize, states: &[State<T>], time: T) -> Vector2<T> {
        self.sums(index, states, time).1
    }

    /// What adds up to the acceleration of a vehicle among `states`, and the acceleration, in m/s².
    #[inline]
    pub(super) fn sums(&self, index: usize, states: &[State<T>], time: T) -> (Sums<T>, Vector2<T>) {
        let vehicle = &self.vehicles[index];
        let me = vehicle.ego(&states[index], time, &self.params);
        let mut pushes = Vector2::zeros();
        let Some(goal) = vehicle.drive.pull(&me, &vehicle.rule, time, &self.params) else {
            return (Sums { pushes, total: pushes }, self.given(index, &states[index]));
        };
        self.for_each_seen(index, states, |_, other| pushes += vehicle.rule.push(&me, &other));
        let lines = self.road.lines().iter().fold(Vector2::zeros(), |sum, line| sum + line.push(&me.state));
        let noise = Vector2::new(self.statuses[index].noise, T::zero());
        let total = goal + pushes * share(&me, pushes) + lines + noise;
        (Sums { pushes, total }, me.limits.hold(total, me.state.velocity))
    }

    /// Acceleration of a vehicle that is moved, in m/s².
    fn given(&self, index: usize, state: &State<T>) -> Vector2<T> {
        let limits = &self.vehicles[index].limits;
        let crate::Drive::Accelerate(along) = self.vehicles[index].drive else { return Vector2::zeros() };
        let (v, dt) = (state.velocity, self.params.dt);
        let most = (self.params.max_speed - v.x).max(T::zero()) / dt;
        // Who rolls backwards comes to rest first; a motion across the road ends.
        let along = if v.x < T::zero() { (-v.x / dt).min(limits.braking) } else { limits.along(along).min(most) };
        Vector2::new(along, (-v.y / dt).max(-limits.lateral).min(limits.lateral))
    }

    /// What is called so outside.
    pub(super) fn name(&self, sight: Sight) -> Obstacle {
        match sight {
            Sight::Vehicle(index) => Obstacle::Vehicle(self.ids[index]),
            Sight::Closure(number) => Obstacle::Closure(number),
        }
    }

    /// Calls `visit` for everything that a vehicle's rule asks about, in an order that depends on places alone.
    #[inline]
    pub(super) fn for_each_seen(&self, index: usize, states: &[State<T>], mut visit: impl FnMut(Sight, Other<T>)) {
        let (me, reach) = (&states[index], self.vehicles[index].rule.reach());
        let (own, aim) = (self.order.lane(index), self.order.aim(index));
        let circumference = self.road.circumference();
        for beside in [0_i8, 1, -1] {
            let Some(lane) = own.checked_add_signed(isize::from(beside)) else { continue };
            if lane >= self.road.lanes() {
                continue;
            }
            let counts =
                if beside == 0 { [reach.ahead, reach.behind] } else { [reach.beside_ahead, reach.beside_behind] };
            let behind = self.order.behind_in(index, lane, &self.vehicles);
            let mut see = |(other, lap): (usize, i8), ahead: bool, rank: usize| {
                let mut state = states[other];
                if let Some(circumference) = circumference {
                    state.position.x += circumference * crate::scalar::lit(f64::from(lap));
                }
                let lengths = self.vehicles[index].extent.length + self.vehicles[other].extent.length;
                let gap = (state.position.x - me.position.x).abs() - lengths * crate::scalar::lit(0.5);
                if gap > self.params.range {
                    return false;
                }
                let merging = beside != 0 && (self.order.aim(other) == own || aim == lane);
                let place = Place { ahead, lane: beside, rank, merging };
                visit(Sight::Vehicle(other), Other { state, extent: self.vehicles[other].extent, place });
                true
            };
            let (is_own, ring) = (usize::from(beside == 0), circumference.is_some());
            for (rank, seen) in self.order.ahead(lane, behind, is_own, ring).take(counts[0]).enumerate() {
                if !see(seen, true, rank) {
                    break;
                }
            }
            for (rank, seen) in self.order.behind(lane, behind, is_own, ring).take(counts[1]).enumerate() {
                if !see(seen, false, rank) {
                    break;
                }
            }
        }
        for lane in [Some(own), (aim != own).then_some(aim)].into_iter().flatten() {
            if reach.beside_ahead > 0
                && let Some((who, other)) = self.further_comer(index, lane, reach.beside_ahead, states)
            {
                visit(Sight::Vehicle(who), other);
            }
            if let Some((number, other)) = self.closure_ahead(index, lane, me)
                && !self.somebody_before(index, lane, me, other.state.position.x)
            {
                visit(Sight::Closure(number), other);
            }
        }
    }

    /// Who is next ahead of those that change into a lane, if not among the nearest `seen` of a lane beside.
    fn further_comer(&self, index: usize, lane: usize, seen: usize, states: &[State<T>]) -> Option<(usize, Other<T>)> {
        let (own, ring) = (self.order.lane(index), self.road.circumference());
        let mut coming = self.order.coming(index, lane, true, ring.is_some(), &self.vehicles);
        let (who, lap) = coming.find(|(who, _)| self.order.lane(*who) != own)?;
        let rank = self.order.nearer((who, lap), index, &self.vehicles);
        let aside = self.order.lane(who) as isize - own as isize;
        if aside.abs() == 1 && rank < seen {
            return None;
        }
        let mut state = states[who];
        state.position.x += ring.map_or_else(T::zero, |ring| ring * crate::scalar::lit(f64::from(lap)));
        if state.position.x - states[index].position.x > self.params.range {
            return None;
        }
        let place = Place { ahead: true, lane: aside.clamp(-127, 127) as i8, rank, merging: true };
        Some((who, Other { state, extent: self.vehicles[who].extent, place }))
    }

    /// The next closure of a lane, as something that stands across it, if it is within sight.
    pub(super) fn closure_ahead(&self, index: usize, lane: usize, me: &State<T>) -> Option<(usize, Other<T>)> {
        if self.road.closures().is_empty() {
            return None;
        }
        let half = self.vehicles[index].extent.length * crate::scalar::lit(0.5);
        let closures = self.road.closures().iter().enumerate().filter(|(_, closure)| closure.lane == lane);
        // A vehicle that has run into the closure with its front still sees it; its centre has not passed.
        let ways = closures.map(|(number, closure)| (number, self.road.distance(me.position.x, closure.from)));
        let (number, way) = ways
            .filter(|(_, way)| *way > T::zero() && *way - half <= self.params.range)
            .min_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(std::cmp::Ordering::Equal))?;
        let state = State::new(me.position.x + way, me.position.y, T::zero(), T::zero());
        Some((number, Other { state, extent: Extent { length: T::zero(), width: T::one() }, place: Place::LEADER }))
    }

    /// Whether a vehicle that stays in that lane is ahead and nearer than `x`, so that following it is enough.
    fn somebody_before(&self, index: usize, lane: usize, me: &State<T>, x: T) -> bool {
        let behind = self.order.behind_in(index, lane, &self.vehicles);
        let is_own = usize::from(lane == self.order.lane(index));
        let ring = self.road.circumference().is_some();
        self.order.ahead(lane, behind, is_own, ring).next().is_some_and(|(other, _)| {
            let way = self.road.distance(me.position.x, self.vehicles[other].state.position.x);
            self.order.aim(other) == lane && me.position.x + way < x
        })
    }
}

/// The factor that shortens a sum of pushes to what the vehicle could brake and accelerate together.
#[inline]
pub(super) fn share<T: RealField + Copy>(me: &Ego<T>, sum: Vector2<T>) -> T {
    let (length, most) = (sum.norm(), me.limits.braking + me.limits.acceleration);
    if length > most { most / length } else { T::one() }
}
