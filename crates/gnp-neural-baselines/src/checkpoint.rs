//! Checkpoints of learned baselines: safetensors with a header that says what the weights are.

use std::collections::BTreeMap;

use gnp_baselines::PlatoonRule;
use gnp_data::{Dataset, WindowShape};
use gnp_file::FileHeader;
use serde::{Deserialize, Serialize};

use crate::kind::NeuralBaseline;
use crate::recipe::{OutputForm, Recipe};

/// Weights of a learned baseline.
pub(crate) type Checkpoint = gnp_nn::Checkpoint<Header>;

/// What the weights are, and what they were trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The baseline.
    pub kind: NeuralBaseline,
    /// Data family trained on.
    pub dataset: Dataset,
    /// Whether any training recording was simulated.
    pub simulated: bool,
    /// Window shape, with the rate in Hz.
    pub shape: WindowShape,
    /// How it was trained, its seed included.
    pub recipe: Recipe,
    /// The rule whose path its points are counted from; `None` for the published form.
    pub reference: Option<PlatoonRule>,
    /// Share of the mean deviation from that path that is believed, 0 to 1: the one with the least squared error over the
    /// validation part. `None` for the published form, and while training goes on.
    pub trust: Option<f64>,
    /// Hash of the split trained on.
    pub split_hash: String,
    /// Version of the code that trained.
    pub code_version: String,
    /// Epochs trained when the file was written.
    pub epoch: usize,
    /// Validation scores at that epoch, by name.
    pub scores: BTreeMap<String, f64>,
    /// What the training loop needs to go on from this file, as JSON.
    pub trainer: Option<String>,
}

impl Header {
    /// What the network's points are counted from.
    #[must_use]
    pub fn form(&self) -> OutputForm {
        if self.reference.is_some() { OutputForm::Deviation } else { OutputForm::Published }
    }
}

impl FileHeader for Header {
    const KEY: &'static str = "gnp-neural-baselines";
    const FORMAT: u32 = 2;
    const WHAT: &'static str = "a learned baseline";
    const REMEDY: &'static str = "train again";
}
