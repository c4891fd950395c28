//! What is the same for all vehicles of a simulator.
use crate::{
    error::{ForceError, require, require_positive},
    integrator::Integrator,
    scalar::lit,
};
use nalgebra::RealField;

/// What a [`Simulator`](crate::Simulator) needs to know besides the road and the vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked<T>", into = "Unchecked<T>"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub struct SimulatorParams<T> {
    /// Length of a step, in s. At most the relaxation time of every vehicle.
    pub dt: T,
    /// How a step is taken.
    pub integrator: Integrator,
    /// How vehicles keep to their lane and change it.
    pub steering: Steering<T>,
    /// Highest speed that a vehicle may want, in m/s. A goal that asks for more is approached at this speed, late.
    pub max_speed: T,
    /// How far along the road others are noticed, from bumper to bumper, in m.
    pub range: T,
    /// Time between a driver's decisions whether to change lanes, in s.
    pub decision_interval: T,
    /// From which all chance comes: [`Noise`](crate::Noise).
    pub seed: u64,
}

/// How a cruising vehicle moves across the road: towards the middle of its lane, as if it were to be there `preview`
/// seconds from now.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Steering<T> {
    /// Time in which a lateral deviation is to be closed, in s. At 4 times tau or more the approach does not overshoot.
    pub preview: T,
    /// Highest lateral speed wanted, in m/s.
    pub lateral_speed: T,
}

impl<T: RealField + Copy> SimulatorParams<T> {
    /// Motorway traffic in steps of `dt` s: semi-implicit Euler, at most 70 m/s, others noticed at up to 300 m.
    #[must_use]
    pub fn motorway(dt: T) -> Self {
        Self {
            dt,
            integrator: Integrator::SemiImplicitEuler,
            steering: Steering { preview: lit(4.0), lateral_speed: lit(1.2) },
            max_speed: lit(70.0),
            range: lit(300.0),
            decision_interval: lit::<T>(0.5).max(dt),
            seed: 0,
        }
    }

    /// Whether the physics allows these numbers.
    ///
    /// # Errors
    /// Names the first number out of range and what it must be.
    pub fn check(&self) -> Result<(), ForceError> {
        require_positive("dt", self.dt)?;
        require_positive("steering.preview", self.steering.preview)?;
        require_positive("steering.lateral_speed", self.steering.lateral_speed)?;
        require_positive("max_speed", self.max_speed)?;
        require_positive("range", self.range)?;
        let decides = self.decision_interval >= self.dt && self.decision_interval.is_finite();
        require(decides, "decision_interval", self.decision_interval, "finite and at least dt")
    }

    /// Steps between the decisions of a driver, at least 1.
    pub(crate) fn decision_steps(&self) -> u64 {
        let steps: f64 = (self.decision_interval / self.dt).round().to_subset_unchecked();
        (steps as u64).max(1)
    }
}

/// What parameters are read from, before they are checked.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked<T> {
    dt: T,
    integrator: Integrator,
    steering: Steering<T>,
    max_speed: T,
    range: T,
    decision_interval: T,
    seed: u64,
}

#[cfg(feature = "serde")]
impl<T: RealField + Copy> TryFrom<Unchecked<T>> for SimulatorParams<T> {
    type Error = ForceError;

    fn try_from(from: Unchecked<T>) -> Result<Self, ForceError> {
        let Unchecked { dt, integrator, steering, max_speed, range, decision_interval, seed } = from;
        let params = Self { dt, integrator, steering, max_speed, range, decision_interval, seed };
        params.check().map(|()| params)
    }
}

#[cfg(feature = "serde")]
impl<T> From<SimulatorParams<T>> for Unchecked<T> {
    fn from(params: SimulatorParams<T>) -> Self {
        let SimulatorParams { dt, integrator, steering, max_speed, range, decision_interval, seed } = params;
        Self { dt, integrator, steering, max_speed, range, decision_interval, seed }
    }
}
