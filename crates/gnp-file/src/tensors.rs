//! Files of named arrays with a typed header: safetensors, with the header as JSON in its metadata. The header begins with
//! a SHA-256 of the whole file, its own digits counted as zeros.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Display;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{FileError, sha256};

/// Stands for the digits of the checksum while it is taken.
const ZEROS: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// What a file of arrays says of itself. It stands under one key of the metadata, because several
/// would come in hash order and change the bytes of the file.
pub trait FileHeader: Serialize + DeserializeOwned {
    /// The key: it tells one kind of file from another.
    const KEY: &'static str;
    /// Version of the header's layout; a file of another version is refused.
    const FORMAT: u32;
    /// The frame of every length in the file, written for who reads it without this program.
    const FRAME: Option<&'static str> = None;
    /// What such a file is, as in "it is not *a checkpoint of this program*".
    const WHAT: &'static str;
    /// How to come by a new file, as in "*train again*".
    const REMEDY: &'static str;
}

/// Numbers of one type.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Values {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 64-bit floats.
    F64(Vec<f64>),
    /// Unsigned 64-bit integers.
    U64(Vec<u64>),
}

/// An array: its numbers in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each dimension; their product is the number of values.
    pub shape: Vec<usize>,
    /// The numbers.
    pub values: Values,
}

impl Array {
    /// An array of `shape`.
    pub fn new(shape: impl Into<Vec<usize>>, values: Values) -> Self {
        Self { shape: shape.into(), values }
    }

    fn raw(&self) -> (Dtype, Vec<u8>) {
        match &self.values {
            Values::F32(values) => (Dtype::F32, values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            Values::F64(values) => (Dtype::F64, values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            Values::U64(values) => (Dtype::U64, values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        }
    }

    fn of(view: &TensorView<'_>) -> Option<Self> {
        let bytes = view.data();
        let values = match view.dtype() {
            Dtype::F32 => Values::F32(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()),
            Dtype::F64 => Values::F64(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
            Dtype::U64 => Values::U64(bytes.as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect()),
            _ => return None,
        };
        Some(Self::new(view.shape(), values))
    }
}

#[derive(Serialize)]
struct Written<'a, H> {
    // First, so that its place is found.
    sha256: &'static str,
    format: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<&'static str>,
    header: &'a H,
}

#[derive(Deserialize)]
struct Format {
    format: u32,
    sha256: Option<String>,
}

#[derive(Deserialize)]
struct Read<H> {
    header: H,
}

/// Where the digits of the checksum are in a file.
fn place_of(sum: &str, bytes: &[u8]) -> Option<usize> {
    // The header is a text in a text: its quotes are escaped.
    let before = format!("\\\"sha256\\\":\\\"{sum}");
    let start = bytes.windows(before.len()).position(|found| found == before.as_bytes())?;
    Some(start + before.len() - sum.len())
}

/// The checksum of a file whose digits for it begin at `place`.
fn checksum(bytes: &[u8], place: usize) -> String {
    sha256([&bytes[..place], ZEROS.as_bytes(), &bytes[place + ZEROS.len()..]])
}

/// Refuses numbers that are not finite: a network with one of them predicts nothing.
fn check_finite(path: &Path, arrays: &BTreeMap<String, Array>, remedy: &str) -> Result<(), FileError> {
    for (name, array) in arrays {
        let found = match &array.values {
            Values::F32(values) => values.iter().position(|x| !x.is_finite()).map(|at| (at, f64::from(values[at]))),
            Values::F64(values) => values.iter().position(|x| !x.is_finite()).map(|at| (at, values[at])),
            Values::U64(_) => None,
        };
        if let Some((at, value)) = found {
            return Err(FileError::new(path, format!("value {at} of array `{name}` is {value}: {remedy}")));
        }
    }
    Ok(())
}

/// Writes a header and arrays to `path`, whole or not at all. The same content gives the same bytes.
///
/// # Errors
/// When an array's shape does not fit its values, a value is not finite, or the file cannot be written.
pub fn save_arrays<H: FileHeader>(path: &Path, header: &H, arrays: &BTreeMap<String, Array>) -> Result<(), FileError> {
    let fail = |error: &dyn Display| FileError::new(path, format!("cannot be written: {error}"));
    check_finite(path, arrays, "it is not written; what it was made by diverged")?;
    let written = Written { sha256: ZEROS, format: H::FORMAT, frame: H::FRAME, header };
    let header = serde_json::to_string(&written).map_err(|error| fail(&error))?;
    let raw: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), &array.shape, array.raw())).collect();
    let mut views = Vec::with_capacity(raw.len());
    for (name, shape, (dtype, bytes)) in &raw {
        views.push((*name, TensorView::new(*dtype, (*shape).clone(), bytes).map_err(|error| fail(&error))?));
    }
    let mut bytes =
        serialize(views, Some(HashMap::from([(H::KEY.to_owned(), header)]))).map_err(|error| fail(&error))?;
    let place = place_of(ZEROS, &bytes).ok_or_else(|| fail(&"its header has no place for a checksum"))?;
    let sum = checksum(&bytes, place);
    bytes[place..place + sum.len()].copy_from_slice(sum.as_bytes());
    crate::save(path, &bytes).map_err(|error| fail(&error))
}

/// Reads what [`save_arrays`] wrote.
///
/// # Errors
/// For a file that is missing, damaged, of another kind or of another version, or that has a value that is not finite.
pub fn load_arrays<H: FileHeader>(path: &Path) -> Result<(H, BTreeMap<String, Array>), FileError> {
    let bytes = std::fs::read(path).map_err(|error| FileError::new(path, format!("cannot be read: {error}")))?;
    parse_arrays(path, &bytes)
}

/// As [`load_arrays`], of the bytes of a file that is in memory; `path` names it in messages.
///
/// # Errors
/// As [`load_arrays`].
pub fn parse_arrays<H: FileHeader>(path: &Path, bytes: &[u8]) -> Result<(H, BTreeMap<String, Array>), FileError> {
    let fail = |problem: String| FileError::new(path, problem);
    let damaged = |error: &dyn Display| {
        fail(format!("is not a whole safetensors file ({error}): copy it again or {}", H::REMEDY))
    };
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| damaged(&error))?;
    let text = metadata.metadata().as_ref().and_then(|entries| entries.get(H::KEY));
    let text = text.ok_or_else(|| fail(format!("has no `{}` header: it is not {}", H::KEY, H::WHAT)))?;
    let unreadable =
        |error: serde_json::Error| fail(format!("has a header that this version cannot read ({error}): {}", H::REMEDY));
    let Format { format, sha256: sum } = serde_json::from_str(text).map_err(unreadable)?;
    if format != H::FORMAT {
        return Err(fail(format!("has format {format}, this version reads {}: {}", H::FORMAT, H::REMEDY)));
    }
    let sum = sum.ok_or_else(|| fail(format!("has no checksum, it is of an earlier version: {}", H::REMEDY)))?;
    let place = Some(&sum).filter(|sum| sum.len() == ZEROS.len()).and_then(|sum| place_of(sum, bytes));
    let place = place.filter(|place| checksum(bytes, *place) == sum);
    if place.is_none() {
        return Err(fail(format!("differs from what was written: copy it again or {}", H::REMEDY)));
    }
    let Read { header } = serde_json::from_str(text).map_err(unreadable)?;
    let file = SafeTensors::deserialize(bytes).map_err(|error| damaged(&error))?;
    let array = |(name, view): (String, TensorView<'_>)| match Array::of(&view) {
        Some(array) => Ok((name, array)),
        None => Err(fail(format!("array `{name}` is {:?}, expected F32, F64 or U64", view.dtype()))),
    };
    let arrays = file.tensors().into_iter().map(array).collect::<Result<_, _>>()?;
    check_finite(path, &arrays, H::REMEDY)?;
    Ok((header, arrays))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Note(String);

    impl FileHeader for Note {
        const KEY: &'static str = "note";
        const FORMAT: u32 = 2;
        const WHAT: &'static str = "a note";
        const REMEDY: &'static str = "write it again";
    }

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Older(String);

    impl FileHeader for Older {
        const KEY: &'static str = "note";
        const FORMAT: u32 = 1;
        const WHAT: &'static str = "a note";
        const REMEDY: &'static str = "write it again";
    }

    fn arrays() -> BTreeMap<String, Array> {
        BTreeMap::from([
            ("a".to_owned(), Array::new([2, 1], Values::F32(vec![1.5, f32::MIN_POSITIVE]))),
            ("b".to_owned(), Array::new([1], Values::F64(vec![0.1]))),
            ("c".to_owned(), Array::new([2], Values::U64(vec![0, u64::MAX]))),
        ])
    }

    #[test]
    fn every_bit_comes_back_and_the_same_content_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        let note = Note("n".to_owned());
        save_arrays(&path, &note, &arrays()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(load_arrays::<Note>(&path).unwrap(), (note, arrays()));
        save_arrays(&path, &Note("n".to_owned()), &arrays()).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
        assert!(String::from_utf8_lossy(&bytes).contains(r#"\",\"format\":2,\"header\":\"n\"}"#));
    }

    #[test]
    fn what_cannot_be_used_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        let message = || load_arrays::<Note>(&path).unwrap_err().to_string();
        assert!(message().contains("x.safetensors: cannot be read"), "{}", message());
        save_arrays(&path, &Older("n".to_owned()), &arrays()).unwrap();
        assert!(message().contains("has format 1, this version reads 2: write it again"), "{}", message());
        save_arrays(&path, &Note("n".to_owned()), &arrays()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for broken in [&bytes[..bytes.len() - 3], b"no tensors", b""] {
            std::fs::write(&path, broken).unwrap();
            assert!(message().contains("is not a whole safetensors file"), "{}", message());
        }
        std::fs::write(&path, serialize(Vec::<(&str, TensorView<'_>)>::new(), None).unwrap()).unwrap();
        assert!(message().contains("has no `note` header: it is not a note"), "{}", message());
        let two = BTreeMap::from([("a".to_owned(), Array::new([3], Values::F32(vec![1.])))]);
        assert!(save_arrays(&path, &Note("n".to_owned()), &two).is_err());
    }

    #[test]
    fn every_byte_is_under_the_checksum() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        save_arrays(&path, &Note("n".to_owned()), &arrays()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for at in 0..bytes.len() {
            let mut broken = bytes.clone();
            broken[at] ^= 4;
            std::fs::write(&path, &broken).unwrap();
            let message = load_arrays::<Note>(&path).unwrap_err().to_string();
            assert!(message.contains("x.safetensors: "), "{at}: {message}");
        }
        // A weight, and a file of before there were checksums.
        let mut broken = bytes.clone();
        *broken.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &broken).unwrap();
        let message = load_arrays::<Note>(&path).unwrap_err().to_string();
        assert!(message.contains("differs from what was written: copy it again or write it again"), "{message}");
        let header = HashMap::from([("note".to_owned(), r#"{"format":2,"header":"n"}"#.to_owned())]);
        std::fs::write(&path, serialize(Vec::<(&str, TensorView<'_>)>::new(), Some(header)).unwrap()).unwrap();
        let message = load_arrays::<Note>(&path).unwrap_err().to_string();
        assert!(message.contains("has no checksum, it is of an earlier version: write it again"), "{message}");
    }

    #[test]
    fn numbers_that_are_not_finite_are_neither_written_nor_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        for values in [Values::F32(vec![0., f32::INFINITY]), Values::F64(vec![0., f64::NAN])] {
            let array = BTreeMap::from([("w".to_owned(), Array::new([2], values.clone()))]);
            let message = save_arrays(&path, &Note("n".to_owned()), &array).unwrap_err().to_string();
            assert!(message.contains("x.safetensors: value 1 of array `w` is "), "{message}");
            assert!(!path.exists());
            // Written by somebody else, checksum and all.
            let fine = match &values {
                Values::F32(_) => Values::F32(vec![0., 1.]),
                _ => Values::F64(vec![0., 1.]),
            };
            save_arrays(&path, &Note("n".to_owned()), &BTreeMap::from([("w".to_owned(), Array::new([2], fine))]))
                .unwrap();
            let mut bytes = std::fs::read(&path).unwrap();
            let raw = Array::new([2], values).raw().1;
            let start = bytes.len() - raw.len();
            bytes[start..].copy_from_slice(&raw);
            let before = load_arrays::<Note>(&path).map(|_| place_of_sum(&bytes)).unwrap();
            let sum = checksum(&bytes, before);
            bytes[before..before + 64].copy_from_slice(sum.as_bytes());
            std::fs::write(&path, &bytes).unwrap();
            let message = load_arrays::<Note>(&path).unwrap_err().to_string();
            assert!(message.contains("value 1 of array `w` is ") && message.ends_with("write it again"), "{message}");
            std::fs::remove_file(&path).unwrap();
        }
    }

    /// Where the digits of a file's checksum are.
    fn place_of_sum(bytes: &[u8]) -> usize {
        place_of("", bytes).unwrap()
    }
}
