//! Modes on disk: a safetensors file, with what is not a tensor as JSON in its metadata.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use serde::{Deserialize, Serialize};

use crate::error::ModeError;
use crate::modes::Modes;
use crate::normalise::ModeFrame;

/// One key holds everything: several would come in hash order and change the bytes of the file.
const KEY: &str = "gnp_modes";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    version: u32,
    converged: bool,
    abandoned: usize,
    seed: u64,
    frame: ModeFrame,
}

const VERSION: u32 = 1;

impl Modes {
    /// Writes the modes as safetensors: `centres` (f32, `[modes, t_pred, 2]`), `sizes` (u64,
    /// `[modes]`) and `inertia` (f64, `[1]`). The file appears whole or not at all.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn save(&self, path: &Path) -> Result<(), ModeError> {
        let io = |source| ModeError::Io { path: path.to_owned(), source };
        let bytes = self.to_bytes().map_err(|reason| io(std::io::Error::other(reason)))?;
        gnp_file::save(path, &bytes).map_err(io)
    }

    /// Reads what [`Modes::save`] wrote.
    ///
    /// # Errors
    /// When the file cannot be read, is truncated or holds something else.
    pub fn load(path: &Path) -> Result<Self, ModeError> {
        let bytes = std::fs::read(path).map_err(|source| ModeError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(&bytes).map_err(|reason| ModeError::File { path: path.to_owned(), reason })
    }

    fn to_bytes(&self) -> Result<Vec<u8>, String> {
        let header = Header {
            version: VERSION,
            converged: self.converged,
            abandoned: self.abandoned,
            seed: self.seed,
            frame: self.frame,
        };
        let header = serde_json::to_string(&header).map_err(|error| error.to_string())?;
        let centres: Vec<u8> = self.centres.iter().flat_map(|x| x.to_le_bytes()).collect();
        let sizes: Vec<u8> = self.sizes.iter().flat_map(|n| (*n as u64).to_le_bytes()).collect();
        // A tensor, because JSON would not give back every bit.
        let inertia = self.inertia.to_le_bytes();
        let view = |dtype, shape, data| TensorView::new(dtype, shape, data).map_err(|error| error.to_string());
        let tensors = [
            ("centres", view(Dtype::F32, vec![self.len(), self.t_pred, 2], &centres)?),
            ("inertia", view(Dtype::F64, vec![1], &inertia)?),
            ("sizes", view(Dtype::U64, vec![self.len()], &sizes)?),
        ];
        serialize(tensors, Some(HashMap::from([(KEY.to_owned(), header)]))).map_err(|error| error.to_string())
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
        let header = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
        let header = header.ok_or_else(|| format!("its header has no `{KEY}`"))?;
        let header: Header = serde_json::from_str(header).map_err(|error| format!("`{KEY}`: {error}"))?;
        if header.version != VERSION {
            return Err(format!("it is of version {}, this program reads version {VERSION}", header.version));
        }
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let get = |name| tensors.tensor(name).map_err(|error| format!("`{name}`: {error}"));
        let (centres, sizes, inertia) = (get("centres")?, get("sizes")?, get("inertia")?);
        let &[modes, t_pred, 2] = centres.shape() else {
            return Err(format!("`centres` has shape {:?}, not [modes, t_pred, 2]", centres.shape()));
        };
        for (name, tensor, dtype, shape) in [
            ("centres", &centres, Dtype::F32, &[modes, t_pred, 2][..]),
            ("sizes", &sizes, Dtype::U64, &[modes]),
            ("inertia", &inertia, Dtype::F64, &[1]),
        ] {
            if (tensor.dtype(), tensor.shape()) != (dtype, shape) {
                return Err(format!("`{name}` is {:?} {:?}, not {dtype:?} {shape:?}", tensor.dtype(), tensor.shape()));
            }
        }
        let centres: Vec<f32> = centres.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        if modes == 0 || t_pred == 0 || centres.iter().any(|x| !x.is_finite()) {
            return Err("it has no centre, or one that is not finite".to_owned());
        }
        Ok(Self {
            centres,
            t_pred,
            sizes: sizes.data().as_chunks().0.iter().map(|b| u64::from_le_bytes(*b) as usize).collect(),
            inertia: inertia.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).sum(),
            converged: header.converged,
            abandoned: header.abandoned,
            seed: header.seed,
            frame: header.frame,
        })
    }
}
