//! How modes are searched for.

use serde::{Deserialize, Serialize};

use crate::error::ModeError;

/// No future of a few seconds ends farther away than this, m. It also keeps every squared distance
/// far from overflow.
pub(crate) const FARTHEST: f32 = 1e5;

/// How modes are searched for: the `[modes]` table of a configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeParams {
    /// Number of modes `L`. The paper has 200 for highD and 100 for NGSIM.
    pub modes: usize,
    /// Seed of the starting centres.
    pub seed: u64,
    /// Most iterations from one start; far fewer are usual.
    pub max_iterations: usize,
    /// Starts; the result with the least inertia is kept.
    pub restarts: usize,
}

impl ModeParams {
    /// # Errors
    /// When a count is zero; the message names the key and the remedy.
    pub fn check(&self) -> Result<(), ModeError> {
        for (key, value) in
            [("modes", self.modes), ("max_iterations", self.max_iterations), ("restarts", self.restarts)]
        {
            if value == 0 {
                return Err(ModeError::Parameter { key, value: value.to_string(), remedy: "set it to 1 or more" });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_must_be_positive() {
        let good = ModeParams { modes: 2, seed: 0, max_iterations: 3, restarts: 1 };
        assert!(good.check().is_ok());
        for (bad, key) in [
            (ModeParams { modes: 0, ..good.clone() }, "modes.modes"),
            (ModeParams { max_iterations: 0, ..good.clone() }, "modes.max_iterations"),
            (ModeParams { restarts: 0, ..good.clone() }, "modes.restarts"),
        ] {
            let message = bad.check().unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }

    #[test]
    fn unknown_keys_are_refused() {
        let text = r#"{"modes": 2, "seed": 0, "max_iterations": 3, "restarts": 1, "mode": 4}"#;
        assert!(serde_json::from_str::<ModeParams>(text).is_err());
    }
}
