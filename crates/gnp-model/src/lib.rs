//! GNP as one predictor: observed windows in, goals, paths and the forces behind them out.
//!
//! [`Gnp::open`] reads a model folder, [`ModelFolder`], and [`Gnp::load`] the same weights (modes, goal network, social
//! force) of a run folder; both give a [`gnp_data::Predictor`]. [`Features`] turns windows into what the networks take, the same for
//! training and prediction. [`Gnp::predict_into`] predicts frame after frame on the caller's thread without allocations.
//! [`Gnp::without_terms`] switches terms of the force off. [`Checkpoint`] is the file format of the weights.

mod augmented_view;
mod card;
mod checkpoint;
mod contributions;
mod error;
mod features;
mod folder;
mod following;
mod forecasts;
mod gnp;
mod joint;
mod precision;
mod predict_into;
mod rows;
mod scene;
mod select;
mod situation;
mod terms;
mod trust;
mod variants;

pub use crate::augmented_view::{AugmentedNeighbour, AugmentedView};
pub use crate::card::{
    CardScore, CardScores, CardWindows, CardWords, ModelCard, PredictSettings, TrainingData, TrainingRecord,
};
pub use crate::checkpoint::{Checkpoint, Component, Header, Origin};
pub use crate::error::ModelError;
pub use crate::features::{FeatureConfig, Features, GoalInputs, Representation, SeenNeighbours};
pub use crate::folder::ModelFolder;
pub use crate::forecasts::{Forecasts, TermTotals};
pub use crate::gnp::Gnp;
pub use crate::predict_into::Workspace;
pub use crate::scene::{NeighbourFuture, NeighbourInput};
pub use crate::select::Selection;
pub use crate::situation::{ReferencePath, Situation};
pub use crate::trust::Trust;
pub use crate::variants::{GoalHead, Oracle, TrueGoal};
pub use candle_core::Device;
pub use gnp_nn::{Precision, PrecisionError};
