//! A transformer block as one operation on the CPU, with a gradient derived by hand.
//!
//! As a graph of candle operations, every step of a block walks the whole batch through memory,
//! and the backward pass three times over. Here each window goes through the whole block in one
//! core's cache, windows are shared out among cores, and the backward pass works out again what it
//! needs instead of keeping it. The graph in [`Block`](crate::block::Block) stays as the reference,
//! and for other devices.
//!
//! Results do not depend on the number of threads: a window's are its own, and the gradients of the
//! weights are summed over fixed groups of windows, then over the groups in order.

mod parts;
mod tokens;
mod window;

use candle_core::{CpuStorage, CustomOp2, CustomOp3, DType, Layout, Result, Shape, Tensor};
use gnp_nn::kernels::{add_rows, read, values};
use rayon::prelude::*;

use self::parts::{Parts, Transposed, lengths};
use self::window::{Layer, Sizes, Work};
use crate::block::BlockMasks;

pub(crate) use self::parts::flatten;
pub(crate) use self::tokens::outer_sum;

/// Groups that the windows of a batch are shared out in.
const GROUPS: usize = 16;

/// A block without its weights: heads, hidden units, masks of this step.
#[derive(Clone, Debug)]
pub(crate) struct FusedBlock {
    pub(crate) heads: usize,
    pub(crate) hidden: usize,
    pub(crate) masks: BlockMasks,
    /// Which keys exist, `[batch, keys]`; all of them without one.
    pub(crate) present: Option<Vec<bool>>,
}

/// Whether `x` is where this operation runs.
pub(crate) fn runs_on(x: &Tensor) -> bool {
    x.device().is_cpu() && x.dtype() == DType::F32
}

impl FusedBlock {
    /// The block on `x` `[batch, queries, width]`, which attends to `keys` `[batch, keys, width]`, or
    /// to itself, with `weights` from [`flatten`].
    pub(crate) fn apply(self, x: &Tensor, keys: Option<&Tensor>, weights: &Tensor) -> Result<Tensor> {
        let x = x.contiguous()?;
        match keys {
            Some(keys) => x.apply_op3(&keys.contiguous()?, weights, self),
            None => x.apply_op2(weights, self),
        }
    }

    fn sizes(&self, x: &Shape, keys: &Shape, weights: usize) -> Result<(usize, Sizes)> {
        let (batch, queries, width) = x.dims3()?;
        let (key_batch, keys, key_width) = keys.dims3()?;
        let sizes = Sizes { queries, keys, width, heads: self.heads, hidden: self.hidden };
        let needed: usize = lengths(width, self.hidden).iter().sum();
        let present = self.present.as_ref().is_none_or(|present| present.len() == batch * keys);
        if (key_batch, key_width) != (batch, width) || weights != needed || !present {
            candle_core::bail!("block: queries {x:?}, keys [{key_batch}, {keys}, {key_width}], {weights} weights");
        }
        Ok((batch, sizes))
    }

    fn layer<'a>(&self, sizes: Sizes, weights: &'a [f32]) -> Layer<'a> {
        let parts = Parts::of(weights, sizes.width, sizes.hidden);
        let transposed = Transposed::of(&parts, sizes.width, sizes.hidden);
        Layer { sizes, parts, transposed, masks: self.masks }
    }

    /// The rows of window `window` of `keys` that exist.
    fn existing(&self, keys: &[f32], window: usize, sizes: &Sizes) -> Vec<f32> {
        let keys = &keys[window * sizes.keys * sizes.width..][..sizes.keys * sizes.width];
        match &self.present {
            None => keys.to_vec(),
            Some(present) => {
                let present = &present[window * sizes.keys..][..sizes.keys];
                let rows = keys.chunks_exact(sizes.width).zip(present);
                rows.filter(|(_, present)| **present).flat_map(|(row, _)| row).copied().collect()
            }
        }
    }

    fn forward(&self, x: &[f32], keys: &[f32], weights: &[f32], batch: usize, sizes: Sizes) -> Vec<f32> {
        let layer = self.layer(sizes, weights);
        let size = sizes.queries * sizes.width;
        let mut out = vec![0f32; x.len()];
        if out.is_empty() {
            return out;
        }
        let group = batch.div_ceil(GROUPS);
        out.par_chunks_mut(group * size).enumerate().for_each_init(
            || Work::new(&sizes, false),
            |work, (g, out)| {
                for (i, out) in out.chunks_exact_mut(size).enumerate() {
                    let window = g * group + i;
                    let keys = self.existing(keys, window, &sizes);
                    layer.forward(&x[window * size..][..size], &keys, out, window * size, work);
                }
            },
        );
        out
    }

    /// Gradients with respect to `x`, to `keys` (empty where the keys are `x`) and to the weights.
    fn backward(&self, given: &Given<'_>, d_out: &[f32]) -> [Vec<f32>; 3] {
        let Given { x, keys, weights, batch, sizes } = *given;
        let layer = self.layer(sizes, weights);
        let size = sizes.queries * sizes.width;
        let mut d_x = vec![0f32; x.len()];
        let mut d_weights = vec![0f32; weights.len()];
        if d_x.is_empty() {
            return [d_x, vec![0.; keys.map_or(0, <[f32]>::len)], d_weights];
        }
        let group = batch.div_ceil(GROUPS);
        let of_groups: Vec<(Vec<f32>, Vec<f32>)> = d_x
            .par_chunks_mut(group * size)
            .enumerate()
            .map_init(
                || (Work::new(&sizes, true), vec![0f32; size]),
                |(work, out), (g, d_x)| {
                    let mut flat = vec![0f32; weights.len()];
                    let mut d = Parts::of_mut(&mut flat, sizes.width, sizes.hidden);
                    let mut d_keys = Vec::new();
                    for (i, d_x) in d_x.chunks_exact_mut(size).enumerate() {
                        let window = g * group + i;
                        let first = window * size;
                        let (x, d_out) = (&x[first..][..size], &d_out[first..][..size]);
                        match keys {
                            None => {
                                layer.forward(x, x, out, first, work);
                                layer.backward(x, x, d_out, d_x, None, &mut d, first, work);
                            }
                            Some(keys) => {
                                let keys = self.existing(keys, window, &sizes);
                                layer.forward(x, &keys, out, first, work);
                                let mut d_existing = vec![0f32; keys.len()];
                                layer.backward(x, &keys, d_out, d_x, Some(&mut d_existing), &mut d, first, work);
                                self.put_back(&d_existing, window, &sizes, &mut d_keys);
                            }
                        }
                    }
                    (flat, d_keys)
                },
            )
            .collect();
        let mut d_keys = Vec::with_capacity(keys.map_or(0, <[f32]>::len));
        for (weights, keys) in of_groups {
            d_keys.extend(keys);
            add_rows(&mut d_weights, &weights);
        }
        [d_x, d_keys, d_weights]
    }

    /// Appends the gradients of all keys of a window, zero for those that do not exist.
    fn put_back(&self, existing: &[f32], window: usize, sizes: &Sizes, to: &mut Vec<f32>) {
        let Some(present) = &self.present else { return to.extend_from_slice(existing) };
        let mut rows = existing.chunks_exact(sizes.width);
        for present in &present[window * sizes.keys..][..sizes.keys] {
            match present.then(|| rows.next()).flatten() {
                Some(row) => to.extend_from_slice(row),
                None => to.resize(to.len() + sizes.width, 0.),
            }
        }
    }
}

/// Inputs of a block, as values.
#[derive(Clone, Copy)]
struct Given<'a> {
    x: &'a [f32],
    keys: Option<&'a [f32]>,
    weights: &'a [f32],
    batch: usize,
    sizes: Sizes,
}

/// A gradient as a tensor of the shape of what it belongs to.
fn gradient(values: Vec<f32>, of: &Tensor) -> Result<Option<Tensor>> {
    Tensor::from_vec(values, of.shape(), of.device()).map(Some)
}

impl CustomOp2 for FusedBlock {
    fn name(&self) -> &'static str {
        "self-attention block"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, w: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let (x, weights) = (values(x, lx)?, values(w, lw)?);
        let (batch, sizes) = self.sizes(lx.shape(), lx.shape(), weights.len())?;
        Ok((CpuStorage::F32(self.forward(x, x, weights, batch, sizes)), lx.shape().clone()))
    }

    fn bwd(&self, x: &Tensor, w: &Tensor, _: &Tensor, d_out: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let d_out = d_out.contiguous()?;
        let (values, weights) = (read(x)?, read(w)?);
        let (batch, sizes) = self.sizes(x.shape(), x.shape(), weights.len())?;
        let given = Given { x: &values, keys: None, weights: &weights, batch, sizes };
        let [d_x, _, d_weights] = self.backward(&given, &read(&d_out)?);
        Ok((gradient(d_x, x)?, gradient(d_weights, w)?))
    }
}

impl CustomOp3 for FusedBlock {
    fn name(&self) -> &'static str {
        "cross-attention block"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        lx: &Layout,
        keys: &CpuStorage,
        lk: &Layout,
        w: &CpuStorage,
        lw: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let weights = values(w, lw)?;
        let (batch, sizes) = self.sizes(lx.shape(), lk.shape(), weights.len())?;
        let out = self.forward(values(x, lx)?, values(keys, lk)?, weights, batch, sizes);
        Ok((CpuStorage::F32(out), lx.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        keys: &Tensor,
        w: &Tensor,
        _: &Tensor,
        d_out: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let d_out = d_out.contiguous()?;
        let (values, key_values, weights) = (read(x)?, read(keys)?, read(w)?);
        let (batch, sizes) = self.sizes(x.shape(), keys.shape(), weights.len())?;
        let given = Given { x: &values, keys: Some(&key_values), weights: &weights, batch, sizes };
        let [d_x, d_keys, d_weights] = self.backward(&given, &read(&d_out)?);
        Ok((gradient(d_x, x)?, gradient(d_keys, keys)?, gradient(d_weights, w)?))
    }
}
