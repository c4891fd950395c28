//! A step backwards beside a step, and a roll-out of ten seconds with its gradient, on one thread.
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use gnp_force::{
    DifferentiableRule, Drive, Driver, Idm, MotorwayRule, Road, RollOut, SceneGradient, Simulator, SimulatorParams,
    State, Vehicle,
};
use std::hint::black_box;

/// Three lanes, a vehicle every 30 m and lane, ten seconds after they set out.
fn traffic<R: DifferentiableRule<f64>>(count: usize, rule: &R) -> Option<Simulator<f64, R>> {
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.04), Road::motorway(3, 3.75).ok()?).ok()?;
    for i in 0..count {
        let y = scene.road().lane_centre(i % 3)?;
        let speed = 26.0 + 3.0 * (i % 3) as f64 + (i % 7) as f64 * 0.3;
        let state = State::new((i / 3) as f64 * 30.0, y, speed, 0.0);
        scene.add(Vehicle::car(state, Drive::Cruise { speed, y }).with_rule(rule.clone())).ok()?;
    }
    (0..250).for_each(|_| {
        scene.step();
    });
    Some(scene)
}

fn measure<R: DifferentiableRule<f64>>(criterion: &mut Criterion, name: &str, rule: &R) {
    let Some(scene) = traffic(1000, rule) else { return };
    let mut everything = SceneGradient::zeros(&scene);
    for (id, _) in scene.vehicles() {
        if let Ok(own) = everything.of(id) {
            (own.state.position.x, own.state.velocity.x) = (1.0, 1.0);
        }
    }
    let mut group = criterion.benchmark_group(format!("adjoint/{name}/1000_vehicles"));
    group.bench_function("step", |bencher| {
        let step = |mut scene: Simulator<f64, R>| {
            black_box(scene.step());
            scene
        };
        bencher.iter_batched(|| scene.clone(), step, BatchSize::LargeInput);
    });
    group.bench_function("step_vjp", |bencher| {
        let back = |mut gradient: SceneGradient<f64>| {
            scene.step_vjp(&mut gradient);
            gradient
        };
        bencher.iter_batched(|| everything.clone(), back, BatchSize::LargeInput);
    });
    group.finish();
}

fn roll_out<R: DifferentiableRule<f64>>(criterion: &mut Criterion, name: &str, rule: &R) {
    let Some(scene) = traffic(100, rule) else { return };
    let mut group = criterion.benchmark_group(format!("adjoint/{name}/100_vehicles_250_steps"));
    group.bench_function("forward", |bencher| {
        let run = |mut scene: Simulator<f64, R>| {
            for _ in 0..250 {
                black_box(scene.step());
            }
            scene
        };
        bencher.iter_batched(|| scene.clone(), run, BatchSize::LargeInput);
    });
    group.bench_function("forward_and_gradient", |bencher| {
        let run = |mut scene: Simulator<f64, R>| {
            let roll_out = RollOut::record(&mut scene, 250);
            let gradient = roll_out.vjp(|_, scene, gradient| {
                scene.vehicles().try_for_each(|(id, _)| gradient.of(id).map(|own| own.state.position.x += 1.0))
            });
            black_box(gradient.is_ok())
        };
        bencher.iter_batched(|| scene.clone(), run, BatchSize::LargeInput);
    });
    group.finish();
}

fn adjoint(criterion: &mut Criterion) {
    measure(criterion, "motorway", &MotorwayRule::standard());
    measure(criterion, "idm", &Idm::of(&Driver::motorway()));
    roll_out(criterion, "idm", &Idm::of(&Driver::motorway()));
}

criterion_group!(benches, adjoint);
criterion_main!(benches);
