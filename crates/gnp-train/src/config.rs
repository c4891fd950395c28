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
    /// Whether every value can be used.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the first key that cannot, and what to write instead.
    pub fn check(&self) -> Result<(), TrainError> {
        let positive = |x: f64| x.is_finite() && x > 0.;
        let not_negative = |x: f64| x.is_finite() && x >= 0.;
        let refuse = |key, value: String, remedy| Err(TrainError::Config { key, value, remedy });
        if self.epochs == 0 {
            return refuse("epochs", "0".into(), "train for 1 epoch or more");
        }
        if self.batch == 0 {
            return refuse("batch", "0".into(), "put 1 window or more in a mini-batch");
        }
        if !(0. ..=1.).contains(&self.site_sampling_exponent) {
            let remedy = "give a number between 0 (every window alike) and 1 (every site alike)";
            return refuse("site_sampling_exponent", self.site_sampling_exponent.to_string(), remedy);
        }
        if !positive(self.learning_rate) {
            return refuse("learning_rate", self.learning_rate.to_string(), "give a number above 0, such as 1e-4");
        }
        if !not_negative(self.weight_decay) {
            return refuse("weight_decay", self.weight_decay.to_string(), "give 0 (off) or a number above 0");
        }
        if !not_negative(self.clip_norm) {
            return refuse("clip_norm", self.clip_norm.to_string(), "give 0 (off) or a number above 0");
        }
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
