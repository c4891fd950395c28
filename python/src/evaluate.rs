//! Forecasts of anyone held against what the tracks then did.

use std::collections::{BTreeMap, BTreeSet};

use gnp::Machine;
use gnp_baselines::ConstantVelocity;
use gnp_data::{DataError, Forecast, Mode, Recording, Subset, TrackOptions, TrackTable, WindowConfig, WindowId, WindowSet};
use gnp_eval::{Bootstrap, EvalConfig, EvalError, EvaluatedModel, Prediction, Predictions, Protocol, Score, evaluate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::column::{Column, Values, columns};
use crate::error::{EvaluationError, Failure};
use crate::table::{Columns, ColumnsBuilder};
use crate::tracks;
use crate::watch::watched;

/// Resamples of the intervals, and their seed.
const BOOTSTRAP: Bootstrap = Bootstrap { resamples: 1000, seed: 0 };

/// Columns that are read: the vehicle by name or number, and where it is in the plane of the tracks.
const READ: [&str; 8] = ["vehicle", "vehicle_name", "time_s", "mode", "probability", "step", "x", "y"];

/// Forecasts as a table has them.
struct Given {
    /// Name of the vehicle in each row.
    vehicle: Vec<String>,
    /// time_s, mode, probability, step, x, y.
    numbers: [Vec<f64>; 6],
}

/// A step of a forecast: probability of its mode, and where, m.
type Point = (f64, [f64; 2]);
/// The modes of a vehicle at a frame, each by step.
type Futures = BTreeMap<(u32, u32), BTreeMap<i64, BTreeMap<i64, Point>>>;

/// Scores forecasts, and constant velocity on the same windows, under a protocol; and sentences on what was not scored.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "as the Python function has them")]
pub(crate) fn score(
    py: Python<'_>,
    forecasts: &Bound<'_, PyAny>,
    source: &Bound<'_, PyAny>,
    protocol: &str,
    name: &str,
    observed_s: f64,
    road: Option<Vec<[f64; 2]>>,
    lines: Option<Vec<f64>>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Columns, Vec<String>)> {
    let Some(protocol) = Protocol::ALL.into_iter().find(|known| known.name() == protocol) else {
        let known = Protocol::ALL.map(Protocol::name).join(", ");
        return Err(PyValueError::new_err(format!("protocol is '{protocol}', but must be one of {known}")));
    };
    let given = Given::read(forecasts)?;
    let table = tracks::read(source)?;
    let options = tracks::options(road, lines)?;
    watched(py, threads, progress, |machine| given.scored(name, &table, &options, observed_s, protocol, machine))
}

impl Given {
    fn read(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mut found = columns(source, |name| READ.contains(&name))?;
        let missing = |name: &str| EvaluationError::new_err(format!("forecasts have no column `{name}`: see Model.predict"));
        let mut take = |name: &str| found.iter().position(|column| column.name == name).map(|index| found.swap_remove(index));
        let number = take("vehicle");
        let Column { name, values } = take("vehicle_name").or(number).ok_or_else(|| missing("vehicle"))?;
        let vehicle = match values {
            Values::Texts(names) => names,
            Values::Whole(numbers) => numbers.iter().map(i64::to_string).collect(),
            Values::Numbers(_) => {
                return Err(EvaluationError::new_err(format!("column `{name}` of forecasts has numbers that are no ids")));
            }
        };
        let mut numbers: [Vec<f64>; 6] = Default::default();
        for (column, name) in numbers.iter_mut().zip(&READ[2..]) {
            *column = match take(name).ok_or_else(|| missing(name))?.values {
                Values::Numbers(values) => values,
                Values::Whole(values) => values.into_iter().map(|value| value as f64).collect(),
                Values::Texts(_) => {
                    return Err(EvaluationError::new_err(format!("column `{name}` of forecasts has texts: give numbers")));
                }
            };
            if let Some(row) = column.iter().position(|value| !value.is_finite()) {
                return Err(EvaluationError::new_err(format!("forecasts, row {row}, column `{name}`: {}", column[row])));
            }
        }
        Ok(Self { vehicle, numbers })
    }

    fn scored(
        &self,
        name: &str,
        tracks: &TrackTable,
        options: &TrackOptions,
        observed_s: f64,
        protocol: Protocol,
        machine: &Machine,
    ) -> Result<(Columns, Vec<String>), Failure> {
        let (recordings, reports): (Vec<_>, Vec<_>) = tracks.recordings(options)?.into_iter().unzip();
        let mut notes: Vec<String> = reports.iter().flat_map(|report| report.remarks()).collect();
        let Some(recording) = recordings.first() else { return Ok((ColumnsBuilder::default().finish(), notes)) };
        let futures = self.futures(recording, &mut notes);
        let steps = futures.values().flat_map(BTreeMap::values).map(BTreeMap::len).max().unwrap_or_default();
        let rate_hz = self.rate_hz(recording);
        let config = WindowConfig {
            observed_s,
            predicted_s: steps as f64 / rate_hz,
            rate_hz,
            stride_s: 1. / rate_hz.max(recording.meta().rate_hz),
            site_stride_s: BTreeMap::new(),
        };
        let (set, _) = WindowSet::cut(&recordings, &config)?;
        let mut predictions = Vec::new();
        let mut ids = Vec::new();
        for id in set.ids() {
            let Some(window) = set.get(*id) else { continue };
            let key = window.key();
            let Some(modes) = futures.get(&(key.vehicle, key.t0)) else { continue };
            let (origin, road) = (window.observation().origin(), recording.tracks()[id.track as usize].road);
            let Some(forecast) = forecast(modes, steps, origin, |at| from_file(recording, road, at)) else { continue };
            predictions.push(Prediction { key, origin: Some(origin), forecast });
            ids.push(*id);
        }
        let unscored = futures.len() - ids.len();
        if unscored > 0 {
            notes.push(format!(
                "{unscored} forecasts are not scored: the tracks do not have all {observed_s} s before or all {} s after, or \
                 the forecast has fewer steps than others",
                config.predicted_s
            ));
        }
        let predictions = Predictions::new(name, predictions);
        Ok((score_on(&set, &ids, &predictions, rate_hz, protocol, machine)?, notes))
    }

    /// Rate of the steps, Hz: the times of steps are those of the tracks' frames, `horizon_s` is not needed.
    fn rate_hz(&self, recording: &Recording) -> f64 {
        let _ = self;
        recording.meta().rate_hz
    }

    /// By vehicle and frame; what names no vehicle or no frame is counted.
    fn futures(&self, recording: &Recording, notes: &mut Vec<String>) -> Futures {
        let meta = recording.meta();
        let mut vehicles: BTreeMap<&str, Option<u32>> = BTreeMap::new();
        let mut futures = Futures::new();
        let mut unknown = BTreeSet::new();
        let [time_s, mode, probability, step, x, y] = &self.numbers;
        for (row, name) in self.vehicle.iter().enumerate() {
            let frame = ((time_s[row] - meta.start_s) * meta.rate_hz).round();
            match vehicles.entry(name).or_insert_with(|| recording.vehicle_named(name)) {
                Some(vehicle) if frame >= 0. => {
                    let modes = futures.entry((*vehicle, frame as u32)).or_default();
                    let steps = modes.entry(mode[row] as i64).or_default();
                    steps.insert(step[row] as i64, (probability[row], [x[row], y[row]]));
                }
                _ => drop(unknown.insert(name.as_str())),
            }
        }
        if !unknown.is_empty() {
            let some: Vec<&str> = unknown.iter().take(3).copied().collect();
            notes.push(format!("forecasts of {} vehicles that have no tracks are left out, of {}", unknown.len(), some.join(", ")));
        }
        futures
    }
}
