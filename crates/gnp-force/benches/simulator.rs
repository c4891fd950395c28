//! One second of motorway traffic at 25 Hz: real time when it takes less than a second.
//!
//! Three lanes, a vehicle every 30 m and lane, one in six a lorry, speeds by lane, on one thread.
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
use std::hint::black_box;

/// `count` vehicles after ten seconds of driving, so that the gaps are uneven.
fn traffic(count: usize) -> Option<Simulator<f64>> {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::motorway(3, 3.75).ok()?).ok()?;
    for i in 0..count {
        let lane = i % 3;
        let y = scene.road().lane_centre(lane)?;
        let truck = lane == 0 && i % 2 == 0;
        let speed = if truck { 23.0 } else { 28.0 + 3.0 * lane as f64 + (i % 7) as f64 * 0.3 };
        let state = State::new((i / 3) as f64 * 30.0, y, speed, 0.0);
        let drive = Drive::Cruise { speed, y };
        scene.add(if truck { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) }).ok()?;
    }
    (0..250).for_each(|_| {
        scene.step();
    });
    Some(scene)
}

fn simulator(criterion: &mut Criterion) {
    for count in [100, 1_000, 10_000] {
        let Some(scene) = traffic(count) else { continue };
        let run = |mut scene: Simulator<f64>| {
            for _ in 0..25 {
                black_box(scene.step());
            }
            scene
        };
        criterion.bench_function(&format!("simulator/{count}_vehicles/25_steps"), |bencher| {
            bencher.iter_batched(|| scene.clone(), run, BatchSize::LargeInput);
        });
    }
}

criterion_group!(benches, simulator);
criterion_main!(benches);
