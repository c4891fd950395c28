//! Files of a model: any bytes, and changed headers and arrays in files that are whole.

use std::collections::BTreeMap;
use std::path::Path;

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::Predictor as _;
use gnp_file::{Array, FileError, FileHeader, Values, load_arrays, save_arrays};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::made::{kind, road};
use crate::model::{self, FILES};
use crate::patch::{self, Patch};
use crate::{Finding, Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "checkpoint",
    about: "files of modes and weights, to a model and its forecasts",
    run,
    seeds,
    words: &[
        "__metadata__",
        "\"shape\":[",
        "\"data_offsets\":[0,",
        "\"dtype\":\"F64\"",
        "gnp_modes",
        "18446744073709551615",
    ],
};

/// A header of a checkpoint that may say anything.
#[derive(Serialize, Deserialize)]
struct OfWeights(Value);

impl FileHeader for OfWeights {
    const KEY: &'static str = gnp_model::Header::KEY;
    const FORMAT: u32 = gnp_model::Header::FORMAT;
    const WHAT: &'static str = gnp_model::Header::WHAT;
    const REMEDY: &'static str = gnp_model::Header::REMEDY;
}

/// A header of modes that may say anything.
#[derive(Serialize, Deserialize)]
struct OfModes(Value);

impl FileHeader for OfModes {
    const KEY: &'static str = "gnp_modes";
    const FORMAT: u32 = 2;
    const WHAT: &'static str = "modes";
    const REMEDY: &'static str = "fit again";
}

/// Changes of a file.
#[derive(Arbitrary, Debug)]
struct Changes {
    header: Vec<Patch>,
    arrays: Vec<(u8, Change)>,
}

/// A change of an array.
#[derive(Arbitrary, Debug)]
enum Change {
    Drop,
    Rename(bool),
    Spot(u8, f32),
    Fill(i8),
    Shape(u8, u8),
    Transpose,
    OtherType(bool),
    Shorter,
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let (kind, rest) = kind(input);
    let files = model::saved(scratch)?;
    let raw = [b'm', b'g', b'r'].iter().position(|raw| *raw == kind);
    let which = raw.unwrap_or(usize::from(kind) % files.len());
    let mut contents = Vec::with_capacity(files.len());
    for (index, file) in files.iter().enumerate() {
        contents.push(match (index == which, raw) {
            (false, _) => std::fs::read(file)?,
            (true, Some(_)) => rest.to_vec(),
            (true, None) => {
                let Ok(changes) = Changes::arbitrary(&mut Unstructured::new(rest)) else { return Ok(()) };
                let made = scratch.made("changed.safetensors");
                let written = match which {
                    0 => change::<OfModes>(file, &made, &changes, |it| &mut it.0),
                    _ => change::<OfWeights>(file, &made, &changes, |it| &mut it.0),
                };
                // What the writer refuses cannot be in a file that is whole.
                if let Err(error) = written {
                    return checks::refusal(&error, ".safetensors");
                }
                std::fs::read(made)?
            }
        });
    }
    let given: Vec<(&str, &[u8])> = FILES.into_iter().zip(&contents).map(|(name, it)| (name, &it[..])).collect();
    scratch.put(&given)?;
    let model = match model::load(scratch.given()) {
        Ok(model) => model,
        // A value that does not fit is named by its key; a file that is not whole by its name.
        Err(error) => return checks::refusal(&error, ""),
    };
    let recordings = [road("case")?];
    let seen = model::seen(&recordings)?;
    match model.predict(&seen[..2], 2) {
        Ok(forecasts) => forecasts.iter().try_for_each(|it| checks::forecast(it, "gnp", Some(seen[0].shape().t_pred))),
        Err(error) => checks::refusal(&error, ""),
    }
}

/// The file at `from` with changes, written by the project's own writer and so whole.
fn change<H: FileHeader>(
    from: &Path,
    to: &Path,
    changes: &Changes,
    value: fn(&mut H) -> &mut Value,
) -> Result<(), FileError> {
    let (mut header, mut arrays) = load_arrays::<H>(from)?;
    patch::apply(value(&mut header), &changes.header);
    for (which, change) in &changes.arrays {
        let Some(name) = arrays.keys().nth(usize::from(*which) % arrays.len().max(1)).cloned() else { break };
        apply(&mut arrays, name, change);
    }
    save_arrays(to, &header, &arrays)
}

fn apply(arrays: &mut BTreeMap<String, Array>, name: String, change: &Change) {
    let Some(mut array) = arrays.remove(&name) else { return };
    let mut name = name;
    let length = array.shape.iter().product::<usize>();
    match change {
        Change::Drop => return,
        Change::Rename(longer) => {
            if *longer {
                name.push('x');
            } else {
                name.pop();
            }
        }
        Change::Spot(at, value) => set(&mut array.values, Some(usize::from(*at)), *value),
        Change::Fill(value) => set(&mut array.values, None, 10f32.powi((*value).into())),
        Change::Shape(first, second) => {
            let (first, second) = (usize::from(*first), usize::from(*second));
            array = Array::new([first, second], Values::F32(vec![0.5; first * second]));
        }
        Change::Transpose => array.shape.reverse(),
        Change::OtherType(whole) => {
            let values = if *whole { Values::U64(vec![u64::MAX; length]) } else { Values::F64(vec![0.5; length]) };
            array.values = values;
        }
        Change::Shorter => {
            if let Some(first) = array.shape.first_mut().filter(|first| **first > 1) {
                *first -= 1;
                let length = array.shape.iter().product();
                match &mut array.values {
                    Values::F32(values) => values.truncate(length),
                    Values::F64(values) => values.truncate(length),
                    Values::U64(values) => values.truncate(length),
                    _ => {}
                }
            }
        }
    }
    arrays.insert(name, array);
}

/// One value, counted round, or every one.
fn set(values: &mut Values, at: Option<usize>, value: f32) {
    fn of<T: Copy>(values: &mut [T], at: Option<usize>, value: T) {
        match at {
            Some(at) if !values.is_empty() => values[at % values.len()] = value,
            Some(_) => {}
            None => values.fill(value),
        }
    }
    match values {
        Values::F32(values) => of(values, at, value),
        Values::F64(values) => of(values, at, value.into()),
        Values::U64(values) => of(values, at, value as u64),
        _ => {}
    }
}

/// The modes as they stand, and one change of each kind.
fn seeds(scratch: &Scratch) -> Result<Vec<Vec<u8>>, Finding> {
    let files = model::saved(scratch)?;
    let raw = [b"m", b"g", b"r"].into_iter().zip(&files);
    let raw =
        raw.map(|(kind, file)| Ok([kind, &std::fs::read(file)?[..]].concat())).collect::<Result<Vec<_>, Finding>>();
    Ok(raw?
        .into_iter()
        .filter(|input| input.len() <= crate::LONGEST_INPUT)
        .chain((0..3).map(|kind| vec![kind]))
        .collect())
}
