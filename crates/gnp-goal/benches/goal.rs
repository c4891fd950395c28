//! The goal network at the published sizes: forward with 20 goals, and a training step with one.

use std::hint::black_box;

use candle_core::{DType, Device, Tensor};
use criterion::{Criterion, criterion_group, criterion_main};
use gnp_goal::{
    GoalConfig, GoalNet, GoalShape, LabelConfig, LabelDistance, LossWeights, Pick, ProbabilityHead, Regression,
};
use gnp_nn::{Dropout, Weights};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const BATCH: usize = 64;
const SLOTS: usize = 8;

fn config(probability: ProbabilityHead) -> GoalConfig {
    let decoder = probability == ProbabilityHead::Decoder;
    GoalConfig {
        width: 64,
        heads: 4,
        layers: 2,
        feed_forward: 2,
        dropout: 0.1,
        probability,
        regression: if decoder { Regression::Residual } else { Regression::Absolute },
        null_token: decoder,
        slot_embedding: decoder,
        zero_start: false,
    }
}

struct Case {
    net: GoalNet,
    observed: Tensor,
    neighbours: Tensor,
    mask: Tensor,
    modes: Tensor,
    truth: Tensor,
}

impl Case {
    fn new(config: &GoalConfig, t_obs: usize, t_pred: usize, modes: usize) -> candle_core::Result<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut random = |shape: &[usize]| {
            let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1. ..1.)).collect();
            Tensor::from_vec(values, shape, &Device::Cpu)
        };
        let shape = GoalShape { observed: 4 * t_obs, neighbour: 4 * t_obs, slots: SLOTS, t_pred };
        let weights = Weights::seeded(0, &Device::Cpu);
        Ok(Self {
            net: GoalNet::new(config, shape, weights.builder()).map_err(candle_core::Error::wrap)?,
            observed: random(&[BATCH, 4 * t_obs])?,
            neighbours: random(&[BATCH, SLOTS, 4 * t_obs])?,
            mask: random(&[BATCH, SLOTS])?.gt(-0.3)?.to_dtype(DType::F32)?,
            modes: random(&[modes, t_pred, 2])?,
            truth: random(&[BATCH, t_pred, 2])?,
        })
    }

    fn forward(&self) -> Result<Tensor, gnp_goal::GoalError> {
        let pick = Pick::MostProbable(20);
        Ok(self.net.forward(&self.observed, &self.neighbours, &self.mask, &self.modes, &pick, None)?.futures)
    }

    fn train(&self, dropout: &mut Dropout) -> Result<candle_core::backprop::GradStore, gnp_goal::GoalError> {
        let config = LabelConfig { distance: LabelDistance::MeanDisplacement, temperature: 0.5 };
        let labels = gnp_goal::labels(&self.truth, &self.modes, &config)?;
        let pick = Pick::Indices(labels.nearest.clone());
        let output =
            self.net.forward(&self.observed, &self.neighbours, &self.mask, &self.modes, &pick, Some(dropout))?;
        Ok(gnp_goal::goal_loss(&output, &self.truth, &labels, LossWeights { alpha: 0.2, mean: 0. })?
            .total
            .backward()?)
    }
}

fn goal(criterion: &mut Criterion) {
    for (data, t_obs, t_pred, modes) in [("ngsim", 30, 50, 100), ("highd", 75, 125, 200)] {
        for (form, probability) in [("published", ProbabilityHead::Encoder), ("decoder", ProbabilityHead::Decoder)] {
            let Ok(case) = Case::new(&config(probability), t_obs, t_pred, modes) else { continue };
            let mut group = criterion.benchmark_group(format!("goal/{data}/{form}/{BATCH}_windows/{modes}_modes"));
            group.sample_size(10);
            group.bench_function("forward/20_goals", |bencher| bencher.iter(|| black_box(case.forward())));
            for rate in [0., 0.1] {
                group.bench_function(format!("train/dropout_{rate}"), |bencher| {
                    let mut dropout = Dropout::new(rate, 1);
                    bencher.iter(|| black_box(case.train(&mut dropout)));
                });
            }
            // The same as a graph of candle operations: what the fused form is worth.
            let graph = Case { net: case.net.clone().as_graph(), ..case };
            group.bench_function("graph/train/dropout_0.1", |bencher| {
                let mut dropout = Dropout::new(0.1, 1);
                bencher.iter(|| black_box(graph.train(&mut dropout)));
            });
            group.finish();
        }
    }
}

criterion_group!(benches, goal);
criterion_main!(benches);
