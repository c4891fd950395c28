//! What the scene player of a report plays, short as text.

use crate::error::Result;
use gnp_data::{MarkingKind, Mode, Split, WindowSet};
use gnp_plot::{PlayedForecast, PlayedLine, PlayedMode, PlayedRecording, PlayedStep, PlayedTerm, PlayedVehicle};

use crate::report::clip::{Clip, Made, Shown, class_word};
use crate::run::Run;

/// The clip that is played; `None` without lanes.
pub(super) fn recording(run: &Run, set: &WindowSet<'_>, split: &Split) -> Result<Option<PlayedRecording>> {
    Ok(Clip::of(run, set, split)?.map(|clip| played(&clip)))
}

fn played(clip: &Clip<'_>) -> PlayedRecording {
    let (recording, shape) = (clip.recording, clip.shape);
    let lines = recording.roads()[usize::from(clip.road)].lines.iter();
    PlayedRecording {
        simulated: recording.meta().simulated,
        rate: clip.rate,
        frames: clip.frames,
        observed: (shape.t_obs - 1) as f64 * shape.dt(),
        horizon: shape.t_pred as f64 * shape.dt(),
        every: clip.every() as f64 * shape.dt(),
        terms: clip.forecasts.iter().find_map(Made::explanation).map(PlayedTerm::of).unwrap_or_default(),
        lines: lines
            .map(|line| PlayedLine { y: centimetres(line.y), boundary: line.kind == MarkingKind::Boundary })
            .collect(),
        vehicles: clip.vehicles.iter().map(|vehicle| played_vehicle(clip, vehicle)).collect(),
        forecasts: clip.forecasts.iter().map(|made| played_forecast(made, clip.every())).collect(),
    }
}

fn played_vehicle(clip: &Clip<'_>, vehicle: &Shown<'_>) -> PlayedVehicle {
    let columns = clip.recording.columns();
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
    let steps = made.explanation().into_iter().flat_map(|explanation| {
        (0..explanation.steps()).step_by(every).map(move |step| PlayedStep::of(explanation, step, short))
    });
    PlayedForecast {
        vehicle: made.vehicle,
        frame: made.frame,
        at: made.seen.origin().map(centimetres),
        neighbours: made.neighbours.clone(),
        modes: made.forecast.modes.iter().map(mode).collect(),
        steps: steps.collect(),
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
