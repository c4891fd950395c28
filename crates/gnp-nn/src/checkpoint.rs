//! Checkpoints: named weights with a typed header.

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use gnp_file::{Array, FileError, FileHeader, Values, load_arrays, parse_arrays, save_arrays};

/// A header and named tensors, on the CPU, f32.
#[derive(Clone, Debug)]
pub struct Checkpoint<H> {
    /// What the tensors are.
    pub header: H,
    /// Tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
}

impl<H: FileHeader> Checkpoint<H> {
    /// Writes the file, whole or not at all; tensors of any device and type as f32.
    ///
    /// # Errors
    /// When a tensor cannot be brought to the CPU or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        let array = |tensor: &Tensor| -> candle_core::Result<Array> {
            let values = tensor.to_device(&Device::Cpu)?.to_dtype(DType::F32)?.flatten_all()?.to_vec1()?;
            Ok(Array::new(tensor.dims(), Values::F32(values)))
        };
        let mut arrays = BTreeMap::new();
        for (name, tensor) in &self.tensors {
            let array = array(tensor).map_err(|error| FileError::new(path, format!("tensor `{name}`: {error}")))?;
            arrays.insert(name.clone(), array);
        }
        save_arrays(path, &self.header, &arrays)
    }

    /// Reads a file written by [`Checkpoint::save`].
    ///
    /// # Errors
    /// For a file that is missing, damaged, of another program or of another format version.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        Self::of(path, load_arrays(path)?)
    }

    /// As [`Checkpoint::load`], of the bytes of such a file; `path` names it in messages.
    ///
    /// # Errors
    /// As [`Checkpoint::load`].
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, FileError> {
        Self::of(path, parse_arrays(path, bytes)?)
    }

    fn of(path: &Path, (header, arrays): (H, BTreeMap<String, Array>)) -> Result<Self, FileError> {
        let tensor = |(name, Array { shape, values }): (String, Array)| {
            let Values::F32(values) = values else {
                return Err(FileError::new(path, format!("tensor `{name}` is not of type F32")));
            };
            let tensor = Tensor::from_vec(values, shape, &Device::Cpu);
            Ok((name, tensor.map_err(|error| FileError::new(path, error.to_string()))?))
        };
        Ok(Self { header, tensors: arrays.into_iter().map(tensor).collect::<Result<_, _>>()? })
    }
}
