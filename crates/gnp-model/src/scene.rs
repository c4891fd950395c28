//! Windows to the scene that the neural social force drives through.

use candle_core::{Device, Tensor};
use gnp_data::{MarkingKind, SLOTS, Slot, Truth};
use gnp_traj::{Lines, NeighbourStates, Neighbours, RollOutBatch};
use serde::{Deserialize, Serialize};

use crate::augmented_view::AugmentedView;
use crate::error::ModelError;
use crate::features::Features;

/// Where a predictor takes its neighbours' future from while the target is driven into its own: from
/// the past alone. The recorded future is no choice here, because a [`Predictor`](gnp_data::Predictor)
/// is never handed one; it is an input of [`Gnp::oracle`](crate::Gnp::oracle).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NeighbourFuture {
    /// Each goes on with its last observed velocity.
    ConstantVelocity,
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
            Self::Joint => "joint",
            Self::Oracle => "oracle",
        }
    }

    /// What a predictor of this run uses: constant velocity where the run is given the future.
    #[must_use]
    pub fn without_future(self) -> NeighbourFuture {
        match self {
            Self::ConstantVelocity | Self::Oracle => NeighbourFuture::ConstantVelocity,
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
    /// the truth where `truths` are given (oracle), constant velocity otherwise.
    ///
    /// # Errors
    /// [`ModelError::Shape`] when a window has another shape, candle's errors.
    pub fn scene(
        &self,
        seen: &[AugmentedView<'_>],
        goals: Tensor,
        truths: Option<&[Truth<'_>]>,
        device: &Device,
    ) -> Result<RollOutBatch, ModelError> {
        let t_pred = self.shape().t_pred;
        let mut futures = vec![0f32; seen.len() * t_pred * SLOTS * 4];
        for (b, seen) in seen.iter().enumerate() {
            for slot in Slot::ALL {
                let place = |j: usize| ((b * t_pred + j) * SLOTS + slot.index()) * 4;
                match truths {
                    Some(truths) => self.recorded_future(seen, &truths[b], slot, |j, s| {
                        futures[place(j)..place(j) + 4].copy_from_slice(&s);
                    }),
                    None => self.straight_future(seen, slot, |j, s| {
                        futures[place(j)..place(j) + 4].copy_from_slice(&s);
                    }),
                }
            }
        }
        let futures = Tensor::from_vec(futures, (seen.len(), t_pred, SLOTS, 4), device)?;
        self.scene_among(seen, goals, NeighbourStates::Given(futures), device)
    }

    /// The scene of each window with neighbours as given.
    ///
    /// # Errors
    /// As [`Features::scene`].
    pub fn scene_among(
        &self,
        seen: &[AugmentedView<'_>],
        goals: Tensor,
        neighbours: NeighbourStates,
        device: &Device,
    ) -> Result<RollOutBatch, ModelError> {
        let shape = self.shape();
        let window = self.config().velocity_window_s;
        let mut observed = Vec::with_capacity(seen.len() * shape.t_obs * 4);
        let mut mask = Vec::with_capacity(seen.len() * SLOTS);
        for seen in seen {
            self.check_shape(seen.observation())?;
            for i in 0..shape.t_obs {
                let state = seen.target(i);
                observed.extend([state.x, state.y, state.vx, state.vy]);
            }
            // The roll-out starts from this velocity: one frame's difference would be noise.
            let velocity = seen.velocity(window);
            let end = observed.len();
            observed[end - 2..].copy_from_slice(&velocity);
            mask.extend(Slot::ALL.map(|slot| if seen.neighbour(slot).is_some() { 1f32 } else { 0. }));
        }
        let b = seen.len();
        Ok(RollOutBatch {
            observed: Tensor::from_vec(observed, (b, shape.t_obs, 4), device)?,
            goals,
            neighbours: Some(Neighbours { states: neighbours, present: Tensor::from_vec(mask, (b, SLOTS), device)? }),
            lines: Some(lines(seen, device)?),
            dt: shape.dt(),
            steps: shape.t_pred,
        })
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

/// Lane lines, padded to the most that any window has.
fn lines(seen: &[AugmentedView<'_>], device: &Device) -> Result<Lines, ModelError> {
    let all: Vec<_> = seen.iter().map(AugmentedView::lines).collect();
    let most = all.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let (mut lines, mut present) = (vec![0f32; seen.len() * most * 3], vec![0f32; seen.len() * most]);
    for (b, window) in all.iter().enumerate() {
        for (m, line) in window.iter().enumerate() {
            let at = b * most + m;
            present[at] = 1.;
            let (kind, side) = match line.kind {
                MarkingKind::LaneDivider => (0., 0.),
                // The rightmost line has the road to its left.
                MarkingKind::Boundary => (1., if m == 0 { 1. } else { -1. }),
            };
            lines[3 * at..3 * at + 3].copy_from_slice(&[line.y, kind, side]);
        }
    }
    let b = seen.len();
    Ok(Lines {
        lines: Tensor::from_vec(lines, (b, most, 3), device)?,
        present: Tensor::from_vec(present, (b, most), device)?,
    })
}
