//! All weights of a block as one flat vector, and its parts.

use gnp_nn::Precision;
use gnp_nn::kernels::{LINE, Panels, Rows, RowsMut, Start, matmul, product, transpose};

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
    pub(crate) query: Map,
    pub(crate) key_value: Map,
    pub(crate) output: Map,
    pub(crate) up: Map,
    pub(crate) down: Map,
}

/// A map without its bias, `[in, out]`.
#[derive(Debug)]
pub(crate) enum Map {
    F32(Vec<f32>),
    Bf16(Panels),
}

impl Map {
    /// Of a matrix `[out, in]`. In bf16 only where that is faster: rows of a line or two cost as much to round as it saves.
    fn of(matrix: &[f32], out: usize, input: usize, precision: Precision) -> Self {
        if precision == Precision::Bf16 && input > 2 * LINE && out > LINE && out.is_multiple_of(LINE) {
            return Self::Bf16(Panels::pack_transposed(matrix, input, input, out).into_bf16());
        }
        let mut to = vec![0.; matrix.len()];
        transpose(&mut to, out, matrix, input, [out, input], 1.);
        Self::F32(to)
    }

    /// `from` `[rows, in]` times the map plus `bias` `[out]`, into `to` `[rows, out]`.
    pub(crate) fn apply(&self, to: &mut [f32], from: &[f32], bias: &[f32]) {
        let (outputs, start) = (bias.len(), Start::Bias(bias));
        let (rows, to) = (to.len() / outputs, RowsMut::new(to, outputs));
        match self {
            Self::F32(map) => {
                let inputs = map.len() / outputs;
                matmul([rows, inputs, outputs], Rows::new(from, inputs), Rows::new(map, outputs), start, to);
            }
            Self::Bf16(map) => product(rows, Rows::new(from, map.depth()), map, start, false, to),
        }
    }
}

impl Transposed {
    pub(crate) fn of(parts: &Parts<&[f32]>, width: usize, hidden: usize, precision: Precision) -> Self {
        let turn = |map: &[f32], out: usize, input: usize| Map::of(map, out, input, precision);
        Self {
            query: turn(parts.query.0, width, width),
            key_value: turn(parts.key_value.0, 2 * width, width),
            output: turn(parts.output.0, width, width),
            up: turn(parts.up.0, hidden, width),
            down: turn(parts.down.0, width, hidden),
        }
    }
}
