//! The form of the network.

use serde::{Deserialize, Serialize};

use crate::error::GoalError;

/// The form of the network: the network's part of a configuration's `[goal]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalConfig {
    /// Width `D` of a token; 64 in the paper.
    pub width: usize,
    /// Attention heads, a divisor of the width; 4 in the paper.
    pub heads: usize,
    /// Encoder layers; 2 in the paper.
    pub layers: usize,
    /// Hidden units of a feed-forward part, as a multiple of the width; 2 in the paper.
    pub feed_forward: usize,
    /// Share of values dropped in training, after each attention and each feed-forward part, before
    /// they are added; 0.1 in the paper. Who trains makes the `gnp_nn::Dropout` of this rate.
    pub dropout: f32,
    /// Where modes get their probability.
    pub probability: ProbabilityHead,
    /// What the goal head gives.
    pub regression: Regression,
    /// Whether the decoder has one more, learned key that is always there, so that a vehicle alone
    /// attends to something and one among others may attend to no one.
    pub null_token: bool,
    /// Whether each neighbour slot adds its own learned vector, so that the network knows who is
    /// ahead and who is beside. Otherwise the order of the neighbours does not matter.
    pub slot_embedding: bool,
    /// Whether both heads start at 0: every mode equally likely and its own future, so that what the network says beyond
    /// that is what it has learned. Off in the paper.
    pub zero_start: bool,
}

/// Where modes get their probability.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbabilityHead {
    /// From the encoder, before any neighbour is seen; only the modes picked are decoded. The
    /// published form.
    Encoder,
    /// From the decoder: every mode is decoded, and its probability knows the neighbours.
    Decoder,
}

/// What the goal head gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Regression {
    /// The future itself. The published form.
    Absolute,
    /// The future's difference from the mode's centre.
    Residual,
}

/// Sizes that come from the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GoalShape {
    /// Values of a flattened observation.
    pub observed: usize,
    /// Values of a neighbour's flattened track.
    pub neighbour: usize,
    /// Neighbour slots `N`.
    pub slots: usize,
    /// Predicted frames `T_p`.
    pub t_pred: usize,
}

impl GoalConfig {
    /// Every number: key, least, most, unit. What is larger is a slip of the keyboard and would end in a failed
    /// allocation.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 5] = [
        ("width", 1., 8192., "units"),
        ("heads", 1., 256., "heads"),
        ("layers", 0., 128., "layers"),
        ("feed_forward", 1., 64., "times the width"),
        ("dropout", 0., 0.95, "of the values"),
    ];

    /// # Errors
    /// When a setting is out of range; the message names the key and the remedy.
    pub fn check(&self) -> Result<(), GoalError> {
        let wrong = |key, value: String, remedy| Err(GoalError::Setting { key, value, remedy });
        let sizes = [self.width, self.heads, self.layers, self.feed_forward].map(|size| size as f64);
        let values = sizes.into_iter().chain([f64::from(self.dropout)]);
        for ((key, least, most, unit), value) in Self::RANGES.into_iter().zip(values) {
            if !(least..=most).contains(&value) {
                return wrong(key, value.to_string(), format!("give a number from {least} to {most} {unit}"));
            }
        }
        if !self.width.is_multiple_of(self.heads) {
            let remedy = format!("choose a divisor of goal.width, which is {}", self.width);
            return wrong("heads", self.heads.to_string(), remedy);
        }
        Ok(())
    }

    /// Number of weights of a network for data of `shape`, which need not be built for it; of a configuration that
    /// [`GoalConfig::check`] passes.
    #[must_use]
    pub fn weights(&self, shape: &GoalShape) -> u64 {
        let [width, layers, slots] = [self.width, self.layers, shape.slots].map(|size| size as u64);
        let map = |inputs: usize, outputs: u64| (inputs as u64 + 1) * outputs;
        let inputs = map(2 * shape.t_pred, width) + map(shape.observed, width) + map(shape.neighbour, width);
        let heads = map(self.width, 1) + map(self.width, 2 * shape.t_pred as u64);
        let learned = u64::from(self.null_token) * width + u64::from(self.slot_embedding) * slots * width;
        inputs + (layers + 1) * self.layer_weights() + heads + learned
    }

    /// Number of weights of one layer: attention, two norms, feed-forward.
    #[must_use]
    pub fn layer_weights(&self) -> u64 {
        let (width, hidden) = (self.width as u64, (self.feed_forward * self.width) as u64);
        4 * (width + 1) * width + 4 * width + (width + 1) * hidden + (hidden + 1) * width
    }
}

impl GoalShape {
    /// # Errors
    /// When a size is 0; the message names it.
    pub fn check(&self) -> Result<(), GoalError> {
        for (key, value) in [
            ("shape.observed", self.observed),
            ("shape.neighbour", self.neighbour),
            ("shape.slots", self.slots),
            ("shape.t_pred", self.t_pred),
        ] {
            if value == 0 {
                let remedy = "the data must give at least 1".to_owned();
                return Err(GoalError::Setting { key, value: value.to_string(), remedy });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> GoalConfig {
        GoalConfig {
            width: 12,
            heads: 3,
            layers: 0,
            feed_forward: 2,
            dropout: 0.,
            probability: ProbabilityHead::Encoder,
            regression: Regression::Absolute,
            null_token: false,
            slot_embedding: false,
            zero_start: false,
        }
    }

    #[test]
    fn weights_are_counted_without_being_made() {
        let shape = GoalShape { observed: 17, neighbour: 9, slots: 5, t_pred: 7 };
        for config in [good(), GoalConfig { layers: 3, null_token: true, slot_embedding: true, ..good() }] {
            let weights = gnp_nn::Weights::seeded(1, &candle_core::Device::Cpu);
            crate::GoalNet::new(&config, shape, weights.builder()).unwrap();
            assert_eq!(config.weights(&shape), weights.count() as u64);
        }
    }

    #[test]
    fn every_setting_out_of_range_is_named() {
        let good = good();
        assert!(good.check().is_ok());
        for (bad, key) in [
            (GoalConfig { width: 0, ..good.clone() }, "goal.width"),
            (GoalConfig { heads: 0, ..good.clone() }, "goal.heads"),
            (GoalConfig { heads: 5, ..good.clone() }, "goal.heads"),
            (GoalConfig { feed_forward: 0, ..good.clone() }, "goal.feed_forward"),
            (GoalConfig { width: 4_096_000, ..good.clone() }, "goal.width"),
            (GoalConfig { layers: 100_000_000, ..good.clone() }, "goal.layers"),
            (GoalConfig { dropout: 1., ..good.clone() }, "goal.dropout"),
            (GoalConfig { dropout: -0.1, ..good.clone() }, "goal.dropout"),
            (GoalConfig { dropout: f32::NAN, ..good.clone() }, "goal.dropout"),
        ] {
            let message = bad.check().unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }

    #[test]
    fn it_reads_back_and_refuses_unknown_keys() {
        let text = r#"{"width": 64, "heads": 4, "layers": 2, "feed_forward": 2, "dropout": 0.125,
            "probability": "decoder", "regression": "residual", "null_token": true, "slot_embedding": true, "zero_start": false}"#;
        let config: GoalConfig = serde_json::from_str(text).unwrap();
        assert_eq!(config.probability, ProbabilityHead::Decoder);
        let again = serde_json::from_str(&serde_json::to_string(&config).unwrap()).unwrap();
        assert_eq!(config, again);
        assert!(serde_json::from_str::<GoalConfig>(&text.replace("heads", "head")).is_err());
    }

    #[test]
    fn no_size_may_be_zero() {
        let good = GoalShape { observed: 4, neighbour: 3, slots: 2, t_pred: 5 };
        assert!(good.check().is_ok());
        for (bad, key) in [
            (GoalShape { observed: 0, ..good }, "observed"),
            (GoalShape { neighbour: 0, ..good }, "neighbour"),
            (GoalShape { slots: 0, ..good }, "slots"),
            (GoalShape { t_pred: 0, ..good }, "t_pred"),
        ] {
            assert!(bad.check().unwrap_err().to_string().contains(key));
        }
    }
}
