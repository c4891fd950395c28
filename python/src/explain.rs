//! One forecast by cause.

use gnp_data::{Account, DataError, Past, Predictor as _, Snapshot, TrackOptions, TrackTable};
use gnp_model::Gnp;

use crate::error::Failure;
use crate::remarks::Remarks;
use crate::table::{Columns, ColumnsBuilder};

/// Name of the vehicle, time in s, the sentence, how much of the past was seen, a row for each cause and step, remarks.
pub(crate) type Told = (String, f64, String, &'static str, Columns, Remarks);

/// Explains the prediction of the vehicle called `name` at `at`, s, or else at its last moment.
pub(crate) fn explain(
    gnp: &Gnp,
    tracks: &TrackTable,
    options: &TrackOptions,
    name: &str,
    at: Option<f64>,
) -> Result<Told, Failure> {
    let gnp = gnp.clone().explaining(true);
    let mut remarks = Remarks::default();
    for (recording, report) in tracks.recordings(options)? {
        remarks.add(&report);
        let meta = recording.meta();
        let Some(vehicle) = recording.vehicle_named(name) else { continue };
        let own = || recording.tracks().iter().filter(|track| track.vehicle == vehicle);
        let frame = match at {
            Some(time_s) => ((time_s - meta.start_s) * meta.rate_hz).round() as u32,
            None => own().map(|track| track.last_frame()).max().unwrap_or_default(),
        };
        let Some(shape) = gnp.shape().at_rate(meta.rate_hz) else {
            return Err(DataError::WindowRate { recording_hz: meta.rate_hz, window_hz: gnp.shape().rate_hz }.into());
        };
        let snapshot = Snapshot::of(&recording, frame, shape)?;
        let Some(present) = snapshot.vehicles().find(|present| present.vehicle() == vehicle) else {
            let spans = own().map(|track| {
                format!("{:.2} s to {:.2} s", meta.time_s(track.first_frame), meta.time_s(track.last_frame()))
            });
            let spans: Vec<String> = spans.collect();
            return Err(Failure::Question(format!(
                "vehicle {name} is not there at {} s: it is from {}",
                at.unwrap_or_default(),
                spans.join(" and ")
            )));
        };
        // All vehicles of the moment: those that are predicted together see each other.
        let (at_moment, observations): (Vec<_>, Vec<_>) =
            snapshot.vehicles().filter_map(|it| Some((it.vehicle(), it.observation()?))).unzip();
        let forecasts = gnp.predict(&observations, 1)?;
        let found = at_moment.iter().position(|number| *number == vehicle).and_then(|index| forecasts.get(index));
        let account = found
            .and_then(|forecast| forecast.modes.first())
            .and_then(|mode| Account::of(vehicle, mode, 1. / gnp.shape().rate_hz));
        let Some(account) = account else {
            return Err(Failure::Question(format!("vehicle {name} was seen in one frame only, without a velocity")));
        };
        let past = if present.past() == Past::Full { "full" } else { "filled" };
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
