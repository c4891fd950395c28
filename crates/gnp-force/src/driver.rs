//! Who follows: the five numbers of a driver in the intelligent driver model.
use crate::{
    error::{ForceError, require},
    scalar::lit,
};
use nalgebra::RealField;

/// Least and greatest desired speed, in m/s; also what bounds every speed in the laws of car following.
pub(crate) const SPEEDS: [f64; 2] = [0.1, 1e3];
/// Least and greatest time gap, in s.
const TIME_GAPS: [f64; 2] = [0.0, 1e3];
/// Least and greatest gap at standstill, in m.
const STANDSTILL_GAPS: [f64; 2] = [0.0, 1e3];
/// Least and greatest acceleration and braking, in m/s².
const RATES: [f64; 2] = [1e-3, 1e3];

/// A driver of the intelligent driver model.
///
/// The ranges keep every force and gradient finite. [`Driver::check`] refuses what lies outside of them; the laws
/// themselves take the nearer end of the range instead, with a gradient of 0 there.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Driver<T> {
    /// Speed on an empty road, in m/s, from 0.1 to 1000; 120 km/h on a motorway.
    pub desired_speed: T,
    /// Time to the vehicle ahead at a steady speed, in s, from 0 to 1000; typically 0.8 to 2.
    pub time_gap: T,
    /// Gap to the vehicle ahead at standstill, bumper to bumper, in m, from 0 to 1000; typically 2.
    pub standstill_gap: T,
    /// Acceleration of a standing vehicle on an empty road, in m/s², from 0.001 to 1000; typically 0.8 to 2.5.
    pub acceleration: T,
    /// Comfortable braking, a positive number, in m/s², from 0.001 to 1000; typically 1 to 3.
    pub braking: T,
}

impl<T: RealField + Copy> Driver<T> {
    /// A car driver on a motorway: 120 km/h, 1 s, 2 m, 1 m/s², 1.5 m/s² (Treiber and Kesting, *Traffic Flow Dynamics*,
    /// 2013, table 11.2).
    #[must_use]
    pub fn motorway() -> Self {
        Self {
            desired_speed: lit(120.0 / 3.6),
            time_gap: T::one(),
            standstill_gap: lit(2.0),
            acceleration: T::one(),
            braking: lit(1.5),
        }
    }

    /// The bumper-to-bumper gap in m at which a driver keeps `speed` m/s behind a vehicle of that speed,
    /// `(s0 + v T) / sqrt(1 - (v / v0)^4)`; none at the desired speed and above, where no gap is large enough.
    #[must_use]
    pub fn equilibrium_gap(&self, speed: T) -> Option<T> {
        let v = speed.max(T::zero());
        let ratio = v / self.desired_speed;
        let room = T::one() - ratio * ratio * ratio * ratio;
        (room > T::zero()).then(|| (self.standstill_gap + v * self.time_gap) / room.sqrt())
    }

    /// Refuses a driver outside of what the model is for.
    ///
    /// # Errors
    /// [`ForceError::Value`] for the first number that is not finite or out of its range.
    pub fn check(&self) -> Result<(), ForceError> {
        for (key, value, [least, most], must) in [
            ("driver.desired_speed", self.desired_speed, SPEEDS, "from 0.1 to 1000 m/s"),
            ("driver.time_gap", self.time_gap, TIME_GAPS, "from 0 to 1000 s"),
            ("driver.standstill_gap", self.standstill_gap, STANDSTILL_GAPS, "from 0 to 1000 m"),
            ("driver.acceleration", self.acceleration, RATES, "from 0.001 to 1000 m/s²"),
            ("driver.braking", self.braking, RATES, "from 0.001 to 1000 m/s²"),
        ] {
            require(value >= lit(least) && value <= lit(most), key, value, must)?;
        }
        Ok(())
    }

    /// The driver with every number in its range.
    pub(crate) fn bounded(&self) -> Self {
        let within = |value: T, [least, most]: [f64; 2]| value.max(lit(least)).min(lit(most));
        Self {
            desired_speed: within(self.desired_speed, SPEEDS),
            time_gap: within(self.time_gap, TIME_GAPS),
            standstill_gap: within(self.standstill_gap, STANDSTILL_GAPS),
            acceleration: within(self.acceleration, RATES),
            braking: within(self.braking, RATES),
        }
    }

    /// `gradient` with respect to the bounded numbers, as one with respect to these: 0 where a number is out of range.
    pub(crate) fn free_of_bounds(&self, gradient: Self) -> Self {
        let bounded = self.bounded();
        let through = |own: T, bounded: T, gradient: T| if own == bounded { gradient } else { T::zero() };
        Self {
            desired_speed: through(self.desired_speed, bounded.desired_speed, gradient.desired_speed),
            time_gap: through(self.time_gap, bounded.time_gap, gradient.time_gap),
            standstill_gap: through(self.standstill_gap, bounded.standstill_gap, gradient.standstill_gap),
            acceleration: through(self.acceleration, bounded.acceleration, gradient.acceleration),
            braking: through(self.braking, bounded.braking, gradient.braking),
        }
    }

    /// No gradient.
    pub(crate) fn zeros() -> Self {
        let zero = T::zero();
        Self { desired_speed: zero, time_gap: zero, standstill_gap: zero, acceleration: zero, braking: zero }
    }
}
