//! The gap to what is ahead, and how near that is to an accident.
use super::{Obstacle, Simulator, VehicleId};
use crate::{error::ForceError, rule::PairRule, scalar::lit};
use nalgebra::RealField;

/// The way to what is next ahead in the lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap<T> {
    /// What is there.
    pub to: Obstacle,
    /// From bumper to bumper, in m; below 0 for an overlap.
    pub distance: T,
    /// Speed of the vehicle itself along the road, in m/s.
    pub speed: T,
    /// How fast the gap closes, in m/s; below 0 when it opens.
    pub closing: T,
}

impl<T: RealField + Copy> Gap<T> {
    /// Time to collision at these speeds, in s (Hayward 1972): 0 at contact, none when the gap does not close.
    #[must_use]
    pub fn ttc(&self) -> Option<T> {
        (self.closing > T::zero()).then(|| self.distance.max(T::zero()) / self.closing)
    }

    /// Constant deceleration that just avoids a collision with what keeps its speed, in m/s² (DRAC): 0 when the gap does
    /// not close, none at contact.
    #[must_use]
    pub fn drac(&self) -> Option<T> {
        if self.closing <= T::zero() {
            return Some(T::zero());
        }
        (self.distance > T::zero()).then(|| self.closing * self.closing / (self.distance + self.distance))
    }

    /// Time until the front bumper is where the leader's rear bumper is now, in s; none for a vehicle that stands.
    #[must_use]
    pub fn time_gap(&self) -> Option<T> {
        (self.speed > T::zero()).then(|| self.distance / self.speed)
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Simulator<T, R> {
    /// The gap to what is next ahead in a vehicle's lane within the range of sight: a vehicle in it or changing into it,
    /// or the lane's end.
    ///
    /// ```
    /// use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
    /// let mut scene = Simulator::new(SimulatorParams::motorway(0.04_f64), Road::motorway(1, 3.75)?)?;
    /// let y = 1.875;
    /// let car = scene.add(Vehicle::car(State::new(0.0, y, 30.0, 0.0), Drive::Cruise { speed: 30.0, y }))?;
    /// scene.add(Vehicle::car(State::new(54.6, y, 20.0, 0.0), Drive::Accelerate(-8.0)))?;
    /// let gap = scene.gap_ahead(car)?.unwrap();
    /// assert!((gap.ttc().unwrap() - 5.0).abs() < 1e-9 && (gap.drac().unwrap() - 1.0).abs() < 1e-9);
    /// # Ok::<(), gnp_force::ForceError>(())
    /// ```
    ///
    /// # Errors
    /// When there is no vehicle of that number.
    pub fn gap_ahead(&self, id: VehicleId) -> Result<Option<Gap<T>>, ForceError> {
        let index = self.index(id)?;
        Ok(self.gap_in(index, self.order.lane(index), true))
    }

    /// The gap that the next vehicle behind in the lane has to this one; `to` names him, `speed` is his.
    ///
    /// # Errors
    /// When there is no vehicle of that number.
    pub fn gap_behind(&self, id: VehicleId) -> Result<Option<Gap<T>>, ForceError> {
        let index = self.index(id)?;
        Ok(self.gap_in(index, self.order.lane(index), false))
    }

    fn gap_in(&self, index: usize, lane: usize, ahead: bool) -> Option<Gap<T>> {
        let next = self.next(index, lane, ahead)?;
        let me = &self.vehicles[index];
        let other = next.who.map(|who| &self.vehicles[who]);
        let lengths = me.extent.length + other.map_or_else(T::zero, |other| other.extent.length);
        let speed = other.map_or_else(T::zero, |other| other.state.velocity.x);
        let (behind, front) = if ahead { (me.state.velocity.x, speed) } else { (speed, me.state.velocity.x) };
        let to = match next.who {
            Some(who) => Obstacle::Vehicle(self.ids[who]),
            None => Obstacle::Closure(self.closure_ahead(index, lane, &me.state)?.0),
        };
        Some(Gap { to, distance: next.way - lengths * lit(0.5), speed: behind, closing: behind - front })
    }
}
