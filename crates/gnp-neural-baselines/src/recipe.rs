//! How a learned baseline is trained.

use gnp_train::{Schedule, TrainConfig};
use serde::{Deserialize, Serialize};

use crate::error::NeuralBaselineError;

/// How the manoeuvre probabilities are compared with the labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClassLoss {
    /// Not at all: for networks without manoeuvres.
    None,
    /// Binary cross-entropy of each class, averaged over classes (CS-LSTM(M), PiP).
    Binary,
    /// Categorical cross-entropy (STDAN).
    Categorical,
}

/// What one baseline is trained with. The published values stand beside each key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Epochs in which the mean squared error is minimised: 5; STDAN 6.
    pub warm_up_epochs: usize,
    /// Epochs after them in which the negative log-likelihood is: 3; PiP 10; STDAN 14.
    pub likelihood_epochs: usize,
    /// Windows in a mini-batch: 128; PiP 64.
    pub batch: usize,
    /// Windows drawn for an epoch; 0 takes all, as published.
    pub epoch_windows: usize,
    /// Adam's learning rate in the first epoch: 1e-3; STDAN 5e-4.
    pub learning_rate: f64,
    /// Factor on it after each epoch: 1; STDAN 0.6.
    pub decay: f64,
    /// Share of every weight that Adam takes off in a step, per unit of learning rate: 0.
    pub weight_decay: f64,
    /// Longest gradient, over all weights together: 10. 0 is off.
    pub clip_norm: f64,
    /// Share of training windows that are seen with left and right exchanged: 0.
    pub mirror: f64,
    /// How manoeuvre probabilities are learned.
    pub class_loss: ClassLoss,
    /// Whether they are from the first epoch on (STDAN) or only after the warm-up.
    pub class_loss_in_warm_up: bool,
    /// Length of the networks' unit, m: 0.3048, a foot. Futures are hundreds of feet, which takes as
    /// many steps of Adam to reach; a few thousand windows are learned from in a longer unit, such as 5.
    pub unit_m: f64,
    /// Vehicles around the ego that PiP fuses, the target among them: 8. 0 leaves the fusion out, as PiP's
    /// ablation does; networks without an ego do not read it.
    pub fused_targets: usize,
    /// Fixes the first weights and the order of the windows.
    pub seed: u64,
}

impl Recipe {
    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Recipe`] with the first key that cannot, and what to write instead;
    /// [`NeuralBaselineError::Train`] for keys that the training loop checks.
    pub fn check(&self) -> Result<(), NeuralBaselineError> {
        let positive = |value: f64| value.is_finite() && value > 0.;
        let refuse =
            |key, value: f64, remedy| Err(NeuralBaselineError::Recipe { key, value: value.to_string(), remedy });
        if self.epochs() == 0 {
            return refuse("likelihood_epochs", 0., "train for 1 epoch or more in all");
        }
        if !positive(self.decay) || self.decay > 1. {
            return refuse("decay", self.decay, "give a factor above 0 and at most 1, such as 1.0");
        }
        if !positive(self.unit_m) {
            return refuse("unit_m", self.unit_m, "give a length in m, such as 0.3048");
        }
        if !(0. ..=1.).contains(&self.mirror) {
            return refuse("mirror", self.mirror, "give a share between 0 (as published) and 1");
        }
        self.training().check().map_err(|error| NeuralBaselineError::Train(Box::new(error)))
    }

    /// Epochs in all.
    #[must_use]
    pub fn epochs(&self) -> usize {
        self.warm_up_epochs + self.likelihood_epochs
    }

    /// Configuration of the training loop.
    pub(crate) fn training(&self) -> TrainConfig {
        let schedule = if self.decay == 1. {
            Schedule::Constant {}
        } else {
            Schedule::Step { factor: self.decay, epochs: (1..self.epochs()).collect() }
        };
        TrainConfig {
            epochs: self.epochs(),
            batch: self.batch,
            epoch_windows: self.epoch_windows,
            site_sampling_exponent: 0.,
            learning_rate: self.learning_rate,
            schedule,
            weight_decay: self.weight_decay,
            clip_norm: self.clip_norm,
            patience: 0,
            seed: self.seed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "warm_up_epochs = 5\nlikelihood_epochs = 3\nbatch = 128\nepoch_windows = 0\nlearning_rate = 1e-3\n\
                        decay = 0.5\nweight_decay = 0.0\nclip_norm = 10.0\nmirror = 0.5\nclass_loss = \"binary\"\nclass_loss_in_warm_up = false\n\
                        unit_m = 0.3048\nfused_targets = 8\nseed = 1\n";

    fn parse(text: &str) -> Result<Recipe, String> {
        let recipe: Recipe = toml::from_str(text).map_err(|e| e.to_string())?;
        recipe.check().map_err(|e| e.to_string())?;
        Ok(recipe)
    }

    #[test]
    fn every_key_is_needed_and_bad_values_are_named() {
        let recipe = parse(GOOD).expect("the good one");
        let factor = |epoch| {
            let at = gnp_train::Position { epoch, epochs: 8, batch: 0, batches: 3 };
            recipe.training().schedule.factor(at)
        };
        assert_eq!([factor(0), factor(1), factor(7)], [1., 0.5, 0.5f64.powi(7)]);
        for line in GOOD.lines() {
            let key = line.split(' ').next().unwrap();
            assert!(parse(&GOOD.replace(line, "")).expect_err(line).contains(key), "{key}");
        }
        assert!(parse(&format!("{GOOD}momentum = 1\n")).is_err());
        for (good, bad, key) in [
            ("decay = 0.5", "decay = 0.0", "decay"),
            ("unit_m = 0.3048", "unit_m = -1.0", "unit_m"),
            ("batch = 128", "batch = 0", "batch"),
            ("mirror = 0.5", "mirror = 1.5", "mirror"),
            ("weight_decay = 0.0", "weight_decay = -1.0", "weight_decay"),
            ("warm_up_epochs = 5\nlikelihood_epochs = 3", "warm_up_epochs = 0\nlikelihood_epochs = 0", "epochs"),
        ] {
            assert!(parse(&GOOD.replace(good, bad)).expect_err(bad).contains(key), "{bad}");
        }
    }
}
