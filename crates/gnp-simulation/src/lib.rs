//! Closed-loop motorway traffic on the physics of [`gnp_force`].
//!
//! A scene says where the road is, who enters and who drives; the simulator drives; and what happened is a
//! [`gnp_data::Recording`], so that simulated and real traffic are measured, drawn and played by the same code.
//!
//! How real it is, says [`realism`]: a [`replay`] starts from a moment of a recording, a system drives on in closed loop, and
//! what it makes of it is compared with what happened.
mod chance;
mod error;
pub mod realism;
mod recorder;
pub mod replay;

pub use crate::{error::SimulationError, recorder::Recorder};
