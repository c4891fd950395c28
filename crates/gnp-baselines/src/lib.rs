//! Predictors without a network: constant velocity, constant acceleration, a Kalman filter, the Intelligent Driver
//! Model behind one leader, and the column ahead rolled out together ([`PlatoonRule`]).
//!
//! They tell how much of an error a network takes away, and are fitted to training windows as networks are: by site where
//! a site has enough vehicles ([`BySite`]). All estimate the motion at the last
//! observed frame from observed positions alone, by least squares over a stated time or by
//! filtering, and give one future with probability 1. Units are m and s, positions are in the
//! window's frame (origin at the last observed centre, x forward, y to the left).
//!
//! [`RULES`] is the one list of them. A further one is a file beside theirs and a line there; one of
//! another crate is a [`Rule`] too.

mod acceleration;
mod by_site;
mod idm;
mod kalman;
mod motion;
mod platoon;
mod rule;
mod span;
mod velocity;

pub use crate::acceleration::ConstantAcceleration;
pub use crate::by_site::BySite;
pub use crate::idm::{Idm, IdmParameters, Leader};
pub use crate::kalman::{AxisNoise, Gaussian, Kalman};
pub use crate::motion::BaselineError;
pub use crate::platoon::{
    ActingTerms, Drivers, FittedDrivers, Motion, PlatoonParameters, PlatoonRoom, PlatoonRule, SeenBehind, SeenMotion,
    SeenVehicle, Traffic, lateral,
};
pub use crate::rule::{Parameters, Rule};
pub use crate::velocity::ConstantVelocity;

/// Every rule, in the order of tables.
pub const RULES: &[Rule] = &[velocity::RULE, acceleration::RULE, kalman::RULE, idm::RULE, platoon::RULE];
