//! What the scene player of a report plays, short as text.

use anyhow::Result;
use gnp_data::{LineKind, Mode, Split, StepForces, WindowSet};
use gnp_plot::{PlayedForecast, PlayedLine, PlayedMode, PlayedRecording, PlayedStep, PlayedVehicle};

use crate::session::Session;
use crate::stretch::{Made, Shown, Stretch, class_word};

/// The stretch that is played; `None` without lanes.
pub(super) fn recording(session: &Session, set: &WindowSet<'_>, split: &Split) -> Result<Option<PlayedRecording>> {
    Ok(Stretch::of(session, set, split)?.map(|stretch| played(&stretch)))
}

fn played(stretch: &Stretch<'_>) -> PlayedRecording {
    let (recording, shape) = (stretch.recording, stretch.shape);
    let lines = recording.roads()[usize::from(stretch.road)].lines.iter();
    PlayedRecording {
        simulated: recording.meta().simulated,
        rate: stretch.rate,
        frames: stretch.frames,
        observed: (shape.observed - 1) as f64 * shape.dt(),
        horizon: shape.predicted as f64 * shape.dt(),
        every: stretch.every() as f64 * shape.dt(),
        lines: lines
            .map(|line| PlayedLine { y: centimetres(line.y), boundary: line.kind == LineKind::Boundary })
            .collect(),
        vehicles: stretch.vehicles.iter().map(|vehicle| played_vehicle(stretch, vehicle)).collect(),
        forecasts: stretch.forecasts.iter().map(|made| played_forecast(made, stretch.every())).collect(),
    }
}

fn played_vehicle(stretch: &Stretch<'_>, vehicle: &Shown<'_>) -> PlayedVehicle {
    let columns = stretch.recording.columns();
    let column = |values: &[f32]| differences(vehicle.rows.iter().map(|(_, row)| centimetres(values[*row])));
    PlayedVehicle {
        id: vehicle.track.vehicle,
        class: class_word(vehicle.track.class).to_owned(),
        test: vehicle.test,
        size: [centimetres(vehicle.track.length), centimetres(vehicle.track.width)],
        first: vehicle.rows.first().map_or(0, |(frame, _)| *frame),
        x: column(&columns.x),
        y: column(&columns.y),
    }
}

fn played_forecast(made: &Made<'_>, every: usize) -> PlayedForecast {
    let mode = |mode: &Mode| PlayedMode {
        p: short(mode.probability),
        path: mode.path.iter().skip(every - 1).step_by(every).flatten().map(|v| centimetres(*v)).collect(),
    };
    let steps = made.forecast.modes.first().and_then(|mode| mode.explanation.as_ref()).map(|e| e.steps.as_slice());
    let step = |step: &StepForces| PlayedStep {
        goal: step.goal.map(short),
        neighbours: step.neighbours.map(short),
        lines: step.lines.map(short),
        tau: short(step.tau),
        k: step.k_slots.map(short).to_vec(),
    };
    PlayedForecast {
        vehicle: made.vehicle,
        frame: made.frame,
        at: made.seen.origin().map(centimetres),
        neighbours: made.neighbours.clone(),
        modes: made.forecast.modes.iter().map(mode).collect(),
        steps: steps.unwrap_or_default().iter().step_by(every).map(step).collect(),
    }
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
}
