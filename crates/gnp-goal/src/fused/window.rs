//! One block on one window, forward and backward, all of it in the cache.

use gnp_nn::kernels::{
    Attention, Rows, RowsMut, Start, add_rows, drop_values, matmul, matmul_transposed, norm, norm_adjoint, relu,
    relu_adjoint,
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

/// A block ready to run.
pub(crate) struct Layer<'a> {
    pub(crate) sizes: Sizes,
    pub(crate) parts: Parts<&'a [f32]>,
    pub(crate) transposed: Transposed,
    pub(crate) masks: BlockMasks,
}

/// What the forward pass of one window leaves for the backward pass, and room to work in.
pub(crate) struct Work {
    query: Vec<f32>,
    key_value: Vec<f32>,
    attention: Attention,
    gathered: Vec<f32>,
    normal1: Vec<f32>,
    scale1: Vec<f32>,
    between: Vec<f32>,
    hidden: Vec<f32>,
    normal2: Vec<f32>,
    scale2: Vec<f32>,
    gradients: Option<Gradients>,
}

/// Room for the backward pass.
struct Gradients {
    out: Vec<f32>,
    between: Vec<f32>,
    hidden: Vec<f32>,
    gathered: Vec<f32>,
    query: Vec<f32>,
    key_value: Vec<f32>,
}

impl Work {
    /// Room for the forward pass, and for the backward pass where `backward`.
    pub(crate) fn new(sizes: &Sizes, backward: bool) -> Self {
        let Sizes { queries: l, keys, width, heads, hidden } = *sizes;
        let room = |n: usize| vec![0f32; n];
        Self {
            query: room(l * width),
            key_value: room(keys * 2 * width),
            attention: Attention::new([l, keys, width, heads], backward),
            gathered: room(l * width),
            normal1: room(l * width),
            scale1: room(l),
            between: room(l * width),
            hidden: room(l * hidden),
            normal2: room(l * width),
            scale2: room(l),
            gradients: backward.then(|| Gradients {
                out: room(l * width),
                between: room(l * width),
                hidden: room(l * hidden),
                gathered: room(l * width),
                query: room(l * width),
                key_value: room(keys * 2 * width),
            }),
        }
    }
}

impl Layer<'_> {
    /// `rows * map + bias` for `[n, inputs]` rows and a transposed map, into `to` `[n, outputs]`.
    fn map(&self, to: &mut [f32], from: &[f32], map: &[f32], bias: &[f32], n: usize) {
        let (inputs, outputs) = (map.len() / bias.len(), bias.len());
        for to in to.chunks_exact_mut(outputs).take(n) {
            to.copy_from_slice(bias);
        }
        let (from, map) = (Rows::new(from, inputs), Rows::new(map, outputs));
        matmul([n, inputs, outputs], from, map, Start::Add, RowsMut::new(to, outputs));
    }

    /// The block on `x` `[queries, width]` with the existing `keys` `[n, width]`, into `out`
    /// `[queries, width]`; `first` is the index of the window's first value in the masks.
    pub(crate) fn forward(&self, x: &[f32], keys: &[f32], out: &mut [f32], first: usize, work: &mut Work) {
        let Sizes { queries: l, width, .. } = self.sizes;
        let (t, p, n) = (&self.transposed, &self.parts, keys.len() / width);
        self.map(&mut work.query, x, &t.query, p.query.1, l);
        self.map(&mut work.key_value, keys, &t.key_value, p.key_value.1, n);
        work.attention.forward(&work.query, &work.key_value[..n * 2 * width], &mut work.gathered);
        self.map(&mut work.normal1, &work.gathered, &t.output, p.output.1, l);
        let (mask, between) = ((self.masks.attention, first), &mut work.between);
        norm(&mut work.normal1, x, mask, p.norm1, &mut work.scale1, between);
        self.map(&mut work.hidden, &work.between, &t.up, p.up.1, l);
        relu(&mut work.hidden);
        self.map(&mut work.normal2, &work.hidden, &t.down, p.down.1, l);
        let mask = (self.masks.feed_forward, first);
        norm(&mut work.normal2, &work.between, mask, p.norm2, &mut work.scale2, out);
    }

    /// Gradients of one window, after [`Layer::forward`] left its `work`: with respect to `x` into
    /// `d_x`, with respect to the existing `keys` into `d_keys` (added to `d_x` where there is none,
    /// because then the keys are `x`), and with respect to the weights added to `d`.
    #[expect(clippy::too_many_arguments, reason = "inputs, their gradients and the place in the mask")]
    pub(crate) fn backward(
        &self,
        x: &[f32],
        keys: &[f32],
        d_out: &[f32],
        d_x: &mut [f32],
        d_keys: Option<&mut [f32]>,
        d: &mut Parts<&mut [f32]>,
        first: usize,
        work: &mut Work,
    ) {
        let Some(mut room) = work.gradients.take() else { return };
        let Sizes { queries: l, width, hidden, .. } = self.sizes;
        let (p, n) = (&self.parts, keys.len() / width);

        room.out.copy_from_slice(d_out);
        let d_norm = (&mut *d.norm2.0, &mut *d.norm2.1);
        norm_adjoint(&mut room.out, &work.normal2, &work.scale2, p.norm2.0, d_norm);
        room.between.copy_from_slice(&room.out);
        drop_values(&mut room.out, self.masks.feed_forward, first);
        self.map_gradient(&room.out, &work.hidden, &mut d.down, l);
        let (d_out, down) = (Rows::new(&room.out, width), Rows::new(p.down.0, hidden));
        matmul([l, width, hidden], d_out, down, Start::Zero, RowsMut::new(&mut room.hidden, hidden));
        relu_adjoint(hidden, &mut room.hidden, Rows::new(&work.hidden, hidden));
        self.map_gradient(&room.hidden, &work.between, &mut d.up, l);
        let (d_hidden, up) = (Rows::new(&room.hidden, hidden), Rows::new(p.up.0, width));
        matmul([l, hidden, width], d_hidden, up, Start::Add, RowsMut::new(&mut room.between, width));

        let d_norm = (&mut *d.norm1.0, &mut *d.norm1.1);
        norm_adjoint(&mut room.between, &work.normal1, &work.scale1, p.norm1.0, d_norm);
        d_x.copy_from_slice(&room.between);
        drop_values(&mut room.between, self.masks.attention, first);
        self.map_gradient(&room.between, &work.gathered, &mut d.output, l);
        let (d_gathered, output) = (Rows::new(&room.between, width), Rows::new(p.output.0, width));
        matmul([l, width, width], d_gathered, output, Start::Zero, RowsMut::new(&mut room.gathered, width));

        let (key_value, d_key_value) = (&work.key_value[..n * 2 * width], &mut room.key_value[..n * 2 * width]);
        work.attention.adjoint(&work.query, key_value, &room.gathered, &mut room.query, d_key_value);
        self.map_gradient(&room.query, x, &mut d.query, l);
        let (d_query, query) = (Rows::new(&room.query, width), Rows::new(p.query.0, width));
        matmul([l, width, width], d_query, query, Start::Add, RowsMut::new(d_x, width));
        self.map_gradient(&room.key_value, keys, &mut d.key_value, n);
        let (to, start) = match d_keys {
            Some(d_keys) => (d_keys, Start::Zero),
            None => (d_x, Start::Add),
        };
        let (d_key_value, maps) = (Rows::new(&room.key_value, 2 * width), Rows::new(p.key_value.0, width));
        matmul([n, 2 * width, width], d_key_value, maps, start, RowsMut::new(to, width));
        work.gradients = Some(room);
    }

    /// Adds to the gradients of a map and its bias, for `n` rows of `inputs` and of what came out.
    fn map_gradient(&self, d_outputs: &[f32], inputs: &[f32], d: &mut (&mut [f32], &mut [f32]), n: usize) {
        let outputs = d.1.len();
        let width = d.0.len() / outputs;
        add_rows(d.1, &d_outputs[..n * outputs]);
        let (d_outputs, inputs) = (Rows::new(d_outputs, outputs), Rows::new(inputs, width));
        matmul_transposed([outputs, n, width], d_outputs, inputs, Start::Add, RowsMut::new(d.0, width));
    }
}
