//! A clip as JSON for the player's script. Lengths are whole cm, so that they are short as text.

use gnp_data::{Mode, StepForces};
use serde_json::{Value, json};

use crate::clip::{Clip, ClipForecast, ClipNeighbour, ClipVehicle, class_name, is_boundary};

/// What the script reads.
pub(super) fn json(clip: &Clip) -> Value {
    let every = clip.points_every();
    let forecasts = clip
        .vehicles
        .iter()
        .enumerate()
        .flat_map(|(i, vehicle)| vehicle.forecasts.iter().map(move |made| forecast(clip, i, made, every)));
    json!({
        "simulated": clip.simulated,
        "subset": clip.subset,
        // Frames shown a second.
        "rate": clip.rate_hz / f64::from(clip.frame_step.max(1)),
        "frames": clip.frames,
        // Seconds: before a forecast, spanned by it, between its points.
        "observed": clip.observed_s,
        "horizon": clip.predicted_s,
        "every": every as f64 * f64::from(clip.forecast_step) / clip.rate_hz,
        "lines": clip.lines.iter()
            .map(|line| json!({ "y": centimetres(line.y), "boundary": is_boundary(line) }))
            .collect::<Vec<_>>(),
        "vehicles": clip.vehicles.iter().map(|each| vehicle(clip, each)).collect::<Vec<_>>(),
        "forecasts": forecasts.collect::<Vec<_>>(),
    })
}

fn vehicle(clip: &Clip, vehicle: &ClipVehicle) -> Value {
    let column = |axis: usize| differences(vehicle.states.iter().map(|state| centimetres(state.centre[axis])));
    json!({
        "id": vehicle.id,
        "class": class_name(vehicle.class),
        "evaluated": vehicle.evaluated,
        "size": vehicle.size.map(centimetres),
        "first": vehicle.states.first().map_or(0, |state| clip.shown(state.frame)),
        "x": column(0),
        "y": column(1),
    })
}

fn forecast(clip: &Clip, vehicle: usize, made: &ClipForecast, every: usize) -> Value {
    let mode = |mode: &Mode| {
        let path = mode.path.iter().skip(every - 1).step_by(every).flatten();
        json!({ "p": short(mode.probability), "path": path.map(|v| centimetres(*v)).collect::<Vec<_>>() })
    };
    let slot = |neighbour: ClipNeighbour| match neighbour {
        ClipNeighbour::Vehicle(index) => index as i64,
        ClipNeighbour::Outside => -1,
        ClipNeighbour::Empty => -2,
    };
    let steps = made.modes.first().and_then(|mode| mode.explanation.as_ref()).map(|e| e.steps.as_slice());
    json!({
        "vehicle": vehicle,
        "frame": clip.shown(made.frame),
        "at": made.history.last().copied().unwrap_or_default().map(centimetres),
        "neighbours": made.neighbours.map(slot),
        "modes": made.modes.iter().map(mode).collect::<Vec<_>>(),
        "steps": steps.unwrap_or_default().iter().step_by(every).map(step).collect::<Vec<_>>(),
    })
}

/// Forces of a step in m/s², and their parameters.
fn step(step: &StepForces) -> Value {
    json!({
        "goal": step.goal.map(short),
        "neighbours": step.neighbours.map(short),
        "lines": step.lines.map(short),
        "tau": short(step.tau),
        "k": step.k_slots.map(short),
    })
}

fn centimetres(metres: f32) -> i32 {
    (metres * 100.).round() as i32
}

/// To four places.
fn short(value: f32) -> f64 {
    (f64::from(value) * 1e4).round() / 1e4
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
}
