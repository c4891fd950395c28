//! Predictors without a network: constant velocity, constant acceleration, a Kalman filter, and the
//! Intelligent Driver Model along the lane.
//!
//! They tell how much of an error a network takes away. All estimate the motion at the last
//! observed frame from observed positions alone, by least squares over a stated time or by
//! filtering, and give one future with probability 1. Units are m and s, positions are in the
//! window's frame (origin at the last observed centre, x forward, y to the left).

mod acceleration;
mod idm;
mod kalman;
mod motion;
mod velocity;

pub use crate::acceleration::ConstantAcceleration;
pub use crate::idm::{Idm, IdmParameters, Leader};
pub use crate::kalman::{AxisNoise, Gaussian, Kalman};
pub use crate::motion::BaselineError;
pub use crate::velocity::ConstantVelocity;
