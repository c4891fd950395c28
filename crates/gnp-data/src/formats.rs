//! The formats of this crate, one a file.

use crate::format::Format;

#[cfg(feature = "readers")]
mod findings;
#[cfg(feature = "readers")]
mod highd;
#[cfg(feature = "readers")]
mod motion;
#[cfg(feature = "readers")]
mod ngsim;
#[cfg(feature = "readers")]
mod periods;
#[cfg(feature = "readers")]
mod table;

/// All of them, in the order in which they are described.
#[cfg(feature = "readers")]
pub(crate) const ALL: &[&dyn Format] = &[&ngsim::Ngsim, &highd::HighD];

/// None: reading needs the feature `readers`.
#[cfg(not(feature = "readers"))]
pub(crate) const ALL: &[&dyn Format] = &[];
