//! Checkpoints of learned baselines: safetensors with a header that says what the weights are.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use gnp_data::{Dataset, WindowShape};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};

use crate::error::NeuralBaselineError;
use crate::kind::NeuralBaseline;
use crate::recipe::Recipe;

/// Version of the header's layout.
const FORMAT: u32 = 1;
/// Key of the header in the safetensors metadata.
const KEY: &str = "gnp-neural-baselines";

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

#[derive(Serialize, Deserialize)]
struct Envelope {
    format: u32,
    header: Header,
}

/// A header and named tensors, on the CPU.
#[derive(Clone, Debug)]
pub(crate) struct Checkpoint {
    pub(crate) header: Header,
    pub(crate) tensors: BTreeMap<String, Tensor>,
}

impl Checkpoint {
    /// Writes the file under a temporary name beside `path`, then renames it.
    pub(crate) fn save(&self, path: &Path) -> Result<(), NeuralBaselineError> {
        let fail = |problem: String| NeuralBaselineError::checkpoint(path, problem);
        let envelope = Envelope { format: FORMAT, header: self.header.clone() };
        let text = serde_json::to_string(&envelope).map_err(|e| fail(e.to_string()))?;
        let mut bytes = Vec::with_capacity(self.tensors.len());
        for (name, tensor) in &self.tensors {
            let values = tensor.to_dtype(DType::F32)?.flatten_all()?.to_vec1::<f32>()?;
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
    pub(crate) fn load(path: &Path) -> Result<Self, NeuralBaselineError> {
        let fail = |problem: String| NeuralBaselineError::checkpoint(path, problem);
        let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
        let damaged = |e: &dyn std::fmt::Display| {
            fail(format!("is not a whole safetensors file ({e}): copy it again or train again"))
        };
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(&e))?;
        let text = metadata
            .metadata()
            .as_ref()
            .and_then(|map| map.get(KEY))
            .ok_or_else(|| fail(format!("has no `{KEY}` header: it is not a learned baseline")))?;
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
}
