//! One forecast by cause.

use gnp::{Asked, At, Model, forecasts};
use gnp_data::{Account, Past, TrackOptions, TrackTable};

use crate::error::Failure;
use crate::remarks::Remarks;
use crate::table::{Columns, ColumnsBuilder};

/// Name of the vehicle, time in s, the sentence, how much of the past was seen, a row for each cause and step, remarks.
pub(crate) type Told = (String, f64, String, &'static str, Columns, Remarks);

/// Explains the prediction of the vehicle called `name` at `at`, s, or else at its last moment.
pub(crate) fn explain(
    model: &Model,
    tracks: &TrackTable,
    options: &TrackOptions,
    name: &str,
    at: Option<f64>,
) -> Result<Told, Failure> {
    let gnp = model.gnp().clone().explaining(true);
    let mut remarks = Remarks::default();
    for (recording, report) in tracks.recordings(options)? {
        remarks.add(&report);
        let meta = recording.meta();
        let Some(vehicle) = recording.vehicle_named(name) else { continue };
        let spans: Vec<[f64; 2]> = recording
            .tracks()
            .iter()
            .filter(|track| track.vehicle == vehicle)
            .map(|track| [track.first_frame, track.last_frame()].map(|frame| meta.time_s(frame)))
            .collect();
        let time_s = at.or(spans.last().map(|[_, last]| *last)).unwrap_or_default();
        let asked = Asked::of(&recording, &At::Times(vec![time_s]), gnp.shape())?;
        let mut found = None;
        // Everybody at that moment, as when all are predicted.
        forecasts(&gnp, &recording, &asked, model.card().predict.k, |made| {
            if made.observation.vehicle() == vehicle {
                let dt = made.observation.shape().dt();
                let account = made.forecast.modes.first().and_then(|mode| Account::of(vehicle, mode, dt));
                found = account.map(|account| (account, made.frame, made.past));
            }
            Ok(())
        })?;
        let Some((account, frame, past)) = found else {
            let spans: Vec<String> = spans.iter().map(|[from, to]| format!("{from:.2} s to {to:.2} s")).collect();
            return Err(Failure::Question(format!(
                "vehicle {name} cannot be predicted at {time_s} s: it is there from {}, and needs a velocity or two frames",
                spans.join(" and from ")
            )));
        };
        let past = if past == Past::Full { "full" } else { "filled" };
        return Ok((name.to_owned(), meta.time_s(frame), account.sentence(), past, causes(&account), remarks));
    }
    Err(Failure::Question(format!("there is no vehicle {name} in the tracks")))
}

/// A row for each cause and step.
fn causes(account: &Account) -> Columns {
    let steps = account.steps();
    let each = || account.parts.iter().flat_map(|part| (1..=steps).map(move |step| (part, step)));
    let mut columns = ColumnsBuilder::default();
    columns.texts("cause", each().map(|(part, _)| part.cause.to_string()));
    columns.texts("kind", each().map(|(part, _)| if part.cause.is_physical() { "physics" } else { "network" }));
    columns.numbers("step", each().map(|(_, step)| step as u32).collect());
    columns.numbers("horizon_s", each().map(|(_, step)| step as f64 * account.dt).collect());
    for (axis, name) in ["dx", "dy"].into_iter().enumerate() {
        columns.numbers(name, each().map(|(part, step)| part.after(step)[axis]).collect());
    }
    columns.finish()
}
