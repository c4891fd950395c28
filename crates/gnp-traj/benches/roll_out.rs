//! The roll-out at the published sizes: 64 windows, 8 neighbour slots of which 65 % are taken, the
//! lengths of NGSIM (30 + 50 steps of 0.1 s) and highD (75 + 125 steps of 0.04 s).
//!
//! A reported time is for the whole batch. `forward` gives the path; `train` gives the gradient of its
//! mean squared error in every weight; `forward_20_goals` rolls each window out to 20 goals.

#![expect(missing_docs, reason = "criterion's macros make undocumented functions")]

use std::hint::black_box;
use std::time::Duration;

use candle_core::{Device, Result, Tensor};
use criterion::{Criterion, criterion_group, criterion_main};
use gnp_nn::Weights;
use gnp_traj::{Engine, NeighbourStates, Neighbours, Phase, Scene, SocialForce, TrajConfig, TrajError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const WINDOWS: usize = 64;
const SLOTS: usize = 8;

fn uniform(rng: &mut ChaCha8Rng, shape: &[usize], size: f32) -> Result<Tensor> {
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-size..size)).collect();
    Tensor::from_vec(values, shape, &Device::Cpu)
}

fn scene(observed: usize, steps: usize, dt: f64, goals: usize) -> Result<Scene> {
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let present: Vec<f32> = (0..WINDOWS * SLOTS).map(|_| f32::from(u8::from(rng.random_bool(0.65)))).collect();
    Ok(Scene {
        observed: uniform(rng, &[WINDOWS, observed, 4], 1.7)?,
        goals: (uniform(rng, &[WINDOWS, goals, 2], 1.7)? + 100.)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Given(uniform(rng, &[WINDOWS, steps, SLOTS, 4], 17.)?),
            present: Tensor::from_vec(present, (WINDOWS, SLOTS), &Device::Cpu)?,
        }),
        lines: None,
        dt,
        steps,
    })
}

fn train(network: &SocialForce, engine: Engine, scene: &Scene, truth: &Tensor) -> std::result::Result<(), TrajError> {
    let loss = (network.roll_out_on(engine, scene, Phase::Full)? - truth)?.sqr()?.mean_all()?;
    black_box(loss.backward()?);
    Ok(())
}

fn forward(network: &SocialForce, scene: &Scene) -> std::result::Result<(), TrajError> {
    black_box(network.roll_out_explained(scene, Phase::Full)?);
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    if let Err(error) = roll_out(criterion) {
        eprintln!("{error}");
    }
}

fn roll_out(criterion: &mut Criterion) -> std::result::Result<(), TrajError> {
    let network = SocialForce::new(&TrajConfig::published(), Weights::seeded(1, &Device::Cpu).builder())?;
    let mut group = criterion.benchmark_group("roll_out");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    for (name, observed, steps, dt) in [("ngsim", 30, 50, 0.1), ("highd", 75, 125, 0.04)] {
        let one = scene(observed, steps, dt, 1)?;
        let twenty = scene(observed, steps, dt, 20)?;
        let truth = uniform(&mut ChaCha8Rng::seed_from_u64(2), &[WINDOWS, 1, steps, 2], 1.7)?;
        let id = |what: &str| format!("{what}/{name}_{observed}_{steps}/{WINDOWS}_windows/{SLOTS}_neighbours");
        let failed = |result: std::result::Result<(), TrajError>| {
            if let Err(error) = result {
                eprintln!("{error}");
            }
        };
        group.bench_function(id("fused/forward"), |b| b.iter(|| failed(forward(&network, &one))));
        group.bench_function(id("fused/train"), |b| b.iter(|| failed(train(&network, Engine::Fused, &one, &truth))));
        group.bench_function(id("fused/forward_20_goals"), |b| b.iter(|| failed(forward(&network, &twenty))));
        group.bench_function(id("graph/train"), |b| b.iter(|| failed(train(&network, Engine::Graph, &one, &truth))));
    }
    group.finish();
    Ok(())
}

criterion_group!(all, benches);
criterion_main!(all);
