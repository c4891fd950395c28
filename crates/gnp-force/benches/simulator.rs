//! One second of motorway traffic at 25 Hz: real time when it takes less than a second.
//!
//! Three lanes, a vehicle every 30 m and lane, half of the right lane lorries, speeds by lane, on one thread: the social
//! force and the intelligent driver model, in either precision.
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use gnp_force::{
    Drive, Driver, Idm, MotorwayRule, PairRule, Road, Simulator, SimulatorParams, State, Vehicle,
    na::{RealField, convert},
};
use std::hint::black_box;

/// `count` vehicles after ten seconds of driving, so that the gaps are uneven.
fn traffic<T: RealField + Copy, R: PairRule<T>>(count: usize, rule: &R) -> Option<Simulator<T, R>> {
    let lit = convert::<f64, T>;
    let road = Road::motorway(3, lit(3.75)).ok()?;
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(lit(0.04)), road).ok()?;
    for i in 0..count {
        let lane = i % 3;
        let y = scene.road().lane_centre(lane)?;
        let truck = lane == 0 && i % 2 == 0;
        let speed = lit(if truck { 23.0 } else { 28.0 + 3.0 * lane as f64 + (i % 7) as f64 * 0.3 });
        let state = State::new(lit((i / 3) as f64 * 30.0), y, speed, T::zero());
        let drive = Drive::Cruise { speed, y };
        let vehicle = if truck { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
        scene.add(vehicle.with_rule(rule.clone())).ok()?;
    }
    (0..250).for_each(|_| {
        scene.step();
    });
    Some(scene)
}

fn measure<T: RealField + Copy, R: PairRule<T>>(criterion: &mut Criterion, name: &str, count: usize, rule: &R) {
    let Some(scene) = traffic::<T, R>(count, rule) else { return };
    let run = |mut scene: Simulator<T, R>| {
        for _ in 0..25 {
            black_box(scene.step());
        }
        scene
    };
    criterion.bench_function(&format!("simulator/{name}/{count}_vehicles/25_steps"), |bencher| {
        bencher.iter_batched(|| scene.clone(), run, BatchSize::LargeInput);
    });
}

fn simulator(criterion: &mut Criterion) {
    for count in [100, 1_000, 10_000] {
        measure::<f64, _>(criterion, "motorway_f64", count, &MotorwayRule::standard());
        measure::<f32, _>(criterion, "motorway_f32", count, &MotorwayRule::standard());
        measure::<f64, _>(criterion, "idm_f64", count, &Idm::of(&Driver::motorway()));
        measure::<f32, _>(criterion, "idm_f32", count, &Idm::of(&Driver::motorway()));
    }
}

criterion_group!(benches, simulator);
criterion_main!(benches);
