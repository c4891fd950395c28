//! What a vehicle wants.
use crate::{
    boxes::{Extent, Separation, separation},
    error::{ForceError, require, require_not_negative},
    field::Attraction,
    scalar::lit,
    simulator::{
        params::{CruiseParams, SimulatorParams},
        repulsion::Body,
    },
    state::State,
};
use nalgebra::{Point2, RealField, Vector2};

/// What a vehicle wants.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Drive<T: RealField> {
    /// To be at a point at a time of the simulator's clock. The relaxation time is shortened to the time left, so that
    /// a vehicle that nobody disturbs arrives exactly; on arrival it leaves the scene.
    Goal {
        /// Where to be, in m.
        goal: Point2<T>,
        /// When, in s of [`Simulator::time`](crate::Simulator::time).
        due: T,
    },
    /// To drive at a speed in a lane, on and on; never backwards.
    Cruise {
        /// Desired speed, in m/s.
        speed: T,
        /// Desired lateral position, in m: the middle of a lane.
        y: T,
    },
    /// To keep its velocity whatever pushes: a recorded vehicle, or with velocity 0 an obstacle.
    Steady,
}

/// A vehicle of a [`Simulator`](crate::Simulator).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Vehicle<T: RealField> {
    /// Where it is and how it moves.
    pub state: State<T>,
    /// How large it is.
    pub extent: Extent<T>,
    /// What it wants.
    pub drive: Drive<T>,
    /// Relaxation time in s, at least one step; about 1 for a driver who responds at once.
    pub tau: T,
}

impl<T: RealField + Copy> Vehicle<T> {
    /// A car with tau = 1 s.
    #[must_use]
    pub fn car(state: State<T>, drive: Drive<T>) -> Self {
        Self { state, extent: Extent::car(), drive, tau: T::one() }
    }

    /// An articulated lorry with tau = 1 s.
    #[must_use]
    pub fn truck(state: State<T>, drive: Drive<T>) -> Self {
        Self { extent: Extent::truck(), ..Self::car(state, drive) }
    }

    /// Something of that size that stands at (`x`, `y`) m and stays there.
    #[must_use]
    pub fn obstacle(x: T, y: T, extent: Extent<T>) -> Self {
        Self { extent, ..Self::car(State::new(x, y, T::zero(), T::zero()), Drive::Steady) }
    }

    /// How its box lies to another's: the gap, and along and across the road by themselves.
    #[must_use]
    pub fn separation_from(&self, other: &Self) -> Separation<T> {
        separation(self.state.position - other.state.position, self.extent, other.extent)
    }

    /// What others feel of it.
    pub(crate) fn body(&self) -> Body<T> {
        Body { state: self.state, extent: self.extent }
    }

    /// Takes the state after a step. A cruising driver stops rather than be pushed backwards.
    pub(crate) fn advance(&mut self, mut state: State<T>) {
        if matches!(self.drive, Drive::Cruise { .. }) && state.velocity.x < T::zero() {
            state.velocity.x = T::zero();
            state.position.x = state.position.x.max(self.state.position.x);
        }
        self.state = state;
    }

    pub(crate) fn check(&self, params: &SimulatorParams<T>, time: T) -> Result<(), ForceError> {
        let speed = self.state.velocity.norm();
        require(self.state.is_finite(), "vehicle.state", speed, "finite in all four numbers")?;
        require_not_negative("vehicle.extent.length", self.extent.length)?;
        require_not_negative("vehicle.extent.width", self.extent.width)?;
        require(self.tau >= params.dt && self.tau.is_finite(), "vehicle.tau", self.tau, "finite and at least dt")?;
        self.drive.check(params, time)
    }
}

impl<T: RealField + Copy> Drive<T> {
    pub(crate) fn check(&self, params: &SimulatorParams<T>, time: T) -> Result<(), ForceError> {
        match *self {
            Self::Goal { goal, due } => {
                let way = goal.coords.norm();
                require(way.is_finite(), "drive.goal", way, "finite in both numbers")?;
                let half = params.dt * lit(0.5);
                require(
                    due.is_finite() && due > time + half,
                    "drive.due",
                    due,
                    "after the present time, by half a step",
                )
            }
            Self::Cruise { speed, y } => {
                let fits = speed >= T::zero() && speed <= params.max_speed;
                require(fits, "drive.speed", speed, "from 0 to max_speed")?;
                require(y.is_finite(), "drive.y", y, "finite")
            }
            Self::Steady => Ok(()),
        }
    }

    /// The goal to follow at `time` s for a vehicle in `state`; none for a steady one.
    #[inline]
    pub(crate) fn attraction(
        &self,
        state: &State<T>,
        tau: T,
        time: T,
        params: &SimulatorParams<T>,
    ) -> Option<Attraction<T>> {
        match *self {
            Self::Goal { goal, due } => {
                let time_left = (due - time).max(params.dt);
                let tau = tau.min(time_left);
                let least = (goal - state.position).norm() / params.max_speed;
                Some(Attraction { goal, time_left: time_left.max(least), tau })
            }
            Self::Cruise { speed, y } => {
                let CruiseParams { acceleration, preview, lateral_speed } = params.cruise;
                let v = state.velocity.x;
                let along = speed.clamp(v - params.grip * tau, v + acceleration * tau);
                let across = ((y - state.position.y) / preview).clamp(-lateral_speed, lateral_speed);
                let goal = state.position + Vector2::new(along, across) * preview;
                Some(Attraction { goal, time_left: preview, tau })
            }
            Self::Steady => None,
        }
    }
}
