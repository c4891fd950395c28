//! What a vehicle wants, or which motion it is given.
use crate::{
    error::{ForceError, require},
    goal::goal_force,
    rule::{Ego, PairRule},
    scalar::lit,
    simulator::{params::SimulatorParams, profile::Profile},
    state::State,
};
use nalgebra::{Point2, RealField, Vector2};
use std::sync::Arc;

/// What a vehicle does once it is where it wanted to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum AfterGoal {
    /// It leaves the scene, which is an [`Event::Arrived`](crate::Event::Arrived).
    #[default]
    Leave,
    /// It drives on at the speed it has, at the lateral position of the goal: [`Drive::Cruise`].
    Cruise,
}

/// What a vehicle wants, or which motion it is given.
///
/// Those with a wish, `Goal` and `Cruise`, feel forces, and never accelerate or brake beyond the
/// [`Limits`](crate::Limits) of their vehicle. The others are moved: nothing pushes them, others feel them.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[cfg_attr(
    feature = "serde",
    serde(bound(
        serialize = "T: RealField + Copy + serde::Serialize",
        deserialize = "T: RealField + Copy + serde::Deserialize<'de>"
    ))
)]
pub enum Drive<T: RealField> {
    /// To be at a point at a time of the simulator's clock. The relaxation time is shortened to the time left, so that
    /// a vehicle that nobody disturbs and whose limits suffice arrives exactly, if `due` is the time of a step, else at
    /// the nearest one; one that is held up is short of its goal by then. On a ring the way leads within the lap: a goal
    /// beyond the seam cannot be said.
    Goal {
        /// Where to be, in m.
        goal: Point2<T>,
        /// When, in s of [`Simulator::time`](crate::Simulator::time).
        due: T,
        /// What then.
        #[cfg_attr(feature = "serde", serde(default))]
        then: AfterGoal,
    },
    /// To drive at a speed in a lane, on and on; never backwards.
    Cruise {
        /// Desired speed, in m/s.
        speed: T,
        /// Desired lateral position, in m: the middle of a lane.
        y: T,
    },
    /// Given: a constant acceleration along the road in m/s², within the limits, such as -8 for an emergency braking. The
    /// vehicle comes to rest and stays there, or keeps to the highest speed; a motion across the road ends.
    Accelerate(T),
    /// Given: velocities over time.
    Follow(#[cfg_attr(feature = "serde", serde(with = "shared"))] Arc<Profile<T>>),
    /// Given: the velocity stays as it is, 0 for an obstacle.
    Steady,
}

impl<T: RealField + Copy> Drive<T> {
    /// Whether the vehicle is drawn and pushed, rather than moved.
    #[must_use]
    pub fn has_a_wish(&self) -> bool {
        matches!(self, Self::Goal { .. } | Self::Cruise { .. })
    }

    /// The lateral position that a cruising vehicle keeps to, in m.
    #[inline]
    pub(crate) fn lateral_aim(&self) -> Option<T> {
        if let Self::Cruise { y, .. } = self { Some(*y) } else { None }
    }

    /// The greatest speed of a given motion, in m/s; 0 for any other.
    pub(crate) fn fastest(&self) -> T {
        if let Self::Follow(profile) = self { profile.fastest() } else { T::zero() }
    }

    pub(crate) fn check(&self, params: &SimulatorParams<T>, time: T) -> Result<(), ForceError> {
        match self {
            Self::Goal { goal, due, .. } => {
                let way = goal.coords.norm();
                require(way.is_finite(), "drive.goal", way, "finite in both numbers")?;
                let half = params.dt * lit(0.5);
                let later = due.is_finite() && *due > time + half;
                require(later, "drive.due", *due, "after the present time, by half a step")
            }
            Self::Cruise { speed, y } => {
                let fits = *speed >= T::zero() && *speed <= params.max_speed;
                require(fits, "drive.speed", *speed, "from 0 to max_speed")?;
                require(y.is_finite(), "drive.y", *y, "finite")
            }
            Self::Accelerate(along) => require(along.is_finite(), "drive.accelerate", *along, "finite"),
            Self::Follow(_) | Self::Steady => Ok(()),
        }
    }

    /// The speed wished for by a vehicle in `state`, in m/s.
    #[inline]
    pub(crate) fn wish(&self, state: &State<T>, time: T, params: &SimulatorParams<T>) -> T {
        match self {
            Self::Goal { goal, due, .. } => {
                let time_left = (*due - time).max(params.dt);
                ((goal.x - state.position.x) / time_left).max(T::zero()).min(params.max_speed)
            }
            Self::Cruise { speed, .. } => *speed,
            Self::Accelerate(_) | Self::Follow(_) | Self::Steady => state.velocity.x.max(T::zero()),
        }
    }

    /// What draws a vehicle with a wish, in m/s², within its limits; none for one that is moved.
    #[inline]
    pub(crate) fn pull<R: PairRule<T>>(
        &self,
        me: &Ego<T>,
        rule: &R,
        time: T,
        params: &SimulatorParams<T>,
    ) -> Option<Vector2<T>> {
        let State { position, velocity } = me.state;
        match self {
            Self::Goal { goal, due, .. } => {
                let time_left = (*due - time).max(params.dt);
                let tau = me.tau.min(time_left);
                let least = (goal - position).norm() / params.max_speed;
                let pull = goal_force(position, velocity, *goal, time_left.max(least), tau);
                Some(me.limits.hold(pull, velocity))
            }
            Self::Cruise { y, .. } => {
                let steering = &params.steering;
                let across =
                    ((*y - position.y) / steering.preview).max(-steering.lateral_speed).min(steering.lateral_speed);
                Some(me.limits.hold(Vector2::new(rule.free(me), (across - velocity.y) / me.tau), velocity))
            }
            Self::Accelerate(_) | Self::Follow(_) | Self::Steady => None,
        }
    }
}

/// A profile that is shared is written as if it were not.
#[cfg(feature = "serde")]
mod shared {
    use crate::Profile;
    use nalgebra::RealField;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::sync::Arc;

    pub(super) fn serialize<T, S>(profile: &Arc<Profile<T>>, serializer: S) -> Result<S::Ok, S::Error>
    where
        T: RealField + Copy + Serialize,
        S: Serializer,
    {
        profile.as_ref().serialize(serializer)
    }

    pub(super) fn deserialize<'de, T, D>(deserializer: D) -> Result<Arc<Profile<T>>, D::Error>
    where
        T: RealField + Copy + Deserialize<'de>,
        D: Deserializer<'de>,
    {
        Profile::deserialize(deserializer).map(Arc::new)
    }
}
