//! Learned baselines: published networks rebuilt layer by layer, so that one table can hold them to
//! the same windows and the same metrics as GNP.
//!
//! S-LSTM, CS-LSTM and CS-LSTM(M) (Deo and Trivedi 2018), PiP (Song et al. 2020) and STDAN (Chen et
//! al. 2022). Shared parts exist once: grids of neighbours, the path encoder, Gaussian heads,
//! pooling whose gradient is right, and one training by [`Recipe`]. [`Learned`] is any of them behind
//! [`gnp_data::Predictor`]; only [`LearnedKind::PipInformed`] is ever handed a recorded future.

mod cell;
mod checkpoint;
mod clock;
mod conv;
mod cslstm;
mod encoder;
mod error;
mod gauss;
mod grid;
mod inputs;
mod kind;
mod learned;
mod manoeuvre;
mod net;
mod network;
mod norm;
mod pip;
mod pooling;
mod recipe;
mod rows;
mod seen;
mod sequence;
mod slstm;
mod stage;
mod stdan;
#[cfg(test)]
mod tests;
mod train;

pub use crate::checkpoint::Header;
pub use crate::error::LearnedError;
pub use crate::kind::LearnedKind;
pub use crate::learned::{Informed, Learned};
pub use crate::recipe::{ClassLoss, Recipe};
pub use crate::train::Training;
