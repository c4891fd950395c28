//! Columns that come from Python, as numbers or texts.

use polars_arrow::array::{Array, BinaryViewArrayGeneric, DictionaryArray, DictionaryKey, PrimitiveArray, Utf8Array};
use polars_arrow::datatypes::{ArrowDataType, PhysicalType, PrimitiveType, TimeUnit};
use polars_arrow::types::NativeType;
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;

use crate::arrow;
use crate::error::{TracksError, tracks_error};

/// A column.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    pub(crate) name: String,
    pub(crate) values: Values,
}

/// Values of a column, one a row.
#[derive(Clone, Debug)]
pub(crate) enum Values {
    /// Numbers; what is missing is NaN.
    Numbers(Vec<f64>),
    /// Whole numbers, none missing.
    Whole(Vec<i64>),
    /// Texts.
    Texts(Vec<String>),
}

impl Values {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Whole(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }
}

/// The `wanted` columns of `source`: an object with `__arrow_c_stream__`, or a list of names and values, of which each is a
/// buffer of float64 or int64 or a list of texts.
///
/// # Errors
/// [`TracksError`] for a column of another type, or with missing texts.
pub(crate) fn columns(source: &Bound<'_, PyAny>, wanted: impl Fn(&str) -> bool) -> PyResult<Vec<Column>> {
    let py = source.py();
    if source.hasattr("__arrow_c_stream__")? {
        let found = arrow::take(source)?.into_iter().filter(|column| wanted(&column.name));
        return found.map(|column| of_arrow(py, column.name, &column.pieces)).collect();
    }
    let found: Vec<(String, Bound<'_, PyAny>)> = source.extract()?;
    let found = found.into_iter().filter(|(name, _)| wanted(name));
    let of_python = |(name, values): (String, Bound<'_, PyAny>)| {
        let values = if let Ok(buffer) = PyBuffer::<f64>::get(&values) {
            Values::Numbers(buffer.to_vec(py)?)
        } else if let Ok(buffer) = PyBuffer::<i64>::get(&values) {
            Values::Whole(buffer.to_vec(py)?)
        } else {
            let texts: Vec<String> = values.extract()?;
            // Nothing has no type.
            if texts.is_empty() { Values::Whole(Vec::new()) } else { Values::Texts(texts) }
        };
        Ok(Column { name, values })
    };
    found.map(of_python).collect()
}

fn of_arrow(py: Python<'_>, name: String, pieces: &[Box<dyn Array>]) -> PyResult<Column> {
    let mut column = Values::Whole(Vec::new());
    for (index, piece) in pieces.iter().enumerate() {
        let before = column.len();
        let values = match values_of(piece.as_ref()) {
            Ok(values) => values,
            Err(Unfit::Type(found)) => {
                let message = format!("column `{name}` is of type {found}: give numbers or texts");
                return Err(tracks_error(py, message, None, Some(&name)));
            }
            Err(Unfit::Missing(row)) => {
                let row = before + row;
                let message =
                    format!("row {row}, column `{name}`: the text is missing; give one, or leave the row out");
                return Err(tracks_error(py, message, Some(row), Some(&name)));
            }
        };
        column = if index == 0 { values } else { joined(column, values).ok_or_else(|| mixed(&name))? };
    }
    Ok(Column { name, values: column })
}

fn mixed(name: &str) -> PyErr {
    TracksError::new_err(format!("column `{name}` has pieces of different types: give one type"))
}

/// Two pieces of one column. Whole numbers beside one with missing values are numbers.
fn joined(one: Values, other: Values) -> Option<Values> {
    let floats = |values: Vec<i64>| values.into_iter().map(|value| value as f64).collect::<Vec<f64>>();
    Some(match (one, other) {
        (Values::Numbers(mut one), Values::Numbers(other)) => {
            one.extend(other);
            Values::Numbers(one)
        }
        (Values::Whole(mut one), Values::Whole(other)) => {
            one.extend(other);
            Values::Whole(one)
        }
        (Values::Texts(mut one), Values::Texts(other)) => {
            one.extend(other);
            Values::Texts(one)
        }
        (Values::Whole(one), Values::Numbers(other)) => joined(Values::Numbers(floats(one)), Values::Numbers(other))?,
        (Values::Numbers(one), Values::Whole(other)) => joined(Values::Numbers(one), Values::Numbers(floats(other)))?,
        _ => return None,
    })
}

/// Why values cannot be used.
enum Unfit {
    /// They are of this type.
    Type(String),
    /// There is none in this row.
    Missing(usize),
}

fn values_of(array: &dyn Array) -> Result<Values, Unfit> {
    let unfit = || Unfit::Type(format!("{:?}", array.dtype()));
    if let ArrowDataType::Timestamp(unit, _) | ArrowDataType::Duration(unit) = array.dtype() {
        let per_second = match unit {
            TimeUnit::Second => 1.,
            TimeUnit::Millisecond => 1e3,
            TimeUnit::Microsecond => 1e6,
            TimeUnit::Nanosecond => 1e9,
        };
        return Ok(Values::Numbers(numbers(array, |value: i64| value as f64 / per_second).ok_or_else(unfit)?));
    }
    match array.dtype().to_physical_type() {
        PhysicalType::Primitive(primitive) => match primitive {
            PrimitiveType::Float64 => match array.as_any().downcast_ref::<PrimitiveArray<f64>>() {
                Some(values) if values.null_count() == 0 => Ok(Values::Numbers(values.values().as_slice().to_vec())),
                _ => Ok(Values::Numbers(numbers(array, |value: f64| value).ok_or_else(unfit)?)),
            },
            PrimitiveType::Float32 => {
                Ok(Values::Numbers(numbers(array, |value: f32| f64::from(value)).ok_or_else(unfit)?))
            }
            PrimitiveType::Int8 => whole::<i8>(array).ok_or_else(unfit),
            PrimitiveType::Int16 => whole::<i16>(array).ok_or_else(unfit),
            PrimitiveType::Int32 => whole::<i32>(array).ok_or_else(unfit),
            PrimitiveType::Int64 => whole::<i64>(array).ok_or_else(unfit),
            PrimitiveType::UInt8 => whole::<u8>(array).ok_or_else(unfit),
            PrimitiveType::UInt16 => whole::<u16>(array).ok_or_else(unfit),
            PrimitiveType::UInt32 => whole::<u32>(array).ok_or_else(unfit),
            PrimitiveType::UInt64 => whole::<u64>(array).ok_or_else(unfit),
            _ => Err(unfit()),
        },
        PhysicalType::Dictionary(_) => dictionary::<i8>(array)
            .or_else(|| dictionary::<i16>(array))
            .or_else(|| dictionary::<i32>(array))
            .or_else(|| dictionary::<i64>(array))
            .or_else(|| dictionary::<u8>(array))
            .or_else(|| dictionary::<u16>(array))
            .or_else(|| dictionary::<u32>(array))
            .or_else(|| dictionary::<u64>(array))
            .unwrap_or_else(|| Err(unfit())),
        _ => texts(array)
            .ok_or_else(unfit)?
            .into_iter()
            .enumerate()
            .map(present)
            .collect::<Result<_, _>>()
            .map(Values::Texts),
    }
}

fn present((row, text): (usize, Option<&str>)) -> Result<String, Unfit> {
    text.map(str::to_owned).ok_or(Unfit::Missing(row))
}

/// Numbers by way of `to`, NaN where one is missing; `None` for an array of another type.
fn numbers<T: NativeType>(array: &dyn Array, to: impl Fn(T) -> f64) -> Option<Vec<f64>> {
    let values = array.as_any().downcast_ref::<PrimitiveArray<T>>()?;
    Some(values.iter().map(|value| value.map_or(f64::NAN, |value| to(*value))).collect())
}

/// Whole numbers; numbers where some are missing or beyond 64 bits with a sign.
fn whole<T: NativeType + Into<i128>>(array: &dyn Array) -> Option<Values> {
    let values = array.as_any().downcast_ref::<PrimitiveArray<T>>()?;
    let whole = values.iter().map(|value| i64::try_from((*value?).into()).ok());
    match whole.collect() {
        Some(whole) => Some(Values::Whole(whole)),
        None => numbers(array, |value: T| value.into() as f64).map(Values::Numbers),
    }
}

/// Texts of any of Arrow's three layouts.
fn texts(array: &dyn Array) -> Option<Vec<Option<&str>>> {
    let any = array.as_any();
    if let Some(values) = any.downcast_ref::<Utf8Array<i64>>() {
        Some(values.iter().collect())
    } else if let Some(values) = any.downcast_ref::<Utf8Array<i32>>() {
        Some(values.iter().collect())
    } else {
        Some(any.downcast_ref::<BinaryViewArrayGeneric<str>>()?.iter().collect())
    }
}

/// Texts that stand in a dictionary with keys of type `K`; `None` for another type of keys.
fn dictionary<K: DictionaryKey>(array: &dyn Array) -> Option<Result<Values, Unfit>> {
    let array = array.as_any().downcast_ref::<DictionaryArray<K>>()?;
    let Some(words) = texts(array.values().as_ref()) else {
        return Some(Err(Unfit::Type(format!("{:?}", array.dtype()))));
    };
    let word =
        |(row, key): (usize, Option<usize>)| present((row, key.and_then(|key| words.get(key).copied().flatten())));
    Some(array.keys_iter().enumerate().map(word).collect::<Result<_, _>>().map(Values::Texts))
}
