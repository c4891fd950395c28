//! What is promised of messages, recordings and forecasts, checked from outside.

use std::error::Error;
use std::sync::LazyLock;

use gnp_baselines::{ConstantAcceleration, ConstantVelocity, Drivers, Idm, Kalman, PlatoonRule};
use gnp_data::{Forecast, Observation, Predictor, Recording, Slot, WindowConfig, WindowSet, WindowShape};

use crate::finding::{Finding, promise};
use crate::scratch::Scratch;

/// Longest message, bytes: a page on a terminal.
const LONGEST_MESSAGE: usize = 2000;

/// Windows of a recording that are predicted.
const WINDOWS: usize = 6;

/// Every rule, with the parameters it has without training.
static RULES: LazyLock<Vec<Box<dyn Predictor>>> = LazyLock::new(|| {
    let mut rules: Vec<Box<dyn Predictor>> = vec![
        Box::new(ConstantVelocity::default()),
        Box::new(ConstantAcceleration::default()),
        Box::new(Kalman::default()),
        Box::new(Idm::default()),
    ];
    rules.extend(PlatoonRule::of_drivers(Drivers::TYPICAL).map(|rule| Box::new(rule) as Box<dyn Predictor>));
    rules
});

/// A refusal must name the file, as `name`, and fit on a page.
pub(crate) fn refusal(error: &dyn Error, name: &str) -> Result<(), Finding> {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        message = format!("{message}: {inner}");
        cause = inner.source();
    }
    refusal_text(&message, name)
}

/// As [`refusal`] of a message.
pub(crate) fn refusal_text(message: &str, name: &str) -> Result<(), Finding> {
    let shown = || message.chars().take(LONGEST_MESSAGE).collect();
    if !message.contains(name) {
        return Err(Finding::Message { why: "names no file", message: shown() });
    }
    if message.len() > LONGEST_MESSAGE {
        return Err(Finding::Message { why: "is a flood", message: shown() });
    }
    Ok(())
}

/// Everything that is promised of a recording: the invariants of its parts, that it comes back from a file as it was, and
/// that whatever is predicted of it is finite.
pub(crate) fn recording(scratch: &Scratch, recording: &Recording) -> Result<(), Finding> {
    parts(recording)?;
    comes_back(scratch, recording)?;
    predictions(recording)
}

fn parts(recording: &Recording) -> Result<(), Finding> {
    let (meta, columns, tracks) = (recording.meta(), recording.columns(), recording.tracks());
    promise(!meta.name.is_empty(), || "a recording without a name".to_owned())?;
    promise(meta.rate_hz.is_finite() && meta.rate_hz > 0., || format!("a rate of {} Hz", meta.rate_hz))?;
    for road in recording.roads() {
        let grow = road.lines.windows(2).all(|pair| pair[0].y < pair[1].y);
        promise(grow && road.lines.iter().all(|line| line.y.is_finite()), || format!("lines {:?}", road.lines))?;
    }
    let rows = recording.len();
    let lengths = [columns.y.len(), columns.vx.len(), columns.vy.len(), columns.lane.len(), columns.neighbours.len()];
    promise(lengths == [rows; 5], || format!("columns of {lengths:?} rows where x has {rows}"))?;
    let values = [&columns.x, &columns.y, &columns.vx, &columns.vy];
    promise(values.iter().all(|column| column.iter().all(|v| v.is_finite())), || "a value that is not finite".into())?;
    let mut end = 0;
    for (index, track) in tracks.iter().enumerate() {
        let covers = track.rows.start == end && !track.rows.is_empty();
        promise(covers, || format!("track {index} has rows {:?} after {end}", track.rows))?;
        end = track.rows.end;
        promise(usize::from(track.road) < recording.roads().len(), || format!("track {index} on no carriageway"))?;
        let sized = [track.length, track.width].iter().all(|side| side.is_finite() && *side > 0.);
        promise(sized, || format!("track {index} of {} m by {} m", track.length, track.width))?;
        let before = index.checked_sub(1).map(|before| (tracks[before].vehicle, tracks[before].segment));
        promise(before < Some((track.vehicle, track.segment)), || format!("track {index} out of order"))?;
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let present = recording.present(frame).contains(&(index as u32));
            promise(present, || format!("track {index} is not present in its frame {frame}"))?;
            for other in Slot::ALL.into_iter().filter_map(|slot| recording.neighbour(row, slot)) {
                let there = other != index && tracks.get(other).is_some_and(|other| other.row_at(frame).is_some());
                promise(there, || format!("row {row} of track {index} has a neighbour {other} that is not there"))?;
            }
        }
    }
    promise(end == rows, || format!("tracks of {end} rows where x has {rows}"))?;
    for named in columns.named_leader.iter().flatten().filter(|named| named.vehicle != 0) {
        promise(named.headway.is_finite() && named.headway > 0., || format!("a leader {} m ahead", named.headway))?;
    }
    Ok(())
}

fn comes_back(scratch: &Scratch, recording: &Recording) -> Result<(), Finding> {
    let file = scratch.made("kept.rec");
    recording.save(&file).map_err(Finding::case)?;
    let again = Recording::load(&file).map_err(|error| Finding::Believed(format!("cannot be loaded: {error}")))?;
    // Numbers in JSON come back to the last digit but one.
    let rates = [again.meta().rate_hz, recording.meta().rate_hz];
    let mut meta = again.meta().clone();
    meta.rate_hz = rates[1];
    let same = (rates[0] / rates[1] - 1.).abs() < 1e-14
        && meta == *recording.meta()
        && again.roads() == recording.roads()
        && again.tracks() == recording.tracks()
        && again.columns() == recording.columns();
    promise(same, || "a recording that comes back from its file as another".to_owned())
}

/// Predicts the last windows of the first tracks, and whatever [`WindowSet::cut`] finds.
fn predictions(recording: &Recording) -> Result<(), Finding> {
    let rate_hz = recording.meta().rate_hz;
    let Ok(shape) = WindowShape::new(4, 3, 1, rate_hz) else { return Ok(()) };
    let last =
        |(index, track): (usize, &gnp_data::Track)| Observation::new(recording, shape, index, track.rows.end - 1).ok();
    let seen: Vec<Observation<'_>> = recording.tracks().iter().enumerate().filter_map(last).take(WINDOWS).collect();
    forecasts_of(&seen)?;
    let times = |frames: f64| frames / rate_hz;
    let config = WindowConfig {
        observed_s: times(3.),
        predicted_s: times(3.),
        rate_hz,
        stride_s: times(2.),
        site_stride_s: Default::default(),
    };
    let Ok((set, _)) = WindowSet::cut(std::slice::from_ref(recording), &config) else { return Ok(()) };
    let seen: Vec<Observation<'_>> = set.iter().take(WINDOWS).map(|window| window.observation()).collect();
    forecasts_of(&seen)
}

/// Predicts by every rule; each forecast must be one.
pub(crate) fn forecasts_of(seen: &[Observation<'_>]) -> Result<(), Finding> {
    if seen.is_empty() {
        return Ok(());
    }
    for rule in RULES.iter() {
        let forecasts = match rule.predict(seen, 3) {
            Ok(forecasts) => forecasts,
            Err(error) => {
                refusal(&error, "")?;
                continue;
            }
        };
        promise(forecasts.len() == seen.len(), || format!("{} forecasts of {}", forecasts.len(), seen.len()))?;
        for (forecast, seen) in forecasts.iter().zip(seen) {
            self::forecast(forecast, rule.name(), Some(seen.shape().t_pred))?;
        }
    }
    Ok(())
}

/// Probabilities sum to 1, paths are finite and of `steps` steps.
pub(crate) fn forecast(forecast: &Forecast, name: &str, steps: Option<usize>) -> Result<(), Finding> {
    let mut sum = 0.;
    for mode in &forecast.modes {
        let finite = mode.path.iter().flatten().all(|value| value.is_finite());
        promise(finite, || format!("a path of {name} that is not finite: {:?}", mode.path))?;
        promise(steps.is_none_or(|steps| mode.path.len() == steps), || format!("{name}: {} steps", mode.path.len()))?;
        let share = (0. ..=1. + 1e-3).contains(&mode.probability);
        promise(share, || format!("a probability of {name} of {}", mode.probability))?;
        sum += mode.probability;
    }
    promise(steps.is_none() || (sum - 1.).abs() < 1e-3, || format!("probabilities of {name} that sum to {sum}"))
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_rule_is_left_out() {
        let names: Vec<&str> = super::RULES.iter().map(|rule| rule.name()).collect();
        let listed: Vec<&str> = gnp_baselines::RULES.iter().map(gnp_baselines::Rule::name).collect();
        assert_eq!(names, listed);
    }
}
