//! STDAN: attention over the vehicles around and over time, and a guess of the intention.

mod attention;
mod intention;
#[cfg(test)]
mod tests;

use candle_core::{D, DType, Result, Tensor};
use candle_nn::{Module, VarBuilder};
use gnp_nn::{LayerNorm, Linear, Lstm, layer_norm, linear};

use crate::gauss::Gaussians;
use crate::grid::LANE_CELLS;
use crate::inputs::Past;
use crate::network::{Ask, Classes, Network, Output};
use crate::stdan::attention::{Crowd, Gate, Social, Temporal};
use crate::stdan::intention::{Fusion, Intention};

/// Manoeuvres of each kind: keep, left, right; normal, brake, accelerate.
const MANOEUVRES: usize = 3;

/// Values a point: x, y, class, speed, acceleration.
const FEATURES: usize = 5;

/// How large the network is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StdanSizes {
    /// Points of the past.
    pub(crate) past: usize,
    /// Points of the future.
    pub(crate) future: usize,
    /// Cells of the grid.
    pub(crate) cells: usize,
    /// Values a point is embedded in.
    pub(crate) embedding: usize,
    /// Units of both LSTMs.
    pub(crate) hidden: usize,
    /// Heads of both attentions.
    pub(crate) heads: usize,
    /// Values a head.
    pub(crate) head: usize,
}

impl StdanSizes {
    /// The published sizes, for `past` and `future` points (16 and 25 as published: 215,595 weights).
    pub(crate) fn published(past: usize, future: usize) -> Self {
        Self { past, future, cells: LANE_CELLS, embedding: 32, hidden: 64, heads: 4, head: 48 }
    }
}

/// The network of Chen et al. 2022, as their code is configured when released: one future, under
/// the likeliest intention, with no dropout.
///
/// The released code also holds 8,336 weights that it never uses; they are left out. Its social
/// attention looks at all cells of the grid, also where nobody stands. Masked, it looks at vehicles
/// only, and at nothing where there are none.
///
/// Its decoder tells positions by 64 states between -1 and 1 and a linear map of them, so that the end of
/// a fast vehicle's path needs the largest weights and is learned last. Trained for too few steps or at
/// too low a rate, it follows the truth up to 4 s and then falls behind, on the windows that it learns
/// from as well: on US-101 by 4.3 m at 5 s after 14 epochs at a rate of 1e-3, by 2.0 m at 3e-3. That is
/// a matter of the recipe, not of the points, which end at the last predicted frame.
#[derive(Debug)]
pub(crate) struct Stdan {
    sizes: StdanSizes,
    masked: bool,
    embedding: Linear,
    encoder: Lstm,
    social: Social,
    social_gate: Gate,
    temporal: Temporal,
    temporal_gate: Gate,
    /// After either attention: the released code has one for both.
    norm: LayerNorm,
    intention: Intention,
    fusion: Fusion,
    input: Linear,
    decoder: Lstm,
    head: Linear,
}

/// What the network says of a batch.
#[derive(Debug)]
struct Said {
    /// Five numbers a future point for the Gaussian head, `[batch, future, 5]`.
    raw: Tensor,
    /// Probabilities of the manoeuvres.
    classes: Classes,
}

impl Stdan {
    /// A network of `sizes`; `masked`, it does not look at empty cells.
    pub(crate) fn new(sizes: StdanSizes, masked: bool, vb: &VarBuilder) -> Result<Self> {
        let (hidden, wide) = (sizes.hidden, sizes.heads * sizes.head);
        Ok(Self {
            sizes,
            masked,
            embedding: linear(FEATURES, sizes.embedding, vb.pp("embedding"))?,
            encoder: Lstm::new(sizes.embedding, hidden, vb.pp("encoder"))?,
            social: Social::new(sizes, masked, vb.pp("social"))?,
            social_gate: Gate::new(wide, hidden, vb.pp("social_gate"))?,
            temporal: Temporal::new(sizes, vb.pp("temporal"))?,
            temporal_gate: Gate::new(wide, hidden, vb.pp("temporal_gate"))?,
            norm: layer_norm(hidden, vb.pp("norm"))?,
            intention: Intention::new(sizes, vb.pp("intention"))?,
            fusion: Fusion::new(sizes, vb.pp("fusion"))?,
            input: linear(hidden + 2 * MANOEUVRES, hidden, vb.pp("input"))?,
            decoder: Lstm::new(hidden, hidden, vb.pp("decoder"))?,
            head: linear(hidden, 5, vb.pp("head"))?,
        })
    }

    /// From the pasts of the targets and, after them, of their neighbours, `[past, batch + neighbours,
    /// features]`; neighbours stand in the cells `cells * window + cell` of `index`.
    fn say(&self, paths: &Tensor, index: &[u32]) -> Result<Said> {
        let (past, future) = (self.sizes.past, self.sizes.future);
        let batch = paths.dim(1)? - index.len();
        let crowd = Crowd::new(index, batch, self.sizes.cells, self.masked);
        let codes = self.encoder.states(&self.embedding.forward(paths)?.elu(1.)?)?;
        let own = codes.narrow(1, 0, batch)?.contiguous()?;
        let others = codes.narrow(1, batch, index.len())?;

        let seen = self.social_gate.forward(&self.social.forward(&own, &others, &crowd)?)?;
        let met = self.norm.forward(&(&own + seen)?)?;
        let remembered = self.temporal_gate.forward(&self.temporal.forward(&met)?)?;
        let codes = self.norm.forward(&(&own + remembered)?)?;

        let logits = self.intention.forward(&codes.get(past - 1)?)?;
        let mixed = self.fusion.forward(&codes, &logits)?;
        let classes = probabilities(&logits)?;
        let intended = Tensor::cat(&[&classes.lateral, &classes.longitudinal], 1)?.unsqueeze(0)?;
        let intended = intended.broadcast_as((future, batch, 2 * MANOEUVRES))?;
        let joined = Tensor::cat(&[&mixed, &intended], 2)?;
        // It lies transposed, which products on a GPU do not take.
        let joined = if joined.device().is_cpu() { joined } else { joined.contiguous()? };
        let input = self.input.forward(&joined)?;
        let raw = self.head.forward(&self.decoder.states(&input)?)?.transpose(0, 1)?.contiguous()?;
        Ok(Said { raw, classes })
    }
}

fn probabilities([lateral, longitudinal]: &[Tensor; 2]) -> Result<Classes> {
    let softmax = |logits: &Tensor| candle_nn::ops::softmax(logits, D::Minus1);
    Ok(Classes { lateral: softmax(lateral)?, longitudinal: softmax(longitudinal)? })
}

impl Network<Past> for Stdan {
    /// The same in training and prediction: true manoeuvres never enter.
    fn forward(&self, past: &Past, _: Ask<'_>) -> Result<Output> {
        let Some([target_features, neighbour_features]) = &past.features else {
            candle_core::bail!("STDAN reads class, speed and acceleration, which this past lacks");
        };
        let targets = Tensor::cat(&[&past.history, target_features], 2)?;
        let paths = if past.cells.is_empty() {
            targets
        } else {
            let neighbours = Tensor::cat(&[&past.neighbours, neighbour_features], 2)?;
            Tensor::cat(&[targets, neighbours], 1)?
        };
        let Said { raw, classes } = self.say(&paths, &past.cells)?;
        let windows = past.windows()?;
        Ok(Output {
            gaussians: Gaussians::from_head(&raw)?.reshape(&[windows, 1, self.sizes.future])?,
            log_probability: Tensor::zeros((windows, 1), DType::F32, raw.device())?,
            classes: Some(classes),
            reference: None,
        })
    }
}
