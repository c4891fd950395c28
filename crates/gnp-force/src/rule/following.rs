//! The intelligent driver model as a rule of the simulator.
use super::{Ego, Other, PairRule, Reach, in_path};
use crate::{
    car_following::{Following, HARDEST_BRAKING},
    driver::Driver,
    error::ForceError,
};
use nalgebra::{RealField, Vector2};

/// The intelligent driver model (Treiber, Hennecke and Helbing 2000): [`free_acceleration`](crate::free_acceleration) on
/// an empty road, [`interaction`](crate::interaction) with the vehicle ahead.
///
/// The desired speed is the vehicle's wish and stands in its [`Drive`](crate::Drive); the other four numbers of a
/// [`Driver`] are here, in the same ranges. In the vehicle's lane the nearest ahead acts, and one that changes into it; a
/// vehicle in a lane beside acts as far as it stands in the path. There is no force across the road: who changes lanes
/// must look ([`Mobil`](crate::Mobil)).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Idm<T> {
    /// Time to the vehicle ahead at a steady speed, in s.
    pub time_gap: T,
    /// Gap to the vehicle ahead at standstill, bumper to bumper, in m.
    pub standstill_gap: T,
    /// Acceleration of a standing vehicle on an empty road, in m/s².
    pub acceleration: T,
    /// Comfortable braking, a positive number, in m/s².
    pub braking: T,
}

impl<T: RealField + Copy> Idm<T> {
    /// The rule of a driver, without his desired speed.
    #[must_use]
    pub fn of(driver: &Driver<T>) -> Self {
        let Driver { time_gap, standstill_gap, acceleration, braking, .. } = *driver;
        Self { time_gap, standstill_gap, acceleration, braking }
    }

    /// The driver with this rule and a desired speed in m/s.
    #[must_use]
    pub fn driver(&self, desired_speed: T) -> Driver<T> {
        let Self { time_gap, standstill_gap, acceleration, braking } = *self;
        Driver { desired_speed, time_gap, standstill_gap, acceleration, braking }
    }
}

impl<T: RealField + Copy> PairRule<T> for Idm<T> {
    fn reach(&self) -> Reach {
        Reach { ahead: 1, behind: 0, beside_ahead: 2, beside_behind: 0 }
    }

    #[inline]
    fn free(&self, me: &Ego<T>) -> T {
        if me.wish <= T::zero() {
            // The model divides by the desired speed: who wishes to stand brakes comfortably instead.
            return me.limits.along(-(me.state.velocity.x / me.tau).min(self.braking));
        }
        me.limits.along(Following::new(&self.driver(me.wish)).free(me.state.velocity.x))
    }

    #[inline]
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
        let r = other.state.position - me.state.position;
        if r.x <= T::zero() {
            return Vector2::zeros();
        }
        let beside = me.separation_from(other).beside;
        let share = in_path(other.place, beside);
        if share == T::zero() {
            return Vector2::zeros();
        }
        let body = (me.extent.length + other.extent.length) * crate::scalar::lit(0.5);
        let law = Following::new(&self.driver(me.wish));
        let push = law.interaction(r.x, body, me.state.velocity.x, other.state.velocity.x);
        Vector2::new(push * share, T::zero())
    }

    fn check(&self) -> Result<(), ForceError> {
        self.driver(crate::scalar::lit(HARDEST_BRAKING)).check()
    }
}
