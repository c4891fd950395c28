//! A clip whose numbers are all different.

use std::sync::Arc;

use gnp_data::{Explanation, LaneMarking, MarkingKind, Mode, SLOTS, TermForces, VehicleClass};
use gnp_force::term;
use gnp_plot::{Clip, ClipForecast, ClipNeighbour, ClipVehicle, TimedState};

/// The car.
pub(crate) const PICKED: Option<u32> = Some(7);
/// Recorded frames a second, recorded frames from a state to the next, and to the next predicted point.
pub(crate) const RATE_HZ: f64 = 25.;
pub(crate) const FRAME_STEP: u32 = 5;
const PREDICTED: usize = 7;

/// Frames 100 to 130. Car 7 is there all the time, a bit to the left in the end, with forecasts at 100 and 120; truck 31
/// stays in its lane and leaves after 115, with a forecast at 110.
pub(crate) fn clip() -> Clip {
    let lines = [(MarkingKind::Boundary, -1.75), (MarkingKind::LaneDivider, 1.75), (MarkingKind::Boundary, 5.25)];
    let mut clip = Clip::new("us101-13, US-101", RATE_HZ);
    (clip.first_frame, clip.frame_step, clip.forecast_step) = (100, FRAME_STEP, FRAME_STEP);
    clip.frames = 7;
    clip.subset = "test".to_owned();
    clip.lines = lines.map(|(kind, y)| LaneMarking { kind, y }).to_vec();
    clip.vehicles = vec![
        ClipVehicle {
            id: 7,
            class: VehicleClass::Car,
            evaluated: true,
            size: [4.5, 1.8],
            states: states(100..=130, [10., 0.2], [8., 0.5]),
            forecasts: vec![forecast(100, [10., 0.2], 3), forecast(120, [16.4, 0.6], 3)],
        },
        ClipVehicle {
            id: 31,
            class: VehicleClass::Truck,
            evaluated: false,
            size: [12., 2.5],
            states: states(100..=115, [40., 3.5], [6., 0.]),
            forecasts: vec![forecast(110, [42.4, 3.5], 2)],
        },
    ];
    clip
}

fn states(frames: std::ops::RangeInclusive<u32>, [x, y]: [f32; 2], velocity: [f32; 2]) -> Vec<TimedState> {
    let first = *frames.start();
    let state = |frame| {
        let t = (frame - first) as f32 / RATE_HZ as f32;
        TimedState { frame, centre: [x + velocity[0] * t, y + velocity[1] * t], velocity }
    };
    frames.step_by(FRAME_STEP as usize).map(state).collect()
}

/// `modes` futures; of the first one, predicted point `j` is `(j + 1, 0.1 (j + 1))` from the origin.
fn forecast(frame: u32, [x, y]: [f32; 2], modes: usize) -> ClipForecast {
    let mode = |i: usize| Mode {
        probability: [0.5, 0.3, 0.2][i],
        path: (1..=PREDICTED).map(|j| [j as f32, 0.1 * j as f32 * (1. + i as f32)]).collect(),
        explanation: Some(explanation()),
    };
    ClipForecast {
        frame,
        neighbours: [ClipNeighbour::Empty; SLOTS],
        history: (0..4).map(|j| [x - 2. * (3 - j) as f32, y]).collect(),
        modes: (0..modes).map(mode).collect(),
    }
}

/// Three terms with their parameters by step.
fn explanation() -> Explanation {
    let steps = 0..PREDICTED;
    let each = |of: fn(f32) -> [f32; 2]| steps.clone().map(|j| of(j as f32)).collect::<Vec<_>>();
    let values = |sources: usize, of: fn(f32, f32) -> f32| {
        steps.clone().flat_map(|j| (0..sources).map(move |i| of(j as f32, i as f32))).collect::<Vec<_>>()
    };
    let term = |name: &str, sources: usize, totals: Vec<[f32; 2]>, parameter: Vec<f32>| {
        let descriptor = Arc::new(term::<f32>(name).unwrap().descriptor().clone());
        let forces = totals.iter().flat_map(|total| vec![*total; sources]).collect();
        TermForces::new(descriptor, sources, forces, vec![parameter]).with_totals(totals)
    };
    let terms = vec![
        term("goal", 1, each(|j| [1. + j, 0.25]), values(1, |j, _| 0.5 + 0.1 * j)),
        term("neighbours", 8, each(|j| [-0.5, 0.125 * j]), values(8, |j, slot| 10. * slot + j)),
        term("lines", 3, each(|_| [0., -0.75]), values(3, |j, line| 3. + line + j)),
    ];
    Explanation { goal: [7., 0.7], terms, ..Explanation::default() }
}
