//! How the column network is trained.

use gnp_train::{Schedule, TrainConfig};
use serde::{Deserialize, Serialize};

use crate::error::NeuralBaselineError;
use crate::recipe::within;

/// Form and training of a [`ColumnNetwork`](crate::ColumnNetwork).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnRecipe {
    /// Networks from each of the two references, alike but for their seeds.
    pub networks: usize,
    /// Units of each of the two hidden layers.
    pub hidden: usize,
    /// Share of hidden units that is dropped in training.
    pub dropout: f64,
    /// Passes over the training windows; the learning rate falls along half a cosine over them.
    pub epochs: usize,
    /// Windows in a mini-batch.
    pub batch: usize,
    /// Adam's learning rate in the first step.
    pub learning_rate: f64,
    /// Share of every weight that Adam takes off in a step, per unit of learning rate.
    pub weight_decay: f64,
    /// Fixes first weights, dropout and order of windows.
    pub seed: u64,
}

impl ColumnRecipe {
    /// Every number that is not of [`TrainConfig`]: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 3] =
        [("networks", 1., 100., "networks"), ("hidden", 1., 8192., "units"), ("dropout", 0., 0.95, "of the units")];

    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Recipe`] with the first key that cannot, and what to write instead;
    /// [`NeuralBaselineError::Train`] for keys that the training loop checks.
    pub fn check(&self) -> Result<(), NeuralBaselineError> {
        within(&Self::RANGES, &[self.networks as f64, self.hidden as f64, self.dropout])?;
        self.training(0).check().map_err(|error| NeuralBaselineError::Train(Box::new(error)))
    }

    /// Configuration of the training loop for one network.
    pub(super) fn training(&self, seed: u64) -> TrainConfig {
        TrainConfig {
            epochs: self.epochs,
            batch: self.batch,
            epoch_windows: 0,
            site_sampling_exponent: 0.,
            learning_rate: self.learning_rate,
            schedule: Schedule::Cosine { warm_up: 0., floor: 0. },
            weight_decay: self.weight_decay,
            clip_norm: 0.,
            patience: 0,
            seed,
        }
    }
}
