//! Training: one loop for every network of GNP, with exact resume.
//!
//! [`GoalStage`] trains the goal network, [`PathStage`] the attraction and then the repulsion of the
//! social force. A [`Stage`] knows its weights, its windows and its loss; [`Trainer`] knows epochs, mini-batches,
//! Adam, schedules, validation, early stopping and checkpoints, and nothing of windows. Checkpoints
//! leave through a [`Sink`], progress through an [`Observer`]; [`EventWriter`] is an observer that
//! TensorBoard reads.
//!
//! Every draw (order of the windows, dropout, noise) is fixed by `(seed, epoch)` or `(seed, step)`,
//! so that a run that was stopped and resumed from its last [`State`] ends with the weights, bit
//! for bit, of one that never stopped.

mod config;
mod error;
mod events;
mod fit;
mod history;
mod observer;
mod optimiser;
mod schedule;
mod seed;
mod stage;
mod stages;
mod state;

pub use crate::config::TrainConfig;
pub use crate::error::TrainError;
pub use crate::events::EventWriter;
pub use crate::fit::{End, Outcome, Trainer};
pub use crate::history::{EpochRecord, History, Score};
pub use crate::observer::{BatchReport, EpochReport, Observer, Plan};
pub use crate::optimiser::{Adam, Step};
pub use crate::schedule::{Position, Schedule};
pub use crate::seed::mix;
pub use crate::stage::{Stage, Sums};
pub use crate::stages::{GoalStage, GoalTraining, PathStage, PathTraining, Windows};
pub use crate::state::{Best, Kind, Progress, Sink, State};
