//! STDAN's intention: what the driver is about to do, and which past matters for it.

use candle_core::{D, DType, Result, Tensor};
use candle_nn::{Init, Module, VarBuilder};
use gnp_nn::{LayerNorm, Linear, layer_norm, linear};

use super::{MANOEUVRES, StdanSizes};

/// Guesses the manoeuvre from the code of the last step.
#[derive(Debug)]
pub(super) struct Intention {
    wide: Linear,
    narrow: Linear,
    norm: LayerNorm,
    lateral: Linear,
    longitudinal: Linear,
}

impl Intention {
    pub(super) fn new(sizes: StdanSizes, vb: VarBuilder) -> Result<Self> {
        let wide = sizes.heads * sizes.head;
        Ok(Self {
            wide: linear(sizes.hidden, wide, vb.pp("wide"))?,
            narrow: linear(wide, sizes.hidden, vb.pp("narrow"))?,
            norm: layer_norm(sizes.hidden, vb.pp("norm"))?,
            lateral: linear(sizes.hidden, MANOEUVRES, vb.pp("lateral"))?,
            longitudinal: linear(sizes.hidden, MANOEUVRES, vb.pp("longitudinal"))?,
        })
    }

    /// Logits of the lateral and of the longitudinal manoeuvres, each `[batch, 3]`, from the code of
    /// the last step, `[batch, hidden]`.
    pub(super) fn forward(&self, last: &Tensor) -> Result<[Tensor; 2]> {
        let x = self.wide.forward(last)?.elu(1.)?;
        let x = self.norm.forward(&self.narrow.forward(&x)?)?.elu(1.)?;
        Ok([self.lateral.forward(&x)?, self.longitudinal.forward(&x)?])
    }
}

/// Which steps of the past each step of the future is made of, by intention.
#[derive(Debug)]
pub(super) struct Fusion {
    /// `[past, future, 6]`
    weight: Tensor,
}

impl Fusion {
    pub(super) fn new(sizes: StdanSizes, vb: VarBuilder) -> Result<Self> {
        // The released code's: Glorot with a gain of 1.414, where the last two dimensions but the
        // first count as a kernel.
        let fans = (sizes.past + sizes.future) * 2 * MANOEUVRES;
        let bound = 1.414 * (6. / fans as f64).sqrt();
        let init = Init::Uniform { lo: -bound, up: bound };
        Ok(Self { weight: vb.get_with_hints((sizes.past, sizes.future, 2 * MANOEUVRES), "weight", init)? })
    }

    /// `[future, batch, hidden]`: convex mixtures of the codes of the past `[past, batch, hidden]`,
    /// under the likeliest manoeuvre of each kind, by their logits.
    pub(super) fn forward(&self, codes: &Tensor, logits: &[Tensor; 2]) -> Result<Tensor> {
        let (past, future, classes) = self.weight.dims3()?;
        let batch = codes.dim(1)?;
        let chosen = |logits: &Tensor| {
            let best = logits.argmax_keepdim(D::Minus1)?;
            let each = Tensor::arange(0u32, MANOEUVRES as u32, logits.device())?;
            best.broadcast_eq(&each.reshape((1, MANOEUVRES))?)?.to_dtype(DType::F32)
        };
        let manoeuvre = Tensor::cat(&[chosen(&logits[0])?, chosen(&logits[1])?], 1)?;
        let scores = manoeuvre.matmul(&self.weight.reshape((past * future, classes))?.t()?)?;
        let scores = scores.reshape((batch, past, future))?.transpose(1, 2)?.contiguous()?;
        let shares = candle_nn::ops::softmax(&scores, D::Minus1)?;
        shares.matmul(&codes.transpose(0, 1)?.contiguous()?)?.transpose(0, 1)
    }
}
