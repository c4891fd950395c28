//! Both networks at the published sizes on random windows, as the reference programs in `peer/` have them.

use std::collections::BTreeMap;

use anyhow::Result;
use candle_core::backprop::GradStore;
use candle_core::{DType, Device, Tensor, Var};
use candle_nn::VarBuilder;
use gnp_data::SLOTS;
use gnp_goal::{
    GoalConfig, GoalError, GoalNet, GoalShape, Labels, LossWeights, Pick, ProbabilityHead, Regression, goal_loss,
};
use gnp_nn::{Precision, Weights};
use gnp_traj::{Engine, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TrajConfig};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Share of neighbour slots that are taken.
const PRESENT: f64 = 0.65;
/// Goals a window where several are asked for.
pub(super) const GOALS: usize = 20;

/// How long the windows of a data set are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lengths {
    pub(super) name: &'static str,
    pub(super) observed: usize,
    pub(super) predicted: usize,
    pub(super) modes: usize,
    /// Frame period, s.
    pub(super) dt: f64,
}

/// NGSIM at 10 Hz.
pub(super) const NGSIM: Lengths = Lengths { name: "ngsim", observed: 30, predicted: 50, modes: 100, dt: 0.1 };
/// highD at 25 Hz.
pub(super) const HIGHD: Lengths = Lengths { name: "highd", observed: 75, predicted: 125, modes: 200, dt: 0.04 };

/// A network that records its steps for gradients, and the same one with constant weights.
#[derive(Clone, Debug)]
pub(super) struct Twice<N> {
    learning: N,
    constant: N,
    weights: Weights,
}

impl<N> Twice<N> {
    fn new(device: &Device, build: impl Fn(VarBuilder<'static>) -> Result<N>) -> Result<Self> {
        let weights = Weights::seeded(1, device);
        let learning = build(weights.builder())?;
        let named = weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().detach()));
        let constant = build(VarBuilder::from_tensors(named.collect(), DType::F32, device))?;
        Ok(Self { learning, constant, weights })
    }
}

/// Random numbers with a seed, on a device.
#[derive(Debug)]
struct Draw(ChaCha8Rng, Device);

impl Draw {
    fn new(device: &Device) -> Self {
        Self(ChaCha8Rng::seed_from_u64(1), device.clone())
    }

    /// As wide as a normal distribution of standard deviation `size`.
    fn values(&mut self, shape: &[usize], size: f32) -> Result<Tensor> {
        let half = size * 3f32.sqrt();
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| self.0.random_range(-half..half)).collect();
        Ok(Tensor::from_vec(values, shape, &self.1)?)
    }

    fn present(&mut self, windows: usize) -> Result<Tensor> {
        let taken = (0..windows * SLOTS).map(|_| if self.0.random_bool(PRESENT) { 1f32 } else { 0. });
        Ok(Tensor::from_vec(taken.collect(), (windows, SLOTS), &self.1)?)
    }

    fn indices(&mut self, shape: (usize, usize), below: usize) -> Result<Tensor> {
        let values: Vec<u32> = (0..shape.0 * shape.1).map(|_| self.0.random_range(0..below as u32)).collect();
        Ok(Tensor::from_vec(values, shape, &self.1)?)
    }
}

/// Slots that are taken of `present` `[windows, SLOTS]`, in the mean over windows.
fn mean_taken(present: &Tensor) -> Result<f64> {
    Ok(f64::from(present.mean_all()?.to_scalar::<f32>()?) * SLOTS as f64)
}

/// The neural social force and a batch of windows.
#[derive(Clone, Debug)]
pub(super) struct Traj {
    network: Twice<SocialForce>,
    one: RollOutBatch,
    many: RollOutBatch,
    truth: Tensor,
}

impl Traj {
    pub(super) fn new(lengths: Lengths, windows: usize) -> Result<Self> {
        Self::on(&Device::Cpu, lengths, windows)
    }

    pub(super) fn on(device: &Device, lengths: Lengths, windows: usize) -> Result<Self> {
        let Lengths { observed, predicted, dt, .. } = lengths;
        let mut draw = Draw::new(device);
        let one = RollOutBatch {
            observed: draw.values(&[windows, observed, 4], 1.)?,
            goals: (draw.values(&[windows, 1, 2], 1.)? + 100.)?,
            neighbours: Some(Neighbours {
                states: NeighbourStates::Given(draw.values(&[windows, predicted, SLOTS, 4], 10.)?),
                present: draw.present(windows)?,
            }),
            lines: None,
            dt,
            steps: predicted,
        };
        let many = RollOutBatch { goals: (draw.values(&[windows, GOALS, 2], 1.)? + 100.)?, ..one.clone() };
        let truth = draw.values(&[windows, 1, predicted, 2], 1.)?;
        let network = Twice::new(device, |vb| Ok(SocialForce::new(&TrajConfig::published(), vb)?))?;
        Ok(Self { network, one, many, truth })
    }

    /// Neighbours of a window that are there, in the mean.
    pub(super) fn taken(&self) -> Result<f64> {
        self.one.neighbours.as_ref().map_or(Ok(0.), |neighbours| mean_taken(&neighbours.present))
    }

    /// The same with constant weights that are packed once, in that precision.
    pub(super) fn frozen(&self, precision: Precision) -> Result<Self> {
        let mut frozen = self.clone();
        frozen.network.constant = self.network.constant.frozen_in(precision)?;
        Ok(frozen)
    }

    pub(super) fn forward(&self, engine: Engine) -> Result<()> {
        self.path(Some(engine)).map(drop)
    }

    /// As predictions have it where no engine is named.
    pub(super) fn path(&self, engine: Option<Engine>) -> Result<Tensor> {
        self.roll_out(&self.network.constant, engine)
    }

    fn roll_out(&self, network: &SocialForce, engine: Option<Engine>) -> Result<Tensor> {
        Ok(match engine {
            Some(engine) => network.roll_out_on(engine, &self.one, Phase::Full)?,
            None => network.roll_out(&self.one, Phase::Full)?,
        })
    }

    /// To [`GOALS`] goals a window.
    pub(super) fn forward_many(&self) -> Result<()> {
        self.network.constant.roll_out_on(Engine::Fused, &self.many, Phase::Full)?;
        Ok(())
    }

    /// The gradient of the mean squared error in every weight.
    pub(super) fn train(&self, engine: Engine) -> Result<()> {
        self.gradients(Some(engine)).map(drop)
    }

    /// As training has them where no engine is named.
    pub(super) fn gradients(&self, engine: Option<Engine>) -> Result<Vec<Tensor>> {
        let path = self.roll_out(&self.network.learning, engine)?;
        Ok(self.network.of_weights(&(path - &self.truth)?.sqr()?.mean_all()?.backward()?))
    }
}

impl<N> Twice<N> {
    /// The gradients of all weights.
    fn of_weights(&self, all: &GradStore) -> Vec<Tensor> {
        self.weights.named().values().filter_map(|weight| all.get(weight).cloned()).collect()
    }
}

/// The goal network and a batch of windows.
#[derive(Debug)]
pub(super) struct Goal {
    fused: Twice<GoalNet>,
    graph: Twice<GoalNet>,
    observed: Tensor,
    neighbours: Tensor,
    mask: Tensor,
    modes: Tensor,
    truth: Tensor,
    many: Pick,
    one: Pick,
}

impl Goal {
    pub(super) fn new(lengths: Lengths, windows: usize) -> Result<Self> {
        Self::on(&Device::Cpu, lengths, windows)
    }

    pub(super) fn on(device: &Device, lengths: Lengths, windows: usize) -> Result<Self> {
        let Lengths { observed, predicted, modes, .. } = lengths;
        let config = GoalConfig {
            width: 64,
            heads: 4,
            layers: 2,
            feed_forward: 2,
            dropout: 0.,
            probability: ProbabilityHead::Encoder,
            regression: Regression::Absolute,
            null_token: false,
            slot_embedding: false,
            zero_start: false,
        };
        let shape = GoalShape { observed: 4 * observed, neighbour: 4 * observed, slots: SLOTS, t_pred: predicted };
        let fused = Twice::new(device, |vb| Ok(GoalNet::new(&config, shape, vb)?))?;
        let graph = Twice {
            learning: fused.learning.clone().as_graph(),
            constant: fused.constant.clone().as_graph(),
            weights: fused.weights.clone(),
        };
        let mut draw = Draw::new(device);
        Ok(Self {
            fused,
            graph,
            observed: draw.values(&[windows, 4 * observed], 1.)?,
            neighbours: draw.values(&[windows, SLOTS, 4 * observed], 1.)?,
            mask: draw.present(windows)?,
            modes: draw.values(&[modes, predicted, 2], 1.)?,
            truth: draw.values(&[windows, predicted, 2], 1.)?,
            many: Pick::Indices(draw.indices((windows, GOALS), modes)?),
            one: Pick::Indices(draw.indices((windows, 1), modes)?),
        })
    }

    fn network(&self, engine: Engine) -> &Twice<GoalNet> {
        match engine {
            Engine::Fused => &self.fused,
            Engine::Graph => &self.graph,
        }
    }

    /// With [`GOALS`] goals a window.
    pub(super) fn forward(&self, engine: Engine) -> Result<()> {
        self.futures(engine).map(drop)
    }

    pub(super) fn futures(&self, engine: Engine) -> Result<Tensor> {
        let network = &self.network(engine).constant;
        let output = network.forward(&self.observed, &self.neighbours, &self.mask, &self.modes, &self.many, None)?;
        Ok(output.futures)
    }

    /// The gradient of the loss in every weight, with one goal a window.
    pub(super) fn train(&self, engine: Engine) -> Result<()> {
        self.gradients(engine).map(drop)
    }

    pub(super) fn gradients(&self, engine: Engine) -> Result<Vec<Tensor>> {
        let inputs = [&self.observed, &self.neighbours, &self.mask, &self.truth];
        let network = self.network(engine);
        Ok(network.of_weights(&self.loss(&network.learning, inputs, &self.one)?.backward()?))
    }

    /// Neighbours of a window that are there, in the mean.
    pub(super) fn taken(&self) -> Result<f64> {
        mean_taken(&self.mask)
    }

    /// Windows of the batch.
    pub(super) fn windows(&self) -> usize {
        self.observed.dims()[0]
    }

    /// What training moves.
    pub(super) fn weights(&self) -> BTreeMap<String, Var> {
        self.fused.weights.named()
    }

    /// The loss of some windows, with one goal each.
    pub(super) fn loss_of(&self, windows: &[u32]) -> candle_core::Result<Tensor> {
        let index = Tensor::new(windows, self.observed.device())?;
        let of = |all: &Tensor| all.index_select(&index, 0);
        let inputs = [of(&self.observed)?, of(&self.neighbours)?, of(&self.mask)?, of(&self.truth)?];
        let Pick::Indices(one) = &self.one else { candle_core::bail!("one goal a window is picked by index") };
        let loss = self.loss(&self.fused.learning, inputs.each_ref(), &Pick::Indices(of(one)?));
        loss.map_err(candle_core::Error::wrap)
    }

    /// The loss of `network` for observations, neighbours, their mask and the truth.
    fn loss(&self, network: &GoalNet, inputs: [&Tensor; 4], pick: &Pick) -> Result<Tensor, GoalError> {
        let [observed, neighbours, mask, truth] = inputs;
        let output = network.forward(observed, neighbours, mask, &self.modes, pick, None)?;
        let soft = candle_nn::ops::softmax(&output.logits.detach(), 1)?;
        let labels = Labels { soft, nearest: output.indices.clone() };
        Ok(goal_loss(&output, truth, &labels, LossWeights { alpha: 0.5, mean: 0. })?.total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Lengths = Lengths { name: "short", observed: 3, predicted: 2, modes: 7, dt: 0.1 };

    #[test]
    fn every_case_runs_on_both_engines() -> Result<()> {
        let (traj, goal) = (Traj::new(SHORT, 5)?, Goal::new(SHORT, 5)?);
        traj.forward_many()?;
        for engine in [Engine::Fused, Engine::Graph] {
            traj.forward(engine)?;
            traj.train(engine)?;
            goal.forward(engine)?;
            goal.train(engine)?;
        }
        Ok(())
    }

    #[test]
    fn about_the_share_of_slots_is_taken() -> Result<()> {
        let taken = Draw::new(&Device::Cpu).present(1000)?.mean_all()?.to_scalar::<f32>()?;
        assert!((f64::from(taken) - PRESENT).abs() < 0.03, "{taken}");
        Ok(())
    }
}
