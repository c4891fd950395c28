//! Highway recordings as columnar tracks, and windows as views into them.
//!
//! Everything here is in SI units and in one right-handed, travel-aligned road frame: x forward
//! along the road, y to the left, the point is the centre of the vehicle's box. The last observed
//! frame of a window is its origin. No value of a later frame can be reached through an
//! [`Observation`].

mod assemble;
mod cache;
mod error;
mod lanes;
mod lookup;
mod neighbours;
mod overlap;
mod parts;
mod predictor;
mod quality;
mod reader;
mod recording;
pub mod schema;
mod split;
mod standardise;
mod velocity;
mod window;
mod windows;

pub use crate::error::DataError;
pub use crate::overlap::{Overlap, groups, overlaps};
pub use crate::predictor::{Explanation, Forecast, InformedPredictor, Mode, PredictError, Predictor, StepForces};
pub use crate::quality::{JUMP_ACCELERATION, JUMP_SPEED, LaneSource, Quality};
pub use crate::reader::{Expectation, Source, discover, read};
pub use crate::recording::{
    Columns, Dataset, LaneLine, LineKind, Recording, RecordingMeta, Road, SLOTS, Slot, State, Track, VehicleClass,
};
pub use crate::split::{Part, Split, SplitConfig, SplitKind};
pub use crate::standardise::Standardiser;
pub use crate::window::{Neighbour, Observation, Truth, Window, WindowId, WindowKey, WindowShape};
pub use crate::windows::{DropCounts, RecordingDrops, WindowConfig, WindowSet};
