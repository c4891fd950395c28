//! Intention modes: the few shapes that the futures of traffic come in, found by clustering
//! (GNP paper, section on mode-level goal prediction).
//!
//! Futures are moved into the [`ModeFrame`] they are clustered in ([`to_mode_frame`]), clustered by
//! `fit`, and kept as [`Modes`]. Lengths in m, time in s. Everything is fixed by the seed, on any
//! number of threads.
//!
//! # The feature `fit`
//!
//! Loading and comparing modes builds on stable Rust as it is. Finding them takes the feature `fit`, which
//! is off by default, and with it the crate `kmeans`, which uses `portable_simd`: an unstable feature of the
//! compiler. On a stable compiler who switches `fit` on must allow that one crate to use it, or the build ends
//! with error E0554 inside `kmeans`. In the `.cargo/config.toml` of the workspace that is built:
//!
//! ```toml
//! [env]
//! RUSTC_BOOTSTRAP = "kmeans"
//! ```
//!
//! Cargo does not take this setting over from a dependency. Name the crate, as here, rather than `1`: then no
//! other crate may use unstable features. Set it in the file once: a change of the variable from one
//! build to the next compiles every crate anew.
//!
#![cfg_attr(feature = "fit", doc = "```")]
#![cfg_attr(not(feature = "fit"), doc = "```ignore")]
//! use gnp_modes::{ModeFrame, ModeParams, fit};
//! // Four futures of two steps each, [n, t_pred, 2]: two vehicles at constant velocity, two turn off.
//! let futures = [1., 0., 2., 0., 1., 0., 2.2, 0., 1., 1., 2., 3., 1., 1., 2., 3.2];
//! let params = ModeParams { modes: 2, seed: 1, max_iterations: 100, restarts: 1 };
//! let modes = fit(&futures, 2, ModeFrame::Position, &params)?;
//! assert_eq!(modes.sizes, [2, 2]);
//! assert_eq!(modes.nearest(&[1., 0., 2., 0.])?, modes.nearest(&[1., 0.1, 2., 0.1])?);
//! # Ok::<(), gnp_modes::ModeError>(())
//! ```

mod distance;
mod error;
#[cfg(feature = "fit")]
mod fit;
#[cfg(feature = "fit")]
mod lloyd;
mod modes;
mod normalise;
mod params;
#[cfg(feature = "fit")]
mod start;
mod store;

pub use crate::error::ModeError;
#[cfg(feature = "fit")]
pub use crate::fit::fit;
pub use crate::modes::Modes;
pub use crate::normalise::{ModeFrame, Reference, from_mode_frame, to_mode_frame};
pub use crate::params::ModeParams;
