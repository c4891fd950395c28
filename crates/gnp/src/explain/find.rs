//! The moment that a question is about.

use std::collections::{BTreeMap, BTreeSet};

use gnp_data::{Cause, Observation, Predictor as _, Recording, Window, WindowId, WindowShape};
use gnp_model::Gnp;

use super::Question;
use crate::error::{Result, bail};
use crate::run::Run;
use crate::what_if::{alike_or_all, cut};

/// Most forecasts that are made to choose one; of more, every n-th is.
const MOST: usize = 500;
/// Most numbers that a message lists.
const LISTED: usize = 24;

/// A vehicle at a moment, with what happened then where that is recorded.
pub(super) struct Found<'a> {
    pub(super) observation: Observation<'a>,
    pub(super) window: Option<Window<'a>>,
}

impl<'a> Found<'a> {
    fn of(recording: &'a Recording, shape: WindowShape, id: WindowId) -> Option<Self> {
        let (track, row) = (id.track as usize, id.row as usize);
        let observation = Observation::new(recording, shape, track, row).ok()?;
        Some(Self { observation, window: Window::new(recording, shape, track, row).ok() })
    }
}

impl Question {
    /// Whether a vehicle of a recording is asked for.
    fn asks_for(&self, recording: &Recording, vehicle: u32) -> bool {
        let named = |name: &String| recording.vehicle_named(name.trim()) == Some(vehicle);
        self.recording.as_ref().is_none_or(|name| recording.meta().name == *name)
            && self.vehicle.as_ref().is_none_or(named)
    }
}

/// Of what fits the question, that in which a leader moves the vehicle most.
pub(super) fn found<'a>(run: &'a Run, gnp: &Gnp, question: &Question) -> Result<Found<'a>> {
    let recordings = run.recordings()?;
    if let Some(name) = &question.recording
        && recordings.iter().all(|recording| recording.meta().name != *name)
    {
        let names: Vec<&str> = recordings.iter().map(|recording| recording.meta().name.as_str()).collect();
        bail!(Recordings, "the run has no recording {name}; it has {}", names.join(", "));
    }
    let fitting = match question.frame {
        Some(frame) => at_frame(run, question, frame)?,
        None => windows(run, question)?,
    };
    let every = fitting.len().div_ceil(MOST).max(1);
    let candidates: Vec<Found<'a>> = fitting.into_iter().step_by(every).collect();
    let seen: Vec<Observation<'_>> = candidates.iter().map(|found| found.observation).collect();
    let mut parts = Vec::with_capacity(seen.len());
    if seen.len() > 1 {
        for batch in seen.chunks(run.config.evaluate.batch) {
            run.machine.stop.check()?;
            parts.extend(gnp.predict(batch, 1)?.iter().map(leader_part));
        }
    }
    let best = (0..parts.len()).max_by(|a, b| parts[*a].total_cmp(&parts[*b]).then(b.cmp(a))).unwrap_or(0);
    match candidates.into_iter().nth(best) {
        Some(found) => Ok(found),
        None => bail!(Recordings, "no vehicle of the run can be explained"),
    }
}

/// How far one leader moves the prediction at its end, m, the one that moves it most.
pub(super) fn leader_part(forecast: &gnp_data::Forecast) -> f32 {
    let explanation = forecast.modes.first().and_then(|mode| mode.explanation.as_ref());
    let parts = explanation.into_iter().flat_map(|explanation| &explanation.contributions);
    let leaders = parts.filter(|part| matches!(part.cause, Cause::Leader { .. }));
    leaders.map(|part| part.at_end()[0].abs()).fold(0., f32::max)
}

/// Evaluated windows that fit, or any that do.
fn windows<'a>(run: &'a Run, question: &Question) -> Result<Vec<Found<'a>>> {
    let (set, recordings) = (run.windows()?, run.recordings()?);
    let of = |id: &WindowId| {
        let recording = recordings.get(id.recording as usize)?;
        Some((recording, recording.tracks().get(id.track as usize)?.vehicle))
    };
    let fits = |id: &WindowId| of(id).is_some_and(|(recording, vehicle)| question.asks_for(recording, vehicle));
    let split = run.split(&set)?;
    let evaluated: Vec<WindowId> = split.subset(run.config.evaluate.subset).iter().copied().filter(&fits).collect();
    let ids = if evaluated.is_empty() { set.ids().iter().copied().filter(&fits).collect() } else { evaluated };
    if ids.is_empty() {
        let others = Question { recording: question.recording.clone(), ..Question::default() };
        let there = set.ids().iter().filter_map(of).filter(|(recording, vehicle)| others.asks_for(recording, *vehicle));
        let there = there.map(|(recording, vehicle)| (vehicle, recording.vehicle_name(vehicle).into_owned()));
        let whose = question.vehicle.as_ref().map_or_else(String::new, |name| format!(" of vehicle {}", cut(name)));
        let place = question.recording.as_ref().map_or_else(String::new, |name| format!(" in {name}"));
        bail!(
            Recordings,
            "there is no window{whose}{place}; vehicles with one: {}",
            alike_or_all(question.vehicle.as_deref().unwrap_or_default(), there)
        );
    }
    let found = |id: WindowId| {
        let window = set.get(id)?;
        Some(Found { observation: window.observation(), window: Some(window) })
    };
    Ok(ids.into_iter().filter_map(found).collect())
}

/// Vehicles that fit and can be predicted in a frame, whether or not what happened then is recorded.
fn at_frame<'a>(run: &'a Run, question: &Question, frame: u32) -> Result<Vec<Found<'a>>> {
    let mut fitting = Vec::new();
    let mut others = Vec::new();
    let mut frames = Vec::new();
    for (index, recording) in run.recordings()?.iter().enumerate() {
        if question.recording.as_ref().is_some_and(|name| recording.meta().name != *name) {
            continue;
        }
        let shape = run.config.windows.shape_for(recording.meta().rate_hz)?;
        for (track, it) in recording.tracks().iter().enumerate() {
            let asked = question.asks_for(recording, it.vehicle);
            let past = ((shape.t_obs - 1) * shape.step) as u32;
            if asked && it.first_frame + past <= it.last_frame() {
                frames.push(in_words(recording, it.first_frame + past, it.last_frame()));
            }
            let Some(row) = it.row_at(frame) else { continue };
            let id = WindowId { recording: index as u32, track: track as u32, row: row as u32 };
            let Some(found) = Found::of(recording, shape, id) else { continue };
            others.push((it.vehicle, recording.vehicle_name(it.vehicle).into_owned()));
            if asked {
                fitting.push(found);
            }
        }
    }
    if !fitting.is_empty() {
        return Ok(fitting);
    }
    let all = |others: Vec<(u32, String)>| {
        let names: BTreeMap<u32, String> = others.into_iter().collect();
        listed(names.keys().copied(), |number| names.get(&number).map_or_else(String::new, |name| cut(name)))
    };
    match &question.vehicle {
        Some(name) if !frames.is_empty() => bail!(
            Recordings,
            "vehicle {name} cannot be predicted in frame {frame}; it can in {}. Vehicles that can in frame {frame}: {}",
            frames.join(", "),
            all(others)
        ),
        Some(name) => bail!(
            Recordings,
            "vehicle {} is never seen for long enough; vehicles in frame {frame}: {}",
            cut(name),
            alike_or_all(name, others.into_iter())
        ),
        None => bail!(Recordings, "no vehicle can be predicted in frame {frame}; leave --at out"),
    }
}

fn in_words(recording: &Recording, first: u32, last: u32) -> String {
    format!("frames {first} to {last} of {}", recording.meta().name)
}

/// Vehicles by growing number, each once, as `name` calls them; those beyond some counted.
pub(crate) fn listed(numbers: impl IntoIterator<Item = u32>, name: impl Fn(u32) -> String) -> String {
    let numbers: BTreeSet<u32> = numbers.into_iter().collect();
    let named: Vec<String> = numbers.iter().take(LISTED).map(|number| name(*number)).collect();
    match numbers.len().saturating_sub(LISTED) {
        _ if numbers.is_empty() => "none".to_owned(),
        0 => named.join(", "),
        more => format!("{} and {more} more", named.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_short_and_in_order() {
        assert_eq!(listed([], |it| it.to_string()), "none");
        assert_eq!(listed([7, 3, 7], |it| it.to_string()), "3, 7");
        assert!(
            listed(1..=30, |it| it.to_string()).ends_with("23, 24 and 6 more"),
            "{}",
            listed(1..=30, |it| it.to_string())
        );
    }
}
