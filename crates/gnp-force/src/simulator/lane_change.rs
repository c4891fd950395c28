//! When a driver changes lanes: MOBIL.
use super::Simulator;
use crate::{
    error::{ForceError, require_not_negative, require_positive},
    rule::{Ego, Other, PairRule, Place},
    scalar::lit,
    simulator::drive::Drive,
    state::State,
};
use nalgebra::RealField;

/// Way before the end of a lane in which its drivers become ever more willing to leave it, in m.
const URGENT_M: f64 = 300.0;
/// What the end of a lane at the bumper adds to the incentive to leave it, in m/s².
const URGENT_MPS2: f64 = 2.0;
/// Least gap to the vehicles that one would move between, in m.
const LEAST_ROOM_M: f64 = 1.0;
/// How far from the middle of the lane a change may begin, in m.
const OFF_CENTRE_M: f64 = 0.5;

/// A driver who changes lanes when that brings him more than it costs others: MOBIL (Kesting, Treiber and Helbing, 2007),
/// over whatever rule each driver has.
///
/// A lane is better by `a'(me) - a(me) + politeness (a'(new) - a(new) + a'(old) - a(old)) - threshold`, where `a` and `a'` are
/// the accelerations along the road before and after the change, of the driver, his new and his old follower; to the
/// right `keep_right` is added, to the left it is taken away. It is taken if nobody would have to brake with more than
/// `safe_braking`, and there is room. Whoever finds somebody beside him before he has crossed the line turns back.
///
/// A lane that ends must be left: over its last 300 m the incentive grows by up to 2 m/s², and so does the braking that is
/// thought safe, up to nine tenths of what the follower can do.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Mobil<T> {
    /// Weight of what the followers gain or lose; 0 an egoist, 1 somebody to whom others count as much.
    pub politeness: T,
    /// Least gain for which a change is worth the trouble, in m/s².
    pub threshold: T,
    /// Preference for the right lane, in m/s²; below 0 for the left.
    pub keep_right: T,
    /// Hardest braking that a change may ask of anybody, in m/s².
    pub safe_braking: T,
    /// Least time between two changes, in s.
    pub pause: T,
}

impl<T: RealField + Copy> Mobil<T> {
    /// Politeness 0.2, threshold 0.1 m/s², 0.2 m/s² for the right lane, at most 3 m/s², 3 s between changes.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            politeness: lit(0.2),
            threshold: lit(0.1),
            keep_right: lit(0.2),
            safe_braking: lit(3.0),
            pause: lit(3.0),
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`ForceError::Value`] for the first that is not finite or out of its range.
    pub fn check(&self) -> Result<(), ForceError> {
        require_not_negative("lane_change.politeness", self.politeness)?;
        require_not_negative("lane_change.threshold", self.threshold)?;
        crate::error::require(self.keep_right.is_finite(), "lane_change.keep_right", self.keep_right, "finite")?;
        require_positive("lane_change.safe_braking", self.safe_braking)?;
        require_not_negative("lane_change.pause", self.pause)
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// Lets the drivers whose turn it is decide, one after the other, each seeing what the others decided.
    pub(super) fn decide_lanes(&mut self) {
        let every = self.params.decision_steps();
        for index in 0..self.vehicles.len() {
            let turn = (self.steps + self.ids[index].0).is_multiple_of(every);
            let Some(lane) = turn.then(|| self.better_lane(index)).flatten() else { continue };
            let Some(centre) = self.road.lane_centre(lane) else { continue };
            if let Drive::Cruise { y, .. } = &mut self.vehicles[index].drive {
                *y = centre;
                self.statuses[index].changed = Some(self.steps);
                self.order.aimed(index, &self.vehicles, &self.road);
            }
        }
    }

    /// The lane beside that a driver should move to now, if any.
    fn better_lane(&self, index: usize) -> Option<usize> {
        let vehicle = &self.vehicles[index];
        let mobil = vehicle.lane_change?;
        let Drive::Cruise { y, .. } = vehicle.drive else { return None };
        let lane = self.order.lane(index);
        let under_way = self.order.aim(index) != lane || (y - vehicle.state.position.y).abs() > lit(OFF_CENTRE_M);
        let since = |changed: u64| self.params.dt * lit((self.steps - changed) as f64);
        if self.order.aim(index).abs_diff(lane) == 1 && !self.has_room(index, self.order.aim(index)) {
            return Some(lane);
        }
        if under_way || self.statuses[index].changed.is_some_and(|changed| since(changed) < mobil.pause) {
            return None;
        }
        let beside = [lane.checked_add(1).filter(|left| *left < self.road.lanes()), lane.checked_sub(1)];
        let me = self.ego(index);
        let (leader, follower) = (self.next(index, lane, true), self.next(index, lane, false));
        let own = vehicle.rule.behind(&me, leader.map(|next| self.seen_ahead(&me, next)).as_ref());
        let urgency = self.urgency(index, lane);
        // The old follower, behind this vehicle and behind what it has ahead.
        let released = follower.and_then(|next| {
            let Next { who: Some(who), way } = next else { return None };
            let rule = &self.vehicles[who].rule;
            let ego = self.ego(who);
            let after = leader.map(|ahead| Next { way: ahead.way + way, ..ahead });
            let before = rule.behind(&ego, Some(&self.seen_ahead(&ego, Next { who: Some(index), way })));
            Some(rule.behind(&ego, after.map(|ahead| self.seen_ahead(&ego, ahead)).as_ref()) - before)
        });
        let closed = |lane: &usize| {
            let mut closures = self.road.closures().iter();
            closures.any(|closure| closure.lane == *lane && self.is_beside(vehicle, closure, lit(LEAST_ROOM_M)))
        };
        let mut best = (T::zero(), None);
        for target in beside.into_iter().flatten().filter(|lane| !closed(lane)) {
            let Some(gain) = self.gain(index, &me, target, urgency, &mobil) else { continue };
            let right = if target < lane { mobil.keep_right } else { -mobil.keep_right };
            let others = released.unwrap_or_else(T::zero) * mobil.politeness;
            let pressure = (urgency - self.urgency(index, target)) * lit(URGENT_MPS2);
            let incentive = gain - own + others + right + pressure - mobil.threshold;
            if incentive > best.0 {
                best = (incentive, Some(target));
            }
        }
        best.1
    }

    /// Acceleration in the `target` lane and, weighted, what its follower would lose; none if that is not safe.
    fn gain(&self, index: usize, me: &Ego<T>, target: usize, urgency: T, mobil: &Mobil<T>) -> Option<T> {
        let rule = &self.vehicles[index].rule;
        let (leader, follower) = (self.next(index, target, true), self.next(index, target, false));
        let safe = |limit: T| mobil.safe_braking.max(urgency * lit::<T>(0.9) * limit).min(limit);
        if !self.has_room(index, target) {
            return None;
        }
        let mine = rule.behind(me, leader.map(|next| self.seen_ahead(me, next)).as_ref());
        if mine < -safe(me.limits.braking) {
            return None;
        }
        let Some(Next { who: Some(who), way }) = follower else { return Some(mine) };
        let (his, ego) = (&self.vehicles[who].rule, self.ego(who));
        let after = his.behind(&ego, Some(&self.seen_ahead(&ego, Next { who: Some(index), way })));
        if after < -safe(ego.limits.braking) {
            return None;
        }
        let ahead = leader.map(|next| Next { way: next.way + way, ..next });
        let before = his.behind(&ego, ahead.map(|next| self.seen_ahead(&ego, next)).as_ref());
        Some(mine + mobil.politeness * (after - before))
    }

    /// Whether nobody in a lane, or changing into it, is beside the vehicle.
    fn has_room(&self, index: usize, lane: usize) -> bool {
        let length = self.vehicles[index].extent.length;
        [true, false].into_iter().filter_map(|ahead| self.next(index, lane, ahead)).all(|next| {
            let lengths = length + next.who.map_or_else(T::zero, |who| self.vehicles[who].extent.length);
            next.way - lengths * lit(0.5) >= lit(LEAST_ROOM_M)
        })
    }

    /// From 0 far from the end of a lane to 1 at it.
    fn urgency(&self, index: usize, lane: usize) -> T {
        let me = &self.vehicles[index].state;
        let way = self.closure_ahead(index, lane, me).map(|(_, other)| other.state.position.x - me.position.x);
        way.map_or_else(T::zero, |way| (T::one() - way / lit(URGENT_M)).max(T::zero()))
    }

    pub(super) fn ego(&self, index: usize) -> Ego<T> {
        let vehicle = &self.vehicles[index];
        vehicle.ego(&vehicle.state, self.time(), &self.params)
    }

    /// Who is next in a lane, ahead or behind, of those in it and those changing into it; ahead also the lane's end.
    pub(super) fn next(&self, index: usize, lane: usize, ahead: bool) -> Option<Next<T>> {
        let me = &self.vehicles[index].state;
        let (ring, is_own) = (self.road.circumference().is_some(), usize::from(lane == self.order.lane(index)));
        let behind = self.order.behind_in(index, lane, &self.vehicles);
        let coming = self.order.coming(index, lane, ahead, ring, &self.vehicles).next();
        let in_lane = if ahead {
            self.order.ahead(lane, behind, is_own, ring).next()
        } else {
            self.order.behind(lane, behind, is_own, ring).next()
        };
        let way = |who: usize| {
            let x = self.vehicles[who].state.position.x;
            let (from, to) = if ahead { (me.position.x, x) } else { (x, me.position.x) };
            self.road.distance(from, to)
        };
        let vehicles = in_lane.into_iter().chain(coming).map(|(who, _)| Next { who: Some(who), way: way(who) });
        let closure = ahead.then(|| self.closure_ahead(index, lane, me)).flatten();
        let closure = closure.map(|(_, other)| Next { who: None, way: other.state.position.x - me.position.x });
        vehicles
            .chain(closure)
            .filter(|next| next.way >= T::zero() && next.way - self.lengths(index, next) <= self.params.range)
            .min_by(|a, b| a.way.partial_cmp(&b.way).unwrap_or(std::cmp::Ordering::Equal))
    }

    /// Half the lengths of a vehicle and of what is next to it, in m.
    fn lengths(&self, index: usize, next: &Next<T>) -> T {
        let other = next.who.map_or_else(T::zero, |who| self.vehicles[who].extent.length);
        (self.vehicles[index].extent.length + other) * lit(0.5)
    }

    /// Somebody at a distance, as the vehicle directly ahead.
    pub(super) fn seen_ahead(&self, me: &Ego<T>, next: Next<T>) -> Other<T> {
        let place = me.state.position;
        let other = next.who.map(|who| &self.vehicles[who]);
        let speed = other.map_or_else(T::zero, |other| other.state.velocity.x);
        let point = crate::boxes::Extent { length: T::zero(), width: T::one() };
        Other {
            state: State::new(place.x + next.way, place.y, speed, T::zero()),
            extent: other.map_or(point, |other| other.extent),
            place: Place::LEADER,
        }
    }
}

/// Who is next in a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Next<T> {
    /// The vehicle; none for the place where the lane is closed.
    pub(super) who: Option<usize>,
    /// From centre to centre along the road, in m.
    pub(super) way: T,
}
