//! Predictors without a network: constant velocity, constant acceleration.
