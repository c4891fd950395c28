//! Training: one loop for every network of GNP, with exact resume.
//!
//! [`GoalStage`] trains the goal network, [`PathStage`] the attraction and then the repulsion of
//! the social force. A [`Stage`] knows its weights, its windows and its loss; [`Trainer`] knows
//! epochs, mini-batches, Adam, schedules, validation, early stopping and checkpoints, and nothing
//! of windows. Checkpoints leave through a [`Sink`], which [`Checkpoints`] is for a run folder;
//! progress leaves through an [`Observer`], which [`EventWriter`] is for TensorBoard.
//!
//! Every draw (order of the windows, dropout, noise) is fixed by `(seed, epoch)` or `(seed, step)`,
//! so that a run that was stopped and resumed from its last [`TrainingState`] ends with the weights, bit
//! for bit, of one that never stopped.
//!
//! ```
//! use std::{collections::BTreeMap, sync::atomic::AtomicBool};
//! use candle_core::{Device, Tensor, Var};
//! use gnp_train::{BatchTotals, CheckpointSlot, Part, Schedule, Sink, Stage, TrainConfig, TrainError, Trainer, TrainingState};
//!
//! struct Offset(Var); // learns the number 3
//! impl Offset {
//!     fn error(&self) -> candle_core::Result<Tensor> {
//!         (self.0.as_tensor() - 3.)?.sqr()?.mean_all()
//!     }
//! }
//! impl Stage for Offset {
//!     fn name(&self) -> &'static str { "offset" }
//!     fn trainable(&self) -> BTreeMap<String, Var> { [("offset".to_owned(), self.0.clone())].into() }
//!     fn train_len(&self) -> usize { 20 }
//!     fn validation_len(&self) -> usize { 4 }
//!     fn loss(&self, _: Part<'_>) -> Result<Tensor, TrainError> { Ok(self.error()?) }
//!     fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
//!         let error = f64::from(self.error()?.to_scalar::<f32>()?);
//!         Ok(BatchTotals::new(batch.len(), [("squared_error", error * batch.len() as f64)]))
//!     }
//! }
//!
//! struct Forget;
//! impl Sink for Forget {
//!     fn save(&mut self, _: CheckpointSlot, _: &TrainingState) -> Result<(), Box<dyn std::error::Error + Send + Sync>> { Ok(()) }
//! }
//!
//! let config = TrainConfig {
//!     epochs: 30, batch: 5, epoch_windows: 0, site_sampling_exponent: 0., learning_rate: 0.1,
//!     schedule: Schedule::Constant {}, weight_decay: 0., clip_norm: 0., patience: 0, seed: 1,
//! };
//! let stage = Offset(Var::new(&[0f32], &Device::Cpu)?);
//! let stop = AtomicBool::new(false);
//! let outcome = Trainer { config: &config, sink: Forget, observer: (), stop: &stop }.fit(&stage)?;
//! assert!(outcome.progress.history[29].validation[0].value < 0.01);
//! # Ok::<(), TrainError>(())
//! ```

mod checkpoints;
mod config;
mod error;
mod events;
mod fit;
mod history;
mod observer;
mod optimiser;
mod parts;
mod schedule;
mod seed;
mod stage;
mod stages;
mod state;

pub use crate::checkpoints::Checkpoints;
pub use crate::config::TrainConfig;
pub use crate::error::TrainError;
pub use crate::events::EventWriter;
pub use crate::fit::{End, Outcome, Trainer};
pub use crate::history::{EpochRecord, History, ValidationScore};
pub use crate::observer::{BatchReport, EpochReport, Observer, Plan};
pub use crate::optimiser::{Adam, Step};
pub use crate::schedule::{Position, Schedule};
pub use crate::seed::derive_seed;
pub use crate::stage::{BatchTotals, Part, Stage};
pub use crate::stages::{GoalStage, GoalTraining, PathStage, PathTraining, Windows};
pub use crate::state::{Best, CheckpointSlot, Progress, Sink, TrainingState};
