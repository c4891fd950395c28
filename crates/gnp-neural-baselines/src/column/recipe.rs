//! How the column network is trained.

use gnp_train::{Schedule, TrainConfig};
use serde::{Deserialize, Serialize};

use crate::error::NeuralBaselineError;

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
    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Recipe`] with the first key that cannot, and what to write instead;
    /// [`NeuralBaselineError::Train`] for keys that the training loop checks.
    pub fn check(&self) -> Result<(), NeuralBaselineError> {
        let refuse = |key, value: String, remedy| Err(NeuralBaselineError::Recipe { key, value, remedy });
        if self.networks == 0 {
            return refuse("networks", "0".to_owned(), "take 1 network or more");
        }
        if self.hidden == 0 {
            return refuse("hidden", "0".to_owned(), "give a layer 1 unit or more");
        }
        if !(0. ..1.).contains(&self.dropout) {
            return refuse("dropout", self.dropout.to_string(), "give a share from 0 to below 1");
        }
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
