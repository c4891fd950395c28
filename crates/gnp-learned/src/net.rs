//! A network of any kind together with what brings windows to it.

use candle_core::{Device, Result};
use candle_nn::VarBuilder;
use gnp_data::{Observation, Truth};

use crate::cslstm::CsLstm;
use crate::inputs::{Inputs, Past};
use crate::kind::LearnedKind;
use crate::network::{Ask, Network, Output};
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
}

impl Net {
    /// The network of `kind` on the weights behind `vb`.
    pub(crate) fn new(kind: LearnedKind, recipe: &Recipe, inputs: Inputs, vb: &VarBuilder) -> Result<Self> {
        let points = inputs.clock.future();
        let body = match kind {
            LearnedKind::SLstm => Body::Lanes(Box::new(SLstm::new(points, vb)?), false),
            LearnedKind::CsLstm => Body::Lanes(Box::new(CsLstm::new(points, false, vb)?), false),
            LearnedKind::CsLstmM => Body::Lanes(Box::new(CsLstm::new(points, true, vb)?), false),
            LearnedKind::Stdan | LearnedKind::StdanMasked => {
                let sizes = StdanSizes::published(inputs.clock.past(), points);
                let masked = kind == LearnedKind::StdanMasked;
                Body::Lanes(Box::new(Stdan::new(sizes, masked, vb)?), true)
            }
            other => candle_core::bail!("{} is not built yet ({:?})", other.name(), recipe),
        };
        Ok(Self { inputs, body, device: vb.device().clone() })
    }

    /// The futures of `observations`; `truths` for the kind that is handed them, and for no other.
    pub(crate) fn forward(
        &self,
        observations: &[Observation<'_>],
        _truths: Option<&[Truth<'_>]>,
        ask: Ask<'_>,
    ) -> Result<Output> {
        match &self.body {
            Body::Lanes(network, features) => {
                network.forward(&self.inputs.past(observations, *features, &self.device)?, ask)
            }
        }
    }

    pub(crate) fn device(&self) -> &Device {
        &self.device
    }
}
