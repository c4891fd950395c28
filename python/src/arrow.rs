//! Tables from and to Python by the C stream interface of Arrow (the *PyCapsule interface*): no column is copied on its way
//! over the border, whichever library made it.
#![allow(unsafe_code, reason = "memory of another library is taken over by the rules of Arrow's C interface")]

use std::ffi::CStr;
use std::fmt;

use polars_arrow::array::{Array, StructArray};
use polars_arrow::datatypes::{ArrowDataType, Field};
use polars_arrow::ffi::{ArrowArrayStream, ArrowArrayStreamReader, export_iterator};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::error::{GnpError, TracksError};

const STREAM: &CStr = c"arrow_array_stream";

/// A column as Arrow has it: its name, and its values in one piece or several.
pub(crate) struct ArrowColumn {
    pub(crate) name: String,
    pub(crate) pieces: Vec<Box<dyn Array>>,
}

/// Columns of any object that has `__arrow_c_stream__`: a data frame of polars or pandas, a table of PyArrow.
///
/// # Errors
/// What the object's method raises, and [`TracksError`] for a stream that is not one of tables.
pub(crate) fn take(object: &Bound<'_, PyAny>) -> PyResult<Vec<ArrowColumn>> {
    let capsule = object.call_method0("__arrow_c_stream__")?;
    let capsule = capsule.cast::<PyCapsule>()?;
    let pointer = capsule.pointer_checked(Some(STREAM))?.cast::<ArrowArrayStream>();
    // SAFETY: a capsule of this name has a pointer to an `ArrowArrayStream`, says the PyCapsule interface. The stream is moved
    // out and a released one left in its place, so that the capsule's destructor does not release it once more.
    let stream = unsafe { std::ptr::replace(pointer.as_ptr(), ArrowArrayStream::empty()) };
    // SAFETY: who makes such a capsule promises a stream that follows the C stream interface.
    let mut reader = unsafe { ArrowArrayStreamReader::try_new(Box::new(stream)) }.map_err(failed)?;
    let ArrowDataType::Struct(fields) = reader.field().dtype() else {
        return Err(TracksError::new_err(
            "the Arrow stream is one column, not a table: give a table with named columns",
        ));
    };
    let mut columns: Vec<ArrowColumn> =
        fields.iter().map(|field| ArrowColumn { name: field.name.to_string(), pieces: Vec::new() }).collect();
    // SAFETY: as above, of each array of the stream.
    while let Some(batch) = unsafe { reader.next() } {
        let batch = batch.map_err(failed)?;
        let batch = batch.as_any().downcast_ref::<StructArray>();
        let batch = batch.ok_or_else(|| TracksError::new_err("the Arrow stream gave an array that is no table"))?;
        for (column, values) in columns.iter_mut().zip(batch.values()) {
            column.pieces.push(values.clone());
        }
    }
    Ok(columns)
}

/// A capsule with columns of one length, for the method `__arrow_c_stream__`.
///
/// # Errors
/// When Python has no memory.
pub(crate) fn give<'py>(
    py: Python<'py>,
    columns: impl Iterator<Item = (String, Box<dyn Array>)>,
    rows: usize,
) -> PyResult<Bound<'py, PyCapsule>> {
    let (fields, values): (Vec<Field>, Vec<_>) = columns
        .map(|(name, values)| (Field::new(name.into(), values.dtype().clone(), values.null_count() > 0), values))
        .unzip();
    let dtype = ArrowDataType::Struct(fields);
    let table = StructArray::try_new(dtype.clone(), rows, values, None)
        .map_err(|error| GnpError::new_err(format!("columns that make no table: {error}")))?;
    let stream = export_iterator(Box::new(std::iter::once(Ok(table.boxed()))), Field::new("".into(), dtype, false));
    PyCapsule::new_with_value(py, stream, STREAM)
}

fn failed(error: impl fmt::Display) -> PyErr {
    TracksError::new_err(format!("the Arrow stream cannot be read: {error}"))
}
