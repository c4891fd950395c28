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
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 4] = [
        ("modes", 1., 10_000., "modes"),
        ("max_iterations", 1., 1e6, "iterations"),
        ("restarts", 1., 1e4, "starts"),
        // The largest number of TOML; other seeds come from sums and can be used.
        ("seed", 0., i64::MAX as f64, ""),
    ];

    /// # Errors
    /// When a count is out of its range; the message names the key and the remedy.
    pub fn check(&self) -> Result<(), ModeError> {
        let values = [self.modes, self.max_iterations, self.restarts].map(|count| count as f64);
        for ((key, least, most, unit), value) in Self::RANGES.into_iter().zip(values) {
            if !(least..=most).contains(&value) {
                let remedy = format!("give a number from {least} to {most} {unit}");
                return Err(ModeError::Parameter { key, value: value.to_string(), remedy });
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
