//! One block on one window, forward and backward, all of it in the cache.

use pulp::Arch;

use super::parts::{Parts, Transposed};
use super::product::{Store, product, product_of_transpose};
use super::rows::{self, LANES};
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
    fn head(&self) -> usize {
        self.width / self.heads
    }

    /// Factor of the scores.
    fn scale(&self) -> f32 {
        1. / (self.head() as f32).sqrt()
    }
}

/// A block ready to run.
pub(crate) struct Layer<'a> {
    pub(crate) arch: Arch,
    pub(crate) sizes: Sizes,
    pub(crate) parts: Parts<&'a [f32]>,
    pub(crate) transposed: Transposed,
    pub(crate) masks: BlockMasks,
}

/// What the forward pass of one window leaves for the backward pass, and room to work in.
pub(crate) struct Work {
    query: Vec<f32>,
    key_value: Vec<f32>,
    /// One head's keys or values, transposed, `[head, padded]`.
    turned: Vec<f32>,
    /// Attention weights `[heads, queries, padded]`; of one head only where none are kept.
    weights: Vec<f32>,
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
    weights: Vec<f32>,
    query: Vec<f32>,
    key_value: Vec<f32>,
}

/// `n` rounded up to whole vectors.
fn padded(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

impl Work {
    /// Room for the forward pass, and for the backward pass where `backward`.
    pub(crate) fn new(sizes: &Sizes, backward: bool) -> Self {
        let Sizes { queries: l, keys, width, heads, hidden } = *sizes;
        let room = |n: usize| vec![0f32; n];
        let scores = l * padded(keys);
        Self {
            query: room(l * width),
            key_value: room(keys * 2 * width),
            turned: room(sizes.head() * padded(keys)),
            weights: room(if backward { heads * scores } else { scores }),
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
                weights: room(scores),
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
        product(self.arch, (to, outputs), (from, inputs), (map, outputs), [n, inputs, outputs], Store::Add);
    }

    /// The block on `x` `[queries, width]` with the existing `keys` `[n, width]`, into `out`
    /// `[queries, width]`; `first` is the index of the window's first value in the masks.
    pub(crate) fn forward(&self, x: &[f32], keys: &[f32], out: &mut [f32], first: usize, work: &mut Work) {
        let Sizes { queries: l, width, heads, .. } = self.sizes;
        let (n, head, arch) = (keys.len() / width, self.sizes.head(), self.arch);
        let (t, p, wide) = (&self.transposed, &self.parts, padded(n));
        self.map(&mut work.query, x, &t.query, p.query.1, l);
        self.map(&mut work.key_value, keys, &t.key_value, p.key_value.1, n);
        let kept = if work.gradients.is_some() { l * wide } else { 0 };
        for h in 0..heads {
            let (at, scale) = (h * head, self.sizes.scale());
            let (query, key_value, turned) = (&work.query[at..], &work.key_value, &mut work.turned);
            let weights = &mut work.weights[h * kept..][..l * wide];
            if n > 0 {
                rows::transpose(arch, turned, wide, &key_value[at..], 2 * width, [n, head], scale);
                product(arch, (weights, wide), (query, width), (turned, wide), [l, head, wide], Store::Set);
                rows::softmax(arch, weights, wide, n);
            }
            // Without any key this is zero.
            let values = key_value.get(width + at..).unwrap_or_default();
            let gathered = &mut work.gathered[at..];
            product(arch, (gathered, width), (weights, wide), (values, 2 * width), [l, n, head], Store::Set);
        }
        self.map(&mut work.normal1, &work.gathered, &t.output, p.output.1, l);
        let (mask, between) = ((self.masks.attention, first), &mut work.between);
        rows::norm(arch, &mut work.normal1, x, mask, p.norm1, &mut work.scale1, between);
        self.map(&mut work.hidden, &work.between, &t.up, p.up.1, l);
        rows::relu(arch, &mut work.hidden);
        self.map(&mut work.normal2, &work.hidden, &t.down, p.down.1, l);
        let mask = (self.masks.feed_forward, first);
        rows::norm(arch, &mut work.normal2, &work.between, mask, p.norm2, &mut work.scale2, out);
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
        let (p, arch, n) = (&self.parts, self.arch, keys.len() / width);

        room.out.copy_from_slice(d_out);
        let d_norm = (&mut *d.norm2.0, &mut *d.norm2.1);
        rows::norm_gradient(arch, &mut room.out, &work.normal2, &work.scale2, p.norm2.0, d_norm);
        room.between.copy_from_slice(&room.out);
        rows::drop_values(arch, &mut room.out, self.masks.feed_forward, first);
        self.map_gradient(&room.out, &work.hidden, &mut d.down, l);
        product(
            arch,
            (&mut room.hidden, hidden),
            (&room.out, width),
            (p.down.0, hidden),
            [l, width, hidden],
            Store::Set,
        );
        rows::relu_gradient(arch, &mut room.hidden, &work.hidden);
        self.map_gradient(&room.hidden, &work.between, &mut d.up, l);
        product(
            arch,
            (&mut room.between, width),
            (&room.hidden, hidden),
            (p.up.0, width),
            [l, hidden, width],
            Store::Add,
        );

        let d_norm = (&mut *d.norm1.0, &mut *d.norm1.1);
        rows::norm_gradient(arch, &mut room.between, &work.normal1, &work.scale1, p.norm1.0, d_norm);
        d_x.copy_from_slice(&room.between);
        rows::drop_values(arch, &mut room.between, self.masks.attention, first);
        self.map_gradient(&room.between, &work.gathered, &mut d.output, l);
        let gathered = (&mut room.gathered[..], width);
        product(arch, gathered, (&room.between, width), (p.output.0, width), [l, width, width], Store::Set);

        self.attention_gradient(n, work, &mut room);
        self.map_gradient(&room.query, x, &mut d.query, l);
        product(arch, (d_x, width), (&room.query, width), (p.query.0, width), [l, width, width], Store::Add);
        self.map_gradient(&room.key_value, keys, &mut d.key_value, n);
        let (to, store) = match d_keys {
            Some(d_keys) => (d_keys, Store::Set),
            None => (d_x, Store::Add),
        };
        let (d_key_value, maps) = ((&room.key_value[..], 2 * width), (p.key_value.0, width));
        product(arch, (to, width), d_key_value, maps, [n, 2 * width, width], store);
        work.gradients = Some(room);
    }

    /// From the gradient of what attention gathered to those of queries, keys and values.
    fn attention_gradient(&self, n: usize, work: &mut Work, room: &mut Gradients) {
        let Sizes { queries: l, width, heads, .. } = self.sizes;
        let (head, arch, wide, scale) = (self.sizes.head(), self.arch, padded(n), self.sizes.scale());
        if n == 0 {
            return room.query.fill(0.);
        }
        for h in 0..heads {
            let at = h * head;
            let weights = &work.weights[h * l * wide..][..l * wide];
            let (key_value, turned) = (&work.key_value, &mut work.turned);
            let gathered = (&room.gathered[at..], width);
            let d_values = (&mut room.key_value[width + at..], 2 * width);
            product_of_transpose(arch, d_values, (weights, wide), gathered, [n, l, head], Store::Set);
            rows::transpose(arch, turned, wide, &key_value[width + at..], 2 * width, [n, head], 1.);
            let scores = &mut room.weights[..l * wide];
            product(arch, (scores, wide), gathered, (turned, wide), [l, head, wide], Store::Set);
            rows::softmax_gradient(arch, scores, weights, wide, scale);
            let d_query = (&mut room.query[at..], width);
            product(arch, d_query, (scores, wide), (&key_value[at..], 2 * width), [l, n, head], Store::Set);
            let (d_keys, query) = ((&mut room.key_value[at..], 2 * width), (&work.query[at..], width));
            product_of_transpose(arch, d_keys, (scores, wide), query, [n, l, head], Store::Set);
        }
    }

    /// Adds to the gradients of a map and its bias, for `n` rows of `inputs` and of what came out.
    fn map_gradient(&self, d_outputs: &[f32], inputs: &[f32], d: &mut (&mut [f32], &mut [f32]), n: usize) {
        let outputs = d.1.len();
        let width = d.0.len() / outputs;
        rows::add_rows(self.arch, d.1, &d_outputs[..n * outputs]);
        let (to, from, with) = ((&mut *d.0, width), (d_outputs, outputs), (inputs, width));
        product_of_transpose(self.arch, to, from, with, [outputs, n, width], Store::Add);
    }
}
