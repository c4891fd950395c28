//! Forecasts of tracks, as a table: a row for each step of each future of each vehicle at each asked moment.

use std::collections::BTreeMap;

use gnp::{Asked, At, Forecasted, Machine, forecasts};
use gnp_data::{Explanation, Past, Recording, TrackOptions, TrackTable};
use gnp_model::Gnp;

use crate::error::Failure;
use crate::remarks::Remarks;
use crate::table::{Columns, ColumnsBuilder};

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Question {
    pub(crate) at: At,
    /// Futures a vehicle.
    pub(crate) k: usize,
    /// With the forces behind them.
    pub(crate) forces: bool,
}

/// Forecasts, what is to be said of them, and what is not among them, in sentences.
pub(crate) type Forecasts = (Columns, Remarks);

/// Predicts every vehicle that is there at each asked moment.
pub(crate) fn predict(
    gnp: &Gnp,
    tracks: &TrackTable,
    options: &TrackOptions,
    question: &Question,
    machine: &Machine,
) -> Result<Forecasts, Failure> {
    let gnp = gnp.clone().explaining(question.forces);
    let mut rows = Rows::default();
    let mut remarks = Remarks::default();
    for (recording, report) in tracks.recordings(options)? {
        remarks.add(&report);
        let asked = Asked::of(&recording, &question.at, gnp.shape())?;
        let work = machine.progress.start("predict", 0, asked.vehicles(&recording) as u64, "forecasts");
        let left_out = forecasts(&gnp, &recording, &asked, question.k, |made| {
            machine.stop.check()?;
            rows.add(&recording, made);
            work.at(rows.heads.len() as u64, "");
            Ok(())
        })?;
        remarks.left_out.extend(left_out.into_iter().map(|(why, count)| format!("not predicted: {count} {why}")));
    }
    Ok((rows.finish(), remarks))
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
    s: Vec<f64>,
    d: Vec<f64>,
    /// Force by term, forward and to the left, m/s².
    forces: BTreeMap<String, [Vec<f32>; 2]>,
}

impl Rows {
    fn add(&mut self, recording: &Recording, made: &Forecasted<'_>) {
        let seen = &made.observation;
        let (origin, dt, road) = (seen.origin(), seen.shape().dt(), seen.road());
        let before = self.mode.len();
        for (mode, future) in (0..).zip(&made.forecast.modes) {
            for (step, point) in (1..).zip(&future.path) {
                let at = [origin[0] + point[0], origin[1] + point[1]];
                let [x, y] = recording.to_file_coordinates(road, at);
                self.mode.push(mode);
                self.probability.push(future.probability);
                self.step.push(step);
                self.horizon_s.push(f64::from(step) * dt);
                self.x.push(x);
                self.y.push(y);
                self.s.push(f64::from(at[0]));
                self.d.push(f64::from(at[1]));
            }
            if let Some(explanation) = &future.explanation {
                self.add_forces(explanation, future.path.len());
            }
        }
        self.heads.push(Head {
            vehicle: seen.vehicle(),
            name: recording.vehicle_name(seen.vehicle()).into_owned(),
            time_s: recording.meta().time_s(made.frame),
            past: if made.past == Past::Full { "full" } else { "filled" },
            observed_s: made.observed_s,
            rows: self.mode.len() - before,
        });
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
        let (rows, heads) = (self.mode.len(), &self.heads);
        let of_rows = || heads.iter().flat_map(|head| std::iter::repeat_n(head, head.rows));
        let mut columns = ColumnsBuilder::default();
        columns.numbers("vehicle", of_rows().map(|head| head.vehicle).collect());
        columns.texts("vehicle_name", of_rows().map(|head| head.name.as_str()));
        columns.numbers("time_s", of_rows().map(|head| head.time_s).collect());
        columns.numbers("mode", self.mode);
        columns.numbers("probability", self.probability);
        columns.numbers("step", self.step);
        columns.numbers("horizon_s", self.horizon_s);
        columns.numbers("x", self.x);
        columns.numbers("y", self.y);
        columns.numbers("s", self.s);
        columns.numbers("d", self.d);
        columns.texts("past", of_rows().map(|head| head.past));
        columns.numbers("observed_s", of_rows().map(|head| head.observed_s).collect());
        for (term, forces) in self.forces {
            for (axis, mut values) in ["x", "y"].into_iter().zip(forces) {
                values.resize(rows, 0.);
                columns.numbers(format!("force_{term}_{axis}"), values);
            }
        }
        columns.finish()
    }
}
