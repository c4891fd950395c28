//! The social force's stages: attraction, then repulsion.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use candle_core::{Device, Tensor, Var};
use gnp_data::{Truth, Window};
use gnp_model::{AugmentedView, Features, NeighbourFuture, NeighbourInput, Situation};
use gnp_nn::Weights;
use gnp_traj::{Phase, SocialForce};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::within;
use crate::error::TrainError;
use crate::seed::derive_seed;
use crate::stage::{BatchTotals, Part, Stage};
use crate::stages::windows::{Augment, Windows};

/// Windows of a mini-batch that one thread takes: as many as the roll-out sums gradients over before anything else.
const PART: usize = 16;

/// What the social force is trained for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathTraining {
    /// Standard deviation of what is added to the true goal in training, forward and to the left,
    /// m: predicted goals are never exact. 0 and 0 as published.
    pub goal_noise_m: [f64; 2],
    /// Share of the training windows that are seen with left and right exchanged; 0 as published.
    pub mirror: f64,
    /// Largest factor by which lengths along the road are multiplied or divided in training; 1 as
    /// published. Headways in seconds stay: the same drivers in faster or slower traffic.
    pub longitudinal_scale: f64,
}

impl PathTraining {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 3] =
        [("goal_noise_m", 0., 1e3, "m (0: none, as published)"), Augment::RANGES[0], Augment::RANGES[1]];

    /// Whether every value can be used.
    ///
    /// # Errors
    /// With the first key that cannot, and what to write instead.
    pub fn check(&self) -> Result<(), TrainError> {
        let [of_noise, ..] = Self::RANGES;
        self.goal_noise_m.iter().try_for_each(|noise| within(&[of_noise], &[*noise]))?;
        self.augment().check()
    }

    fn augment(&self) -> Augment {
        Augment { mirror: self.mirror, longitudinal_scale: self.longitudinal_scale }
    }
}

/// Trains one of the two networks of a [`SocialForce`] on its roll-out towards the true goal
/// (GNP paper, progressive training): first the attraction alone, then, that one frozen, the
/// repulsion.
///
/// Its validation scores are `mse`, the loss without noise and variation in m², and `ade` and `fde` in
/// m. All are made with the true goal: they measure the force, not the prediction.
#[derive(Debug)]
pub struct PathStage<'a> {
    name: &'static str,
    phase: Phase,
    force: SocialForce,
    weights: Weights,
    features: &'a Features,
    train: Windows<'a>,
    validation: Windows<'a>,
    uses_future: bool,
    neighbours: NeighbourFuture,
    config: &'a PathTraining,
}

impl<'a> PathStage<'a> {
    /// The attraction of `force`, which was built on `weights`; nobody pushes.
    ///
    /// # Errors
    /// When the configuration is refused.
    pub fn attraction(
        force: SocialForce,
        weights: &Weights,
        features: &'a Features,
        [train, validation]: [Windows<'a>; 2],
        config: &'a PathTraining,
    ) -> Result<Self, TrainError> {
        config.check()?;
        let (name, phase, uses_future) = ("attraction", Phase::Attraction, false);
        let (weights, neighbours) = (weights.clone(), NeighbourFuture::ConstantVelocity);
        Ok(Self { name, phase, force, weights, features, train, validation, uses_future, neighbours, config })
    }

    /// The repulsion of `force`, whose attraction is trained. `neighbours` says where the
    /// neighbours are: on recorded paths for [`NeighbourInput::Oracle`], behind their own leaders for
    /// [`NeighbourInput::Platoon`], at constant velocity for the other two, because vehicles that react to each
    /// other need each other's forces, which are not trained yet.
    ///
    /// # Errors
    /// When the configuration is refused.
    pub fn repulsion(
        force: SocialForce,
        weights: &Weights,
        features: &'a Features,
        [train, validation]: [Windows<'a>; 2],
        neighbours: NeighbourInput,
        config: &'a PathTraining,
    ) -> Result<Self, TrainError> {
        config.check()?;
        let (name, phase, uses_future) = ("repulsion", Phase::Repulsion, neighbours.uses_future());
        let (weights, neighbours) = (weights.clone(), neighbours.without_future());
        Ok(Self { name, phase, force, weights, features, train, validation, uses_future, neighbours, config })
    }

    fn device(&self) -> &Device {
        self.weights.device()
    }

    /// Rolled out and true positions, both `[batch, t_pred, 2]`, m; `off` is added to the goals.
    fn paths(&self, windows: &[(AugmentedView<'_>, Window<'_>)], off: &[[f32; 2]]) -> Result<[Tensor; 2], TrainError> {
        let (batch, t_pred) = (windows.len(), self.features.shape().t_pred);
        let mut truth = Vec::with_capacity(batch * t_pred * 2);
        let mut goals = Vec::with_capacity(batch * 2);
        for ((seen, window), off) in windows.iter().zip(off) {
            let recorded = window.truth();
            for j in 0..t_pred {
                let state = seen.true_target(&recorded, j);
                truth.extend([state.x, state.y]);
            }
            let goal = seen.true_target(&recorded, t_pred - 1);
            goals.extend([goal.x + off[0], goal.y + off[1]]);
        }
        let goals = Tensor::from_vec(goals, (batch, 1, 2), self.device())?;
        let situations: Vec<Situation<'_>> =
            windows.par_iter().map(|(seen, _)| self.features.situation(*seen)).collect::<Result<_, _>>()?;
        let truths: Option<Vec<Truth<'_>>> =
            self.uses_future.then(|| windows.iter().map(|(_, window)| window.truth()).collect());
        let scene = self.features.scene(&situations, goals, self.neighbours, truths.as_deref(), self.device())?;
        let path = self.features.to_road(&situations, &self.force.roll_out(&scene, self.phase)?)?;
        Ok([path.squeeze(1)?, Tensor::from_vec(truth, (batch, t_pred, 2), self.device())?])
    }
}

impl Stage for PathStage<'_> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        let trained = |(name, _): &(String, Var)| self.force.trains(self.phase, name);
        self.weights.named().into_iter().filter(trained).collect()
    }

    fn train_len(&self) -> usize {
        self.train.len()
    }

    fn validation_len(&self) -> usize {
        self.validation.len()
    }

    fn train_sites(&self) -> Vec<u32> {
        self.train.sites()
    }

    fn validation_sites(&self) -> Vec<u32> {
        self.validation.sites()
    }

    fn part_windows(&self) -> Option<usize> {
        self.device().is_cpu().then_some(PART)
    }

    fn loss(&self, part: Part<'_>) -> Result<Tensor, TrainError> {
        let windows = self.train.part(part, self.config.augment())?;
        let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(part.seed, 1));
        let [forward, left] = self.config.goal_noise_m;
        let draw = |_| {
            let [a, b] = normal(&mut rng);
            [(forward * a) as f32, (left * b) as f32]
        };
        // The first draws are those of the windows before them in the mini-batch.
        let off: Vec<[f32; 2]> = (0..part.first + windows.len()).map(draw).skip(part.first).collect();
        let [path, truth] = self.paths(&windows, &off)?;
        Ok((path - truth)?.sqr()?.mean_all()?)
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        let windows = self.validation.part(Part::whole(batch, 0), Augment::NONE)?;
        let [path, truth] = self.paths(&windows, &vec![[0.; 2]; batch.len()])?;
        let squares = (path.detach() - truth)?.sqr()?.sum(2)?.to_vec2::<f32>()?;
        let (mut mse, mut ade, mut fde) = (0., 0., 0.);
        for row in &squares {
            let frames = row.len() as f64;
            mse += row.iter().map(|square| f64::from(*square)).sum::<f64>() / (2. * frames);
            ade += row.iter().map(|square| f64::from(*square).sqrt()).sum::<f64>() / frames;
            fde += row.last().map_or(f64::NAN, |square| f64::from(*square).sqrt());
        }
        Ok(BatchTotals::new(batch.len(), [("mse", mse), ("ade", ade), ("fde", fde)]))
    }
}

/// Two independent draws from the standard normal distribution (Box and Muller 1958).
fn normal(rng: &mut impl Rng) -> [f64; 2] {
    let radius = (-2. * (1. - rng.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_0_and_variance_1() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let draws: Vec<f64> = (0..20_000).flat_map(|_| normal(&mut rng)).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / draws.len() as f64;
        let beyond_two = draws.iter().filter(|x| x.abs() > 2.).count() as f64 / draws.len() as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.).abs() < 0.03, "{mean}, {variance}");
        assert!((beyond_two - 0.0455).abs() < 0.005, "{beyond_two}");
    }

    #[test]
    fn bad_values_are_refused_by_key() {
        let good = PathTraining { goal_noise_m: [2., 0.], mirror: 0.5, longitudinal_scale: 1.2 };
        assert!(good.check().is_ok());
        for (bad, key) in [
            (PathTraining { goal_noise_m: [-1., 0.], ..good.clone() }, "goal_noise_m"),
            (PathTraining { goal_noise_m: [0., f64::NAN], ..good.clone() }, "goal_noise_m"),
            (PathTraining { mirror: 1.1, ..good.clone() }, "mirror"),
            (PathTraining { longitudinal_scale: 0.8, ..good.clone() }, "longitudinal_scale"),
        ] {
            let message = bad.check().unwrap_err().to_string();
            assert!(message.starts_with(key), "{message}");
        }
    }
}
