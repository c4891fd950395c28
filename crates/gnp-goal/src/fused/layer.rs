//! One block on one window, forward and backward, all of it in the cache.

use gnp_nn::kernels::{
    Attention, Rows, RowsMut, Start, add_rows, affine_rows, drop_values, matmul, matmul_transposed, norm, norm_adjoint,
    padded, relu, relu_adjoint,
};

use super::parts::{Parts, Transposed};
use crate::block::BlockMasks;

/// Sizes of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    /// Queries of a window.
    pub(crate) queries: usize,
    /// Keys of a window, absent ones included.
    pub(crate) keys: usize,
    /// Width of a token.
    pub(crate) width: usize,
    /// Attention heads.
    pub(crate) heads: usize,
    /// Hidden units of feed-forward.
    pub(crate) hidden: usize,
}

impl Sizes {
    pub(crate) fn attention(&self) -> Attention {
        Attention { queries: self.queries, width: self.width, heads: self.heads }
    }

    /// Lengths of the parts of [`Kept`], in order.
    fn kept(&self) -> [usize; 9] {
        let Self { queries: l, keys, width, hidden, .. } = *self;
        let statistics = self.attention().statistics();
        [l * width, keys * 2 * width, statistics, l * width, l * width, l, l * hidden, l * width, l]
    }

    /// Values of [`Kept`].
    pub(crate) fn kept_values(&self) -> usize {
        self.kept().map(padded).iter().sum()
    }

    /// Lengths of the parts of [`Room`], in order.
    fn room(&self) -> [usize; 6] {
        let Self { queries: l, keys, width, hidden, .. } = *self;
        [self.attention().room(keys), l * width, l * hidden, l * width, l * width, keys * 2 * width]
    }

    /// Values of [`Room`].
    pub(crate) fn room_values(&self) -> usize {
        self.room().map(padded).iter().sum()
    }
}

/// What the forward pass of one window leaves for the backward pass. The block's input, what stands between its halves
/// and the weights of attention are not kept: they cost less to make again than to carry through memory.
pub(crate) struct Kept<T> {
    query: T,
    key_value: T,
    statistics: T,
    gathered: T,
    normal1: T,
    scale1: T,
    hidden: T,
    normal2: T,
    scale2: T,
}

impl<T> Kept<T> {
    /// `take` is asked for each part's length in turn.
    fn cut(sizes: &Sizes, take: impl FnMut(usize) -> T) -> Self {
        let [query, key_value, statistics, gathered, normal1, scale1, hidden, normal2, scale2] = sizes.kept().map(take);
        Self { query, key_value, statistics, gathered, normal1, scale1, hidden, normal2, scale2 }
    }
}

impl<'a> Kept<&'a mut [f32]> {
    /// The parts of `flat`.
    pub(crate) fn of_mut(mut flat: &'a mut [f32], sizes: &Sizes) -> Self {
        Self::cut(sizes, |n| next_mut(&mut flat, n))
    }
}

impl<'a> Kept<&'a [f32]> {
    /// The parts of `flat`.
    pub(crate) fn of(mut flat: &'a [f32], sizes: &Sizes) -> Self {
        Self::cut(sizes, |n| {
            let (part, rest) = flat.split_at(padded(n));
            flat = rest;
            &part[..n]
        })
    }
}

/// The next `n` values of `flat`, which then begins on the cache line behind them.
pub(crate) fn next_mut<'a>(flat: &mut &'a mut [f32], n: usize) -> &'a mut [f32] {
    let (part, rest) = std::mem::take(flat).split_at_mut(padded(n));
    *flat = rest;
    &mut part[..n]
}

/// Room to work in; what it holds is of no use afterwards.
pub(crate) struct Room<'a> {
    attention: &'a mut [f32],
    between: &'a mut [f32],
    hidden: &'a mut [f32],
    gathered: &'a mut [f32],
    query: &'a mut [f32],
    key_value: &'a mut [f32],
}

impl<'a> Room<'a> {
    /// The parts of `flat`.
    pub(crate) fn of(mut flat: &'a mut [f32], sizes: &Sizes) -> Self {
        let [attention, between, hidden, gathered, query, key_value] = sizes.room().map(|n| next_mut(&mut flat, n));
        Self { attention, between, hidden, gathered, query, key_value }
    }
}

/// A block ready to run.
pub(crate) struct Layer<'a> {
    pub(crate) sizes: Sizes,
    pub(crate) parts: Parts<&'a [f32]>,
    pub(crate) masks: BlockMasks,
}

/// What a block takes of one window.
#[derive(Clone, Copy)]
pub(crate) struct Input<'a> {
    /// Queries `[queries, width]`.
    pub(crate) x: &'a [f32],
    /// Existing keys `[n, width]`.
    pub(crate) keys: &'a [f32],
    /// Index of the window's first value in the masks.
    pub(crate) first: usize,
}

/// Gradients of one window's tokens in a block.
pub(crate) struct TokenGradients<'a> {
    /// Of what the block gave, `[queries, width]`; worked on.
    pub(crate) out: &'a mut [f32],
    /// Of `x`, `[queries, width]`; with that of the keys where these are `x`.
    pub(crate) x: &'a mut [f32],
    /// Of the existing keys `[n, width]`, where they are not `x`.
    pub(crate) keys: Option<&'a mut [f32]>,
}

/// `rows * map + bias` for rows of `inputs` values and a transposed map, into `to` `[rows, outputs]`.
fn map(to: &mut [f32], from: &[f32], map: &[f32], bias: &[f32]) {
    let (inputs, outputs) = (map.len() / bias.len(), bias.len());
    let (from, map) = (Rows::new(from, inputs), Rows::new(map, outputs));
    matmul([to.len() / outputs, inputs, outputs], from, map, Start::Bias(bias), RowsMut::new(to, outputs));
}

/// Adds to the gradients of a map and its bias, for rows of `inputs` and of the gradient of what came out.
fn map_gradient(d_outputs: &[f32], inputs: &[f32], d: &mut (&mut [f32], &mut [f32])) {
    let outputs = d.1.len();
    let (width, n) = (d.0.len() / outputs, d_outputs.len() / outputs);
    add_rows(d.1, d_outputs);
    let (d_outputs, inputs) = (Rows::new(d_outputs, outputs), Rows::new(inputs, width));
    matmul_transposed([outputs, n, width], d_outputs, inputs, Start::Add, RowsMut::new(d.0, width));
}

/// The gradient of what a map took, from that of what it gave.
fn map_back(to: &mut [f32], d_outputs: &[f32], map: &[f32], outputs: usize, start: Start<'_>) {
    let inputs = map.len() / outputs;
    let (d_outputs, map) = (Rows::new(d_outputs, outputs), Rows::new(map, inputs));
    matmul([to.len() / inputs, outputs, inputs], d_outputs, map, start, RowsMut::new(to, inputs));
}

impl Layer<'_> {
    /// The block on `input`, into `out` `[queries, width]`.
    pub(crate) fn forward(
        &self,
        transposed: &Transposed,
        input: Input<'_>,
        out: &mut [f32],
        kept: &mut Kept<&mut [f32]>,
        room: &mut Room<'_>,
    ) {
        let Input { x, keys, first } = input;
        let (t, p, n) = (transposed, &self.parts, keys.len() / self.sizes.width);
        let key_value = &mut kept.key_value[..n * 2 * self.sizes.width];
        map(kept.query, x, &t.query, p.query.1);
        map(key_value, keys, &t.key_value, p.key_value.1);
        self.sizes.attention().forward(kept.query, key_value, kept.gathered, kept.statistics, room.attention);
        map(kept.normal1, kept.gathered, &t.output, p.output.1);
        norm(kept.normal1, x, (self.masks.attention, first), p.norm1, kept.scale1, room.between);
        map(kept.hidden, room.between, &t.up, p.up.1);
        relu(kept.hidden);
        map(kept.normal2, kept.hidden, &t.down, p.down.1);
        norm(kept.normal2, room.between, (self.masks.feed_forward, first), p.norm2, kept.scale2, out);
    }

    /// What [`Layer::forward`] gave, from what it kept.
    pub(crate) fn output(&self, kept: &Kept<&[f32]>, to: &mut [f32]) {
        affine_rows(to, kept.normal2, self.parts.norm2);
    }

    /// The gradients of one window, after [`Layer::forward`] on the same `input` kept what it did: those of the weights
    /// are added to `d`.
    pub(crate) fn backward(
        &self,
        input: Input<'_>,
        gradients: TokenGradients<'_>,
        d: &mut Parts<&mut [f32]>,
        kept: &Kept<&[f32]>,
        room: &mut Room<'_>,
    ) {
        let Input { x, keys, first } = input;
        let TokenGradients { out, x: d_x, keys: d_keys } = gradients;
        let Sizes { width, hidden, .. } = self.sizes;
        let (p, n) = (&self.parts, keys.len() / width);

        norm_adjoint(out, kept.normal2, kept.scale2, p.norm2.0, (&mut *d.norm2.0, &mut *d.norm2.1));
        d_x.copy_from_slice(out);
        drop_values(out, self.masks.feed_forward, first);
        map_gradient(out, kept.hidden, &mut d.down);
        map_back(room.hidden, out, p.down.0, width, Start::Zero);
        relu_adjoint(hidden, room.hidden, Rows::new(kept.hidden, hidden));
        affine_rows(room.between, kept.normal1, p.norm1);
        map_gradient(room.hidden, room.between, &mut d.up);
        map_back(d_x, room.hidden, p.up.0, hidden, Start::Sum);

        norm_adjoint(d_x, kept.normal1, kept.scale1, p.norm1.0, (&mut *d.norm1.0, &mut *d.norm1.1));
        out.copy_from_slice(d_x);
        drop_values(out, self.masks.attention, first);
        map_gradient(out, kept.gathered, &mut d.output);
        map_back(room.gathered, out, p.output.0, width, Start::Zero);

        let (key_value, d_key_value) = (&kept.key_value[..n * 2 * width], &mut room.key_value[..n * 2 * width]);
        self.sizes.attention().adjoint(
            kept.query,
            key_value,
            room.gathered,
            kept.statistics,
            room.query,
            d_key_value,
            room.attention,
        );
        map_gradient(room.query, x, &mut d.query);
        map_back(d_x, room.query, p.query.0, width, Start::Sum);
        map_gradient(d_key_value, keys, &mut d.key_value);
        match d_keys {
            Some(d_keys) => map_back(d_keys, d_key_value, p.key_value.0, 2 * width, Start::Zero),
            None => map_back(d_x, d_key_value, p.key_value.0, 2 * width, Start::Sum),
        }
    }
}
