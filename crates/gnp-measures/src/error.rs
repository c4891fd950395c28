//! What goes wrong, and what cannot be said of a recording.

use serde::{Serialize, Serializer};

/// A recording or setting that nothing can be measured with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// Nothing happens in it.
    #[error("recording {recording} has fewer than two frames; there is no time to measure over")]
    NoTime {
        /// Name of the recording.
        recording: String,
    },
    /// A setting that is none.
    #[error("{setting} is {value}; it must be {must}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        must: &'static str,
    },
    /// Cells so small that they would fill the memory.
    #[error("cells of {x} m and {t} s make {cells} cells; take larger ones (at most {most})")]
    TooFine {
        /// Length of a cell, m.
        x: f64,
        /// Duration of a cell, s.
        t: f64,
        /// Cells that would be made.
        cells: usize,
        /// Cells that are made at most.
        most: usize,
    },
}

impl MeasureError {
    /// Refuses what is not positive and finite.
    pub(crate) fn positive(setting: &'static str, value: f64) -> Result<f64, Self> {
        if value.is_finite() && value > 0. {
            Ok(value)
        } else {
            Err(Self::Setting { setting, value, must: "positive" })
        }
    }

    /// Refuses what is no share.
    pub(crate) fn share(setting: &'static str, value: f64) -> Result<f64, Self> {
        let must = "between 0 and 1";
        if (0. ..=1.).contains(&value) { Ok(value) } else { Err(Self::Setting { setting, value, must }) }
    }
}

/// Why a recording does not tell a quantity.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Missing {
    /// Too few cells of time and space.
    #[error("{found} cells {which}; at least {needed} are needed")]
    FewPoints {
        /// Which cells, such as `of free traffic`.
        which: &'static str,
        /// Cells there are.
        found: usize,
        /// Cells that are needed.
        needed: usize,
    },
    /// Congested cells that are all equally dense.
    #[error("the congested cells span {span:.0} vehicles/km; at least {needed:.0} are needed for a slope")]
    NarrowBranch {
        /// Range of their density, vehicles/km.
        span: f64,
        /// Range that is needed, vehicles/km.
        needed: f64,
    },
    /// Congested cells whose flow does not fall with density.
    #[error("flow does not fall with density in the congested cells (Kendall's tau {tau:.2})")]
    NoFallingBranch {
        /// Rank correlation of flow and density.
        tau: f64,
    },
    /// A recording too short, or too empty, to compare two places.
    #[error("no two places are seen together for {needed_s:.0} s at every lag of a wave")]
    TooShort {
        /// Time that is needed, s.
        needed_s: f64,
    },
    /// Speeds that hardly change.
    #[error("speed varies by {deviation:.2} m/s at a place; below {needed:.2} m/s there is no wave to follow")]
    Steady {
        /// Median standard deviation of the speed at a place, m/s.
        deviation: f64,
        /// Least standard deviation, m/s.
        needed: f64,
    },
    /// What one place shows is not seen at the next.
    #[error(
        "no speed stands out: places agree best with correlation {correlation:.2}, {prominence:.2} above other speeds"
    )]
    Weak {
        /// Greatest mean correlation over pairs of places.
        correlation: f64,
        /// How far it stands above the valleys that part it from other lags.
        prominence: f64,
    },
    /// Patterns that travel with the vehicles.
    #[error("changes of speed run downstream at {speed:.1} m/s, as in free traffic")]
    Downstream {
        /// Speed of the pattern with the traffic, m/s.
        speed: f64,
    },
    /// No lag between places.
    #[error("speed changes everywhere at once; no wave runs through it")]
    AtOnce,
    /// A best lag that is that of no peak.
    #[error("places agree ever better towards the slowest wave looked for, {speed:.1} m/s upstream")]
    OutOfRange {
        /// Speed of the best lag, m/s upstream.
        speed: f64,
    },
}

impl Serialize for Missing {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
