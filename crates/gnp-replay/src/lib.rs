//! Recordings with forecasts, and the forces behind them, for the [Rerun](https://rerun.io) viewer.
//!
//! [`records`] says which entity of the viewer shows what of a [`Clip`](gnp_plot::Clip) from which frame on, and
//! needs nothing of Rerun. With the feature `rerun`,
//! [`encode`] makes an `.rrd` file of them, which opens in the viewer of version [`VIEWER`].
//!
//! | entity | what |
//! |---|---|
//! | `/about` | the recording, the colours, the length of arrows |
//! | `/road/boundaries`, `/road/centre_lines` | lane lines |
//! | `/picked` | a ring of 30 m around the picked vehicle, which the eye follows |
//! | `/vehicles/ID` | the vehicle's box in every frame |
//! | `/forecasts/ID/history` | what the latest forecast saw of the vehicle |
//! | `/forecasts/ID/futures` | its paths, the prediction first, labelled by probability |
//! | `/forecasts/ID/forces/TERM` | accelerations along the prediction, by term of the force: `goal`, `neighbours`, `lines` |
//! | `/scalars/ID/speed` | m/s, recorded |
//! | `/scalars/ID/probability` | of each path |
//! | `/scalars/ID/TERM/PARAMETER` | parameters of the terms, of the prediction at that time: `goal/tau`, `neighbours/k`, `lines/k` |
//!
//! Times are on two timelines: `time`, the frame number divided by the frame rate, in s, and `frame`.
//! Space is the road frame in m: x forward, y to the left, z up and 0 throughout.

mod colour;
mod encode;
mod error;
#[cfg(feature = "rerun")]
mod file;
#[cfg(feature = "rerun")]
mod layout;
mod record;
mod records;
#[cfg(feature = "rerun")]
mod rrd;

pub use crate::colour::Colour;
pub use crate::encode::{CAN_ENCODE, VIEWER, encode};
pub use crate::error::ReplayError;
pub use crate::record::{Drawing, Record, Row};
pub use crate::records::{ARROW_M, RING_M, records};
