//! Everything that a run needs to go on from where it stopped.

use std::collections::BTreeMap;

use candle_core::Tensor;
use serde::{Deserialize, Serialize};

use crate::config::TrainConfig;
use crate::history::EpochRecord;

/// A snapshot of a run: weights, moments of Adam, and the place in the training. All tensors are
/// copies on the CPU.
#[derive(Clone, Debug)]
pub struct TrainingState {
    /// Trained weights by name. Frozen ones are not here; the checkpoint adds them.
    pub weights: BTreeMap<String, Tensor>,
    /// First moments of Adam, under the names of the weights.
    pub first: BTreeMap<String, Tensor>,
    /// Second moments of Adam, under the names of the weights.
    pub second: BTreeMap<String, Tensor>,
    /// The place in the training.
    pub progress: Progress,
}

/// The place in the training. Every number of it survives JSON exactly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Name of the stage.
    pub stage: String,
    /// Configuration of the run.
    pub config: TrainConfig,
    /// Number of training windows.
    pub train_windows: usize,
    /// Finished epochs, validation included.
    pub epoch: usize,
    /// Steps of the optimiser so far.
    pub steps: u64,
    /// Losses of the mini-batches that the epoch under way has behind it; empty between epochs.
    pub losses: Vec<f32>,
    /// The best epoch so far.
    pub best: Option<Best>,
    /// Finished epochs in order.
    pub history: Vec<EpochRecord>,
}

impl Progress {
    /// Epochs since the best one.
    #[must_use]
    pub fn waited(&self) -> usize {
        self.best.map_or(0, |best| self.epoch - best.epoch.min(self.epoch))
    }

    /// Whether `scores`, as a checkpoint has them, are those of the validation after `epoch`, from 1. Weights of another
    /// training score otherwise in the last bit.
    #[must_use]
    pub fn scored(&self, epoch: usize, scores: &BTreeMap<String, f64>) -> bool {
        let Some(record) = epoch.checked_sub(1).and_then(|at| self.history.get(at)) else { return false };
        // An f64 may lose its last bit in JSON, an f32 in an f64 none of its own.
        let same = |name: &String, value: f32| scores.get(name).is_some_and(|score| *score as f32 == value);
        record.validation.len() == scores.len() && record.validation.iter().all(|score| same(&score.name, score.value))
    }
}

/// The best epoch of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// The epoch, from 1.
    pub epoch: usize,
    /// Its first validation score.
    pub score: f32,
}

/// Which checkpoint a state is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckpointSlot {
    /// The epoch with the lowest validation score: what is used afterwards.
    Best,
    /// Where the run stands: what it is resumed from.
    Last,
}

impl CheckpointSlot {
    /// `best` or `last`: the stem of a file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Best => "best",
            Self::Last => "last",
        }
    }
}

/// Where checkpoints go. The loop knows nothing of files.
pub trait Sink {
    /// Keeps `state`, in the place of an earlier one of the same kind.
    ///
    /// # Errors
    /// Whatever keeps it from being written.
    fn save(
        &mut self,
        kind: CheckpointSlot,
        state: &TrainingState,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

impl<S: Sink + ?Sized> Sink for &mut S {
    fn save(
        &mut self,
        kind: CheckpointSlot,
        state: &TrainingState,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        (**self).save(kind, state)
    }
}

const FIRST: &str = "trainer.first.";
const SECOND: &str = "trainer.second.";

impl TrainingState {
    /// All tensors under one set of names, for a file: weights under their own names, moments
    /// under `trainer.first.` and `trainer.second.` and the weight's name.
    #[must_use]
    pub fn tensors(&self) -> BTreeMap<String, Tensor> {
        let under = |prefix: &'static str, of: &BTreeMap<String, Tensor>| {
            of.iter().map(move |(name, tensor)| (format!("{prefix}{name}"), tensor.clone())).collect::<Vec<_>>()
        };
        let parts = [under("", &self.weights), under(FIRST, &self.first), under(SECOND, &self.second)];
        parts.into_iter().flatten().collect()
    }

    /// The state whose [`TrainingState::tensors`] and progress these are. Weights that were not trained may
    /// be among `tensors`: only those that have moments are taken.
    #[must_use]
    pub fn from_tensors(tensors: &BTreeMap<String, Tensor>, progress: Progress) -> Self {
        let under = |prefix: &str| -> BTreeMap<String, Tensor> {
            let named = tensors.iter().filter_map(|(name, tensor)| Some((name.strip_prefix(prefix)?, tensor)));
            named.map(|(name, tensor)| (name.to_owned(), tensor.clone())).collect()
        };
        let (first, second) = (under(FIRST), under(SECOND));
        let trained = tensors.iter().filter(|(name, _)| first.contains_key(*name));
        let weights = trained.map(|(name, tensor)| (name.clone(), tensor.clone())).collect();
        Self { weights, first, second, progress }
    }
}
