//! Multi-head attention with separate query, key, value and output maps.

use candle_core::{D, Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::linear;

/// Multi-head attention; `width` is a multiple of `heads`.
#[derive(Clone, Debug)]
pub(crate) struct Attention {
    pub(crate) query: Linear,
    pub(crate) key: Linear,
    pub(crate) value: Linear,
    pub(crate) output: Linear,
    pub(crate) heads: usize,
}

impl Attention {
    /// Named `q`, `k`, `v` and `o` under `vb`.
    pub(crate) fn new(width: usize, heads: usize, vb: VarBuilder) -> Result<Self> {
        let map = |name| linear(width, width, vb.pp(name));
        Ok(Self { query: map("q")?, key: map("k")?, value: map("v")?, output: map("o")?, heads })
    }

    /// What each of `queries` `[batch, l, width]` gathers from `keys` `[batch, m, width]`, where
    /// `mask` `[batch, m]` is 1 where a key exists and 0 where it does not; all exist without one.
    ///
    /// A query without any key gathers zeros: the result is then the output map's bias.
    pub(crate) fn forward(&self, queries: &Tensor, keys: &Tensor, mask: Option<&Tensor>) -> Result<Tensor> {
        let (batch, l, width) = queries.dims3()?;
        let head = width / self.heads;
        let split = |x: Tensor| x.reshape((batch, (), self.heads, head))?.transpose(1, 2)?.contiguous();
        let query = (split(self.query.forward(queries)?)? * (1. / (head as f64).sqrt()))?;
        let key = split(self.key.forward(keys)?)?;
        let value = split(self.value.forward(keys)?)?;
        let scores = query.matmul(&key.t()?)?;
        let weights = match mask {
            None => candle_nn::ops::softmax(&scores, D::Minus1)?,
            Some(mask) => {
                let mask = mask.reshape((batch, 1, 1, ()))?;
                let absent = ((&mask - 1.)? * 1e9)?;
                // The second factor is for a row without any key, which softmax would share out.
                candle_nn::ops::softmax(&scores.broadcast_add(&absent)?, D::Minus1)?.broadcast_mul(&mask)?
            }
        };
        self.output.forward(&weights.matmul(&value)?.transpose(1, 2)?.reshape((batch, l, width))?)
    }
}
