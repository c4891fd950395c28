//! Forecasts of anyone held against what the tracks then did.

use std::collections::{BTreeMap, BTreeSet};

use gnp::Machine;
use gnp_baselines::ConstantVelocity;
use gnp_data::{Forecast, Mode, Recording, Subset, TrackOptions, TrackTable, WindowConfig, WindowId, WindowSet};
use gnp_eval::{Bootstrap, EvalConfig, EvalError, EvaluatedModel, Prediction, Predictions, Protocol, Score, evaluate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::column::{Column, Values, columns};
use crate::error::{EvaluationError, Failure};
use crate::remarks::Remarks;
use crate::table::{Columns, ColumnsBuilder};
use crate::tracks;
use crate::watch::watched;

/// Resamples of the intervals, and their seed.
const BOOTSTRAP: Bootstrap = Bootstrap { resamples: 1000, seed: 0 };

/// Columns that are read: the vehicle by name or number, and where it is in the plane of the tracks.
const READ: [&str; 9] = ["vehicle", "vehicle_name", "time_s", "mode", "probability", "step", "horizon_s", "x", "y"];

/// Forecasts as a table has them.
struct Given {
    /// Name of the vehicle in each row.
    vehicle: Vec<String>,
    /// The other columns of [`READ`], in its order.
    numbers: [Vec<f64>; 7],
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
) -> PyResult<(Columns, Remarks)> {
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
        let missing =
            |name: &str| EvaluationError::new_err(format!("forecasts have no column `{name}`: see Model.predict"));
        let mut take =
            |name: &str| found.iter().position(|column| column.name == name).map(|index| found.swap_remove(index));
        let number = take("vehicle");
        let Column { name, values } = take("vehicle_name").or(number).ok_or_else(|| missing("vehicle"))?;
        let vehicle = match values {
            Values::Texts(names) => names,
            Values::Whole(numbers) => numbers.iter().map(i64::to_string).collect(),
            Values::Numbers(_) => {
                return Err(EvaluationError::new_err(format!(
                    "column `{name}` of forecasts has numbers that are no ids"
                )));
            }
        };
        let mut numbers: [Vec<f64>; 7] = Default::default();
        for (column, name) in numbers.iter_mut().zip(&READ[2..]) {
            *column = match take(name).ok_or_else(|| missing(name))?.values {
                Values::Numbers(values) => values,
                Values::Whole(values) => values.into_iter().map(|value| value as f64).collect(),
                Values::Texts(_) => {
                    return Err(EvaluationError::new_err(format!(
                        "column `{name}` of forecasts has texts: give numbers"
                    )));
                }
            };
            if let Some(row) = column.iter().position(|value| !value.is_finite()) {
                return Err(EvaluationError::new_err(format!(
                    "forecasts, row {row}, column `{name}`: {}",
                    column[row]
                )));
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
    ) -> Result<(Columns, Remarks), Failure> {
        let (recordings, reports): (Vec<_>, Vec<_>) = tracks.recordings(options)?.into_iter().unzip();
        let mut remarks = Remarks::default();
        reports.iter().for_each(|report| remarks.add(report));
        let Some(recording) = recordings.first() else { return Ok((ColumnsBuilder::default().finish(), remarks)) };
        let futures = self.futures(recording, &mut remarks);
        let steps = futures.values().flat_map(BTreeMap::values).map(BTreeMap::len).max().unwrap_or_default();
        let rate_hz = self.rate_hz()?;
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
            remarks.left_out.push(format!(
                "{unscored} forecasts are not scored: the tracks do not have all {observed_s} s before or all {} s after, or \
                 the forecast has fewer steps than others",
                config.predicted_s
            ));
        }
        let predictions = Predictions::new(name, predictions);
        Ok((score_on(&set, &ids, &predictions, rate_hz, protocol, machine)?, remarks))
    }

    /// Rate of the steps, Hz.
    fn rate_hz(&self) -> Result<f64, Failure> {
        let [_, _, _, step, horizon_s, ..] = &self.numbers;
        let rate = step.first().zip(horizon_s.first()).map(|(step, horizon_s)| step / horizon_s);
        rate.filter(|rate| rate.is_finite() && *rate > 0.).ok_or_else(|| EvalError::NoWindows.into())
    }

    /// By vehicle and frame; what names no vehicle or no frame is counted.
    fn futures(&self, recording: &Recording, remarks: &mut Remarks) -> Futures {
        let meta = recording.meta();
        let mut vehicles: BTreeMap<&str, Option<u32>> = BTreeMap::new();
        let mut futures = Futures::new();
        let mut unknown = BTreeSet::new();
        let [time_s, mode, probability, step, _, x, y] = &self.numbers;
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
            remarks.left_out.push(format!(
                "forecasts of {} vehicles that have no tracks are left out, of {}",
                unknown.len(),
                some.join(", ")
            ));
        }
        futures
    }
}

/// A forecast of `steps` steps from `origin`, m in the road frame; `None` where a mode lacks a step or a point has no place on
/// the road. Probabilities are made to sum to 1.
fn forecast(
    modes: &BTreeMap<i64, BTreeMap<i64, Point>>,
    steps: usize,
    origin: [f32; 2],
    to_road: impl Fn([f64; 2]) -> Option<[f64; 2]>,
) -> Option<Forecast> {
    let all: f64 = modes.values().filter_map(|mode| mode.values().next()).map(|(probability, _)| probability).sum();
    let of_mode = |points: &BTreeMap<i64, Point>| {
        let numbered = points.keys().copied().eq(1..=steps as i64);
        let (probability, _) = points.values().next().filter(|_| numbered)?;
        let path = points.values().map(|(_, at)| {
            let [s, d] = to_road(*at)?;
            Some([(s - f64::from(origin[0])) as f32, (d - f64::from(origin[1])) as f32])
        });
        Some(Mode { probability: (probability / all) as f32, path: path.collect::<Option<_>>()?, explanation: None })
    };
    Some(Forecast { modes: modes.values().map(of_mode).collect::<Option<_>>()? })
}

/// A position in the plane of the tracks, m, in the frame of a carriageway.
fn from_file(recording: &Recording, road: u16, at: [f64; 2]) -> Option<[f64; 2]> {
    match recording.roads().get(usize::from(road)).and_then(|road| road.axis.as_ref()) {
        None => Some(at),
        Some(axis) => axis.to_road(at).map(|point| [point.s, point.d]),
    }
}

fn score_on(
    set: &WindowSet<'_>,
    ids: &[WindowId],
    predictions: &Predictions,
    rate_hz: f64,
    protocol: Protocol,
    machine: &Machine,
) -> Result<Columns, Failure> {
    let constant = ConstantVelocity::new(1. / rate_hz).map_err(|error| Failure::Other(error.into()))?;
    let models = [EvaluatedModel::Predictor(predictions), EvaluatedModel::Predictor(&constant)];
    let config = EvalConfig { subset: Subset::Test, protocols: vec![protocol], batch: 256, bootstrap: BOOTSTRAP };
    let work = machine.progress.start("evaluate", 0, ids.len() as u64, "windows");
    let evaluation = evaluate(set, ids, &models, &config, &mut |batch| {
        work.at((batch.done * ids.len() / batch.total.max(1)) as u64, "");
        if machine.stop.is_requested() { Err(EvalError::Stopped) } else { Ok(()) }
    });
    let scores = match evaluation {
        Err(EvalError::Stopped) => return Err(Failure::Stopped),
        evaluation => evaluation?.scores(&BOOTSTRAP),
    };
    let scores: Vec<Score> =
        scores.into_iter().filter(|score| score.manoeuvre.is_none() && score.site == gnp_eval::ALL_SITES).collect();
    let mut columns = ColumnsBuilder::default();
    let missing = |value: Option<f64>| value.unwrap_or(f64::NAN);
    columns.texts("model", scores.iter().map(|score| score.model.as_str()));
    columns.texts("metric", scores.iter().map(|score| score.metric.as_str()));
    columns.numbers("k", scores.iter().map(|score| score.k.unwrap_or_default() as u32).collect());
    columns.numbers("horizon_s", scores.iter().map(|score| score.horizon_s).collect());
    columns.numbers("value", scores.iter().map(|score| score.value).collect());
    columns.numbers("ci_low", scores.iter().map(|score| missing(score.ci_low)).collect());
    columns.numbers("ci_high", scores.iter().map(|score| missing(score.ci_high)).collect());
    columns.numbers("windows", scores.iter().map(|score| score.windows as i64).collect());
    columns.numbers("vehicles", scores.iter().map(|score| score.vehicles as i64).collect());
    Ok(columns.finish())
}
