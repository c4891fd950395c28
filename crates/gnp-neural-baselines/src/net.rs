//! A network of any kind together with what brings windows to it.

use candle_core::{Device, Error, Result, Tensor};
use candle_nn::VarBuilder;
use gnp_baselines::PlatoonRule;
use gnp_data::{TrackState, Truth};
use tracing::debug;

use crate::cslstm::CsLstm;
use crate::inputs::{Inputs, Past};
use crate::kind::NeuralBaseline;
use crate::network::{Ask, Network, Output};
use crate::oriented_view::{OrientedView, Variation};
use crate::pip::{Pip, Plan, Scenes};
use crate::recipe::Recipe;
use crate::slstm::SLstm;
use crate::stdan::{Stdan, StdanSizes};

/// A network by kind.
#[derive(Debug)]
pub(crate) struct Net {
    pub(crate) inputs: Inputs,
    body: Body,
    /// Whose path the network's points are counted from; `None` for the last observed position, as published.
    reference: Option<PlatoonRule>,
    device: Device,
}

#[derive(Debug)]
enum Body {
    /// On the grid by lane; with class, speed and acceleration or without.
    Lanes(Box<dyn Network<Past>>, bool),
    /// PiP, with the source of its plan and the number of targets that it fuses.
    Places(Box<Pip>, Plan, usize),
}

impl Net {
    /// The network of `kind` on the weights behind `vb`.
    pub(crate) fn new(
        kind: NeuralBaseline,
        recipe: &Recipe,
        reference: Option<PlatoonRule>,
        inputs: Inputs,
        vb: &VarBuilder,
    ) -> Result<Self> {
        let points = inputs.clock.future();
        let body = match kind {
            NeuralBaseline::SLstm => Body::Lanes(Box::new(SLstm::new(points, vb)?), false),
            NeuralBaseline::CsLstm => Body::Lanes(Box::new(CsLstm::new(points, false, vb)?), false),
            NeuralBaseline::CsLstmM => Body::Lanes(Box::new(CsLstm::new(points, true, vb)?), false),
            NeuralBaseline::PipInformed | NeuralBaseline::PipSurrogate | NeuralBaseline::PipNoPlan => {
                let plan = match kind {
                    NeuralBaseline::PipInformed => Plan::Recorded,
                    NeuralBaseline::PipSurrogate => Plan::Constant,
                    _ => Plan::None,
                };
                let pip = Pip::new(points, plan != Plan::None, recipe.fused_targets > 0, vb)?;
                Body::Places(Box::new(pip), plan, recipe.fused_targets)
            }
            NeuralBaseline::Stdan | NeuralBaseline::StdanMasked => {
                let sizes = StdanSizes::published(inputs.clock.past(), points);
                let masked = kind == NeuralBaseline::StdanMasked;
                Body::Lanes(Box::new(Stdan::new(sizes, masked, vb)?), true)
            }
        };
        Ok(Self { inputs, body, reference, device: vb.device().clone() })
    }

    /// The futures of `windows`; `truths` for the kind that is handed them, and for no other.
    pub(crate) fn forward(
        &self,
        windows: &[OrientedView<'_>],
        truths: Option<&[Truth<'_>]>,
        ask: Ask<'_>,
    ) -> Result<Output> {
        let mut output = self.decoded(windows, truths, ask)?;
        output.reference = self.reference_points(windows)?;
        if let Some(reference) = &output.reference {
            output.gaussians.mean = output.gaussians.mean.broadcast_add(&reference.unsqueeze(1)?)?;
        }
        Ok(output)
    }

    /// Where the reference path of each window is, in the networks' unit and axes, `[windows, points, 2]`; `None` for a
    /// network that has no reference.
    fn reference_points(&self, windows: &[OrientedView<'_>]) -> Result<Option<Tensor>> {
        let Some(rule) = &self.reference else { return Ok(None) };
        let points = self.inputs.clock.future();
        let mut values = Vec::with_capacity(windows.len() * points * 2);
        for seen in windows {
            // The rule stretches traffic itself, since gaps between vehicles that keep their sizes are no multiple.
            let side = Variation { along: 1., ..seen.variation };
            let path = rule.path(&seen.observation, f64::from(seen.variation.along)).map_err(Error::wrap)?;
            for k in 0..points {
                let [x, y] = path.get(self.inputs.clock.predicted_frame(k)).copied().unwrap_or_default();
                values.extend(self.inputs.point(side.turn(TrackState { x, y, ..TrackState::default() })));
            }
        }
        Tensor::from_vec(values, (windows.len(), points, 2), &self.device).map(Some)
    }

    fn decoded(&self, windows: &[OrientedView<'_>], truths: Option<&[Truth<'_>]>, ask: Ask<'_>) -> Result<Output> {
        match &self.body {
            Body::Lanes(network, features) => {
                let past = self.inputs.past(windows, *features, &self.device)?;
                if past.collisions > 0 {
                    debug!(windows = windows.len(), vehicles = past.collisions, "left out behind a nearer one");
                }
                network.forward(&past, ask)
            }
            Body::Places(pip, plan, targets) => {
                let scenes = Scenes::new(&self.inputs, windows, *plan, truths, *targets, &self.device)?;
                if scenes.without_ego > 0 {
                    debug!(windows = scenes.windows, without_ego = scenes.without_ego, "nobody is near enough to plan");
                }
                pip.forward(&scenes, ask)
            }
        }
    }

    /// Plans of constant velocity from now on, for a network that takes plans.
    pub(crate) fn plan_constant_velocity(&mut self) {
        if let Body::Places(_, plan @ Plan::Recorded, _) = &mut self.body {
            *plan = Plan::Constant;
        }
    }

    pub(crate) fn device(&self) -> &Device {
        &self.device
    }
}
