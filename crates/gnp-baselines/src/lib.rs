//! Predictors without a network: constant velocity, constant acceleration.
//!
//! They tell how much of an error a network takes away. Both estimate the motion at the last
//! observed frame from observed positions alone, by least squares over a stated time, and give one
//! future with probability 1. Units are m and s, positions are in the window's frame (origin at the
//! last observed centre, x forward, y to the left).

mod acceleration;
mod motion;
mod velocity;

pub use crate::acceleration::ConstantAcceleration;
pub use crate::motion::BaselineError;
pub use crate::velocity::ConstantVelocity;
