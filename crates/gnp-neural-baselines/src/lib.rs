//! Neural baselines: published networks rebuilt layer by layer, so that one table can hold them to
//! the same windows and the same metrics as GNP.
//!
//! S-LSTM, CS-LSTM and CS-LSTM(M) (Deo and Trivedi 2018), PiP (Song et al. 2020) and STDAN (Chen et
//! al. 2022). Shared parts exist once: grids of neighbours, the path encoder, Gaussian heads,
//! pooling whose gradient is right, and one training by [`Recipe`]. [`TrainedBaseline`] is any of them behind
//! [`gnp_data::Predictor`]; only [`NeuralBaseline::PipInformed`] is ever handed a recorded future.
//! [`ColumnNetwork`] is not published: a small network that looks at the column of leaders alone, the learned rule
//! that a larger model must beat.

mod checkpoint;
mod column;
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
mod oriented_view;
mod pip;
mod pooling;
mod recipe;
mod rows;
mod slstm;
mod stage;
mod stdan;
#[cfg(test)]
mod tests;
mod time_grid;
mod train;

pub use crate::checkpoint::Header;
pub use crate::column::{ColumnHeader, ColumnNetwork, ColumnRecipe};
pub use crate::error::NeuralBaselineError;
pub use crate::kind::NeuralBaseline;
pub use crate::learned::{TrainedBaseline, WithFuture};
pub use crate::recipe::{ClassLoss, OutputForm, Recipe};
pub use crate::train::Training;
