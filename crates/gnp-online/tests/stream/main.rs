//! Streams of tracks, from frames to forecasts.

#![allow(clippy::unwrap_used, clippy::panic)] // also outside the test functions

mod bad_input;
mod batch;
mod coming_and_going;
mod model;
mod sharing;
mod times;

/// 3 s observed and 5 s predicted at 10 Hz.
pub(crate) const SHAPE: gnp_data::WindowShape = gnp_data::WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };
