//! All weights of a block as one flat vector, and its parts.

use gnp_nn::kernels::transpose;

/// Weights of a block by part, as slices of one vector; maps are `[out, in]`.
pub(crate) struct Parts<T> {
    /// Query map `[width, width]` and bias.
    pub(crate) query: (T, T),
    /// Key and value maps, one above the other, `[2 width, width]`, and bias.
    pub(crate) key_value: (T, T),
    /// Output map of attention `[width, width]` and bias.
    pub(crate) output: (T, T),
    /// Weight and bias of the first norm.
    pub(crate) norm1: (T, T),
    /// First map of feed-forward `[hidden, width]` and bias.
    pub(crate) up: (T, T),
    /// Second map of feed-forward `[width, hidden]` and bias.
    pub(crate) down: (T, T),
    /// Weight and bias of the second norm.
    pub(crate) norm2: (T, T),
}

/// Number of weights of a block.
pub(crate) fn block_weights(width: usize, hidden: usize) -> usize {
    lengths(width, hidden).iter().sum()
}

/// Lengths of the parts, in the order in which they lie in the vector.
fn lengths(width: usize, hidden: usize) -> [usize; 14] {
    let (d, h) = (width, hidden);
    [d * d, 2 * d * d, d, 2 * d, d * d, d, d, d, h * d, h, d * h, d, d, d]
}

impl<T> Parts<T> {
    /// `take` is asked for each part's length in turn.
    fn cut(width: usize, hidden: usize, mut take: impl FnMut(usize) -> T) -> Self {
        let [q, kv, bq, bkv, o, bo, w1, b1, u, bu, d, bd, w2, b2] = lengths(width, hidden).map(&mut take);
        Self {
            query: (q, bq),
            key_value: (kv, bkv),
            output: (o, bo),
            norm1: (w1, b1),
            up: (u, bu),
            down: (d, bd),
            norm2: (w2, b2),
        }
    }
}

impl<'a> Parts<&'a [f32]> {
    /// The parts of `flat`.
    pub(crate) fn of(mut flat: &'a [f32], width: usize, hidden: usize) -> Self {
        Self::cut(width, hidden, |n| {
            let (part, rest) = flat.split_at(n);
            flat = rest;
            part
        })
    }
}

impl<'a> Parts<&'a mut [f32]> {
    /// The parts of `flat`.
    pub(crate) fn of_mut(mut flat: &'a mut [f32], width: usize, hidden: usize) -> Self {
        Self::cut(width, hidden, |n| {
            let (part, rest) = std::mem::take(&mut flat).split_at_mut(n);
            flat = rest;
            part
        })
    }
}

/// The maps as `[in, out]`: what the forward pass multiplies with.
#[derive(Debug)]
pub(crate) struct Transposed {
    pub(crate) query: Vec<f32>,
    pub(crate) key_value: Vec<f32>,
    pub(crate) output: Vec<f32>,
    pub(crate) up: Vec<f32>,
    pub(crate) down: Vec<f32>,
}

impl Transposed {
    pub(crate) fn of(parts: &Parts<&[f32]>, width: usize, hidden: usize) -> Self {
        let turn = |map: &[f32], out: usize, input: usize| {
            let mut to = vec![0.; map.len()];
            transpose(&mut to, out, map, input, [out, input], 1.);
            to
        };
        Self {
            query: turn(parts.query.0, width, width),
            key_value: turn(parts.key_value.0, 2 * width, width),
            output: turn(parts.output.0, width, width),
            up: turn(parts.up.0, hidden, width),
            down: turn(parts.down.0, width, hidden),
        }
    }
}
