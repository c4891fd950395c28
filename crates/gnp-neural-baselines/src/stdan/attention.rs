//! STDAN's attention over the vehicles around, then over time.

use candle_core::{D, Result, Tensor};
use candle_nn::{Module, VarBuilder};
use gnp_nn::{Linear, linear};

use super::StdanSizes;

/// Who stands around each window, packed: as many places a window as the fullest one needs, and
/// one more that stands for all empty cells of its grid.
#[derive(Debug)]
pub(super) struct Crowd {
    /// `[batch * places]`: row of the neighbour in each place, `neighbours` for an empty one.
    rows: Vec<u32>,
    /// `[batch * places]`: added to the scores; logarithm of how many cells a place stands for.
    weights: Vec<f32>,
    places: usize,
    /// Whether there is anybody at all, `[batch]`.
    met: Vec<bool>,
}

impl Crowd {
    /// From the cells `cells * window + cell` of the neighbours in a batch of `windows`. Masked,
    /// empty cells stand for nothing.
    pub(super) fn new(index: &[u32], windows: usize, cells: usize, masked: bool) -> Self {
        let mut around: Vec<Vec<(u32, u32)>> = vec![Vec::new(); windows];
        for (row, cell) in index.iter().enumerate() {
            if let Some(window) = around.get_mut(*cell as usize / cells) {
                window.push((*cell, row as u32));
            }
        }
        let places = around.iter().map(Vec::len).max().unwrap_or(0) + 1;
        let nobody = index.len() as u32;
        let (mut rows, mut weights) = (vec![nobody; windows * places], vec![f32::NEG_INFINITY; windows * places]);
        let mut met = Vec::with_capacity(windows);
        for (window, mut around) in around.into_iter().enumerate() {
            // In the order of the cells, so that the order of the list does not reach a sum.
            around.sort_unstable();
            for (place, (_, row)) in around.iter().enumerate() {
                rows[window * places + place] = *row;
                weights[window * places + place] = 0.;
            }
            let empty = cells.saturating_sub(around.len());
            let counts = if masked { around.is_empty() } else { empty > 0 };
            if counts {
                weights[(window + 1) * places - 1] = if masked { 0. } else { (empty as f32).ln() };
            }
            met.push(!around.is_empty());
        }
        Self { rows, weights, places, met }
    }
}

/// Each step of the target looks at the same step of everybody in its grid.
#[derive(Debug)]
pub(super) struct Social {
    query: Linear,
    key: Linear,
    value: Linear,
    heads: usize,
    scale: f64,
    masked: bool,
}

impl Social {
    pub(super) fn new(sizes: StdanSizes, masked: bool, vb: VarBuilder) -> Result<Self> {
        let wide = sizes.heads * sizes.head;
        let layer = |name: &str| linear(sizes.hidden, wide, vb.pp(name));
        Ok(Self {
            query: layer("query")?,
            key: layer("key")?,
            value: layer("value")?,
            heads: sizes.heads,
            scale: (sizes.hidden as f64).sqrt().recip(),
            masked,
        })
    }

    /// What the targets `[past, batch, hidden]` see of their neighbours `[past, neighbours, hidden]`
    /// in the places of `crowd`: `[past, batch, heads * head]`.
    ///
    /// Keys and values are affine in the codes, and the weights of a softmax sum to 1. So the query
    /// goes through the keys' weights and the mean code through the values', once a window instead
    /// of once a cell: the same numbers as projecting every cell, the empty ones (a code of zeros)
    /// included.
    pub(super) fn forward(&self, targets: &Tensor, neighbours: &Tensor, crowd: &Crowd) -> Result<Tensor> {
        let (past, batch, hidden) = targets.dims3()?;
        let (device, steps) = (targets.device(), past * batch);
        let by_head = |x: &Tensor| x.reshape((steps, self.heads, ()))?.transpose(0, 1)?.contiguous();
        let per_head = |layer: &Linear| layer.weight().reshape((self.heads, (), hidden));

        let nobody = Tensor::zeros((past, 1, hidden), targets.dtype(), device)?;
        let rows = Tensor::from_slice(&crowd.rows, batch * crowd.places, device)?;
        let around = Tensor::cat(&[neighbours, &nobody], 1)?.index_select(&rows, 1)?;
        let around = around.reshape((steps, crowd.places, hidden))?;

        let query = self.query.forward(targets)?;
        let asked = by_head(&query)?.matmul(&per_head(&self.key)?)?.transpose(0, 1)?.contiguous()?;
        let scores = (asked.matmul(&around.t()?)?.broadcast_add(&self.alike(&query)?)? * self.scale)?;
        let counts = Tensor::from_slice(&crowd.weights, (1, batch, 1, crowd.places), device)?;
        let scores = scores.reshape((past, batch, self.heads, ()))?.broadcast_add(&counts)?;
        let weights = candle_nn::ops::softmax(&scores, D::Minus1)?;

        let mean = weights.reshape((steps, self.heads, ()))?.matmul(&around)?.transpose(0, 1)?.contiguous()?;
        let seen = mean.matmul(&per_head(&self.value)?.transpose(1, 2)?)?.transpose(0, 1)?.contiguous()?;
        let mut seen = seen.reshape((past, batch, ()))?;
        if let Some(bias) = self.value.bias() {
            seen = seen.broadcast_add(bias)?;
        }
        if !self.masked {
            return Ok(seen);
        }
        // Masked and alone: nothing is seen.
        let met: Vec<f32> = crowd.met.iter().map(|met| f32::from(u8::from(*met))).collect();
        seen.broadcast_mul(&Tensor::from_vec(met, (1, batch, 1), device)?)
    }

    /// What the keys' bias adds to all scores of a query `[past, batch, heads * head]` alike,
    /// `[past * batch, heads, 1]`. A softmax does not feel it, but the network has it.
    fn alike(&self, query: &Tensor) -> Result<Tensor> {
        let (past, batch, _) = query.dims3()?;
        let product = match self.key.bias() {
            Some(bias) => query.broadcast_mul(bias)?,
            None => query.zeros_like()?,
        };
        product.reshape((past * batch, self.heads, ()))?.sum_keepdim(D::Minus1)
    }
}

/// Each step of the past looks at all of them: no mask, no position.
#[derive(Debug)]
pub(super) struct Temporal {
    query: Linear,
    key: Linear,
    value: Linear,
    heads: usize,
    scale: f64,
}

impl Temporal {
    pub(super) fn new(sizes: StdanSizes, vb: VarBuilder) -> Result<Self> {
        let wide = sizes.heads * sizes.head;
        let layer = |name: &str| linear(sizes.hidden, wide, vb.pp(name));
        Ok(Self {
            query: layer("query")?,
            key: layer("key")?,
            value: layer("value")?,
            heads: sizes.heads,
            scale: (sizes.hidden as f64).sqrt().recip(),
        })
    }

    /// `[past, batch, heads * head]` of `[past, batch, hidden]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let (past, batch, _) = x.dims3()?;
        let by_head = |layer: &Linear| {
            layer.forward(x)?.reshape((past, batch, self.heads, ()))?.permute((1, 2, 0, 3))?.contiguous()
        };
        let (query, key, value) = (by_head(&self.query)?, by_head(&self.key)?, by_head(&self.value)?);
        let scores = (query.matmul(&key.t()?)? * self.scale)?;
        let seen = candle_nn::ops::softmax(&scores, D::Minus1)?.matmul(&value)?;
        seen.permute((2, 0, 1, 3))?.contiguous()?.reshape((past, batch, ()))
    }
}

/// A gated linear unit: one linear map, opened by the sigmoid of another.
#[derive(Debug)]
pub(super) struct Gate {
    content: Linear,
    gate: Linear,
}

impl Gate {
    pub(super) fn new(input: usize, output: usize, vb: VarBuilder) -> Result<Self> {
        Ok(Self { content: linear(input, output, vb.pp("content"))?, gate: linear(input, output, vb.pp("gate"))? })
    }

    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.content.forward(x)? * candle_nn::ops::sigmoid(&self.gate.forward(x)?)?
    }
}
