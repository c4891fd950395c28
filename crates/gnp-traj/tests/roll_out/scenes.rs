//! Small networks and seeded scenes; every size is another number.

use candle_core::{DType, Device, Tensor, Var};
use gnp_nn::Weights;
use gnp_traj::{InputScale, Integrator, Lines, NeighbourStates, Neighbours, RollOutBatch, SocialForce, TrajConfig};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(crate) type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;
/// The gradient of every weight by name; none where none arrives.
pub(crate) type Gradients = Vec<(String, Option<Vec<f32>>)>;

/// A network of a few units whose forces are all of the same order.
pub(crate) fn small() -> TrajConfig {
    TrajConfig {
        hidden: 12,
        embedding: 8,
        latent_dim: 6,
        encoder: vec![10, 9],
        decoder: vec![11, 13, 14],
        tau_max: 1.7,
        k_max: 6.,
        k_max_line: 3.,
        k_bias: -0.5,
        r_col: 12.,
        lines: true,
        input_scale: InputScale { position: 0.05, velocity: 0.1 },
        integrator: Integrator::SemiImplicitEuler,
        network_period: 1,
        terms: Vec::new(),
    }
}

pub(crate) fn network(cfg: &TrajConfig, seed: u64) -> Outcome<(SocialForce, Weights)> {
    let weights = Weights::seeded(seed, &Device::Cpu);
    Ok((SocialForce::new(cfg, weights.builder())?, weights))
}

pub(crate) fn uniform(rng: &mut ChaCha8Rng, shape: &[usize], lo: f32, hi: f32) -> candle_core::Result<Tensor> {
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(lo..hi)).collect();
    Tensor::from_vec(values, shape, &Device::Cpu)
}

/// `windows` windows of 4 observed and 7 predicted frames, 5 slots, 3 lines; each window lacks some.
pub(crate) fn scene(windows: usize, goals: usize, seed: u64) -> Outcome<RollOutBatch> {
    const OBSERVED: usize = 4;
    const STEPS: usize = 7;
    const SLOTS: usize = 5;
    const LINES: usize = 3;
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let pair = |rng: &mut ChaCha8Rng, shape: &[usize], x: (f32, f32), y: (f32, f32)| {
        Tensor::stack(&[uniform(rng, shape, x.0, x.1)?, uniform(rng, shape, y.0, y.1)?], shape.len())
    };
    let observed = Tensor::cat(
        &[
            pair(rng, &[windows, OBSERVED], (-6., 0.), (-0.5, 0.5))?,
            pair(rng, &[windows, OBSERVED], (8., 15.), (-1., 1.))?,
        ],
        2,
    )?;
    let states = Tensor::cat(
        &[
            pair(rng, &[windows, STEPS, SLOTS], (-25., 25.), (-5., 5.))?,
            pair(rng, &[windows, STEPS, SLOTS], (8., 15.), (-1., 1.))?,
        ],
        3,
    )?;
    let present: Vec<f32> = (0..windows * SLOTS).map(|i| f32::from(u8::from(i % SLOTS != i / SLOTS % 7))).collect();
    let mut lines = Vec::new();
    for _ in 0..windows {
        let shift = rng.random_range(-0.6f32..0.6);
        lines.extend([shift - 1.8, 1., 1., shift + 1.8, 0., 0., shift + 5.4, 1., -1.]);
    }
    let there: Vec<f32> = (0..windows * LINES).map(|i| f32::from(u8::from(i % 4 != 1))).collect();
    Ok(RollOutBatch {
        observed,
        goals: pair(rng, &[windows, goals], (5., 12.), (-4., 4.))?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Given(states),
            present: Tensor::from_vec(present, (windows, SLOTS), &Device::Cpu)?,
        }),
        lines: Some(Lines {
            lines: Tensor::from_vec(lines, (windows, LINES, 3), &Device::Cpu)?,
            present: Tensor::from_vec(there, (windows, LINES), &Device::Cpu)?,
        }),
        dt: 0.1,
        steps: STEPS,
    })
}

pub(crate) fn values(x: &Tensor) -> candle_core::Result<Vec<f32>> {
    x.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
}

/// Fails unless `found` is within `tolerance` of `wanted`, relative to the largest wanted value.
pub(crate) fn assert_close(name: &str, found: &[f32], wanted: &[f32], tolerance: f32) {
    assert_eq!(found.len(), wanted.len(), "{name}");
    let largest = wanted.iter().fold(0f32, |a, b| a.max(b.abs()));
    for (i, (a, b)) in found.iter().zip(wanted).enumerate() {
        let off = (a - b).abs();
        assert!(off <= tolerance * largest.max(1e-6), "{name}[{i}]: {a}, wanted {b} (largest {largest})");
    }
}

pub(crate) fn gradients(weights: &Weights, loss: &Tensor) -> candle_core::Result<Gradients> {
    let store = loss.backward()?;
    let of = |var: &Var| store.get(var).map(values).transpose();
    weights.named().into_iter().map(|(name, var)| Ok((name, of(&var)?))).collect()
}
