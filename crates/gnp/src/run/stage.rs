//! The stages of a run: their order, their commands and their files.

use serde::{Deserialize, Serialize};

/// A stage of the pipeline, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Stage {
    /// Recordings to windows and their split.
    Ingest,
    /// Training windows to intention modes.
    Modes,
    /// The goal network.
    Goal,
    /// The goal attraction.
    Attraction,
    /// The repulsion of vehicles and lines.
    Repulsion,
    /// Scores on the test part.
    Evaluate,
    /// Figures and the report.
    Report,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 7] =
        [Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion, Self::Evaluate, Self::Report];

    /// As in file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Modes => "modes",
            Self::Goal => "goal",
            Self::Attraction => "attraction",
            Self::Repulsion => "repulsion",
            Self::Evaluate => "evaluate",
            Self::Report => "report",
        }
    }

    /// The command that does it.
    pub(super) fn command(self) -> String {
        match self {
            Self::Ingest | Self::Evaluate | Self::Report => self.name().to_owned(),
            _ => format!("train --stage {}", self.name()),
        }
    }

    /// The files that it leaves under names known beforehand, from the run folder.
    pub(super) fn files(self) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let name = self.name();
        match self {
            Self::Ingest => named(&["config.toml", "ingest.json", "ingest.txt"]),
            Self::Modes => named(&["modes.safetensors"]),
            Self::Goal | Self::Attraction | Self::Repulsion => {
                vec![format!("{name}.safetensors"), format!("{name}.last.safetensors"), format!("history-{name}.json")]
            }
            Self::Evaluate => {
                named(&["metrics.json", "metrics.csv", "metrics.md", "differences.json", "predictions.parquet"])
            }
            Self::Report => named(&["report.html"]),
        }
    }

    /// What must be finished before it.
    #[must_use]
    pub fn needs(self) -> &'static [Self] {
        match self {
            Self::Ingest => &[],
            Self::Modes => &[Self::Ingest],
            // The split is made with the modes.
            Self::Goal | Self::Attraction => &[Self::Ingest, Self::Modes],
            Self::Repulsion => &[Self::Ingest, Self::Modes, Self::Attraction],
            Self::Evaluate => &[Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion],
            Self::Report => &[Self::Ingest, Self::Modes, Self::Goal, Self::Attraction, Self::Repulsion, Self::Evaluate],
        }
    }
}
