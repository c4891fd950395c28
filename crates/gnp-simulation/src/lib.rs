//! Closed-loop motorway traffic on the physics of [`gnp_force`].
//!
//! A scene says where the road is, who enters and who drives; the simulator drives; and what happened is a
//! [`gnp_data::Recording`], so that simulated and real traffic are measured, drawn and played by the same code.
pub mod drivers;
mod error;
mod recorder;

pub use crate::{error::SimulationError, recorder::Recorder};
