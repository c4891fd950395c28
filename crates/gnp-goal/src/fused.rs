//! The transformer as one operation on the CPU, with a gradient derived by hand.
//!
//! As a graph of candle operations, every step of a block walks the whole batch through memory,
//! and the backward pass three times over. Here each window goes from its tokens through all blocks in one
//! core's cache, windows are shared out among cores, and threads meet once a pass. The graph in
//! [`Block`](crate::block::Block) stays as the reference, and for other devices.
//!
//! Results do not depend on the number of threads: a window's are its own, and the gradients of the
//! weights are summed over fixed groups of windows, then over the groups in order.

mod layer;
mod parts;
#[cfg(test)]
mod tests;
mod window;

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use candle_core::{CpuStorage, CustomOp3, DType, Layout, Result, Shape as Dims, Tensor};
use gnp_nn::kernels::{Aligned, Pool, add_rows, read, values};
use rayon::prelude::*;

pub(crate) use self::parts::Transposed;
use self::window::{Gradients, WindowGradients};
pub(crate) use self::window::{Shape, Transformer, Window, transposed};
use crate::ProbabilityHead;
use crate::block::BlockMasks;
use crate::pick::Picked;

/// Groups at most that the windows of a batch are shared out in, and the fewest windows of one: each group has gradients of
/// its own.
const GROUPS: usize = 16;
const GROUP: usize = 4;

/// Values (4 bytes each) that the forward pass of a batch may leave for the backward pass; windows beyond go forward
/// once more before they go backward. Also what waits for the next batch at most.
const KEPT_VALUES: usize = 1 << 26;

/// Values of the gradients that groups make side by side, as far as there are still a group for each thread.
const SHARED_VALUES: usize = 1 << 24;

/// Weights whose gradients are added up at once.
const BLOCK: usize = 1 << 13;

/// What a network keeps from one batch to the next: idle memory.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    pool: Arc<Pool>,
    kept_values: usize,
    shared_values: usize,
}

impl Default for Memory {
    fn default() -> Self {
        Self { pool: Arc::default(), kept_values: KEPT_VALUES, shared_values: SHARED_VALUES }
    }
}

impl Memory {
    fn give(&self, buffers: impl IntoIterator<Item = Aligned>) {
        self.pool.give(buffers, self.kept_values);
    }
}

/// Whether `x` is where this operation runs.
pub(crate) fn runs_on(x: &Tensor) -> bool {
    x.device().is_cpu() && x.dtype() == DType::F32
}

/// The transformer without its weights.
#[derive(Clone, Debug)]
pub(crate) struct FusedTransformer {
    pub(crate) memory: Memory,
    pub(crate) layers: usize,
    pub(crate) heads: usize,
    pub(crate) hidden: usize,
    pub(crate) probability: ProbabilityHead,
    pub(crate) picked: Picked,
    /// Masks of this step, of the encoder's blocks and then of the decoder.
    pub(crate) masks: Vec<BlockMasks>,
}

impl FusedTransformer {
    /// Logits `[batch, modes]` and the decoded tokens `[batch, picked, width]` of the modes picked.
    ///
    /// Tokens are the sums of `modes` `[modes, width]` with `observed` `[batch, width]`; `keys` `[batch, keys, width]`
    /// exist where `mask` `[batch, keys]` is not 0; `weights` are those of the encoder's blocks, of the decoder and of
    /// the map to a logit, in the order of [`Block::weights`](crate::block::Block::weights).
    pub(crate) fn apply(
        self,
        [modes, observed, keys, mask]: [&Tensor; 4],
        weights: &[&Tensor],
    ) -> Result<(Tensor, Tensor)> {
        let ((batch, key_count, key_width), (modes_count, width)) = (keys.dims3()?, modes.dims2()?);
        let shape = Shape {
            layers: self.layers,
            modes: modes_count,
            picked: self.picked.count(),
            keys: key_count,
            width,
            heads: self.heads,
            hidden: self.hidden,
            probability: self.probability,
        };
        let flat = weights.iter().map(|weight| weight.flatten_all()).collect::<Result<Vec<_>>>()?;
        let flat = Tensor::cat(&flat, 0)?;
        if observed.dims() != [batch, width] || key_width != width || mask.dims() != [batch, key_count] {
            candle_core::bail!(
                "transformer: modes {modes:?}, observed {observed:?}, keys {keys:?}, mask {mask:?} do not fit together"
            );
        }
        if flat.elem_count() != shape.weights() {
            candle_core::bail!("transformer: {} weights, not {}", flat.elem_count(), shape.weights());
        }
        let present = mask.flatten_all()?.to_vec1::<f32>()?.into_iter().map(|m| m != 0.).collect();
        let tokens = Tensor::cat(&[modes, observed], 0)?;
        let keys = keys.contiguous()?;
        let keep = tokens.track_op() || keys.track_op() || flat.track_op();
        let (picked, masks, memory) = (self.picked, self.masks, self.memory);
        let operation = Operation { shape, batch, picked, masks, present, keep, memory, left: Mutex::default() };
        let out = tokens.apply_op3(&keys, &flat, operation)?;
        let logits = out.narrow(0, 0, batch * modes_count)?.reshape((batch, modes_count))?;
        let decoded = batch * shape.picked * width;
        Ok((logits, out.narrow(0, batch * modes_count, decoded)?.reshape((batch, shape.picked, width))?))
    }
}

/// From tokens, keys and weights to logits, followed by decoded tokens, of all windows.
struct Operation {
    shape: Shape,
    batch: usize,
    picked: Picked,
    masks: Vec<BlockMasks>,
    /// Which keys exist, `[batch, keys]`.
    present: Vec<bool>,
    /// Whether there will be a gradient.
    keep: bool,
    memory: Memory,
    /// What the forward pass left of each window, as far as it fits; taken by the first backward pass.
    left: Mutex<Vec<Option<Aligned>>>,
}

/// Inputs of the operation, as values.
#[derive(Clone, Copy)]
struct Given<'a> {
    modes: &'a [f32],
    observed: &'a [f32],
    keys: &'a [f32],
    weights: &'a [f32],
}

/// Gradients of a group of windows.
struct GroupGradients {
    /// Of the weights, followed by the modes.
    shared: Aligned,
    observed: Vec<f32>,
    keys: Vec<f32>,
}

impl Operation {
    fn left(&self) -> MutexGuard<'_, Vec<Option<Aligned>>> {
        self.left.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn given<'a>(&self, tokens: &'a [f32], keys: &'a [f32], weights: &'a [f32]) -> Given<'a> {
        let (modes, observed) = tokens.split_at(self.shape.modes * self.shape.width);
        Given { modes, observed, keys, weights }
    }

    /// Windows of a group.
    fn group(&self) -> usize {
        self.batch.div_ceil(GROUPS).max(GROUP)
    }

    fn present(&self, window: usize) -> &[bool] {
        &self.present[window * self.shape.keys..][..self.shape.keys]
    }

    /// The keys of window `window` that exist.
    fn existing(&self, keys: &[f32], window: usize) -> Vec<f32> {
        let Shape { keys: count, width, .. } = self.shape;
        let rows = keys[window * count * width..][..count * width].chunks_exact(width);
        rows.zip(self.present(window)).filter(|(_, present)| **present).flat_map(|(row, _)| row).copied().collect()
    }

    /// Appends the gradients of all keys of a window, zero for those that do not exist.
    fn put_back(&self, existing: &[f32], window: usize, to: &mut Vec<f32>) {
        let width = self.shape.width;
        let mut rows = existing.chunks_exact(width);
        for present in self.present(window) {
            match present.then(|| rows.next()).flatten() {
                Some(row) => to.extend_from_slice(row),
                None => to.resize(to.len() + width, 0.),
            }
        }
    }

    fn window<'a>(&self, given: &Given<'a>, index: usize, keys: &'a [f32]) -> Window<'a> {
        let observed = &given.observed[index * self.shape.width..][..self.shape.width];
        let first = self.masks.first().map_or(0, |masks| masks.attention.first_window());
        Window { index: first + index, modes: given.modes, observed, keys }
    }

    fn forward(&self, given: &Given<'_>) -> Vec<f32> {
        let Shape { modes, picked, width, .. } = self.shape;
        let transformer = Transformer::new(self.shape, given.weights, &self.masks);
        let turned = transposed(given.weights, &self.shape);
        let mut out = vec![0f32; self.batch * (modes + picked * width)];
        let (logits, decoded) = out.split_at_mut(self.batch * modes);
        let (group, pool) = (self.group(), &self.memory.pool);
        let room_for = self.memory.kept_values / self.shape.kept_values().max(1);
        let groups = logits.par_chunks_mut(group * modes).zip(decoded.par_chunks_mut(group * picked * width));
        let left: Vec<Vec<Option<Aligned>>> = groups
            .enumerate()
            .map(|(g, (logits, decoded))| {
                let mut room = pool.take(self.shape.room_values());
                let mut kept = None;
                let outs = logits.chunks_exact_mut(modes).zip(decoded.chunks_exact_mut(picked * width));
                let left = outs.enumerate().map(|(i, out)| {
                    let index = g * group + i;
                    let keys = self.existing(given.keys, index);
                    let mut to = kept.take().unwrap_or_else(|| pool.take(self.shape.kept_values()));
                    let pick = |logits: &[f32]| self.picked.of_window(index, logits);
                    let window = self.window(given, index, &keys);
                    transformer.forward(&turned, &window, pick, out, &mut to, &mut room);
                    if self.keep && index < room_for {
                        return Some(to);
                    }
                    kept = Some(to);
                    None
                });
                let left = left.collect();
                self.memory.give(kept.into_iter().chain([room]));
                left
            })
            .collect();
        if self.keep {
            *self.left() = left.into_iter().flatten().collect();
        }
        out
    }

    /// Gradients with respect to tokens, keys and weights from that of what [`Operation::forward`] gave, `out`.
    fn backward(&self, given: &Given<'_>, out: &[f32], d_out: &[f32]) -> [Vec<f32>; 3] {
        let Shape { modes, picked, width, .. } = self.shape;
        let transformer = Transformer::new(self.shape, given.weights, &self.masks);
        let turned = OnceLock::new();
        let (d_logits, d_decoded) = d_out.split_at(self.batch * modes);
        let (group, pool, count) = (self.group(), &self.memory.pool, given.weights.len());
        let mut left = std::mem::take(&mut *self.left());
        left.resize_with(self.batch, || None);
        let size = count + modes * width;
        let side_by_side = (self.memory.shared_values / size).max(rayon::current_num_threads()).min(GROUPS);
        let mut sum = vec![0f32; size];
        let (mut d_observed, mut d_keys) = (Vec::new(), Vec::new());
        for (wave, left) in left.chunks_mut(group * side_by_side).enumerate() {
            let groups = left.par_chunks_mut(group).enumerate().map(|(g, left)| {
                let g = wave * side_by_side + g;
                let mut room = pool.take(self.shape.room_values());
                let mut shared = pool.take(size);
                shared.fill(0.);
                let (d_weights, d_modes) = shared.split_at_mut(count);
                let mut d = Gradients::of_mut(d_weights, &self.shape);
                let (mut d_observed, mut d_keys) = (vec![0f32; left.len() * width], Vec::new());
                for (i, (left, d_observed)) in left.iter_mut().zip(d_observed.chunks_exact_mut(width)).enumerate() {
                    let index = g * group + i;
                    let keys = self.existing(given.keys, index);
                    let window = self.window(given, index, &keys);
                    let chosen = self.picked.of_window(index, &out[index * modes..][..modes]);
                    let kept = left.take().unwrap_or_else(|| {
                        let turned = turned.get_or_init(|| transposed(given.weights, &self.shape));
                        let mut kept = pool.take(self.shape.kept_values());
                        let (mut logits, mut decoded) = (vec![0f32; modes], vec![0f32; picked * width]);
                        let out = (&mut *logits, &mut *decoded);
                        transformer.forward(turned, &window, |_| &chosen, out, &mut kept, &mut room);
                        kept
                    });
                    let d_out =
                        (&d_logits[index * modes..][..modes], &d_decoded[index * picked * width..][..picked * width]);
                    let mut d_existing = vec![0f32; keys.len()];
                    let to = WindowGradients { modes: d_modes, observed: d_observed, keys: &mut d_existing };
                    transformer.backward(&window, &chosen, d_out, (to, &mut d), &kept, &mut room);
                    self.put_back(&d_existing, index, &mut d_keys);
                    self.memory.give([kept]);
                }
                self.memory.give([room]);
                GroupGradients { shared, observed: d_observed, keys: d_keys }
            });
            let groups: Vec<GroupGradients> = groups.collect();
            sum.par_chunks_mut(BLOCK).enumerate().for_each(|(i, sum)| {
                for group in &groups {
                    add_rows(sum, &group.shared[i * BLOCK..][..sum.len()]);
                }
            });
            for group in groups {
                d_observed.extend(group.observed);
                d_keys.extend(group.keys);
                self.memory.give([group.shared]);
            }
        }
        let mut d_tokens = sum.split_off(count);
        d_tokens.extend(d_observed);
        [d_tokens, d_keys, sum]
    }
}

impl CustomOp3 for Operation {
    fn name(&self) -> &'static str {
        "goal-transformer"
    }

    fn cpu_fwd(
        &self,
        tokens: &CpuStorage,
        lt: &Layout,
        keys: &CpuStorage,
        lk: &Layout,
        weights: &CpuStorage,
        lw: &Layout,
    ) -> Result<(CpuStorage, Dims)> {
        let given = self.given(values(tokens, lt)?, values(keys, lk)?, values(weights, lw)?);
        let out = self.forward(&given);
        let dims = Dims::from(out.len());
        Ok((CpuStorage::F32(out), dims))
    }

    fn bwd(
        &self,
        tokens: &Tensor,
        keys: &Tensor,
        weights: &Tensor,
        out: &Tensor,
        d_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let d_out = d_out.contiguous()?;
        let (token_values, key_values, weight_values) = (read(tokens)?, read(keys)?, read(weights)?);
        let given = self.given(&token_values, &key_values, &weight_values);
        let [d_tokens, d_keys, d_weights] = self.backward(&given, &read(out)?, &read(&d_out)?);
        let gradient = |values, of: &Tensor| Tensor::from_vec(values, of.shape(), of.device()).map(Some);
        Ok((gradient(d_tokens, tokens)?, gradient(d_keys, keys)?, gradient(d_weights, weights)?))
    }
}
