//! The goal network's stage.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use gnp_data::Window;
use gnp_goal::{GoalLoss, GoalNet, LabelConfig, LossWeights, Pick, goal_loss, labels};
use gnp_model::{AugmentedView, Features, GoalInputs, Situation};
use gnp_modes::Modes;
use gnp_nn::{Dropout, Weights};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::within;
use crate::error::TrainError;
use crate::seed::derive_seed;
use crate::stage::{BatchTotals, Part, Stage};
use crate::stages::windows::{Augment, Windows};

/// Goals a window that the validation scores look at.
const LOOKED_AT: usize = 6;

/// Windows of a mini-batch that one thread takes: so few that there are parts for the threads, so many that what is made once
/// a part (tokens of the modes) does not show.
const PART: usize = 16;

/// What the goal network is trained for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalTraining {
    /// Weight of the probabilities against the future in the loss; 0.2 in the paper.
    pub alpha: f64,
    /// Weight of the squared error of the mean of all modes beside them; 0 as published.
    pub mean_weight: f64,
    /// How a future is shared out over the modes.
    pub labels: LabelConfig,
    /// Share of the training windows that are seen with left and right exchanged; 0 as published.
    pub mirror: f64,
    /// Largest factor by which lengths along the road are multiplied or divided in training; 1 as
    /// published. Headways in seconds stay: the same drivers in faster or slower traffic.
    pub longitudinal_scale: f64,
}

impl GoalTraining {
    /// Every number but those of the labels: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 4] = [
        ("alpha", 0., 1., "(the paper's is 0.2)"),
        ("mean_weight", 0., 1e6, "(0: as published)"),
        Augment::RANGES[0],
        Augment::RANGES[1],
    ];

    /// Whether every value can be used.
    ///
    /// # Errors
    /// With the first key that cannot, and what to write instead.
    pub fn check(&self) -> Result<(), TrainError> {
        within(&Self::RANGES, &[self.alpha, self.mean_weight])?;
        self.labels.check()?;
        self.augment().check()
    }

    fn augment(&self) -> Augment {
        Augment { mirror: self.mirror, longitudinal_scale: self.longitudinal_scale }
    }
}

/// Trains a [`GoalNet`]: the mode nearest to the truth is decoded and compared with it, the
/// probabilities against soft labels (GNP paper, section on mode-level goal prediction).
///
/// Its validation scores are `loss`, `regression`, `classification` and `mean` as in training but without
/// dropout, and in m the errors at the last frame of the likeliest goal, `fde`, and of the best of
/// the six likeliest, `min_fde_6`.
#[derive(Debug)]
pub struct GoalStage<'a> {
    net: GoalNet,
    weights: Weights,
    features: &'a Features,
    /// Centres in the network's unit, and in m.
    centres: [Tensor; 2],
    train: Windows<'a>,
    validation: Windows<'a>,
    config: &'a GoalTraining,
}

impl<'a> GoalStage<'a> {
    /// The stage of `net`, which was built on `weights`; `modes` are in the frame of `features`.
    ///
    /// # Errors
    /// When the configuration is refused, or the modes do not have the features' frames.
    pub fn new(
        net: GoalNet,
        weights: &Weights,
        features: &'a Features,
        modes: &Modes,
        [train, validation]: [Windows<'a>; 2],
        config: &'a GoalTraining,
    ) -> Result<Self, TrainError> {
        config.check()?;
        if modes.frame != features.mode_frame() || modes.t_pred != features.shape().t_pred {
            let problem = "the modes are not in the frame of the features; find them again";
            return Err(TrainError::Mismatch { stage: "goal", problem });
        }
        let scaled = features.centres(modes, weights.device())?;
        let metres = (&scaled * features.config().length_scale)?;
        let weights = weights.clone();
        Ok(Self { net, weights, features, centres: [scaled, metres], train, validation, config })
    }

    fn device(&self) -> &Device {
        self.weights.device()
    }

    /// The loss over `windows`, with what it was made of: inputs, and truth in the network's unit.
    fn losses(
        &self,
        windows: &[(AugmentedView<'_>, Window<'_>)],
        dropout: Option<&mut Dropout>,
    ) -> Result<(GoalLoss, GoalInputs, Tensor), TrainError> {
        let situations: Vec<Situation<'_>> =
            windows.par_iter().map(|(seen, _)| self.features.situation(*seen)).collect::<Result<_, _>>()?;
        let windows: Vec<Window<'_>> = windows.iter().map(|(_, window)| *window).collect();
        let inputs = self.features.goal_inputs(&situations, self.device())?;
        let truth = self.features.futures(&situations, &windows, self.device())?;
        let [scaled, metres] = &self.centres;
        let labels = labels(&(&truth * self.features.config().length_scale)?, metres, &self.config.labels)?;
        let GoalInputs { observed, neighbours, mask } = &inputs;
        let weights = LossWeights { alpha: self.config.alpha, mean: self.config.mean_weight };
        let pick = if weights.mean > 0. { Pick::All } else { Pick::Indices(labels.nearest.clone()) };
        let output = self.net.forward(observed, neighbours, mask, scaled, &pick, dropout)?;
        let loss = goal_loss(&output, &truth, &labels, weights)?;
        Ok((loss, inputs, truth))
    }
}

impl Stage for GoalStage<'_> {
    fn name(&self) -> &'static str {
        "goal"
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        self.weights.named()
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
        let mut dropout = Dropout::new(self.net.config().dropout, derive_seed(part.seed, 1)).from_window(part.first);
        Ok(self.losses(&windows, Some(&mut dropout))?.0.total)
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        let windows = self.validation.part(Part::whole(batch, 0), Augment::NONE)?;
        let (loss, inputs, truth) = self.losses(&windows, None)?;
        let GoalInputs { observed, neighbours, mask } = &inputs;
        let goals = self.net.predict(observed, neighbours, mask, &self.centres[0], LOOKED_AT)?;
        let last = self.features.shape().t_pred - 1;
        let ends = goals.futures.narrow(2, last, 1)?.squeeze(2)?;
        let true_ends = truth.narrow(1, last, 1)?;
        let off = ends.broadcast_sub(&true_ends)?.sqr()?.sum(2)?.sqrt()?;
        let off = (off * self.features.config().length_scale)?.to_vec2::<f32>()?;
        let sum = |of: fn(&[f32]) -> f32| off.iter().map(|row| f64::from(of(row))).sum::<f64>();
        let fde = sum(|row| row.first().copied().unwrap_or(f32::NAN));
        let min_fde = sum(|row| row.iter().copied().fold(f32::INFINITY, f32::min));
        let count = batch.len();
        let whole = |mean: &Tensor| Ok::<_, TrainError>(f64::from(mean.to_scalar::<f32>()?) * count as f64);
        let losses = [("loss", whole(&loss.total)?), ("regression", whole(&loss.regression)?)];
        let more = [("classification", whole(&loss.classification)?), ("fde", fde), ("min_fde_6", min_fde)];
        let mean = (self.config.mean_weight > 0.).then(|| whole(&loss.mean)).transpose()?.map(|mean| ("mean", mean));
        Ok(BatchTotals::new(count, losses.into_iter().chain(more).chain(mean)))
    }
}
