//! Forecasts of tracks, as a table: a row for each step of each future of each vehicle at each asked moment.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use gnp::Machine;
use gnp_data::{
    DataError, Explanation, Forecast, Observation, Past, Predictor as _, Present, Recording, Snapshot, TrackOptions,
    TrackTable, WindowShape,
};
use gnp_model::Gnp;

use crate::error::Failure;
use crate::remarks::Remarks;
use crate::table::{Columns, ColumnsBuilder};

/// Which moments are predicted.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum At {
    /// The last one.
    Last,
    /// Every so many seconds, from the first one on.
    Every(f64),
    /// These, s in the clock of the tracks.
    Times(Vec<f64>),
}

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asked {
    pub(crate) at: At,
    /// Futures a vehicle.
    pub(crate) k: usize,
    /// With the forces behind them.
    pub(crate) forces: bool,
}

/// Forecasts, what is to be said of them, and what is not among them, in sentences.
pub(crate) type Forecasts = (Columns, Remarks);

/// Times that are asked for may be this far from a frame, s.
const TIME_TOLERANCE: f64 = 1e-3;

/// Predicts every vehicle that is there at each asked moment.
pub(crate) fn predict(
    gnp: &Gnp,
    tracks: &TrackTable,
    options: &TrackOptions,
    asked: &Asked,
    machine: &Machine,
) -> Result<Forecasts, Failure> {
    let gnp = gnp.clone().explaining(asked.forces);
    let mut rows = Rows::default();
    let mut remarks = Remarks::default();
    for (recording, report) in tracks.recordings(options)? {
        remarks.add(&report);
        let shape = shape_for(gnp.shape(), &recording)?;
        let frames = frames(&asked.at, &recording, &mut remarks);
        let work = machine.progress.start("predict", 0, frames.len() as u64, "moments");
        let mut without_velocity = 0;
        let mut snapshot: Option<Snapshot> = None;
        for (done, frame) in (1..).zip(&frames) {
            if machine.stop.is_requested() {
                return Err(Failure::Stopped);
            }
            let moment = match snapshot.take() {
                Some(mut used) => {
                    used.take(&recording, *frame)?;
                    used
                }
                None => Snapshot::of(&recording, *frame, shape)?,
            };
            let moment = snapshot.insert(moment);
            let seen: Vec<_> = moment.vehicles().filter_map(|it| Some((it, it.observation()?))).collect();
            without_velocity += moment.vehicles().len() - seen.len();
            let observations: Vec<_> = seen.iter().map(|(_, observation)| *observation).collect();
            let forecasts = gnp.predict(&observations, asked.k)?;
            seen.iter().zip(&forecasts).for_each(|(seen, forecast)| rows.add(&recording, *frame, seen, forecast));
            work.at(done, "");
        }
        if without_velocity > 0 {
            remarks.left_out.push(format!(
                "{without_velocity} forecasts are not there: the vehicle had been seen in one frame, without a velocity"
            ));
        }
    }
    if rows.heads.is_empty() {
        remarks.left_out.push("nothing is predicted: no vehicle is there at the asked times".to_owned());
    }
    Ok((rows.finish(), remarks))
}

/// The windows of the model at the rate of a recording.
pub(crate) fn shape_for(model: WindowShape, recording: &Recording) -> Result<WindowShape, Failure> {
    let recording_hz = recording.meta().rate_hz;
    let step = recording_hz / model.rate_hz;
    if step < 0.5 || (step - step.round()).abs() > 1e-6 * step {
        return Err(DataError::WindowRate { recording_hz, window_hz: model.rate_hz }.into());
    }
    Ok(WindowShape { step: step.round() as usize, ..model })
}

/// The first and the last frame; none without tracks.
fn span(recording: &Recording) -> Option<RangeInclusive<u32>> {
    let first = recording.tracks().iter().map(|track| track.first_frame).min()?;
    let last = recording.tracks().iter().map(|track| track.last_frame()).max()?;
    Some(first..=last)
}

/// The asked frames of a recording, in order.
fn frames(at: &At, recording: &Recording, remarks: &mut Remarks) -> Vec<u32> {
    let meta = recording.meta();
    let Some(span) = span(recording) else { return Vec::new() };
    match at {
        At::Last => vec![*span.end()],
        At::Every(seconds) => span.step_by((seconds * meta.rate_hz).round().max(1.) as usize).collect(),
        At::Times(times) => {
            let mut found = Vec::with_capacity(times.len());
            for time_s in times {
                let frame = ((time_s - meta.start_s) * meta.rate_hz).round();
                let near = (time_s - meta.start_s - frame / meta.rate_hz).abs() <= TIME_TOLERANCE;
                // Negative and too large numbers become the ends of u32, which are then off the time.
                if near && frame == f64::from(frame as u32) && span.contains(&(frame as u32)) {
                    found.push(frame as u32);
                } else {
                    let (from, to) = (meta.time_s(*span.start()), meta.time_s(*span.end()));
                    remarks.left_out.push(format!(
                        "nothing is predicted at {time_s} s: tracks have moments from {from} s to {to} s, {} a second",
                        meta.rate_hz
                    ));
                }
            }
            found.sort_unstable();
            found.dedup();
            found
        }
    }
}

/// What all rows of a vehicle at a moment have in common.
struct Head {
    vehicle: u32,
    name: String,
    time_s: f64,
    past: &'static str,
    observed_s: f64,
    rows: usize,
}

/// The table as it grows.
#[derive(Default)]
struct Rows {
    heads: Vec<Head>,
    mode: Vec<u32>,
    probability: Vec<f32>,
    step: Vec<u32>,
    horizon_s: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    s: Vec<f32>,
    d: Vec<f32>,
    /// Force by term, forward and to the left, m/s².
    forces: BTreeMap<String, [Vec<f32>; 2]>,
}

impl Rows {
    fn add(&mut self, recording: &Recording, frame: u32, seen: &(Present<'_>, Observation<'_>), forecast: &Forecast) {
        let (present, observation) = seen;
        let (origin, shape, road) = (observation.origin(), observation.shape(), present.track().road);
        let before = self.mode.len();
        for (mode, future) in (0..).zip(&forecast.modes) {
            for (index, point) in future.path.iter().enumerate() {
                let at = [origin[0] + point[0], origin[1] + point[1]];
                let [x, y] = recording.to_file_coordinates(road, at);
                self.mode.push(mode);
                self.probability.push(future.probability);
                self.step.push(index as u32 + 1);
                self.horizon_s.push((index + 1) as f64 / shape.rate_hz);
                self.x.push(x);
                self.y.push(y);
                self.s.push(at[0]);
                self.d.push(at[1]);
            }
            if let Some(explanation) = &future.explanation {
                self.add_forces(explanation, future.path.len());
            }
        }
        let (past, observed_s) = match present.past() {
            Past::Full => ("full", (shape.t_obs - 1) as f64 / shape.rate_hz),
            Past::Filled { observed_s } => ("filled", observed_s),
            _ => ("unknown", 0.),
        };
        let vehicle = present.vehicle();
        let (name, time_s) = (recording.vehicle_name(vehicle).into_owned(), recording.meta().time_s(frame));
        self.heads.push(Head { vehicle, name, time_s, past, observed_s, rows: self.mode.len() - before });
    }

    fn add_forces(&mut self, explanation: &Explanation, steps: usize) {
        let before = self.mode.len() - steps;
        for term in &explanation.terms {
            let columns = self.forces.entry(term.term().name.to_string()).or_default();
            for (axis, column) in columns.iter_mut().enumerate() {
                // A term that did not act before is 0 there.
                column.resize(before, 0.);
                column.extend((0..steps).map(|step| term.total(step)[axis]));
            }
        }
    }

    fn finish(self) -> Columns {
        let rows = self.mode.len();
        let mut columns = ColumnsBuilder::default();
        let heads = &self.heads;
        fn of_heads<'a, T>(
            heads: &'a [Head],
            value: impl Fn(&'a Head) -> T + Copy + 'a,
        ) -> impl Iterator<Item = T> + 'a {
            heads.iter().flat_map(move |head| (0..head.rows).map(move |_| value(head)))
        }
        columns.numbers("vehicle", of_heads(heads, |head| head.vehicle).collect());
        if heads.iter().any(|head| head.name != head.vehicle.to_string()) {
            columns.texts("vehicle_name", of_heads(heads, |head| head.name.as_str()));
        }
        columns.numbers("time_s", of_heads(heads, |head| head.time_s).collect());
        columns.numbers("mode", self.mode);
        columns.numbers("probability", self.probability);
        columns.numbers("step", self.step);
        columns.numbers("horizon_s", self.horizon_s);
        columns.numbers("x", self.x);
        columns.numbers("y", self.y);
        columns.numbers("s", self.s);
        columns.numbers("d", self.d);
        columns.texts("past", of_heads(heads, |head| head.past));
        columns.numbers("observed_s", of_heads(heads, |head| head.observed_s).collect());
        for (term, [forward, left]) in self.forces {
            for (axis, mut values) in [("x", forward), ("y", left)] {
                values.resize(rows, 0.);
                columns.numbers(format!("force_{term}_{axis}"), values);
            }
        }
        columns.finish()
    }
}
