//! Exceptions of the package, each a `gnp.GnpError`.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(gnp, GnpError, PyException, "Whatever goes wrong in gnp; the message says where, what and what to do.");
create_exception!(
    gnp,
    TracksError,
    GnpError,
    "Tracks that cannot be read. `row` (from 0) and `column` say where, None where it is no single place."
);
create_exception!(gnp, ModelError, GnpError, "A model that is not there, is damaged, or does not fit what it is asked.");
create_exception!(gnp, ForceError, GnpError, "A number that the physics does not allow.");
create_exception!(gnp, EvaluationError, GnpError, "Forecasts that cannot be scored.");

/// A [`TracksError`] that says at which row, from 0, and in which column.
pub(crate) fn tracks_error(py: Python<'_>, message: String, row: Option<usize>, column: Option<&str>) -> PyErr {
    let error = TracksError::new_err(message);
    let value = error.value(py);
    match value.setattr("row", row).and_then(|()| value.setattr("column", column)) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// An exception with the whole chain of what caused it.
pub(crate) fn chain(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let cause_text = cause.to_string();
        if !text.ends_with(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        next = cause.source();
    }
    text
}

/// Puts the exceptions into the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("GnpError", py.get_type::<GnpError>())?;
    module.add("TracksError", py.get_type::<TracksError>())?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("ForceError", py.get_type::<ForceError>())?;
    module.add("EvaluationError", py.get_type::<EvaluationError>())
}
