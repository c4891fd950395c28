//! Checkpoints: safetensors with a header that says what the weights are and what they need.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gnp_data::{Dataset, WindowShape};
use gnp_file::FileHeader;
use gnp_goal::GoalConfig;
use gnp_traj::TrajConfig;
use serde::{Deserialize, Serialize};

use crate::error::ModelError;
use crate::features::Features;

/// Weights of a component of GNP.
pub type Checkpoint = gnp_nn::Checkpoint<Header>;

/// Part of the pipeline that a checkpoint belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Component {
    /// Goal network.
    Goal,
    /// Social force after its attraction was trained.
    Attraction,
    /// Social force after its repulsion was trained.
    Repulsion,
}

impl Component {
    /// Name in file names and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Goal => "goal",
            Self::Attraction => "attraction",
            Self::Repulsion => "repulsion",
        }
    }
}

/// What the weights are: enough to rebuild the network and to refuse data they were not made for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Part of the pipeline.
    pub part: Component,
    /// Data family trained on.
    pub dataset: Dataset,
    /// Whether any training recording was simulated.
    pub simulated: bool,
    /// Window shape, with the rate in Hz.
    pub shape: WindowShape,
    /// Feature configuration and the statistics of the training part.
    pub features: Features,
    /// Goal network, for [`Component::Goal`].
    pub goal: Option<GoalConfig>,
    /// Social force, for the other parts.
    pub traj: Option<TrajConfig>,
    /// Seed of the run.
    pub seed: u64,
    /// Version of the code that trained.
    pub code_version: String,
    /// Hash of the split trained on.
    pub split_hash: String,
    /// The run whose weights the training started from; none where they were drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Share of what the goal network expects on average beyond the reference path that had the least squared error over
    /// the validation part, 0 to 1; none before it is fitted, and where there is no reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust: Option<f64>,
    /// Epochs trained when the file was written.
    pub epoch: usize,
    /// Validation scores at that epoch, by name.
    pub scores: BTreeMap<String, f64>,
    /// What a trainer needs to go on from this file, as JSON; its tensors are named `trainer.*`.
    pub trainer: Option<String>,
}

/// The run that a fine-tuned one started from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Its folder at that time.
    pub folder: PathBuf,
    /// Hash of the split that it was trained on.
    pub split_hash: String,
}

impl FileHeader for Header {
    const KEY: &'static str = "gnp";
    const FORMAT: u32 = 1;
    const FRAME: Option<&'static str> =
        Some("road frame: x forward, y left, origin at the target's last observed centre, metres");
    const WHAT: &'static str = "a checkpoint of this program";
    const REMEDY: &'static str = "train again";
}

impl Header {
    /// Refuses the checkpoint at `path` when it is of another part or another window shape.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] for another part, [`ModelError::Shape`] for another shape or rate.
    pub fn expect(&self, path: &Path, part: Component, shape: Option<WindowShape>) -> Result<(), ModelError> {
        if self.part != part {
            let found = self.part.name();
            return Err(ModelError::checkpoint(path, format!("is of `{found}`, expected `{}`", part.name())));
        }
        match shape {
            Some(found) if !self.shape.fits(&found) => Err(ModelError::Shape { needs: self.shape, found }),
            _ => Ok(()),
        }
    }
}
