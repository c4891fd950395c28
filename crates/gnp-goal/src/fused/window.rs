//! The whole transformer on one window, forward and backward.

use gnp_nn::kernels::{Rows, RowsMut, Start, add_rows, add_to_rows, matmul, padded, row_products};

use super::layer::{Input, Kept, Layer, Room, Sizes, TokenGradients, next_mut};
use super::parts::{Parts, Transposed, block_weights};
use crate::ProbabilityHead;
use crate::block::BlockMasks;

/// Sizes of the transformer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Encoder layers.
    pub(crate) layers: usize,
    /// Modes, each with a token.
    pub(crate) modes: usize,
    /// Modes decoded for a window.
    pub(crate) picked: usize,
    /// Keys of a window, absent ones included.
    pub(crate) keys: usize,
    /// Width of a token.
    pub(crate) width: usize,
    /// Attention heads.
    pub(crate) heads: usize,
    /// Hidden units of feed-forward.
    pub(crate) hidden: usize,
    /// Where modes get their probability.
    pub(crate) probability: ProbabilityHead,
}

impl Shape {
    fn encoder(&self) -> Sizes {
        let Self { modes, width, heads, hidden, .. } = *self;
        Sizes { queries: modes, keys: modes, width, heads, hidden }
    }

    fn decoder(&self) -> Sizes {
        let queries = match self.probability {
            ProbabilityHead::Encoder => self.picked,
            ProbabilityHead::Decoder => self.modes,
        };
        Sizes { queries, keys: self.keys, ..self.encoder() }
    }

    /// Number of weights: of the encoder's blocks, the decoder and the map to a logit.
    pub(crate) fn weights(&self) -> usize {
        (self.layers + 1) * block_weights(self.width, self.hidden) + self.width + 1
    }

    /// Values that a window leaves for the backward pass.
    pub(crate) fn kept_values(&self) -> usize {
        self.layers * self.encoder().kept_values() + self.decoder().kept_values()
    }

    /// Values of the room to work in.
    pub(crate) fn room_values(&self) -> usize {
        4 * padded(self.tokens()) + self.encoder().room_values().max(self.decoder().room_values())
    }

    /// Values of as many tokens as there ever are of a window.
    fn tokens(&self) -> usize {
        self.modes.max(self.picked) * self.width
    }
}

/// The transformer ready to run.
pub(crate) struct Transformer<'a> {
    shape: Shape,
    weights: &'a [f32],
    /// Of the encoder's blocks and then of the decoder; none where there are fewer.
    masks: &'a [BlockMasks],
    /// Map to a logit: weight `[width]` and bias.
    logit: (&'a [f32], f32),
}

/// Gradients of all weights.
pub(crate) struct Gradients<'a> {
    encoder: Vec<Parts<&'a mut [f32]>>,
    decoder: Parts<&'a mut [f32]>,
    logit: (&'a mut [f32], &'a mut [f32]),
}

impl<'a> Gradients<'a> {
    /// The parts of `flat`, which lie as the weights do.
    pub(crate) fn of_mut(mut flat: &'a mut [f32], shape: &Shape) -> Self {
        let Shape { layers, width, hidden, .. } = *shape;
        let mut block = || {
            let (block, rest) = std::mem::take(&mut flat).split_at_mut(block_weights(width, hidden));
            flat = rest;
            Parts::of_mut(block, width, hidden)
        };
        Self { encoder: (0..layers).map(|_| block()).collect(), decoder: block(), logit: flat.split_at_mut(width) }
    }
}

/// What the transformer takes of one window.
#[derive(Clone, Copy)]
pub(crate) struct Window<'a> {
    /// Its place in the batch, by which the masks know it.
    pub(crate) index: usize,
    /// What all modes are, `[modes, width]`.
    pub(crate) modes: &'a [f32],
    /// What was observed, `[width]`; a token is the sum of a mode's vector and this one.
    pub(crate) observed: &'a [f32],
    /// Existing keys `[n, width]`.
    pub(crate) keys: &'a [f32],
}

impl Window<'_> {
    fn tokens(&self, to: &mut [f32]) {
        to.copy_from_slice(self.modes);
        add_to_rows(to, self.observed);
    }
}

/// Gradients of what the transformer takes of one window.
pub(crate) struct WindowGradients<'a> {
    /// Of the modes `[modes, width]`; added to.
    pub(crate) modes: &'a mut [f32],
    /// Of what was observed, `[width]`; added to.
    pub(crate) observed: &'a mut [f32],
    /// Of the existing keys `[n, width]`; overwritten.
    pub(crate) keys: &'a mut [f32],
}

/// The maps of all blocks, turned: of the encoder's in order, then of the decoder.
pub(crate) fn transposed(weights: &[f32], shape: &Shape) -> Vec<Transposed> {
    let Shape { width, hidden, .. } = *shape;
    let blocks = weights.chunks_exact(block_weights(width, hidden)).take(shape.layers + 1);
    blocks.map(|block| Transposed::of(&Parts::of(block, width, hidden), width, hidden)).collect()
}

fn row_range(index: u32, width: usize) -> std::ops::Range<usize> {
    index as usize * width..(index as usize + 1) * width
}

impl<'a> Transformer<'a> {
    /// With `weights` as many as [`Shape::weights`], and the masks of the blocks of the encoder and then of the decoder.
    pub(crate) fn new(shape: Shape, weights: &'a [f32], masks: &'a [BlockMasks]) -> Self {
        let Shape { layers, width, hidden, .. } = shape;
        let logit = &weights[(layers + 1) * block_weights(width, hidden)..];
        Self { shape, weights, masks, logit: (&logit[..width], logit[width]) }
    }

    /// Block `i` of the encoder, and behind them the decoder.
    fn layer(&self, i: usize) -> Layer<'a> {
        let Shape { layers, width, hidden, .. } = self.shape;
        let size = block_weights(width, hidden);
        Layer {
            sizes: if i < layers { self.shape.encoder() } else { self.shape.decoder() },
            parts: Parts::of(&self.weights[i * size..][..size], width, hidden),
            masks: self.masks.get(i).copied().unwrap_or(BlockMasks::NONE),
        }
    }

    fn decoder(&self) -> Layer<'a> {
        self.layer(self.shape.layers)
    }

    /// The parts of what a window leaves: of the encoder's blocks, and of the decoder.
    fn kept<'b>(&self, flat: &'b [f32]) -> (Vec<Kept<&'b [f32]>>, Kept<&'b [f32]>) {
        let (encoder, decoder) = (self.shape.encoder(), self.shape.decoder());
        let (blocks, last) = flat.split_at(self.shape.layers * encoder.kept_values());
        let blocks = blocks.chunks_exact(encoder.kept_values()).map(|block| Kept::of(block, &encoder));
        (blocks.collect(), Kept::of(last, &decoder))
    }

    /// Logits of all modes of `window` into `logits` `[modes]`, and the decoded tokens of those that `pick` names for
    /// them into `decoded` `[picked, width]`; what the backward pass needs into `kept`.
    pub(crate) fn forward<P: AsRef<[u32]>>(
        &self,
        transposed: &[Transposed],
        window: &Window<'_>,
        pick: impl FnOnce(&[f32]) -> P,
        (logits, decoded): (&mut [f32], &mut [f32]),
        kept: &mut [f32],
        room: &mut [f32],
    ) {
        let Shape { layers, width, .. } = self.shape;
        let (encoder, decoder) = (self.shape.encoder(), self.shape.decoder());
        let size = encoder.queries * width;
        let mut room = room;
        let [mut x, mut out, rows] = [size, size, self.shape.tokens()].map(|n| next_mut(&mut room, n));
        window.tokens(x);
        let (blocks, last) = kept.split_at_mut(layers * encoder.kept_values());
        let first = window.index * size;
        for (i, (t, kept)) in transposed.iter().zip(blocks.chunks_exact_mut(encoder.kept_values())).enumerate() {
            let mut kept = Kept::of_mut(kept, &encoder);
            self.layer(i).forward(t, Input { x, keys: x, first }, out, &mut kept, &mut Room::of(room, &encoder));
            std::mem::swap(&mut x, &mut out);
        }
        let (t, mut kept, mut room) = (&transposed[layers], Kept::of_mut(last, &decoder), Room::of(room, &decoder));
        let input = |x| Input { x, keys: window.keys, first: window.index * decoder.queries * width };
        match self.shape.probability {
            ProbabilityHead::Encoder => {
                row_products(logits, x, self.logit.0, self.logit.1);
                let rows = &mut rows[..decoded.len()];
                for (to, index) in rows.chunks_exact_mut(width).zip(pick(logits).as_ref()) {
                    to.copy_from_slice(&x[row_range(*index, width)]);
                }
                self.decoder().forward(t, input(rows), decoded, &mut kept, &mut room);
            }
            ProbabilityHead::Decoder => {
                self.decoder().forward(t, input(x), out, &mut kept, &mut room);
                row_products(logits, out, self.logit.0, self.logit.1);
                for (to, index) in decoded.chunks_exact_mut(width).zip(pick(logits).as_ref()) {
                    to.copy_from_slice(&out[row_range(*index, width)]);
                }
            }
        }
    }

    /// The gradients of one window, after [`Transformer::forward`] left its `kept` and picked `picked`, from those of
    /// what it gave; those of the weights are added to `d`.
    pub(crate) fn backward(
        &self,
        window: &Window<'_>,
        picked: &[u32],
        (d_logits, d_decoded): (&[f32], &[f32]),
        (gradients, d): (WindowGradients<'_>, &mut Gradients<'_>),
        kept: &[f32],
        room: &mut [f32],
    ) {
        let Shape { width, .. } = self.shape;
        let (encoder, decoder) = (self.shape.encoder(), self.shape.decoder());
        let (size, picked_size) = (encoder.queries * width, d_decoded.len());
        let (blocks, last) = self.kept(kept);
        let mut room = room;
        let [x, d_out, d_x, rows] = [self.shape.tokens(); 4].map(|n| next_mut(&mut room, n));
        let (first, keys) = (window.index * decoder.queries * width, window.keys);
        let d_keys = Some(gradients.keys);
        self.output(blocks.len(), window, &blocks, &mut x[..size]);
        match self.shape.probability {
            ProbabilityHead::Encoder => {
                let (d_rows, d_picked) = (&mut d_out[..picked_size], &mut d_x[..picked_size]);
                let rows = &mut rows[..picked_size];
                for (to, index) in rows.chunks_exact_mut(width).zip(picked) {
                    to.copy_from_slice(&x[row_range(*index, width)]);
                }
                d_rows.copy_from_slice(d_decoded);
                let tokens = TokenGradients { out: d_rows, x: d_picked, keys: d_keys };
                let mut room = Room::of(room, &decoder);
                self.decoder().backward(Input { x: rows, keys, first }, tokens, &mut d.decoder, &last, &mut room);
                self.logits_back(&x[..size], d_logits, &mut d_out[..size], d);
                add_picked(d_out, d_picked, picked, width);
            }
            ProbabilityHead::Decoder => {
                self.decoder().output(&last, &mut rows[..size]);
                self.logits_back(&rows[..size], d_logits, &mut d_x[..size], d);
                add_picked(d_x, d_decoded, picked, width);
                let tokens = TokenGradients { out: &mut d_x[..size], x: &mut d_out[..size], keys: d_keys };
                let input = Input { x: &x[..size], keys, first };
                self.decoder().backward(input, tokens, &mut d.decoder, &last, &mut Room::of(room, &decoder));
            }
        }
        let (x, mut d_out, mut d_x) = (&mut x[..size], &mut d_out[..size], &mut d_x[..size]);
        for (i, (kept, d)) in blocks.iter().zip(&mut d.encoder).enumerate().rev() {
            self.output(i, window, &blocks, x);
            let input = Input { x, keys: x, first: window.index * size };
            let tokens = TokenGradients { out: d_out, x: d_x, keys: None };
            self.layer(i).backward(input, tokens, d, kept, &mut Room::of(room, &encoder));
            std::mem::swap(&mut d_out, &mut d_x);
        }
        add_rows(gradients.modes, d_out);
        add_rows(gradients.observed, d_out);
    }

    /// What the first `count` blocks of the encoder gave.
    fn output(&self, count: usize, window: &Window<'_>, blocks: &[Kept<&[f32]>], to: &mut [f32]) {
        match count.checked_sub(1) {
            Some(last) => self.layer(last).output(&blocks[last], to),
            None => window.tokens(to),
        }
    }

    /// Into `d_x` the gradient of the tokens `x` in the logits, and to `d` that of the map.
    fn logits_back(&self, x: &[f32], d_logits: &[f32], d_x: &mut [f32], d: &mut Gradients<'_>) {
        let (width, n) = (self.shape.width, d_logits.len());
        let (column, weight) = (Rows::new(d_logits, 1), Rows::new(self.logit.0, width));
        matmul([n, 1, width], column, weight, Start::Zero, RowsMut::new(d_x, width));
        let (row, x) = (Rows::new(d_logits, n), Rows::new(x, width));
        matmul([1, n, width], row, x, Start::Add, RowsMut::new(d.logit.0, width));
        add_rows(d.logit.1, d_logits);
    }
}

/// Adds each of `rows` to the row of `to` from which it was picked.
fn add_picked(to: &mut [f32], rows: &[f32], picked: &[u32], width: usize) {
    for (row, index) in rows.chunks_exact(width).zip(picked) {
        add_rows(&mut to[row_range(*index, width)], row);
    }
}
