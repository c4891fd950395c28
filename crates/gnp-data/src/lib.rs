//! Highway recordings as columnar tracks, and windows as views into them.
//!
//! Everything here is in SI units and in one right-handed, travel-aligned road frame: x forward
//! along the road, y to the left, the point is the centre of the vehicle's box. The last observed
//! frame of a window is its origin. No value of a later frame can be reached through an
//! [`Observation`].

mod assemble;
mod cache;
mod error;
mod explanation;
mod ingest_report;
mod lanes;
mod lookup;
mod neighbours;
mod overlap;
mod parts;
mod predictor;
mod reader;
mod recording;
pub mod schema;
mod split;
mod standardise;
mod velocity;
mod window;
mod windows;

pub use crate::error::DataError;
pub use crate::ingest_report::{IngestReport, JUMP_ACCELERATION, JUMP_SPEED, LaneSource};
pub use crate::overlap::{Overlap, groups, overlaps};
pub use crate::explanation::{Explanation, TermForces};
pub use crate::predictor::{Forecast, Mode, OraclePredictor, PredictError, Predictor};
pub use crate::reader::{Expectation, Source, discover, read};
pub use crate::recording::{
    Columns, Dataset, LaneMarking, Recording, RecordingMeta, Road, SLOTS, Slot, Track, TrackState,
    VehicleClass,
};
pub use crate::split::{Split, SplitConfig, SplitKind, Subset};
pub use crate::standardise::Standardiser;
pub use crate::window::{Neighbour, Observation, Truth, Window, WindowId, WindowKey, WindowShape};
pub use crate::windows::{DropCounts, RecordingDrops, WindowConfig, WindowSet};
pub use gnp_force::MarkingKind;
