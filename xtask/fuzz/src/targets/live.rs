//! Tracks that a program gives: pushed sample by sample, observed and predicted.

use arbitrary::{Arbitrary, Unstructured};
use gnp_data::{LaneMarking, LiveError, LiveScene, Sample, VehicleClass, WindowShape};

use crate::finding::Finding;
use crate::made::{Number, Rarely};
use crate::{Scratch, Target, checks};

pub(super) const TARGET: Target = Target {
    name: "live",
    about: "tracks of a program, to observations and forecasts",
    run,
    seeds: |_| Ok(vec![vec![0; 64], vec![7; 200]]),
    words: &[],
};

/// A program's scene.
#[derive(Arbitrary, Debug)]
struct Made {
    rate_hz: Rarely<f64>,
    lines: Rarely<[Number; 3]>,
    start_s: Rarely<f64>,
    measured: bool,
    count: u8,
    pushes: [Push; 4],
    observed: u8,
    step: Rarely<u8>,
}

/// Samples of a vehicle.
#[derive(Arbitrary, Debug)]
struct Push {
    vehicle: Rarely<u8>,
    size: Rarely<[f32; 2]>,
    first: Rarely<i16>,
    samples: u8,
    gap: Rarely<u8>,
    from: Number,
    to_the_left: u8,
    speed: u8,
    off_s: Rarely<f64>,
    odd: Rarely<(u8, [Number; 2])>,
    other_velocity: Rarely<bool>,
}

fn run(scratch: &Scratch, input: &[u8]) -> Result<(), Finding> {
    let Ok(made) = Made::arbitrary(&mut Unstructured::new(input)) else { return Ok(()) };
    let rate_hz = made.rate_hz.or(10.);
    let lines = made.lines.0.map_or([0., 3.6, 7.2], |lines| lines.map(|y| y.0));
    let lines = lines.map(|y| LaneMarking::new(y, false)).to_vec();
    let mut scene = match LiveScene::new(rate_hz, lines) {
        Ok(scene) => scene,
        Err(error) => return checks::refusal(&error, ""),
    };
    let count = 1 + usize::from(made.count) % made.pushes.len();
    for (index, push) in made.pushes[..count].iter().enumerate() {
        let samples = samples(push, &made, rate_hz);
        let vehicle = push.vehicle.0.map_or(index as u32 + 1, u32::from);
        if let Err(error) = scene.push(vehicle, push.size.or([4.5, 1.8]), VehicleClass::Car, &samples) {
            checks::refusal(&error, "")?;
        }
    }
    match scene.recording() {
        Ok(recording) => checks::recording(scratch, recording)?,
        Err(error) => return checks::refusal(&error, ""),
    }
    let step = usize::from(made.step.or(1));
    let Ok(shape) = WindowShape::new(2 + usize::from(made.observed % 6), 4, step, rate_hz / step.max(1) as f64) else {
        return Ok(());
    };
    let mut seen = Vec::new();
    for vehicle in 0..=count as u32 {
        match scene.observe(vehicle, shape) {
            Ok(observation) => seen.push(observation),
            Err(error @ (LiveError::Absent { .. } | LiveError::Window(_) | LiveError::Data(_))) => {
                checks::refusal(&error, "")?;
            }
            Err(error) => return Err(Finding::Believed(format!("another error of an observation: {error}"))),
        }
    }
    checks::forecasts_of(&seen)
}

fn samples(push: &Push, made: &Made, rate_hz: f64) -> Vec<Sample> {
    let start = made.start_s.or(0.) + f64::from(push.first.or(0)) / rate_hz;
    let speed = f32::from(push.speed % 50);
    let sample = |i: u8| {
        let gone = push.gap.0.is_some_and(|gap| gap % 20 < i);
        let time_s = start + f64::from(u32::from(i) + u32::from(gone)) / rate_hz + push.off_s.or(0.);
        let mut position = [push.from.0 + speed * (f64::from(i) / rate_hz) as f32, f32::from(push.to_the_left) / 32.];
        if let Some((_, odd)) = push.odd.0.filter(|(at, _)| at % 20 == i) {
            position = odd.map(|value| value.0);
        }
        let sample = Sample::new(time_s, position);
        let measured = made.measured != push.other_velocity.or(false);
        if measured { sample.with_velocity([speed, 0.]) } else { sample }
    };
    (0..push.samples % 20).map(sample).collect()
}
