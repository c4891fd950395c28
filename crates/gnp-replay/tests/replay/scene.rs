//! A scene whose numbers are all different.

use std::sync::Arc;

use gnp_data::{Explanation, LaneMarking, MarkingKind, Mode, TermForces, VehicleClass};
use gnp_force::term;
use gnp_replay::{Scene, SceneForecast, TimedState, Vehicle};

/// Recorded frames a second, recorded frames from a moment to the next, and to the next predicted point.
pub(crate) const RATE_HZ: f64 = 25.;
pub(crate) const FRAME_STEP: u32 = 5;
const PREDICTED: usize = 7;

/// Frames 100 to 130. Car 7 is there all the time, a bit to the left in the end, with forecasts at 100 and 120; truck 31
/// stays in its lane and leaves after 115, with a forecast at 110.
pub(crate) fn scene() -> Scene {
    let lines = [(MarkingKind::Boundary, -1.75), (MarkingKind::LaneDivider, 1.75), (MarkingKind::Boundary, 5.25)];
    Scene {
        title: "us101-13, US-101".to_owned(),
        simulated: false,
        rate_hz: RATE_HZ,
        frame_step: FRAME_STEP,
        lines: lines.map(|(kind, y)| LaneMarking { kind, y }).to_vec(),
        vehicles: vec![
            Vehicle {
                id: 7,
                class: VehicleClass::Car,
                test: true,
                size: [4.5, 1.8],
                moments: moments(100..=130, [10., 0.2], [8., 0.5]),
                forecasts: vec![forecast(100, [10., 0.2], 3), forecast(120, [16.4, 0.6], 3)],
            },
            Vehicle {
                id: 31,
                class: VehicleClass::Truck,
                test: false,
                size: [12., 2.5],
                moments: moments(100..=115, [40., 3.5], [6., 0.]),
                forecasts: vec![forecast(110, [42.4, 3.5], 2)],
            },
        ],
        picked: Some(7),
    }
}

fn moments(frames: std::ops::RangeInclusive<u32>, [x, y]: [f32; 2], velocity: [f32; 2]) -> Vec<TimedState> {
    let first = *frames.start();
    let moment = |frame| {
        let t = (frame - first) as f32 / RATE_HZ as f32;
        TimedState { frame, centre: [x + velocity[0] * t, y + velocity[1] * t], velocity }
    };
    frames.step_by(FRAME_STEP as usize).map(moment).collect()
}

/// `modes` futures; of the first one, predicted point `j` is `(j + 1, 0.1 (j + 1))` from the origin.
fn forecast(frame: u32, [x, y]: [f32; 2], modes: usize) -> SceneForecast {
    let mode = |i: usize| Mode {
        probability: [0.5, 0.3, 0.2][i],
        path: (1..=PREDICTED).map(|j| [j as f32, 0.1 * j as f32 * (1. + i as f32)]).collect(),
        explanation: Some(explanation()),
    };
    SceneForecast {
        frame,
        frame_step: FRAME_STEP,
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
    Explanation { goal: [7., 0.7], terms }
}
