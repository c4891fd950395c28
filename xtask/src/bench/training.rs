//! Training as the product does it: the loop with its parts of a batch and its optimiser, on the goal network.

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use candle_core::{Tensor, Var};
use gnp_train::{
    BatchTotals, CheckpointSlot, Part, Schedule, Sink, Stage, TrainConfig, TrainError, Trainer, TrainingState,
};

use super::networks::Goal;

/// Windows of a part, as the stage of the goal network has them.
const PART: usize = 16;

/// An epoch of one step with all windows of the network's batch.
///
/// # Errors
/// When the network fails.
pub(super) fn step(goal: &Goal) -> Result<()> {
    let config = TrainConfig {
        epochs: 1,
        batch: goal.windows(),
        epoch_windows: 0,
        site_sampling_exponent: 0.,
        // The weights stay as they are in f32, so that every repeat does the same.
        learning_rate: 1e-12,
        schedule: Schedule::Constant {},
        weight_decay: 0.,
        clip_norm: 1.,
        patience: 0,
        seed: 1,
    };
    Trainer { config: &config, sink: Nowhere, observer: (), stop: &AtomicBool::new(false) }.fit(&Training(goal))?;
    Ok(())
}

struct Training<'a>(&'a Goal);

impl Stage for Training<'_> {
    fn name(&self) -> &'static str {
        "goal"
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        self.0.weights()
    }

    fn train_len(&self) -> usize {
        self.0.windows()
    }

    fn validation_len(&self) -> usize {
        1
    }

    fn part_windows(&self) -> Option<usize> {
        Some(PART)
    }

    fn loss(&self, part: Part<'_>) -> Result<Tensor, TrainError> {
        let windows: Vec<u32> = part.windows.iter().map(|window| *window as u32).collect();
        Ok(self.0.loss_of(&windows)?)
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        Ok(BatchTotals::new(batch.len(), [("loss", 0.)]))
    }
}

struct Nowhere;

impl Sink for Nowhere {
    fn save(&mut self, _: CheckpointSlot, _: &TrainingState) -> Result<(), Box<dyn Error + Send + Sync>> {
        Ok(())
    }
}
