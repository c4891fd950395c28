//! The Kalman filter and the Intelligent Driver Model on roads whose answers are known, and all
//! predictors on roads whose future is another.

#![allow(clippy::unwrap_used, clippy::panic)] // also outside the test functions

#[path = "drivers/future.rs"]
mod future;
#[path = "drivers/idm.rs"]
mod idm;
#[path = "drivers/kalman.rs"]
mod kalman;
#[path = "drivers/road.rs"]
mod road;
