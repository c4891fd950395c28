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

/// What a network's points are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutputForm {
    /// From where the vehicle was last seen, as published.
    Published,
    /// From the platoon's path, as GNP's are. How much of the mean deviation is believed is fitted to the validation
    /// part.
    Deviation,
}

/// What one baseline is trained with. The published values stand beside each key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Optimiser steps, rounded to whole passes over the training windows, one at the least. Published trainings are counted in passes over
    /// millions of windows: 8, PiP 15, STDAN 20.
    pub steps: usize,
    /// Share of the passes in which the mean squared error is minimised; in those after them the negative
    /// log-likelihood is: 5 of 8; PiP 5 of 15; STDAN 6 of 20.
    pub warm_up: f64,
    /// Windows in a mini-batch: 128; PiP 64.
    pub batch: usize,
    /// 0 draws windows alike, as published; 1 gives every site the same share. The validation score weighs likewise.
    pub site_sampling_exponent: f64,
    /// Adam's learning rate before the schedule: 1e-3; STDAN 5e-4.
    pub learning_rate: f64,
    /// How it changes: constant; for STDAN 0.6 after each epoch.
    pub schedule: Schedule,
    /// Share of every weight that Adam takes off in a step, per unit of learning rate: 0.
    pub weight_decay: f64,
    /// Longest gradient, over all weights together: 10. 0 is off.
    pub clip_norm: f64,
    /// Share of training windows that are seen with left and right exchanged: 0.
    pub mirror: f64,
    /// Largest factor on lengths along the road in training, either way: 1.
    pub longitudinal_scale: f64,
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
    /// Every number that is not of [`TrainConfig`]: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 6] = [
        ("steps", 1., 1e6, "steps"),
        ("warm_up", 0., 1., "of the passes (0: likelihood alone; 1: squared error alone)"),
        ("unit_m", 1e-3, 1e3, "m, such as 0.3048"),
        ("mirror", 0., 1., "of the windows (0: as published)"),
        ("longitudinal_scale", 1., 4., "(1: none)"),
        ("fused_targets", 0., 64., "vehicles (0: no fusion)"),
    ];

    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Recipe`] with the first key that cannot, and what to write instead;
    /// [`NeuralBaselineError::Train`] for keys that the training loop checks.
    pub fn check(&self) -> Result<(), NeuralBaselineError> {
        let values = [
            self.steps as f64,
            self.warm_up,
            self.unit_m,
            self.mirror,
            self.longitudinal_scale,
            self.fused_targets as f64,
        ];
        within(&Self::RANGES, &values)?;
        self.training(self.batch).check().map_err(|error| NeuralBaselineError::Train(Box::new(error)))
    }

    /// Passes over so many training windows, of which [`Recipe::warm_up_epochs`] come first.
    #[must_use]
    pub fn epochs(&self, windows: usize) -> usize {
        let batches = windows.div_ceil(self.batch.max(1)).max(1);
        ((self.steps as f64 / batches as f64).round() as usize).max(1)
    }

    /// Passes in which the squared error is minimised. At least one of likelihood follows, unless there is to be none.
    #[must_use]
    pub fn warm_up_epochs(&self, windows: usize) -> usize {
        let epochs = self.epochs(windows);
        let most = if self.warm_up >= 1. { epochs } else { epochs - 1 };
        ((self.warm_up * epochs as f64).round() as usize).min(most)
    }

    /// Configuration of the training loop on so many windows.
    pub(crate) fn training(&self, windows: usize) -> TrainConfig {
        TrainConfig {
            epochs: self.epochs(windows),
            batch: self.batch,
            epoch_windows: 0,
            site_sampling_exponent: self.site_sampling_exponent,
            learning_rate: self.learning_rate,
            schedule: self.schedule.clone(),
            weight_decay: self.weight_decay,
            clip_norm: self.clip_norm,
            patience: 0,
            seed: self.seed,
        }
    }
}

/// Refuses the first of `values` that is not in its range.
pub(crate) fn within(
    ranges: &[(&'static str, f64, f64, &'static str)],
    values: &[f64],
) -> Result<(), NeuralBaselineError> {
    for ((key, least, most, unit), value) in ranges.iter().zip(values) {
        if !(least..=most).contains(&value) {
            let remedy = format!("give a number from {least} to {most} {unit}");
            return Err(NeuralBaselineError::Recipe { key, value: value.to_string(), remedy });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "steps = 800\nwarm_up = 0.625\nbatch = 10\nsite_sampling_exponent = 0.5\nlearning_rate = 1e-3\n\
                        schedule = { kind = \"constant\" }\nweight_decay = 0.0\nclip_norm = 10.0\nmirror = 0.5\n\
                        longitudinal_scale = 1.2\nclass_loss = \"binary\"\nclass_loss_in_warm_up = false\n\
                        unit_m = 0.3048\nfused_targets = 8\nseed = 1\n";

    fn parse(text: &str) -> Result<Recipe, String> {
        let recipe: Recipe = toml::from_str(text).map_err(|e| e.to_string())?;
        recipe.check().map_err(|e| e.to_string())?;
        Ok(recipe)
    }

    #[test]
    fn a_budget_of_steps_is_a_number_of_passes() {
        let recipe = parse(GOOD).expect("the good one");
        let passes = |recipe: &Recipe, windows| (recipe.epochs(windows), recipe.warm_up_epochs(windows));
        assert_eq!(passes(&recipe, 1000), (8, 5));
        assert_eq!(passes(&recipe, 995), (8, 5), "a last batch that is not full is a step");
        assert_eq!(passes(&recipe, 100_000), (1, 0), "likelihood trains the spreads, so that it is not left out");
        assert_eq!(passes(&Recipe { warm_up: 1., ..recipe.clone() }, 1000), (8, 8));
        assert_eq!(passes(&Recipe { warm_up: 0., ..recipe }, 1000), (8, 0));
    }

    #[test]
    fn every_key_is_needed_and_bad_values_are_named() {
        for line in GOOD.lines() {
            let key = line.split(' ').next().unwrap();
            assert!(parse(&GOOD.replace(line, "")).expect_err(line).contains(key), "{key}");
        }
        assert!(parse(&format!("{GOOD}momentum = 1\n")).is_err());
        for (good, bad, key) in [
            ("steps = 800", "steps = 0", "steps"),
            ("steps = 800", "steps = 1000000000000", "steps"),
            ("batch = 10", "batch = 100000000000", "batch"),
            ("fused_targets = 8", "fused_targets = 1000000", "fused_targets"),
            ("unit_m = 0.3048", "unit_m = inf", "unit_m"),
            ("warm_up = 0.625", "warm_up = 1.5", "warm_up"),
            ("site_sampling_exponent = 0.5", "site_sampling_exponent = -1.0", "site_sampling_exponent"),
            ("unit_m = 0.3048", "unit_m = -1.0", "unit_m"),
            ("batch = 10", "batch = 0", "batch"),
            ("mirror = 0.5", "mirror = 1.5", "mirror"),
            ("longitudinal_scale = 1.2", "longitudinal_scale = 0.8", "longitudinal_scale"),
            ("weight_decay = 0.0", "weight_decay = -1.0", "weight_decay"),
        ] {
            assert!(parse(&GOOD.replace(good, bad)).expect_err(bad).contains(key), "{bad}");
        }
    }
}
