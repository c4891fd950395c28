//! The streaming predictor for Python.

use std::sync::Mutex;

use gnp_data::{VehicleClass, VehicleWord};
use gnp_online::{Frame, OnlineError as StreamError, Stream, StreamConfig, Tracked, Validity};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;

use crate::column::{Column, Values, columns};
use crate::error::{OnlineError, chain, tracks_error};
use crate::model::PyModel;
use crate::tracks;

/// Columns of a frame that are read.
const READ: [&str; 8] = ["id", "x", "y", "vx", "vy", "length", "width", "class"];

/// A stream; `gnp.online.Stream` holds one.
#[pyclass(frozen, module = "gnp._gnp", name = "Stream")]
pub(crate) struct PyStream(Mutex<Stream>);

/// What a stream gives for a frame, in memory of its own.
#[pyclass(frozen, module = "gnp._gnp", name = "Frame")]
pub(crate) struct PyFrame {
    time_s: f64,
    modes: usize,
    steps: usize,
    ids: Vec<u64>,
    validity: Vec<&'static str>,
    reasons: Vec<Option<String>>,
    problems: Vec<(usize, u64, String)>,
    /// Arrays by name, one entry a vehicle first: NaN where there is no forecast.
    arrays: Vec<(String, Vec<f64>)>,
}

#[pymethods]
impl PyStream {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "as the Python class has them")]
    fn new(
        py: Python<'_>,
        model: &PyModel,
        lines: Vec<f64>,
        k: usize,
        road: Option<Vec<[f64; 2]>>,
        site: Option<String>,
        coast_s: f64,
        bridge_s: f64,
        max_vehicles: usize,
        max_rate_hz: f64,
        forces: bool,
    ) -> PyResult<Self> {
        let options = tracks::options(road, Some(lines))?;
        let mut config = StreamConfig {
            k,
            road: options.road,
            coast_s,
            bridge_s,
            max_vehicles,
            max_rate_hz,
            ..StreamConfig::default()
        };
        if let Some(site) = site {
            config.site = site;
        }
        let gnp = model.gnp().clone().explaining(forces);
        let stream = py.detach(|| Stream::new(&gnp, options.lines.unwrap_or_default(), config));
        Ok(Self(Mutex::new(stream.map_err(raised)?)))
    }

    /// Takes the vehicles that were detected at a time, and predicts them.
    fn push(&self, py: Python<'_>, time_s: f64, source: &Bound<'_, PyAny>) -> PyResult<PyFrame> {
        let tracks = read(source)?;
        py.detach(|| {
            let mut stream = self.stream()?;
            stream.push(time_s, &tracks).map(|frame| PyFrame::of(&frame)).map_err(raised)
        })
    }

    /// Moves the lane lines.
    fn set_lines(&self, py: Python<'_>, lines: Vec<f64>) -> PyResult<()> {
        let lines = tracks::options(None, Some(lines))?.lines.unwrap_or_default();
        py.detach(|| self.stream()?.set_lines(lines).map_err(raised))
    }

    /// Forgets all vehicles and the time.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| {
            self.stream()?.reset();
            Ok(())
        })
    }
}

impl PyStream {
    fn stream(&self) -> PyResult<std::sync::MutexGuard<'_, Stream>> {
        self.0.lock().map_err(|_| OnlineError::new_err("the stream failed in another thread: make a new one"))
    }
}

#[pymethods]
impl PyFrame {
    #[getter]
    fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Vehicles, futures, steps.
    fn shape(&self) -> (usize, usize, usize) {
        (self.ids.len(), self.modes, self.steps)
    }

    fn ids(&self) -> Vec<u64> {
        self.ids.clone()
    }

    fn validity(&self) -> Vec<&'static str> {
        self.validity.clone()
    }

    fn reasons(&self) -> Vec<Option<String>> {
        self.reasons.clone()
    }

    fn problems(&self) -> Vec<(usize, u64, String)> {
        self.problems.clone()
    }

    /// Names of the forces' arrays.
    fn forces(&self) -> Vec<&str> {
        self.arrays.iter().filter_map(|(name, _)| name.strip_prefix("force_")).collect()
    }

    /// Writes the array of that name into `out`.
    fn fill(&self, name: &str, out: &Bound<'_, PyAny>) -> PyResult<()> {
        let found = self.arrays.iter().find(|(array, _)| array == name);
        let (_, values) = found.ok_or_else(|| PyKeyError::new_err(name.to_owned()))?;
        PyBuffer::<f64>::get(out)?.copy_from_slice(out.py(), values)
    }
}

impl PyFrame {
    fn of(frame: &Frame<'_>) -> Self {
        let (modes, steps, vehicles) = (frame.modes(), frame.steps(), frame.vehicles().len());
        let each = 2 * modes * steps;
        let mut paths = Vec::with_capacity(vehicles * each);
        let mut probabilities = Vec::with_capacity(vehicles * modes);
        let mut forces: Vec<Vec<f64>> = vec![Vec::new(); frame.terms().len()];
        let [mut position, mut age, mut seen, mut gap] = <[Vec<f64>; 4]>::default();
        let (mut validity, mut reasons) = (Vec::with_capacity(vehicles), Vec::with_capacity(vehicles));
        for (row, vehicle) in frame.vehicles().enumerate() {
            for mode in 0..modes {
                paths.extend(vehicle.path(mode).iter().flatten());
                for (term, force) in forces.iter_mut().enumerate() {
                    force.extend(vehicle.force(term, mode).iter().flatten().map(|value| f64::from(*value)));
                }
            }
            paths.resize((row + 1) * each, f64::NAN);
            forces.iter_mut().for_each(|force| force.resize((row + 1) * each, f64::NAN));
            probabilities.extend(vehicle.probabilities().iter().map(|value| f64::from(*value)));
            probabilities.resize((row + 1) * modes, f64::NAN);
            position.extend(vehicle.position());
            age.push(vehicle.age_s());
            gap.push(vehicle.gap_s());
            let (word, seen_s, reason) = match vehicle.validity() {
                Validity::Full => ("full", f64::NAN, None),
                Validity::Filled { observed_s } => ("filled", observed_s, None),
                Validity::Interpolated { .. } => ("interpolated", f64::NAN, None),
                Validity::Not(reason) => ("not", f64::NAN, Some(reason.to_string())),
                _ => ("unknown", f64::NAN, None),
            };
            validity.push(word);
            seen.push(seen_s);
            reasons.push(reason);
        }
        let named = [("paths", paths), ("probabilities", probabilities), ("position", position), ("age_s", age)];
        let named = named.into_iter().chain([("observed_s", seen), ("gap_s", gap)]);
        let mut arrays: Vec<(String, Vec<f64>)> = named.map(|(name, values)| (name.to_owned(), values)).collect();
        let terms = frame.terms().iter().map(|term| format!("force_{}", term.term.name));
        arrays.extend(terms.zip(forces));
        Self {
            time_s: frame.time_s(),
            modes,
            steps,
            ids: frame.vehicles().map(|vehicle| vehicle.id()).collect(),
            validity,
            reasons,
            problems: frame.problems().iter().map(|it| (it.row, it.id, it.reason.to_string())).collect(),
            arrays,
        }
    }
}

/// The tracks of a frame: columns id, x, y, and optionally vx and vy, length and width, class.
fn read(source: &Bound<'_, PyAny>) -> PyResult<Vec<Tracked>> {
    let py = source.py();
    let mut found = columns(source, |name| READ.contains(&name))?;
    let mut take =
        |name: &str| found.iter().position(|column| column.name == name).map(|index| found.swap_remove(index));
    let missing = |name: &str| tracks_error(py, format!("a frame has no column `{name}`"), None, Some(name));
    let ids: Vec<u64> = match take("id").ok_or_else(|| missing("id"))?.values {
        // Numbers of 64 bits with a sign become others without one, and different ones different ones.
        Values::Whole(ids) => ids.into_iter().map(i64::cast_unsigned).collect(),
        // A frame without vehicles has no type.
        values if values.len() == 0 => Vec::new(),
        _ => return Err(tracks_error(py, "ids must be whole numbers".to_owned(), None, Some("id"))),
    };
    let mut numbers = |name: &str| match take(name) {
        None => Ok(None),
        Some(Column { values, .. }) if values.len() != ids.len() => {
            let message = format!("column `{name}` has {} rows, `id` has {}", values.len(), ids.len());
            Err(tracks_error(py, message, None, Some(name)))
        }
        Some(Column { values: Values::Numbers(values), .. }) => Ok(Some(values)),
        Some(Column { values: Values::Whole(values), .. }) => {
            Ok(Some(values.into_iter().map(|it| it as f64).collect()))
        }
        Some(_) => Err(tracks_error(py, format!("column `{name}` has texts: give numbers"), None, Some(name))),
    };
    let (x, y) = (numbers("x")?.ok_or_else(|| missing("x"))?, numbers("y")?.ok_or_else(|| missing("y"))?);
    let velocity = numbers("vx")?.zip(numbers("vy")?);
    let size = numbers("length")?.zip(numbers("width")?);
    let class = match take("class").map(|column| column.values) {
        Some(Values::Texts(words)) if words.len() == ids.len() => Some(words),
        Some(values) if values.len() == 0 => None,
        Some(_) => {
            return Err(tracks_error(
                py,
                "column `class` must have a word in each row".to_owned(),
                None,
                Some("class"),
            ));
        }
        None => None,
    };
    // NaN where it is not known of a vehicle.
    let pair = |pair: &Option<(Vec<f64>, Vec<f64>)>, row: usize| {
        let (one, other) = pair.as_ref().map(|(one, other)| (one[row] as f32, other[row] as f32))?;
        (!one.is_nan() && !other.is_nan()).then_some([one, other])
    };
    let track = |(row, id): (usize, &u64)| {
        let mut track = Tracked::new(*id, [x[row], y[row]]);
        track.velocity = pair(&velocity, row);
        track.size = pair(&size, row);
        if let Some(words) = &class {
            track.class = match VehicleWord::of(&words[row]) {
                VehicleWord::Class(class) => class,
                _ => VehicleClass::Car,
            };
        }
        track
    };
    Ok(ids.iter().enumerate().map(track).collect())
}

fn raised(error: StreamError) -> PyErr {
    match error {
        error @ (StreamError::Config { .. } | StreamError::LaneWidth { .. }) => {
            PyValueError::new_err(error.to_string())
        }
        error => OnlineError::new_err(chain(&error)),
    }
}
