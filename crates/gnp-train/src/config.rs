//! Configuration of a training.

use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::schedule::Schedule;

/// How a stage is trained; one table of the configuration a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Passes over the training windows.
    pub epochs: usize,
    /// Windows in a mini-batch; the last one of an epoch may be smaller.
    pub batch: usize,
    /// Windows drawn for an epoch, without repetition; 0 takes all of them.
    pub epoch_windows: usize,
    /// How much sites count alike instead of windows: a window is drawn with a probability in
    /// proportion to its site's number of windows to the power of minus this, with repetition, and
    /// validation scores weigh windows so, too. 0 draws every window once an epoch; 1 gives every
    /// site the same share.
    pub site_sampling_exponent: f64,
    /// Adam's learning rate before the schedule.
    pub learning_rate: f64,
    /// How the learning rate changes over the epochs.
    pub schedule: Schedule,
    /// Decoupled weight decay a step, times the learning rate; 0 is plain Adam.
    pub weight_decay: f64,
    /// Largest Euclidean norm of the whole gradient; longer ones are shortened to it. 0 is off.
    pub clip_norm: f64,
    /// Epochs without a better validation score after which training stops; 0 is off.
    pub patience: usize,
    /// Fixes the order of the windows and everything that a stage draws.
    pub seed: u64,
}

impl TrainConfig {
    /// Every number but those of the schedule: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 9] = [
        ("epochs", 1., 1e6, "passes"),
        // The activations of a batch are all in memory.
        ("batch", 1., 65_536., "windows"),
        ("epoch_windows", 0., 1e9, "windows (0: all)"),
        ("site_sampling_exponent", 0., 1., "(0: every window alike; 1: every site alike)"),
        ("learning_rate", 1e-12, 10., "(1e-3 is usual)"),
        ("weight_decay", 0., 100., "(0: off)"),
        ("clip_norm", 0., 1e6, "(0: off)"),
        ("patience", 0., 1e6, "passes (0: off)"),
        // The largest number of TOML.
        ("seed", 0., i64::MAX as f64, ""),
    ];

    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the first key that cannot, and what to write instead.
    pub fn check(&self) -> Result<(), TrainError> {
        let values = [
            self.epochs as f64,
            self.batch as f64,
            self.epoch_windows as f64,
            self.site_sampling_exponent,
            self.learning_rate,
            self.weight_decay,
            self.clip_norm,
            self.patience as f64,
        ];
        // Seeds are added to each other and wrap around: each can be used.
        within(&Self::RANGES, &values)?;
        self.schedule.check(self.epochs)
    }

    /// The first key in which a run with `self` would not continue one with `saved` exactly. More
    /// or fewer epochs are allowed unless the schedule stretches over them.
    pub(crate) fn difference(&self, saved: &Self) -> Option<String> {
        let epochs = if self.schedule.depends_on_epochs() { self.epochs } else { saved.epochs };
        let pairs = [
            ("epochs", epochs.to_string(), saved.epochs.to_string()),
            ("batch", self.batch.to_string(), saved.batch.to_string()),
            ("epoch_windows", self.epoch_windows.to_string(), saved.epoch_windows.to_string()),
            (
                "site_sampling_exponent",
                self.site_sampling_exponent.to_string(),
                saved.site_sampling_exponent.to_string(),
            ),
            ("learning_rate", self.learning_rate.to_string(), saved.learning_rate.to_string()),
            ("schedule", format!("{:?}", self.schedule), format!("{:?}", saved.schedule)),
            ("weight_decay", self.weight_decay.to_string(), saved.weight_decay.to_string()),
            ("clip_norm", self.clip_norm.to_string(), saved.clip_norm.to_string()),
            ("seed", self.seed.to_string(), saved.seed.to_string()),
        ];
        let (key, now, then) = pairs.into_iter().find(|(_, now, then)| now != then)?;
        Some(format!("`{key}` is {now} and was {then}"))
    }
}

/// Refuses the first of `values` that is not in its range; those of `ranges` that have no value here are not looked at.
pub(crate) fn within(ranges: &[(&'static str, f64, f64, &'static str)], values: &[f64]) -> Result<(), TrainError> {
    for ((key, least, most, unit), value) in ranges.iter().zip(values) {
        if !(least..=most).contains(&value) {
            let remedy = format!("give a number from {least} to {most} {unit}").trim_end().to_owned();
            return Err(TrainError::Config { key, value: value.to_string(), remedy });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "epochs = 7\nbatch = 3\nepoch_windows = 0\nsite_sampling_exponent = 0.0\nlearning_rate = 1e-4\nschedule = { kind = \"constant\" }\n\
                        weight_decay = 0.0\nclip_norm = 1.0\npatience = 2\nseed = 5\n";

    fn parse(text: &str) -> Result<TrainConfig, String> {
        let config: TrainConfig = toml::from_str(text).map_err(|e| e.to_string())?;
        config.check().map_err(|e| e.to_string())?;
        Ok(config)
    }

    #[test]
    fn every_key_is_needed_and_no_other_is_known() {
        parse(GOOD).expect("the good one");
        for line in GOOD.lines() {
            let without = GOOD.replace(line, "");
            let key = line.split(' ').next().unwrap();
            assert!(parse(&without).expect_err(line).contains(key), "{key}");
        }
        assert!(parse(&format!("{GOOD}momentum = 1\n")).expect_err("unknown").contains("momentum"));
    }

    #[test]
    fn a_bad_value_is_refused_by_its_key() {
        let cases = [
            ("epochs = 7", "epochs = 0", "epochs"),
            ("batch = 3", "batch = 0", "batch"),
            ("site_sampling_exponent = 0.0", "site_sampling_exponent = 1.5", "site_sampling_exponent"),
            ("learning_rate = 1e-4", "learning_rate = 0.0", "learning_rate"),
            ("learning_rate = 1e-4", "learning_rate = nan", "learning_rate"),
            ("weight_decay = 0.0", "weight_decay = -1.0", "weight_decay"),
            ("clip_norm = 1.0", "clip_norm = inf", "clip_norm"),
        ];
        for (good, bad, key) in cases {
            let message = parse(&GOOD.replace(good, bad)).expect_err(bad);
            assert!(message.starts_with(key), "{bad}: {message}");
        }
    }

    #[test]
    fn only_more_epochs_and_another_patience_continue_a_run() {
        let saved = parse(GOOD).unwrap();
        let longer = TrainConfig { epochs: 9, patience: 0, ..saved.clone() };
        assert_eq!(longer.difference(&saved), None);
        let faster = TrainConfig { learning_rate: 1e-3, ..saved.clone() };
        assert_eq!(faster.difference(&saved).as_deref(), Some("`learning_rate` is 0.001 and was 0.0001"));
        let cosine =
            |epochs| TrainConfig { epochs, schedule: Schedule::Cosine { warm_up: 1., floor: 0. }, ..saved.clone() };
        assert_eq!(cosine(9).difference(&cosine(7)).as_deref(), Some("`epochs` is 9 and was 7"));
    }
}
