//! A vehicle of the simulator: state, size, wish and driver.
use crate::{
    boxes::{Extent, Separation, separation},
    error::{ForceError, require, require_not_negative},
    rule::{Ego, Limits, MotorwayRule, PairRule, Rule},
    simulator::{drive::Drive, lane_change::Mobil, noise::Noise, params::SimulatorParams},
    state::State,
};
use nalgebra::RealField;

/// A vehicle of a [`Simulator`](crate::Simulator), with a rule of type `R`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize, R: serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>, R: serde::Deserialize<'de>"
    ))
)]
pub struct Vehicle<T: RealField, R = Rule<T>> {
    /// Where it is and how it moves.
    pub state: State<T>,
    /// How large it is.
    pub extent: Extent<T>,
    /// What it wants.
    pub drive: Drive<T>,
    /// Relaxation time in s, at least one step; about 1 for a driver who responds at once.
    pub tau: T,
    /// How its driver keeps away from others.
    pub rule: R,
    /// What it can do.
    pub limits: Limits<T>,
    /// How unsteady its driver is; none for one who is not.
    pub noise: Option<Noise<T>>,
    /// How its driver decides to change lanes while he cruises; none for one who only does what [`Drive::Cruise`] says.
    pub lane_change: Option<Mobil<T>>,
}

impl<T: RealField + Copy> Vehicle<T> {
    /// A car with tau = 1 s and [`MotorwayRule::standard`], that keeps its lane.
    #[must_use]
    pub fn car(state: State<T>, drive: Drive<T>) -> Self {
        Self {
            state,
            extent: Extent::car(),
            drive,
            tau: T::one(),
            rule: MotorwayRule::standard().into(),
            limits: Limits::car(),
            noise: None,
            lane_change: None,
        }
    }

    /// An articulated lorry with tau = 1 s and [`MotorwayRule::standard`], that keeps its lane.
    #[must_use]
    pub fn truck(state: State<T>, drive: Drive<T>) -> Self {
        Self { extent: Extent::truck(), limits: Limits::truck(), ..Self::car(state, drive) }
    }

    /// Something of that size that stands at (`x`, `y`) m and stays there, no wider than that it reaches into the lanes
    /// beside its own: others look no further. For a stretch that cannot be driven on see
    /// [`Road::closing`](crate::Road::closing).
    #[must_use]
    pub fn obstacle(x: T, y: T, extent: Extent<T>) -> Self {
        Self { extent, ..Self::car(State::new(x, y, T::zero(), T::zero()), Drive::Steady) }
    }
}

impl<T: RealField + Copy, R> Vehicle<T, R> {
    /// The same vehicle with a driver of another rule, also of another type.
    #[must_use]
    pub fn with_rule<S>(self, rule: S) -> Vehicle<T, S> {
        let Self { state, extent, drive, tau, limits, noise, lane_change, .. } = self;
        Vehicle { state, extent, drive, tau, rule, limits, noise, lane_change }
    }

    /// How its box lies to another's: the gap, and along and across the road by themselves. A ring is not considered.
    #[must_use]
    pub fn separation_from(&self, other: &Self) -> Separation<T> {
        separation(self.state.position - other.state.position, self.extent, other.extent)
    }

    /// What its rule knows of it when it is in `state`.
    #[inline]
    pub(crate) fn ego(&self, state: &State<T>, time: T, params: &SimulatorParams<T>) -> Ego<T> {
        Ego {
            state: *state,
            extent: self.extent,
            wish: self.drive.wish(state, time, params),
            tau: self.tau,
            limits: self.limits,
        }
    }

    /// Takes the state after a step that ends at `time` s. A cruising driver stops rather than be pushed backwards, and
    /// one that rolls backwards gets no faster; one that is moved has the velocity it is given.
    pub(crate) fn advance(&mut self, mut state: State<T>, time: T, dt: T) {
        let before = &self.state;
        match &self.drive {
            Drive::Goal { .. } | Drive::Steady => {}
            Drive::Cruise { .. } | Drive::Accelerate(_) => {
                let least = before.velocity.x.min(T::zero());
                if state.velocity.x < least {
                    state.velocity.x = least;
                    state.position.x = state.position.x.max(before.position.x + least * dt);
                }
            }
            Drive::Follow(profile) => {
                state.velocity = profile.velocity_at(time);
                state.position = before.position + profile.way(time - dt, time);
            }
        }
        self.state = state;
    }
}

impl<T: RealField + Copy, R: PairRule<T>> Vehicle<T, R> {
    pub(crate) fn check(&self, params: &SimulatorParams<T>, time: T) -> Result<(), ForceError> {
        let speed = self.state.velocity.norm();
        require(self.state.is_finite(), "vehicle.state", speed, "finite in all four numbers")?;
        require_not_negative("vehicle.extent.length", self.extent.length)?;
        require_not_negative("vehicle.extent.width", self.extent.width)?;
        require(self.tau >= params.dt && self.tau.is_finite(), "vehicle.tau", self.tau, "finite and at least dt")?;
        self.limits.check()?;
        self.rule.check()?;
        if let Some(noise) = &self.noise {
            noise.check()?;
        }
        if let Some(lane_change) = &self.lane_change {
            lane_change.check()?;
        }
        self.drive.check(params, time)
    }
}
