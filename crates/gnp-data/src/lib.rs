//! Highway recordings as columnar tracks, and windows as views into them.
//!
//! Everything here is in SI units and in one right-handed, travel-aligned road frame: x forward
//! along the road, y to the left, the point is the centre of the vehicle's box. The last observed
//! frame of a window is its origin. No value of a later frame can be reached through an
//! [`Observation`].
//!
//! Recordings come from files through a [`Format`] ([`FORMATS`] lists those that are known), or from a
//! program's own tracks: columns of them, in any plane, through a `TrackTable` (feature `readers`), or sample by sample
//! through a [`LiveScene`].
//!
//! Feature `readers`, on by default: the formats of this crate, and with them polars. Without it
//! there are recordings, windows, splits and predictors, and formats of other crates.

mod account;
mod assemble;
mod cache;
mod copies;
mod dataset;
mod discover;
mod error;
mod explanation;
mod file_coordinates;
mod foreign;
mod format;
mod formats;
mod ingest_report;
mod lanes;
mod leader;
pub mod limits;
mod live;
mod lookup;
mod named;
mod neighbours;
mod overlap;
mod parts;
mod predictor;
mod recording;
mod scene_edit;
pub mod schema;
mod slot;
mod snapshot;
mod split;
mod standardise;
#[cfg(feature = "readers")]
mod time_parts;
mod track_options;
#[cfg(feature = "readers")]
mod track_table;
#[cfg(feature = "readers")]
mod tracks;
mod velocity;
mod window;
mod window_shape;
mod windows;
#[cfg(feature = "readers")]
mod write;

pub use crate::account::Account;
pub use crate::assemble::{NeighbourSource, Rows, VehicleBody};
pub use crate::copies::{Copies, Fingerprint, LeftOut, Taken};
pub use crate::dataset::{Dataset, DatasetNameError};
pub use crate::discover::{Discovery, FoundFile, FoundFiles, NotRead, discover_with, search};
pub use crate::error::{DataError, TrackProblem};
pub use crate::explanation::{Cause, Contribution, Explanation, TermForces};
pub use crate::format::{
    Expectation, FORMATS, Format, Source, check_rate, discover, format_of, read, read_with, survey,
};
pub use crate::ingest_report::{IngestReport, JUMP_ACCELERATION, JUMP_SPEED, LaneSource};
pub use crate::lanes::{LaneFit, fit_lanes};
pub use crate::leader::{Leader, NAMED_LEADER_SIZE};
pub use crate::live::{LiveError, LiveScene, Sample};
pub use crate::neighbours::{LanePosition, find_neighbours};
pub use crate::overlap::{Drivers, Overlap, SharedBy, groups, overlaps};
pub use crate::predictor::{Forecast, Mode, OraclePredictor, PredictError, Predictor, nearest_to_mean};
pub use crate::recording::{
    Columns, LaneMarking, NamedLeader, Recording, RecordingMeta, Road, Track, TrackState, VehicleClass, VelocitySource,
};
pub use crate::scene_edit::{EditedScene, NewVehicle, SPEED_CHANGE_S, SPEED_KEPT_S, SceneEdit, SceneEditError};
pub use crate::slot::{BySlot, SLOTS, Slot};
pub use crate::snapshot::{FILL_FROM_S, Past, Present, Snapshot};
pub use crate::split::{Split, SplitConfig, SplitKind, Subset};
pub use crate::standardise::Standardiser;
#[cfg(feature = "readers")]
pub use crate::time_parts::{Part, PartSize};
pub use crate::track_options::TrackOptions;
#[cfg(feature = "readers")]
pub use crate::track_table::{
    DEFAULT_SIZES, LaneNumbers, MAX_TURN_DEGREES, MAX_TURN_OF_FEW_DEGREES, RowPlaces, TableVehicle, TrackLayout,
    TrackTable, VehicleWord,
};
#[cfg(feature = "readers")]
pub use crate::tracks::{TrackFile, Tracks};
pub use crate::window::{Neighbour, Observation, Truth, Window, WindowId, WindowKey};
pub use crate::window_shape::{WindowError, WindowShape};
pub use crate::windows::{DropCounts, RecordingDrops, WindowConfig, WindowSet};
#[cfg(feature = "readers")]
pub use crate::write::{Written, write_fcd, write_fcd_types};
pub use gnp_force::MarkingKind;
