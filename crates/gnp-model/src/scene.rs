//! Windows to the scene that the neural social force drives through.

use candle_core::{Device, Tensor};
use gnp_baselines::lateral;
use gnp_data::{MarkingKind, SLOTS, Slot, Truth};
use gnp_traj::{Lines, NeighbourStates, Neighbours, RollOutBatch};
use serde::{Deserialize, Serialize};

use crate::augmented_view::AugmentedView;
use crate::error::ModelError;
use crate::features::Features;
use crate::situation::Situation;

/// Where a predictor takes its neighbours' future from while the target is driven into its own: from
/// the past alone. The recorded future is no choice here, because a [`Predictor`](gnp_data::Predictor)
/// is never handed one; it is an input of [`Gnp::oracle`](crate::Gnp::oracle).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NeighbourFuture {
    /// Each goes on with its last observed velocity.
    ConstantVelocity,
    /// Each follows the column ahead of it, as the platoon that the model's reference path is made of.
    Platoon,
    /// Every vehicle of the carriageway is rolled out together towards its own likeliest goal.
    Joint,
}

/// The configuration key `predict.neighbours`: what a run takes for its neighbours' future in
/// training and evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NeighbourInput {
    /// [`NeighbourFuture::ConstantVelocity`].
    ConstantVelocity,
    /// [`NeighbourFuture::Platoon`]; needs `features.reference = "platoon"`.
    Platoon,
    /// [`NeighbourFuture::Joint`]; trained at constant velocity.
    Joint,
    /// Where they were recorded: an input that nobody has at prediction time. Reproduces the
    /// published evaluation: the repulsion is trained with it, and [`Gnp::oracle`](crate::Gnp::oracle)
    /// is scored beside the predictor. Every number made with it is marked.
    Oracle,
}

impl NeighbourInput {
    /// Name in tables and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ConstantVelocity => "constant_velocity",
            Self::Platoon => "platoon",
            Self::Joint => "joint",
            Self::Oracle => "oracle",
        }
    }

    /// What a predictor of this run uses: constant velocity where the run is given the future.
    #[must_use]
    pub fn without_future(self) -> NeighbourFuture {
        match self {
            Self::ConstantVelocity | Self::Oracle => NeighbourFuture::ConstantVelocity,
            Self::Platoon => NeighbourFuture::Platoon,
            Self::Joint => NeighbourFuture::Joint,
        }
    }

    /// Whether recorded futures are an input.
    #[must_use]
    pub fn uses_future(self) -> bool {
        self == Self::Oracle
    }
}

impl Features {
    /// The scene of each window with `goals` `[batch, k, 2]` (m, window frame). Neighbours follow
    /// the truth where `truths` are given (oracle), and otherwise what `neighbours` says; what is rolled out
    /// together beforehand ([`NeighbourFuture::Joint`]) counts as constant velocity here.
    ///
    /// Where the reference path is the platoon's, the scene is in a frame that moves with the target of that path along
    /// the road: [`Features::to_road`] leads back.
    ///
    /// # Errors
    /// [`ModelError::Shape`] when a window has another shape, [`ModelError::Config`] for neighbours behind leaders without
    /// a rule, candle's errors.
    pub fn scene(
        &self,
        situations: &[Situation<'_>],
        goals: Tensor,
        neighbours: NeighbourFuture,
        truths: Option<&[Truth<'_>]>,
        device: &Device,
    ) -> Result<RollOutBatch, ModelError> {
        if neighbours == NeighbourFuture::Platoon && self.platoon().is_none() {
            let problem = "is \"platoon\": that needs features.reference = \"platoon\", in training too";
            return Err(ModelError::config("predict.neighbours", problem));
        }
        let t_pred = self.shape().t_pred;
        let mut futures = vec![0f32; situations.len() * t_pred * SLOTS * 4];
        let settling: Vec<f64> = self.settling().collect();
        let of_window = futures.chunks_exact_mut(t_pred * SLOTS * 4);
        for (b, (situation, futures)) in situations.iter().zip(of_window).enumerate() {
            let truth = truths.map(|truths| &truths[b]);
            self.neighbour_futures(situation, neighbours, truth, &settling, futures);
        }
        let futures = Tensor::from_vec(futures, (situations.len(), t_pred, SLOTS, 4), device)?;
        self.scene_among(situations, goals, NeighbourStates::Given(futures), device)
    }

    /// The scene of each window with neighbours as given, in the frame of [`Features::scene`].
    ///
    /// # Errors
    /// As [`Features::scene`].
    pub fn scene_among(
        &self,
        situations: &[Situation<'_>],
        goals: Tensor,
        neighbours: NeighbourStates,
        device: &Device,
    ) -> Result<RollOutBatch, ModelError> {
        let shape = self.shape();
        let mut observed = Vec::with_capacity(situations.len() * shape.t_obs * 4);
        let mut mask = Vec::with_capacity(situations.len() * SLOTS);
        for situation in situations {
            let seen = &situation.seen;
            self.check_shape(seen.observation())?;
            self.observed_states(situation, &mut observed);
            mask.extend(Slot::ALL.map(|slot| if seen.neighbour(slot).is_some() { 1f32 } else { 0. }));
        }
        let b = situations.len();
        let (_, k, _) = goals.dims3()?;
        let shift: Vec<f32> = situations.iter().flat_map(|it| [it.frame(shape.t_pred)[0], 0.]).collect();
        let shift = Tensor::from_vec(shift, (b, 1, 2), device)?.broadcast_as((b, k, 2))?;
        Ok(RollOutBatch {
            observed: Tensor::from_vec(observed, (b, shape.t_obs, 4), device)?,
            goals: (goals - shift)?,
            neighbours: Some(Neighbours { states: neighbours, present: Tensor::from_vec(mask, (b, SLOTS), device)? }),
            lines: Some(lines(situations, device)?),
            dt: shape.dt(),
            steps: shape.t_pred,
        })
    }

    /// [`lateral`] of 1 m/s as each step sets out.
    pub(crate) fn settling(&self) -> impl Iterator<Item = f64> {
        (0..self.shape().t_pred).map(|j| lateral(1., j as f64 * self.shape().dt()))
    }

    /// The neighbours of one window in the frame of [`Features::scene`], into `futures` `[t_pred, SLOTS, 4]`, which stay as
    /// they are where nobody is.
    pub(crate) fn neighbour_futures(
        &self,
        situation: &Situation<'_>,
        neighbours: NeighbourFuture,
        truth: Option<&Truth<'_>>,
        settling: &[f64],
        futures: &mut [f32],
    ) {
        let seen = &situation.seen;
        for slot in Slot::ALL {
            let mut put = |j: usize, s: [f32; 4]| {
                let [x, vx] = situation.frame(j);
                let at = (j * SLOTS + slot.index()) * 4;
                futures[at..at + 4].copy_from_slice(&[s[0] - x, s[1], s[2] - vx, s[3]]);
            };
            match truth {
                Some(truth) => self.recorded_future(seen, truth, slot, put),
                None if neighbours == NeighbourFuture::Platoon => {
                    let window = self.config().velocity_window_s;
                    for (j, s) in situation.following_neighbour(slot, settling, window).enumerate() {
                        put(j, [s.x, s.y, s.vx, s.vy]);
                    }
                }
                None => self.straight_future(seen, slot, put),
            }
        }
    }

    /// Appends the observed states of the target in the frame of [`Features::scene`], `[t_obs, 4]`.
    pub(crate) fn observed_states(&self, situation: &Situation<'_>, observed: &mut Vec<f32>) {
        let shape = self.shape();
        let [_, speed] = situation.frame(0);
        for i in 0..shape.t_obs {
            // Before it sets out the frame has the speed that it sets out with.
            let ago = (shape.t_obs - 1 - i) as f32 * shape.dt() as f32;
            let state = situation.seen.target(i);
            observed.extend([state.x + speed * ago, state.y, state.vx - speed, state.vy]);
        }
        // The roll-out starts from this velocity: one frame's difference would be noise.
        let [vx, vy] = situation.velocity;
        let end = observed.len();
        observed[end - 2..].copy_from_slice(&[vx - speed, vy]);
    }

    /// Adds the way of the moving frame to paths `[batch, k, steps, 2]` that were rolled out in it, m, window frame.
    ///
    /// # Errors
    /// Those of candle.
    pub fn to_road(&self, situations: &[Situation<'_>], path: &Tensor) -> Result<Tensor, ModelError> {
        if situations.iter().all(|it| it.platoon.is_none()) {
            return Ok(path.clone());
        }
        let steps = self.shape().t_pred;
        let way: Vec<f32> =
            situations.iter().flat_map(|it| (1..=steps).flat_map(|step| [it.frame(step)[0], 0.])).collect();
        Ok(path.broadcast_add(&Tensor::from_vec(way, (situations.len(), 1, steps, 2), path.device())?)?)
    }

    /// States of the neighbour in `slot` at constant velocity; entry `j` is where it is when step `j`
    /// sets out, so entry 0 is the last observed frame.
    fn straight_future(&self, seen: &AugmentedView<'_>, slot: Slot, mut put: impl FnMut(usize, [f32; 4])) {
        let Some(neighbour) = seen.neighbour(slot) else { return };
        let now = neighbour.now(self.config().velocity_window_s);
        for j in 0..self.shape().t_pred {
            let t = j as f32 * self.shape().dt() as f32;
            put(j, [now.x + now.vx * t, now.y + now.vy * t, now.vx, now.vy]);
        }
    }

    /// Recorded states of the neighbour in `slot`; at constant velocity from where its record ends.
    fn recorded_future(
        &self,
        seen: &AugmentedView<'_>,
        truth: &Truth<'_>,
        slot: Slot,
        mut put: impl FnMut(usize, [f32; 4]),
    ) {
        let Some(neighbour) = seen.neighbour(slot) else { return };
        let mut last = neighbour.now(self.config().velocity_window_s);
        let dt = self.shape().dt() as f32;
        for j in 0..self.shape().t_pred {
            put(j, [last.x, last.y, last.vx, last.vy]);
            last = match seen.true_neighbour(truth, slot, j) {
                Some(state) => state,
                None => gnp_data::TrackState { x: last.x + last.vx * dt, y: last.y + last.vy * dt, ..last },
            };
        }
    }
}

/// The lane lines of a window as [`Lines`] has them, from right to left.
pub(crate) fn line_values(seen: &AugmentedView<'_>) -> impl Iterator<Item = [f32; 3]> {
    seen.lines().enumerate().map(|(m, line)| match line.kind {
        MarkingKind::LaneDivider => [line.y, 0., 0.],
        // The rightmost line has the road to its left.
        MarkingKind::Boundary => [line.y, 1., if m == 0 { 1. } else { -1. }],
    })
}

/// Lane lines, padded to the most that any window has.
fn lines(situations: &[Situation<'_>], device: &Device) -> Result<Lines, ModelError> {
    let b = situations.len();
    let most = situations.iter().map(|it| it.seen.lines().count()).max().unwrap_or(0).max(1);
    let (mut lines, mut present) = (vec![0f32; b * most * 3], vec![0f32; b * most]);
    for (situation, (lines, present)) in
        situations.iter().zip(lines.chunks_exact_mut(most * 3).zip(present.chunks_exact_mut(most)))
    {
        for ((line, to), present) in line_values(&situation.seen).zip(lines.chunks_exact_mut(3)).zip(present) {
            to.copy_from_slice(&line);
            *present = 1.;
        }
    }
    Ok(Lines {
        lines: Tensor::from_vec(lines, (b, most, 3), device)?,
        present: Tensor::from_vec(present, (b, most), device)?,
    })
}
