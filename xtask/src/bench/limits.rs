//! What the ratios must be: `configs/bench.toml`.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, anyhow, bail};
use serde::Deserialize;

/// The limits; every key is written, unknown ones are refused.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    /// Time of the graph of candle's operations over that of the fused operation, at least.
    pub(super) fused: Fused,
    /// Gain of two threads over one, as a share of what independent loops gain, at least.
    pub(super) threads: Threads,
    /// Time for twice as much over that for once, at most.
    pub(super) growth: Growth,
    /// Of the windows.
    pub(super) memory: Memory,
}

/// `[fused]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Fused {
    pub(super) traj_forward: f64,
    pub(super) traj_train: f64,
    pub(super) goal_forward: f64,
    pub(super) goal_train: f64,
}

/// `[threads]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Threads {
    pub(super) traj_train: f64,
    pub(super) goal_train: f64,
    pub(super) goal_step: f64,
}

/// `[growth]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Growth {
    pub(super) ingest: f64,
    pub(super) windows: f64,
}

/// `[memory]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Memory {
    /// Bytes for each window that is cut, at most.
    pub(super) window_bytes: f64,
}

/// A limit on a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Limit {
    AtLeast(f64),
    AtMost(f64),
}

impl Limit {
    pub(super) fn holds(self, value: f64) -> bool {
        match self {
            Self::AtLeast(limit) => value >= limit,
            Self::AtMost(limit) => value <= limit,
        }
    }

    /// The one of two values that is farther on the good side.
    pub(super) fn better(self, a: f64, b: f64) -> f64 {
        match self {
            Self::AtLeast(_) => a.max(b),
            Self::AtMost(_) => a.min(b),
        }
    }

    pub(super) fn text(self) -> String {
        match self {
            Self::AtLeast(limit) => format!("≥ {limit}"),
            Self::AtMost(limit) => format!("≤ {limit}"),
        }
    }
}

impl Limits {
    /// Reads the file.
    ///
    /// # Errors
    /// When it cannot be read, a key is missing or unknown, or a limit is not positive.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        Self::parse(&text).with_context(|| path.display().to_string())
    }

    fn parse(text: &str) -> Result<Self> {
        let limits: Self = toml::from_str(text).map_err(|error| anyhow!("{}", error.to_string().trim_end()))?;
        for (key, value) in [
            ("fused.traj_forward", limits.fused.traj_forward),
            ("fused.traj_train", limits.fused.traj_train),
            ("fused.goal_forward", limits.fused.goal_forward),
            ("fused.goal_train", limits.fused.goal_train),
            ("threads.traj_train", limits.threads.traj_train),
            ("threads.goal_train", limits.threads.goal_train),
            ("threads.goal_step", limits.threads.goal_step),
            ("growth.ingest", limits.growth.ingest),
            ("growth.windows", limits.growth.windows),
            ("memory.window_bytes", limits.memory.window_bytes),
        ] {
            if !(value.is_finite() && value > 0.) {
                bail!("{key} = {value}: give a positive number");
            }
        }
        Ok(limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project;

    fn embedded() -> String {
        fs::read_to_string(project::root().join("configs/bench.toml")).unwrap()
    }

    #[test]
    fn the_limits_of_the_project_read() {
        let limits = Limits::parse(&embedded()).unwrap();
        assert!(limits.fused.traj_train > 1. && limits.threads.traj_train > 0.5, "{limits:?}");
        assert!(limits.growth.ingest > 2. && limits.growth.windows > 2., "{limits:?}");
    }

    #[test]
    fn unknown_missing_and_impossible_keys_are_refused() {
        let text = embedded();
        let unknown = Limits::parse(&text.replace("goal_train", "goal_trains")).unwrap_err().to_string();
        assert!(unknown.contains("goal_trains"), "{unknown}");
        let line = text.lines().find(|line| line.starts_with("window_bytes")).unwrap();
        let missing = Limits::parse(&text.replace(line, "")).unwrap_err().to_string();
        assert!(missing.contains("window_bytes"), "{missing}");
        let negative = Limits::parse(&text.replace(line, "window_bytes = -1.0")).unwrap_err().to_string();
        assert!(negative.contains("memory.window_bytes"), "{negative}");
    }

    #[test]
    fn a_limit_holds_on_its_side() {
        let (least, most) = (Limit::AtLeast(2.), Limit::AtMost(2.));
        assert!(least.holds(2.) && least.holds(3.) && !least.holds(1.9) && !least.holds(f64::NAN));
        assert!(most.holds(2.) && most.holds(1.) && !most.holds(2.1) && !most.holds(f64::NAN));
        assert_eq!((least.better(1., 3.), most.better(1., 3.)), (3., 1.));
    }
}
