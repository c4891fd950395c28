//! Intention modes: the few shapes that the futures of traffic come in, found by clustering
//! (GNP paper, section on mode-level goal prediction).
//!
//! Futures are moved into the [`ModeFrame`] they are clustered in ([`to_mode_frame`]), clustered by
//! [`fit`], and kept as [`Modes`]. Lengths in m, time in s. Everything is fixed by the seed, on any
//! number of threads.
//!
//! ```
//! use gnp_modes::{ModeFrame, ModeParams, fit};
//! // Four futures of two steps each, [n, t_pred, 2]: two vehicles go straight on, two turn off.
//! let futures = [1., 0., 2., 0., 1., 0., 2.2, 0., 1., 1., 2., 3., 1., 1., 2., 3.2];
//! let params = ModeParams { modes: 2, seed: 1, max_iterations: 100, restarts: 1 };
//! let modes = fit(&futures, 2, ModeFrame::Position, &params)?;
//! assert_eq!(modes.sizes, [2, 2]);
//! assert_eq!(modes.nearest(&[1., 0., 2., 0.])?, modes.nearest(&[1., 0.1, 2., 0.1])?);
//! # Ok::<(), gnp_modes::ModeError>(())
//! ```

mod error;
mod fit;
mod lloyd;
mod modes;
mod normalise;
mod params;
mod start;
mod store;

pub use crate::error::ModeError;
pub use crate::fit::fit;
pub use crate::modes::{ModeDistance, Modes};
pub use crate::normalise::{ModeFrame, Reference, from_mode_frame, to_mode_frame};
pub use crate::params::ModeParams;
