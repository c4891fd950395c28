//! Checkpoints: safetensors with a header that says what the weights are and what they need.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use gnp_data::{Dataset, WindowShape};
use gnp_goal::GoalConfig;
use gnp_traj::TrajConfig;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};

use crate::error::ModelError;
use crate::features::Features;

/// Version of the header's layout.
const FORMAT: u32 = 1;
/// Key of the header in the safetensors metadata.
const KEY: &str = "gnp";
/// The frame of every length in a checkpoint.
const FRAME: &str = "road frame: x forward, y left, origin at the target's last observed centre, metres";

/// Component of the pipeline that a checkpoint belongs to.
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
    /// Component of the pipeline.
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
    /// Epochs trained when the file was written.
    pub epoch: usize,
    /// Validation scores at that epoch, by name.
    pub scores: BTreeMap<String, f64>,
    /// What a trainer needs to go on from this file, as JSON; its tensors are named `trainer.*`.
    pub trainer: Option<String>,
}

#[derive(Serialize, Deserialize)]
struct Envelope {
    format: u32,
    frame: String,
    header: Header,
}

/// A header and named tensors.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// What the tensors are.
    pub header: Header,
    /// Tensors by name, on the CPU, f32.
    pub tensors: BTreeMap<String, Tensor>,
}

impl Checkpoint {
    /// Writes the file under a temporary name beside `path`, then renames it.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] when the file cannot be written.
    pub fn save(path: &Path, header: &Header, tensors: &BTreeMap<String, Tensor>) -> Result<(), ModelError> {
        let fail = |problem: String| ModelError::checkpoint(path, problem);
        let envelope = Envelope { format: FORMAT, frame: FRAME.to_owned(), header: header.clone() };
        let text = serde_json::to_string(&envelope).map_err(|e| fail(e.to_string()))?;
        let mut bytes = Vec::with_capacity(tensors.len());
        for (name, tensor) in tensors {
            let values = tensor.to_device(&Device::Cpu)?.to_dtype(DType::F32)?.flatten_all()?.to_vec1::<f32>()?;
            let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            bytes.push((name.as_str(), tensor.dims().to_vec(), raw));
        }
        let mut views = Vec::with_capacity(bytes.len());
        for (name, dims, raw) in &bytes {
            let view = TensorView::new(Dtype::F32, dims.clone(), raw).map_err(|e| fail(e.to_string()))?;
            views.push((*name, view));
        }
        let metadata = HashMap::from([(KEY.to_owned(), text)]);
        let file = safetensors::serialize(views, Some(metadata)).map_err(|e| fail(e.to_string()))?;
        gnp_file::save(path, &file).map_err(|e| fail(format!("cannot be written: {e}")))
    }

    /// Reads a file written by [`Checkpoint::save`].
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] for a file that is missing, damaged, of another program or of
    /// another format version.
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        let fail = |problem: String| ModelError::checkpoint(path, problem);
        let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
        let damaged = |e: &dyn std::fmt::Display| {
            fail(format!("is not a whole safetensors file ({e}): copy it again or train again"))
        };
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(&e))?;
        let text = metadata
            .metadata()
            .as_ref()
            .and_then(|map| map.get(KEY))
            .ok_or_else(|| fail(format!("has no `{KEY}` header: it is not a checkpoint of this program")))?;
        let envelope: Envelope = serde_json::from_str(text)
            .map_err(|e| fail(format!("has a header this version cannot read ({e}): train again")))?;
        if envelope.format != FORMAT {
            return Err(fail(format!("has format {}, this version reads {FORMAT}: train again", envelope.format)));
        }
        let file = SafeTensors::deserialize(&bytes).map_err(|e| damaged(&e))?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.tensors() {
            if view.dtype() != Dtype::F32 {
                return Err(fail(format!("tensor `{name}` is {:?}, expected F32", view.dtype())));
            }
            let values: Vec<f32> =
                view.data().chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
            tensors.insert(name, Tensor::from_vec(values, view.shape(), &Device::Cpu)?);
        }
        Ok(Self { header: envelope.header, tensors })
    }

    /// Refuses a checkpoint of another part or another window shape.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] for another part, [`ModelError::Shape`] for another shape or rate.
    pub fn expect(&self, path: &Path, part: Component, shape: Option<WindowShape>) -> Result<(), ModelError> {
        if self.header.part != part {
            let found = self.header.part.name();
            return Err(ModelError::checkpoint(path, format!("is of `{found}`, expected `{}`", part.name())));
        }
        match shape {
            Some(found) if !same_frames(found, self.header.shape) => {
                Err(ModelError::Shape { needs: self.header.shape, found })
            }
            _ => Ok(()),
        }
    }
}

/// Whether windows of two shapes have the same frames in time, whatever they were resampled from.
fn same_frames(a: WindowShape, b: WindowShape) -> bool {
    a.t_obs == b.t_obs && a.t_pred == b.t_pred && (a.rate_hz - b.rate_hz).abs() < 1e-6
}
