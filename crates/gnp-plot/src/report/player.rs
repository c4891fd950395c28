//! A clip as JSON for the player's script. Lengths are whole cm, so that they are short as text.

use gnp_data::{Explanation, Mode, SLOTS, TermForces};
use gnp_force::{Arity, TermDescriptor};
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
        // The terms of the force, in the order of every step's.
        "terms": clip.terms().into_iter().map(term).collect::<Vec<_>>(),
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
    let explanation = made.modes.first().and_then(|mode| mode.explanation.as_ref());
    let terms = clip.terms();
    let steps = explanation.into_iter().flat_map(|explanation| {
        (0..explanation.steps()).step_by(every).map(|i| step(&terms, explanation, i)).collect::<Vec<_>>()
    });
    json!({
        "vehicle": vehicle,
        "frame": clip.shown(made.frame),
        "at": made.history.last().copied().unwrap_or_default().map(centimetres),
        "neighbours": made.neighbours.map(slot),
        "modes": made.modes.iter().map(mode).collect::<Vec<_>>(),
        "steps": steps.collect::<Vec<_>>(),
    })
}

/// A term of the force: how it is called and drawn, and its parameters that are plotted over time. Those of lane lines
/// differ in number from road to road and are not.
fn term(term: &TermDescriptor) -> Value {
    let plotted = term.varying().filter(|_| term.arity != Arity::PerLine);
    let parameters = plotted.map(|parameter| {
        json!({
            "name": parameter.name,
            "title": parameter.meaning,
            "unit": parameter.unit,
            // Whether each neighbour slot has its own.
            "slots": term.arity == Arity::PerNeighbour,
        })
    });
    json!({
        "label": term.label,
        "unit": term.unit,
        "colour": term.colour,
        "parameters": parameters.collect::<Vec<_>>(),
    })
}

/// The force of each term in a step, and the values of all plotted parameters in the order of the terms; 0 where a term
/// does not act.
fn step(terms: &[&TermDescriptor], explanation: &Explanation, step: usize) -> Value {
    let acting: Vec<Option<&TermForces>> = terms.iter().map(|term| explanation.term(&term.name)).collect();
    let forces = acting.iter().map(|forces| forces.map_or([0.; 2], |forces| forces.total(step)).map(short));
    let plotted = terms.iter().zip(&acting).filter(|(term, _)| term.arity != Arity::PerLine);
    let parameters = plotted.flat_map(|(term, forces)| {
        let values = move |i: usize| forces.map_or(&[0.; SLOTS][..], |forces| forces.parameter(i, step));
        (0..term.varying().count()).map(move |i| values(i).iter().map(|value| short(*value)).collect::<Vec<_>>())
    });
    json!({ "forces": forces.collect::<Vec<_>>(), "parameters": parameters.collect::<Vec<_>>() })
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
