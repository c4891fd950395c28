//! Exceptions of the package, each a `gnp.GnpError`.

use std::error::Error;

use gnp_data::DataError;
use gnp_eval::EvalError;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;

create_exception!(
    gnp,
    GnpError,
    PyException,
    "Whatever goes wrong in gnp; the message says where, what and what to do."
);
create_exception!(
    gnp,
    TracksError,
    GnpError,
    "Tracks that cannot be read. `row` (from 0) and `column` say where, None where it is no single place."
);
create_exception!(
    gnp,
    ModelError,
    GnpError,
    "A model that is not there, is damaged, or does not fit what it is asked."
);
create_exception!(gnp, OnlineError, GnpError, "A frame that a stream refuses.");
create_exception!(gnp, ForceError, GnpError, "A number that the physics does not allow.");
create_exception!(gnp, EvaluationError, GnpError, "Forecasts that cannot be scored.");

/// What goes wrong while Python is not looked at.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The tracks.
    Tracks(DataError),
    /// The scores.
    Evaluation(EvalError),
    /// Somebody asked to stop, which Python says itself.
    Stopped,
    /// Something that the tracks do not have.
    Question(String),
    /// Anything else.
    Other(gnp::Error),
}

impl From<DataError> for Failure {
    fn from(error: DataError) -> Self {
        Self::Tracks(error)
    }
}

impl From<EvalError> for Failure {
    fn from(error: EvalError) -> Self {
        Self::Evaluation(error)
    }
}

impl From<gnp::Error> for Failure {
    fn from(error: gnp::Error) -> Self {
        if error.is_stopped() { Self::Stopped } else { Self::Other(error) }
    }
}

impl Failure {
    /// The exception.
    pub(crate) fn raised(self, py: Python<'_>) -> PyErr {
        match self {
            Self::Tracks(error) => {
                let (row, column) = match &error {
                    DataError::Tracks { place, .. } => place_of(place),
                    _ => (None, None),
                };
                tracks_error(py, chain(&error), row, column.as_deref())
            }
            Self::Evaluation(error) => EvaluationError::new_err(chain(&error)),
            Self::Question(message) => TracksError::new_err(message),
            Self::Stopped => PyKeyboardInterrupt::new_err(()),
            Self::Other(error) => {
                let mut inner = &error;
                while let gnp::Error::While { source, .. } = inner {
                    inner = source;
                }
                let message = error.chain();
                match inner {
                    gnp::Error::Data(_) | gnp::Error::Recordings(_) => TracksError::new_err(message),
                    gnp::Error::Model(_) | gnp::Error::Predict(_) | gnp::Error::File(_) | gnp::Error::Folder(_) => {
                        ModelError::new_err(message)
                    }
                    gnp::Error::Evaluate(_) | gnp::Error::Predictions(_) => EvaluationError::new_err(message),
                    _ => GnpError::new_err(message),
                }
            }
        }
    }
}

/// A [`TracksError`] that says at which row, from 0, and in which column.
pub(crate) fn tracks_error(py: Python<'_>, message: String, row: Option<usize>, column: Option<&str>) -> PyErr {
    let error = TracksError::new_err(message);
    let value = error.value(py);
    match value.setattr("row", row).and_then(|()| value.setattr("column", column)) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// The row and the column that a place such as ``tracks, row 3, column `x` `` names.
fn place_of(place: &str) -> (Option<usize>, Option<String>) {
    let after = |word: &str| place.rsplit_once(word).map(|(_, rest)| rest);
    let row = after(", row ").and_then(|rest| rest.split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok());
    let column = after(", column `").and_then(|rest| rest.split('`').next()).map(str::to_owned);
    (row, column)
}

/// An error with all that caused it.
pub(crate) fn chain(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let words = cause.to_string();
        if !text.ends_with(&words) {
            text = format!("{text}: {words}");
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
    module.add("OnlineError", py.get_type::<OnlineError>())?;
    module.add("ForceError", py.get_type::<ForceError>())?;
    module.add("EvaluationError", py.get_type::<EvaluationError>())
}
