//! Modes on disk: arrays, with what is not an array in the header.

use std::collections::BTreeMap;
use std::path::Path;

use gnp_file::{Array, FileError, FileHeader, Values, load_arrays, parse_arrays, save_arrays};
use serde::{Deserialize, Serialize};

use crate::error::ModeError;
use crate::modes::Modes;
use crate::normalise::ModeFrame;
use crate::params::FARTHEST;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    converged: bool,
    abandoned: usize,
    seed: u64,
    frame: ModeFrame,
}

impl FileHeader for Header {
    const KEY: &'static str = "gnp_modes";
    const FORMAT: u32 = 2;
    const WHAT: &'static str = "a file of intention modes";
    const REMEDY: &'static str = "fit the modes again";
}

impl Modes {
    /// Writes the modes as safetensors: `centres` (f32, `[modes, t_pred, 2]`), `sizes` (u64,
    /// `[modes]`) and `inertia` (f64, `[1]`). The file appears whole or not at all.
    ///
    /// # Errors
    /// [`ModeError::File`] when the folder cannot be written to.
    pub fn save(&self, path: &Path) -> Result<(), ModeError> {
        let Self { converged, abandoned, seed, frame, .. } = *self;
        let sizes = self.sizes.iter().map(|n| *n as u64).collect();
        let arrays = [
            ("centres", Array::new([self.len(), self.t_pred, 2], Values::F32(self.centres.clone()))),
            // An array, because JSON would not give back every bit.
            ("inertia", Array::new([1], Values::F64(vec![self.inertia]))),
            ("sizes", Array::new([self.len()], Values::U64(sizes))),
        ];
        let arrays = arrays.into_iter().map(|(name, array)| (name.to_owned(), array)).collect();
        Ok(save_arrays(path, &Header { converged, abandoned, seed, frame }, &arrays)?)
    }

    /// Reads what [`Modes::save`] wrote.
    ///
    /// # Errors
    /// [`ModeError::File`] when the file cannot be read, is damaged or holds something else.
    pub fn load(path: &Path) -> Result<Self, ModeError> {
        Self::read(path, load_arrays(path)?)
    }

    /// As [`Modes::load`], of the bytes of such a file; `path` names it in messages.
    ///
    /// # Errors
    /// As [`Modes::load`].
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, ModeError> {
        Self::read(path, parse_arrays(path, bytes)?)
    }

    fn read(path: &Path, (header, arrays): (Header, BTreeMap<String, Array>)) -> Result<Self, ModeError> {
        let modes = Self::of(header, arrays);
        modes.map_err(|problem| FileError::new(path, format!("{problem}: {}", Header::REMEDY)).into())
    }

    fn of(header: Header, mut arrays: BTreeMap<String, Array>) -> Result<Self, String> {
        let mut take = |name: &str| arrays.remove(name).ok_or_else(|| format!("has no array `{name}`"));
        let (centres, sizes, inertia) = (take("centres")?, take("sizes")?, take("inertia")?);
        let Header { converged, abandoned, seed, frame } = header;
        match (&centres.shape[..], centres.values, &sizes.shape[..], sizes.values, inertia.values) {
            (&[modes, t_pred, 2], Values::F32(centres), &[count], Values::U64(sizes), Values::F64(inertia))
                if count == modes && inertia.len() == 1 =>
            {
                if modes == 0 || t_pred == 0 || centres.iter().any(|x| x.is_nan() || x.abs() > FARTHEST) {
                    return Err(format!("has no centre, or one that is not a position within {} km", FARTHEST / 1e3));
                }
                let sizes = sizes.into_iter().map(|n| n as usize).collect();
                Ok(Self { centres, t_pred, sizes, inertia: inertia[0], converged, abandoned, seed, frame })
            }
            (centres, _, sizes, _, _) => Err(format!(
                "has `centres` {centres:?}, `sizes` {sizes:?} and `inertia` {:?}, not f32 [modes, t_pred, 2], u64 [modes] \
                 and f64 [1]",
                inertia.shape
            )),
        }
    }
}
