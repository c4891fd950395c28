//! Clustering futures into intention modes: one start, at the lengths and numbers of modes of NGSIM
//! and highD.

#![allow(missing_docs)] // criterion's macros write functions without

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gnp_modes::{ModeFrame, ModeParams, fit};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FUTURES: usize = 10_000;

/// Futures of vehicles that keep, gain or lose speed and stay in lane or change it, `[FUTURES, t_pred, 2]`.
fn futures(t_pred: usize, dt: f32) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut futures = Vec::with_capacity(FUTURES * t_pred * 2);
    for _ in 0..FUTURES {
        let (speed, gain) = (rng.random_range(5f32..35.), rng.random_range(-1.5f32..1.5));
        let aside = [0f32, 0., 0., 3.6, -3.6][rng.random_range(0..5)] + rng.random_range(-0.5f32..0.5);
        for j in 1..=t_pred {
            let (t, share) = (j as f32 * dt, j as f32 / t_pred as f32);
            let smooth = share * share * (3. - 2. * share);
            futures.extend([speed * t + 0.5 * gain * t * t, aside * smooth]);
        }
    }
    futures
}

fn modes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("modes");
    group.sample_size(10).throughput(Throughput::Elements(FUTURES as u64));
    for (data, t_pred, dt, modes) in [("ngsim", 50, 0.1, 100), ("highd", 125, 0.04, 200)] {
        let futures = futures(t_pred, dt);
        let params = ModeParams { modes, seed: 1, max_iterations: 20, restarts: 1 };
        let id = format!("{data}/{FUTURES}_futures/{t_pred}_steps/{modes}_modes/20_iterations");
        group.bench_function(id, |bencher| {
            bencher.iter(|| black_box(fit(&futures, t_pred, ModeFrame::Position, &params)));
        });
    }
    group.finish();
}

criterion_group!(benches, modes);
criterion_main!(benches);
