//! Closed-loop motorway traffic on the physics of [`gnp_force`].
//!
//! A scene says where the road is, who enters and who drives; the simulator drives; and what happened is a
//! [`gnp_data::Recording`], so that simulated and real traffic are measured, drawn and played by the same code.
//!
//! How real it is, says [`realism`]: a [`replay`] starts from a moment of a recording, a system drives on in closed loop, and
//! what it makes of it is compared with what happened.
mod chance;
pub mod drivers;
mod error;
mod output;
pub mod realism;
mod recorder;
pub mod replay;
mod run;
mod scene;

pub use crate::{
    error::SimulationError,
    output::write_parquet,
    recorder::Recorder,
    run::{Counts, Happening, Kind, Simulated},
    scene::{ClosureSpec, DriverSpec, InflowSpec, RoadSpec, Scene, SpeedLimit, Spread, StartSpec},
};

/// The README's programs are compiled and run with the documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
