//! What the scene player of a report plays: the busiest minute of the longest recording.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Result, anyhow};
use gnp_data::{Forecast, LineKind, Observation, Predictor as _, Split, VehicleClass, WindowSet};
use gnp_model::{Gnp, NeighbourFuture};
use gnp_plot::{PlayedForecast, PlayedLine, PlayedMode, PlayedRecording, PlayedStep, PlayedVehicle};

use crate::figures::traffic::{SHOWN_S, busiest_of};
use crate::session::Session;
use crate::stop;

/// Frames of the player a second, at most.
const RATE_HZ: f64 = 10.;
/// Time between forecasts of a vehicle, s.
const APART_S: f64 = 1.;
/// Time between the points of a forecast, s.
const EVERY_S: f64 = 0.5;

/// The stretch with a forecast of every vehicle each second; `None` without lanes.
pub(super) fn recording(session: &Session, set: &WindowSet<'_>, split: &Split) -> Result<Option<PlayedRecording>> {
    let recordings = session.recordings()?;
    let tested: BTreeSet<(u32, u32)> = split.test().iter().map(|id| (id.recording, id.track)).collect();
    let Some((index, lane)) = busiest_of(recordings, |i| tested.iter().any(|(r, _)| *r as usize == i)) else {
        return Ok(None);
    };
    let recording = &recordings[index];
    let step = (recording.meta().rate_hz / RATE_HZ).ceil().max(1.) as u32;
    let rate = recording.meta().rate_hz / f64::from(step);
    let frames = (SHOWN_S * rate) as usize;
    let mut vehicles = Vec::new();
    let mut index_of = BTreeMap::new();
    for (track_index, track) in recording.tracks().iter().enumerate().filter(|(_, track)| track.road == lane.road) {
        let present = |frame: &usize| track.row_at(lane.first_frame + *frame as u32 * step);
        let there: Vec<usize> = (0..frames).filter(|frame| present(frame).is_some()).collect();
        let (Some(first), true) = (there.first(), there.len() > 1) else { continue };
        let column = |values: &[f32]| differences(there.iter().filter_map(present).map(|row| centimetres(values[row])));
        index_of.insert(track_index, vehicles.len());
        vehicles.push(PlayedVehicle {
            id: track.vehicle,
            class: match track.class {
                VehicleClass::Motorcycle => "motorcycle",
                VehicleClass::Car => "car",
                VehicleClass::Truck => "truck",
            }
            .to_owned(),
            test: tested.contains(&(index as u32, track_index as u32)),
            size: [centimetres(track.length), centimetres(track.width)],
            first: *first,
            x: column(&recording.columns().x),
            y: column(&recording.columns().y),
        });
    }
    // Every vehicle is forecast, whether its windows were for training or for testing; the page says which.
    let mut seen: Vec<(usize, usize, Observation<'_>)> = Vec::new();
    for (track, vehicle) in &index_of {
        for frame in (0..frames).step_by((APART_S * rate).round().max(1.) as usize) {
            let row = recording.tracks()[*track].row_at(lane.first_frame + frame as u32 * step);
            let observation = row.and_then(|row| Observation::new(recording, set.shape(), *track, row));
            seen.extend(observation.map(|observation| (*vehicle, frame, observation)));
        }
    }
    let forecasts = forecasts(session, &seen, &index_of)?;
    let shape = set.shape();
    let lines = recording.roads()[usize::from(lane.road)].lines.iter();
    Ok(Some(PlayedRecording {
        simulated: recording.meta().simulated,
        rate,
        frames,
        observed: (shape.observed - 1) as f64 * shape.dt(),
        horizon: shape.predicted as f64 * shape.dt(),
        every: stride(shape.dt()) as f64 * shape.dt(),
        lines: lines
            .map(|line| PlayedLine { y: centimetres(line.y), boundary: line.kind == LineKind::Boundary })
            .collect(),
        vehicles,
        forecasts,
    }))
}

fn forecasts(
    session: &Session,
    seen: &[(usize, usize, Observation<'_>)],
    index_of: &BTreeMap<usize, usize>,
) -> Result<Vec<PlayedForecast>> {
    let neighbours = match session.config.predict.neighbours {
        NeighbourFuture::Oracle => NeighbourFuture::ConstantVelocity,
        other => other,
    };
    let gnp = Gnp::load(session.folder.root(), neighbours, &session.machine.device)?.explaining(true);
    let work = session.terminal().work("player", seen.len() as u64, "forecasts");
    let mut played = Vec::with_capacity(seen.len());
    for batch in seen.chunks(session.config.evaluate.batch) {
        stop::check()?;
        let observations: Vec<_> = batch.iter().map(|(_, _, observation)| *observation).collect();
        let found = gnp.predict(&observations, session.config.predict.k).map_err(|error| anyhow!(error))?;
        played.extend(batch.iter().zip(&found).map(|((vehicle, frame, observation), forecast)| {
            let neighbours = observation.neighbours().map(|slot| {
                slot.map_or(-2, |other| index_of.get(&other.track_index()).map_or(-1, |vehicle| *vehicle as i32))
            });
            played_forecast(*vehicle, *frame, observation, neighbours.to_vec(), forecast)
        }));
        work.at(played.len() as u64, "");
    }
    Ok(played)
}

fn played_forecast(
    vehicle: usize,
    frame: usize,
    seen: &Observation<'_>,
    neighbours: Vec<i32>,
    forecast: &Forecast,
) -> PlayedForecast {
    let every = stride(seen.shape().dt());
    let mode = |mode: &gnp_data::Mode| PlayedMode {
        p: short(mode.probability),
        path: mode.path.iter().skip(every - 1).step_by(every).flatten().map(|v| centimetres(*v)).collect(),
    };
    let steps = forecast.modes.first().and_then(|mode| mode.explanation.as_ref()).map(|e| e.steps.as_slice());
    let step = |step: &gnp_data::StepForces| PlayedStep {
        goal: step.goal.map(short),
        neighbours: step.neighbours.map(short),
        lines: step.lines.map(short),
        tau: short(step.tau),
        k: step.k_slots.map(short).to_vec(),
    };
    PlayedForecast {
        vehicle,
        frame,
        at: seen.origin().map(centimetres),
        neighbours,
        modes: forecast.modes.iter().map(mode).collect(),
        steps: steps.unwrap_or_default().iter().step_by(every).map(step).collect(),
    }
}

/// Frames of a window from one point shown to the next.
fn stride(dt: f64) -> usize {
    (EVERY_S / dt).round().max(1.) as usize
}

fn centimetres(metres: f32) -> i32 {
    (metres * 100.).round() as i32
}

fn short(value: f32) -> f32 {
    (value * 1e4).round() / 1e4
}

/// The first value, then differences.
fn differences(values: impl Iterator<Item = i32>) -> Vec<i32> {
    let mut last = 0;
    values.map(|value| value - std::mem::replace(&mut last, value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_add_up() {
        let found = differences([-350, -348, 12].into_iter());
        assert_eq!(found, [-350, 2, 360]);
    }

    #[test]
    fn half_a_second_is_a_whole_number_of_frames() {
        assert_eq!([0.1, 0.2, 0.04, 1.].map(stride), [5, 3, 13, 1]);
    }
}
