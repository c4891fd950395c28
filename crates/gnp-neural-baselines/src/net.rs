//! A network of any kind together with what brings windows to it.

use candle_core::{Device, Result};
use candle_nn::VarBuilder;
use gnp_data::Truth;
use tracing::debug;

use crate::cslstm::CsLstm;
use crate::inputs::{Inputs, Past};
use crate::kind::NeuralBaseline;
use crate::network::{Ask, Network, Output};
use crate::oriented_view::OrientedView;
use crate::pip::{Pip, Plan, Scenes};
use crate::recipe::Recipe;
use crate::slstm::SLstm;
use crate::stdan::{Stdan, StdanSizes};

/// A network by kind.
#[derive(Debug)]
pub(crate) struct Net {
    pub(crate) inputs: Inputs,
    body: Body,
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
    pub(crate) fn new(kind: NeuralBaseline, recipe: &Recipe, inputs: Inputs, vb: &VarBuilder) -> Result<Self> {
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
        Ok(Self { inputs, body, device: vb.device().clone() })
    }

    /// The futures of `windows`; `truths` for the kind that is handed them, and for no other.
    pub(crate) fn forward(
        &self,
        windows: &[OrientedView<'_>],
        truths: Option<&[Truth<'_>]>,
        ask: Ask<'_>,
    ) -> Result<Output> {
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
