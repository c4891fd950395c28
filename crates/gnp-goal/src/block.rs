//! One layer of the transformer.

use candle_core::{Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::{Dropout, DropoutMask, LayerNorm, layer_norm, linear};

use crate::attention::Attention;

/// A post-norm transformer layer: attention, then feed-forward with ReLU, each added to what came
/// in and normalised.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    attention: Attention,
    norm1: LayerNorm,
    norm2: LayerNorm,
    hidden: Linear,
    output: Linear,
}

/// Masks of a block: for what attention gives, and for what feed-forward gives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockMasks {
    pub(crate) attention: DropoutMask,
    pub(crate) feed_forward: DropoutMask,
}

impl BlockMasks {
    /// Masks that keep everything as it is.
    pub(crate) const NONE: Self = Self { attention: DropoutMask::NONE, feed_forward: DropoutMask::NONE };

    /// The next two masks of a training step, none for inference.
    pub(crate) fn draw(dropout: Option<&mut Dropout>) -> Self {
        match dropout {
            Some(dropout) => Self { attention: dropout.draw(), feed_forward: dropout.draw() },
            None => Self::NONE,
        }
    }
}

impl Block {
    /// Named `attn`, `n1`, `n2`, `f1` and `f2` under `vb`.
    pub(crate) fn new(width: usize, heads: usize, feed_forward: usize, vb: VarBuilder) -> Result<Self> {
        Ok(Self {
            attention: Attention::new(width, heads, vb.pp("attn"))?,
            norm1: layer_norm(width, vb.pp("n1"))?,
            norm2: layer_norm(width, vb.pp("n2"))?,
            hidden: linear(width, feed_forward * width, vb.pp("f1"))?,
            output: linear(feed_forward * width, width, vb.pp("f2"))?,
        })
    }

    /// `x` `[batch, l, width]` attends to `keys` `[batch, m, width]` where `mask` `[batch, m]` is not
    /// 0 (see [`Attention::forward`]), or to all of itself.
    pub(crate) fn graph(&self, x: &Tensor, keys: Option<(&Tensor, &Tensor)>, masks: BlockMasks) -> Result<Tensor> {
        let (keys, mask) = keys.map_or((x, None), |(keys, mask)| (keys, Some(mask)));
        let gathered = masks.attention.apply(&self.attention.forward(x, keys, mask)?)?;
        let x = self.norm1.forward(&(x + gathered)?)?;
        let y = masks.feed_forward.apply(&self.output.forward(&self.hidden.forward(&x)?.relu()?)?)?;
        self.norm2.forward(&(x + y)?)
    }

    /// All weights in the order of the fused operation.
    pub(crate) fn weights(&self) -> Result<[&Tensor; 16]> {
        let Attention { query, key, value, output, .. } = &self.attention;
        let maps = [query, key, value, output, &self.hidden, &self.output];
        let [bq, bk, bv, bo, bu, bd] = maps.map(Linear::bias);
        let (Some(bq), Some(bk), Some(bv), Some(bo), Some(bu), Some(bd)) = (bq, bk, bv, bo, bu, bd) else {
            candle_core::bail!("a block's maps have biases");
        };
        let [q, k, v, o, u, d] = maps.map(Linear::weight);
        let ((w1, b1), (w2, b2)) = (self.norm1.affine(), self.norm2.affine());
        Ok([q, k, v, bq, bk, bv, o, bo, w1, b1, u, bu, d, bd, w2, b2])
    }
}
