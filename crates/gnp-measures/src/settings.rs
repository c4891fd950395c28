//! How everything is measured.

use serde::{Deserialize, Serialize};

use crate::cells::CellSize;
use crate::diagram::DiagramSettings;
use crate::lane_changes::LaneChangeSettings;
use crate::safety::SafetySettings;
use crate::waves::WaveSettings;

/// How a [`Summary`](crate::Summary) is measured. The defaults suit a motorway section of some hundred metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Cells of flow, density and speed; the points of the fundamental diagram.
    pub cells: CellSize,
    /// Places of detectors, m, on every carriageway whose measured stretch has them; empty: evenly spread ones.
    pub detectors: Vec<f64>,
    /// Number of evenly spread detectors.
    pub spread_detectors: usize,
    /// Length of a detector's loop, m; 0 is a line.
    pub loop_length: f64,
    /// Interval of the detectors, s.
    pub interval_s: f64,
    /// Time over which velocities are differenced for acceleration, s.
    pub acceleration_span_s: f64,
    /// Fundamental diagram.
    pub diagram: DiagramSettings,
    /// Waves.
    pub waves: WaveSettings,
    /// Surrogate safety.
    pub safety: SafetySettings,
    /// Lane changes.
    pub lane_changes: LaneChangeSettings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            cells: CellSize { x: 100., t: 30. },
            detectors: Vec::new(),
            spread_detectors: 3,
            loop_length: 0.,
            interval_s: 60.,
            acceleration_span_s: 1.,
            diagram: DiagramSettings::default(),
            waves: WaveSettings::default(),
            safety: SafetySettings::default(),
            lane_changes: LaneChangeSettings::default(),
        }
    }
}
