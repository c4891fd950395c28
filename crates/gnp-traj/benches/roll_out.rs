//! The roll-out at the published sizes: 64 windows, 8 neighbour slots of which 65 % are taken, the
//! lengths of NGSIM (30 + 50 steps of 0.1 s) and highD (75 + 125 steps of 0.04 s).
//!
//! A reported time is for the whole batch. `forward` gives the path; `train` gives the gradient of its
//! mean squared error in every weight; `forward_20_goals` rolls each window out to 20 goals;
//! `train_period_3` runs the networks at every third frame.

use std::hint::black_box;
use std::time::Duration;

use candle_core::{Device, Result, Tensor};
use criterion::{Criterion, criterion_group, criterion_main};
use gnp_nn::Weights;
use gnp_traj::{Engine, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TrajConfig, TrajError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SLOTS: usize = 8;

fn uniform(rng: &mut ChaCha8Rng, shape: &[usize], size: f32) -> Result<Tensor> {
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-size..size)).collect();
    Tensor::from_vec(values, shape, &Device::Cpu)
}

/// Lengths of a dataset's windows: observed and predicted frames, and the frame period in s.
#[derive(Clone, Copy)]
struct Length {
    name: &'static str,
    observed: usize,
    steps: usize,
    dt: f64,
}

const NGSIM: Length = Length { name: "ngsim", observed: 30, steps: 50, dt: 0.1 };
const HIGHD: Length = Length { name: "highd", observed: 75, steps: 125, dt: 0.04 };

fn scene(length: Length, windows: usize, goals: usize) -> Result<RollOutBatch> {
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let present: Vec<f32> = (0..windows * SLOTS).map(|_| f32::from(u8::from(rng.random_bool(0.65)))).collect();
    Ok(RollOutBatch {
        observed: uniform(rng, &[windows, length.observed, 4], 1.7)?,
        goals: (uniform(rng, &[windows, goals, 2], 1.7)? + 100.)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Given(uniform(rng, &[windows, length.steps, SLOTS, 4], 17.)?),
            present: Tensor::from_vec(present, (windows, SLOTS), &Device::Cpu)?,
        }),
        lines: None,
        dt: length.dt,
        steps: length.steps,
    })
}

/// One forward and backward pass.
fn train(network: &SocialForce, engine: Engine, scene: &RollOutBatch) -> std::result::Result<(), TrajError> {
    let loss = network.roll_out_on(engine, scene, Phase::Full)?.sqr()?.mean_all()?;
    black_box(loss.backward()?);
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    if let Err(error) = roll_out(criterion) {
        eprintln!("{error}");
    }
}

fn roll_out(criterion: &mut Criterion) -> std::result::Result<(), TrajError> {
    let network = |network_period| {
        let cfg = TrajConfig { network_period, ..TrajConfig::published() };
        SocialForce::new(&cfg, Weights::seeded(1, &Device::Cpu).builder())
    };
    let (every, third) = (network(1)?, network(3)?);
    let mut group = criterion.benchmark_group("roll_out");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    let mut run = |what: &str, length: Length, windows: usize, f: &dyn Fn() -> std::result::Result<(), TrajError>| {
        let Length { name, observed, steps, .. } = length;
        let id = format!("{what}/{name}_{observed}_{steps}/{windows}_windows/{SLOTS}_neighbours");
        group.bench_function(id, |b| {
            b.iter(|| {
                if let Err(error) = f() {
                    eprintln!("{error}");
                }
            });
        });
    };
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    for length in [NGSIM, HIGHD] {
        let (half, one, twenty) = (scene(length, 32, 1)?, scene(length, 64, 1)?, scene(length, 64, 20)?);
        run("fused/forward", length, 64, &|| {
            black_box(every.predict(&one, Phase::Full)?);
            Ok(())
        });
        run("fused/forward_20_goals", length, 64, &|| {
            black_box(every.predict(&twenty, Phase::Full)?);
            Ok(())
        });
        run("fused/train", length, 64, &|| train(&every, Engine::Fused, &one));
        run("fused/train", length, 32, &|| train(&every, Engine::Fused, &half));
        run("fused/train_period_3", length, 64, &|| train(&third, Engine::Fused, &one));
        if let Ok(single) = &single {
            run("fused/train_1_thread", length, 64, &|| single.install(|| train(&every, Engine::Fused, &one)));
        }
    }
    let one = scene(NGSIM, 64, 1)?;
    run("graph/train", NGSIM, 64, &|| train(&every, Engine::Graph, &one));
    group.finish();
    Ok(())
}

criterion_group!(all, benches);
criterion_main!(all);
