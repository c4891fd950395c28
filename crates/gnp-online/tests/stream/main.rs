//! Streams of tracks, from frames to forecasts.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod bad_input;
mod batch;
mod coming_and_going;
mod model;
mod sharing;
mod times;
