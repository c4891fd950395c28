//! A table that goes to Python: columns of Arrow, handed over without a copy or written into NumPy's arrays.

use polars_arrow::array::{Array, PrimitiveArray, Utf8Array};
use polars_arrow::types::NativeType;
use pyo3::buffer::{Element, PyBuffer};
use pyo3::exceptions::{PyKeyError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyList};

use crate::arrow;

/// Columns of one length, by name and in order.
#[pyclass(frozen, module = "gnp._gnp")]
pub(crate) struct Columns {
    columns: Vec<(String, Box<dyn Array>)>,
    rows: usize,
}

/// Fills a [`Columns`].
#[derive(Default)]
pub(crate) struct ColumnsBuilder(Vec<(String, Box<dyn Array>)>);

impl ColumnsBuilder {
    /// Adds a column of numbers.
    pub(crate) fn numbers<T: NativeType>(&mut self, name: impl Into<String>, values: Vec<T>) {
        self.0.push((name.into(), PrimitiveArray::from_vec(values).boxed()));
    }

    /// Adds a column of texts.
    pub(crate) fn texts<S: AsRef<str>>(&mut self, name: impl Into<String>, values: impl Iterator<Item = S>) {
        self.0.push((name.into(), Utf8Array::<i64>::from_iter_values(values).boxed()));
    }

    /// The table.
    pub(crate) fn finish(self) -> Columns {
        let rows = self.0.first().map_or(0, |(_, values)| values.len());
        Columns { columns: self.0, rows }
    }
}

#[pymethods]
impl Columns {
    fn __len__(&self) -> usize {
        self.rows
    }

    /// Names of the columns.
    fn names(&self) -> Vec<&str> {
        self.columns.iter().map(|(name, _)| name.as_str()).collect()
    }

    /// NumPy's name of a column's type; `str` for texts.
    fn dtype(&self, name: &str) -> PyResult<&'static str> {
        let values = self.column(name)?.as_any();
        Ok(if values.is::<PrimitiveArray<f64>>() {
            "float64"
        } else if values.is::<PrimitiveArray<f32>>() {
            "float32"
        } else if values.is::<PrimitiveArray<i64>>() {
            "int64"
        } else if values.is::<PrimitiveArray<u32>>() {
            "uint32"
        } else {
            "str"
        })
    }

    /// Writes a column of numbers into an array of its length and type.
    fn fill(&self, name: &str, out: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = self.column(name)?;
        for write in [write::<f64>, write::<f32>, write::<i64>, write::<u32>] {
            if write(values, out)? {
                return Ok(());
            }
        }
        Err(PyTypeError::new_err(format!("column `{name}` is of texts: take `texts`")))
    }

    /// A column of texts.
    fn texts<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyList>> {
        let values = self.column(name)?.as_any().downcast_ref::<Utf8Array<i64>>();
        let values =
            values.ok_or_else(|| PyTypeError::new_err(format!("column `{name}` is of numbers: take `fill`")))?;
        PyList::new(py, values.values_iter())
    }

    /// The table by Arrow's C stream interface.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // Another schema is a wish that need not be granted.
        drop(requested_schema);
        arrow::give(py, self.columns.iter().cloned(), self.rows)
    }
}

impl Columns {
    fn column(&self, name: &str) -> PyResult<&dyn Array> {
        let found = self.columns.iter().find(|(column, _)| column == name);
        found.map(|(_, values)| &**values).ok_or_else(|| PyKeyError::new_err(name.to_owned()))
    }
}

/// Writes `values` into `out` where they are of type `T`, and says whether they are.
fn write<T: NativeType + Element>(values: &dyn Array, out: &Bound<'_, PyAny>) -> PyResult<bool> {
    let Some(values) = values.as_any().downcast_ref::<PrimitiveArray<T>>() else { return Ok(false) };
    PyBuffer::<T>::get(out)?.copy_from_slice(out.py(), values.values().as_slice())?;
    Ok(true)
}
