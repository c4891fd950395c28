//! A trained model for Python.

use std::path::PathBuf;

use gnp::{At, Machine, Model, Precision, PrecisionError};
use gnp_model::Gnp;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{Failure, ModelError};
use crate::explain::{Told, explain};
use crate::predict::{Forecasts, Question, predict};
use crate::tracks;
use crate::watch::watched;

/// A trained model; `gnp.Model` holds one.
#[pyclass(frozen, module = "gnp._gnp", name = "Model")]
pub(crate) struct PyModel(Model);

#[pymethods]
impl PyModel {
    /// The model in a folder, or the one that comes with the package, in its own precision or another.
    #[new]
    #[pyo3(signature = (path = None, precision = None))]
    fn new(py: Python<'_>, path: Option<PathBuf>, precision: Option<&str>) -> PyResult<Self> {
        let precision: Option<Precision> = match precision {
            Some(name) => Some(name.parse().map_err(|error: PrecisionError| {
                PyValueError::new_err(format!("precision is {name:?}, but {error}"))
            })?),
            None => None,
        };
        let model = py.detach(|| {
            let model = Model::open(path.as_deref(), &Machine::default())?;
            match precision {
                Some(precision) => model.with_precision(precision),
                None => Ok(model),
            }
        });
        model.map(Self).map_err(|error| Failure::from(error).raised(py))
    }

    /// The card as JSON.
    fn card(&self) -> PyResult<String> {
        serde_json::to_string(self.0.card()).map_err(|error| ModelError::new_err(error.to_string()))
    }

    /// Forecasts as a table, and sentences on what is not among them.
    #[expect(clippy::too_many_arguments, reason = "as the Python method has them")]
    fn predict(
        &self,
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        at: Option<Vec<f64>>,
        every: Option<f64>,
        k: usize,
        road: Option<Vec<[f64; 2]>>,
        lines: Option<Vec<f64>>,
        forces: bool,
        threads: Option<usize>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Forecasts> {
        let most = self.gnp().modes().len();
        if !(1..=most).contains(&k) {
            return Err(PyValueError::new_err(format!(
                "k is {k}, but must be from 1 to {most}, the futures of the model"
            )));
        }
        let at = match (at, every) {
            (Some(times), _) => At::Times(times),
            (None, Some(every)) if every > 0. && every.is_finite() => At::Every(every),
            (None, Some(every)) => {
                return Err(PyValueError::new_err(format!("every is {every}, but must be above 0 s")));
            }
            (None, None) => At::Last,
        };
        let table = tracks::read(source)?;
        let options = tracks::options(road, lines)?;
        let question = Question { at, k, forces };
        watched(py, threads, progress, |machine| predict(self.gnp(), &table, &options, &question, machine))
    }

    /// Why the prediction of a vehicle is what it is.
    fn explain(
        &self,
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        vehicle: &str,
        at: Option<f64>,
        road: Option<Vec<[f64; 2]>>,
        lines: Option<Vec<f64>>,
    ) -> PyResult<Told> {
        let table = tracks::read(source)?;
        let options = tracks::options(road, lines)?;
        watched(py, None, None, |_| explain(&self.0, &table, &options, vehicle, at))
    }
}

impl PyModel {
    /// The predictor.
    pub(crate) fn gnp(&self) -> &Gnp {
        self.0.gnp()
    }
}
