//! Prediction while vehicles drive: one frame of tracks in, for every vehicle its likely paths out.
//!
//! A [`Stream`] remembers the last seconds of every vehicle of one carriageway. Each [`Stream::push`] takes the vehicles
//! that were detected at one time and gives, for each of them, K paths with probabilities, the forces behind them where
//! the model is [explaining](gnp_model::Gnp::explaining), and a [`Validity`] that says what the forecast rests on.
//!
//! ```no_run
//! # fn example(gnp: &gnp_model::Gnp) -> Result<(), gnp_online::OnlineError> {
//! use gnp_data::LaneMarking;
//! use gnp_online::{Stream, StreamConfig, Tracked};
//!
//! let lines = [0., 3.7, 7.4].map(|y| LaneMarking::new(y, y != 3.7)); // two lanes, from right to left
//! let mut stream = Stream::new(gnp, lines.to_vec(), StreamConfig::default())?;
//! for i in 0..100 {
//!     let time_s = 0.04 * f64::from(i);
//!     let tracks = [Tracked::new(17, [30. * time_s, 1.8]), Tracked::new(4, [40. + 28. * time_s, 5.6])];
//!     for vehicle in stream.push(time_s, &tracks)?.vehicles() {
//!         println!("{}: {:?}, probably at {:?}", vehicle.id(), vehicle.validity(), vehicle.path(0).last());
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # What goes in
//!
//! - **Coordinates** are yours: m, in one fixed plane, not one that moves with a vehicle. Without a road line x must be
//!   forward along the road and y to the left, within 131 km of the origin; with one ([`StreamConfig::road`]) the
//!   plane is any, and lane lines are given by their distance to the left of that line.
//! - **Lane lines** are at least two, from right to left, lanes up to 8 m wide: wider ones look like feet and are an error.
//!   There is no prediction without lines, since neighbours follow from lanes: where none are known, lines 3.7 m apart
//!   around the traffic do. They can be moved while driving ([`Stream::set_lines`]). Vehicles outside the lines are
//!   predicted without neighbours. Oncoming traffic belongs into a stream of its own.
//! - **Times** are s from any start, each after the one before; frames may come at any rate and irregularly. Positions are
//!   interpolated to the times that the model needs, which end at the time of the frame; a sample that lies on such a
//!   time enters as it is. Frames faster than the model's are as good as those at its rate.
//! - **Velocities** may be given with any sample, from measurements up to its time; where they are not, they are
//!   differences of positions.
//! - **Sizes** may be given; the last one given counts, before that the one of the class ([`default_size`](gnp_data::VehicleClass::default_size)).
//!
//! # What happens when
//!
//! - **a vehicle is new**: what is missing of its past is filled at constant velocity: [`Validity::Filled`]. After one
//!   position without a velocity it is not predicted yet: [`Reason::NoVelocity`]. [`Snapshot`](gnp_data::Snapshot) has the
//!   rule, which is that of `gnp predict`, too.
//! - **a vehicle is missing in a frame**: it is taken to go on as it went for [`StreamConfig::coast_s`], is predicted and
//!   is a neighbour; [`Vehicle::age_s`] says since when it was not seen.
//! - **it comes back** within [`StreamConfig::bridge_s`]: the gap is interpolated, [`Validity::Interpolated`]. After that
//!   time it is forgotten, and starts anew.
//! - **an id jumps** by more than 100 m/s and 5 m: it is another vehicle, and starts anew.
//! - **a track is bad** (not finite, twice in the frame, off the road, beyond [`StreamConfig::max_vehicles`]): it is left
//!   out and reported ([`Frame::problems`]), the vehicle counts as missing, and all others are predicted. Of one with a
//!   velocity or a size that cannot be the position is used, and that is reported, too.
//! - **time does not grow**: the frame is refused by an error, and the stream stays as it was.
//!
//! Whatever comes in, nothing panics and every number that comes out is finite. A stream is used by one thread at a time;
//! many streams may share one model.

mod config;
mod error;
mod frame;
mod samples;
mod stream;
mod tracked;
mod vehicles;

pub use crate::config::StreamConfig;
pub use crate::error::{OnlineError, Reason};
pub use crate::frame::{Frame, Problem, Validity, Vehicle};
pub use crate::stream::Stream;
pub use crate::tracked::Tracked;
