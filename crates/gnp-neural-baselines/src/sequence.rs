//! An LSTM over a whole sequence as one operation on the CPU, with its gradient derived by hand.
//!
//! The products of the inputs with their weights are made for all points at once outside; inside,
//! rows are worked on in chunks of a fixed number, so that the result does not depend on threads.

use std::sync::{Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp3, Device, Layout, Result, Shape, Tensor};
use rayon::prelude::*;

use crate::cell;
use crate::rows::{add_row, slice, sum_rows};

/// Rows of a chunk: small enough that a chunk's states stay in the cache.
const CHUNK: usize = 64;

/// `h` of every point, `[points, rows, hidden]`, from what enters the gates but for the recurrent
/// part: `gates` `[points, rows, 4 * hidden]`, or `[1, rows, 4 * hidden]` for the same input at all
/// `points`. The start is zero; `weight` `[4 * hidden, hidden]` in PyTorch's gate order, `bias`
/// `[4 * hidden]`.
pub(crate) fn lstm_states(gates: &Tensor, weight: &Tensor, bias: &Tensor, points: usize) -> Result<Tensor> {
    let hidden = weight.dim(1)?;
    if weight.device().is_cpu() && hidden.is_multiple_of(cell::LINE) && gates.dim(1)? > 0 {
        let op = Steps { points, keep: gates.track_op() || weight.track_op(), kept: Mutex::default() };
        return gates.contiguous()?.apply_op3(&weight.contiguous()?, &bias.contiguous()?, op);
    }
    in_steps(gates, weight, bias, points)
}

/// The same from candle's operations: for other devices and widths, and to test against.
fn in_steps(gates: &Tensor, weight: &Tensor, bias: &Tensor, points: usize) -> Result<Tensor> {
    let gates = gates.broadcast_add(bias)?;
    let hidden = weight.dim(1)?;
    let (constant, transposed) = (gates.dim(0)? == 1, weight.t()?);
    let mut state: Option<(Tensor, Tensor)> = None;
    let mut all = Vec::with_capacity(points);
    for t in 0..points {
        let mut sums = gates.get(if constant { 0 } else { t })?;
        if let Some((h, _)) = &state {
            sums = (sums + h.matmul(&transposed)?)?;
        }
        let gate = |i: usize| sums.narrow(1, i * hidden, hidden)?.contiguous();
        let fresh = (candle_nn::ops::sigmoid(&gate(0)?)? * gate(2)?.tanh()?)?;
        let c = match &state {
            Some((_, c)) => (fresh + (candle_nn::ops::sigmoid(&gate(1)?)? * c)?)?,
            None => fresh,
        };
        let h = (candle_nn::ops::sigmoid(&gate(3)?)? * c.tanh()?)?;
        all.push(h.clone());
        state = Some((h, c));
    }
    Tensor::stack(&all, 0)
}

/// What the forward pass leaves for the backward one, by chunk.
#[derive(Debug, Default)]
struct Kept {
    /// What left the gates, `[points, rows of the chunk, 4 * hidden]`.
    gates: Vec<f32>,
    /// Cells, `[points, rows of the chunk, hidden]`.
    cells: Vec<f32>,
}

#[derive(Debug)]
struct Steps {
    points: usize,
    keep: bool,
    kept: Mutex<Vec<Kept>>,
}

/// Sizes of one call.
#[derive(Clone, Copy)]
struct Sizes {
    points: usize,
    rows: usize,
    hidden: usize,
    constant: bool,
}

impl Sizes {
    /// First row and number of rows of each chunk.
    fn chunks(self) -> Vec<(usize, usize)> {
        (0..self.rows).step_by(CHUNK).map(|first| (first, CHUNK.min(self.rows - first))).collect()
    }

    /// Where row `first` of point `t` begins in the input gates, in units of rows.
    fn input(self, t: usize, first: usize) -> usize {
        if self.constant { first } else { t * self.rows + first }
    }
}

/// `a` `[m, k]` times `b` `[k, n]`, row-major.
fn product(a: &[f32], m: usize, b: &Tensor) -> Result<Vec<f32>> {
    Tensor::from_slice(a, (m, b.dim(0)?), &Device::Cpu)?.matmul(b)?.flatten_all()?.to_vec1()
}

/// The chunk's `h` `[points, count, hidden]` and what is kept.
fn forward(
    sizes: Sizes,
    (first, count): (usize, usize),
    gates: &[f32],
    weight: &Tensor,
    bias: &[f32],
) -> Result<(Vec<f32>, Kept)> {
    let Sizes { points, hidden: n, .. } = sizes;
    let mut h = vec![0f32; points * count * n];
    let mut kept = Kept { gates: vec![0.; points * count * 4 * n], cells: vec![0.; points * count * n] };
    for t in 0..points {
        let now = &mut kept.gates[t * count * 4 * n..][..count * 4 * n];
        let given = gates[sizes.input(t, first) * 4 * n..].chunks_exact(4 * n);
        for (now, given) in now.chunks_exact_mut(4 * n).zip(given) {
            now.iter_mut().zip(given.iter().zip(bias)).for_each(|(now, (given, bias))| *now = given + bias);
        }
        let mut cells = vec![0f32; count * n];
        if t > 0 {
            let sums = product(&h[(t - 1) * count * n..][..count * n], count, weight)?;
            cell::add(now, &sums);
            cells.copy_from_slice(&kept.cells[(t - 1) * count * n..][..count * n]);
        }
        cell::step(n, now, &mut cells, &mut h[t * count * n..][..count * n]);
        kept.cells[t * count * n..][..count * n].copy_from_slice(&cells);
    }
    Ok((h, kept))
}

/// Gradients of what enters the gates, `[points, count, 4 * hidden]`.
fn backward(sizes: Sizes, first: usize, count: usize, kept: &Kept, dh: &[f32], weight: &Tensor) -> Result<Vec<f32>> {
    let Sizes { points, rows, hidden: n, .. } = sizes;
    let mut dgates = kept.gates.clone();
    let mut dcell = vec![0f32; count * n];
    let mut carried = vec![0f32; count * n];
    let zeros = vec![0f32; count * n];
    for t in (0..points).rev() {
        cell::add(&mut carried, &dh[(t * rows + first) * n..][..count * n]);
        let before = if t > 0 { &kept.cells[(t - 1) * count * n..][..count * n] } else { &zeros };
        let after = &kept.cells[t * count * n..][..count * n];
        let now = &mut dgates[t * count * 4 * n..][..count * 4 * n];
        cell::step_adjoint(n, now, before, after, &carried, &mut dcell);
        if t > 0 {
            carried = product(now, count, weight)?;
        }
    }
    Ok(dgates)
}

impl CustomOp3 for Steps {
    fn name(&self) -> &'static str {
        "lstm-states"
    }

    fn cpu_fwd(
        &self,
        s1: &CpuStorage,
        l1: &Layout,
        s2: &CpuStorage,
        l2: &Layout,
        s3: &CpuStorage,
        l3: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (first_dim, rows, _) = l1.shape().dims3()?;
        let hidden = l2.shape().dims2()?.1;
        let points = self.points;
        let sizes = Sizes { points, rows, hidden, constant: first_dim == 1 };
        if !(sizes.constant || first_dim == points) {
            candle_core::bail!("lstm: {first_dim} points of input for {points} points");
        }
        let (gates, bias) = (slice(s1, l1)?, slice(s3, l3)?);
        let weight = Tensor::from_slice(slice(s2, l2)?, l2.shape(), &Device::Cpu)?.t()?.contiguous()?;
        let chunks = sizes.chunks();
        let parts: Vec<(Vec<f32>, Kept)> =
            chunks.par_iter().map(|chunk| forward(sizes, *chunk, gates, &weight, bias)).collect::<Result<_>>()?;
        let mut h = vec![0f32; points * rows * hidden];
        let mut kept = Vec::with_capacity(parts.len());
        for ((first, count), (part, keep)) in chunks.iter().zip(parts) {
            for (t, part) in part.chunks_exact(count * hidden).enumerate() {
                h[(t * rows + first) * hidden..][..count * hidden].copy_from_slice(part);
            }
            if self.keep {
                kept.push(keep);
            }
        }
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = kept;
        Ok((CpuStorage::F32(h), (points, rows, hidden).into()))
    }

    fn bwd(
        &self,
        gates: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        res: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (points, rows, hidden) = res.dims3()?;
        let sizes = Sizes { points, rows, hidden, constant: gates.dim(0)? == 1 };
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let dh = grad.flatten_all()?.to_vec1::<f32>()?;
        let held = weight.detach();
        let chunks = sizes.chunks();
        let parts: Vec<Vec<f32>> = chunks
            .par_iter()
            .zip(kept.par_iter())
            .map(|((first, count), kept)| backward(sizes, *first, *count, kept, &dh, &held))
            .collect::<Result<_>>()?;
        if parts.len() != chunks.len() {
            candle_core::bail!("lstm: the forward pass kept nothing to go back from");
        }
        let mut all = vec![0f32; points * rows * 4 * hidden];
        for ((first, count), part) in chunks.iter().zip(&parts) {
            for (t, part) in part.chunks_exact(count * 4 * hidden).enumerate() {
                all[(t * rows + first) * 4 * hidden..][..count * 4 * hidden].copy_from_slice(part);
            }
        }
        let width = 4 * hidden;
        let dbias = sum_rows(points * rows, width, |at, sums| add_row(sums, &all[at..at + width]));
        let dbias = Tensor::from_vec(dbias, width, &Device::Cpu)?;
        let all = Tensor::from_vec(all, (points, rows, 4 * hidden), &Device::Cpu)?;
        let dweight = if points > 1 {
            let later = all.narrow(0, 1, points - 1)?.flatten(0, 1)?;
            let earlier = res.detach().narrow(0, 0, points - 1)?.flatten(0, 1)?;
            later.t()?.matmul(&earlier)?
        } else {
            weight.zeros_like()?
        };
        let dgates = if sizes.constant { all.sum_keepdim(0)? } else { all };
        Ok((Some(dgates), Some(dweight), Some(dbias)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Var};

    fn numbers(shape: impl Into<Shape>, from: f32) -> Var {
        let shape = shape.into();
        let values: Vec<f32> = (0..shape.elem_count()).map(|i| (from + 1.7 * i as f32).sin() * 0.8).collect();
        Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
    }

    fn largest(a: &Tensor, b: &Tensor) -> f32 {
        (a - b).unwrap().abs().unwrap().flatten_all().unwrap().max(0).unwrap().to_scalar().unwrap()
    }

    #[test]
    fn one_operation_gives_the_values_and_gradients_of_the_graph() {
        let (points, rows, hidden) = (5, 67, 16);
        let (weight, bias) = (numbers((4 * hidden, hidden), 0.3), numbers(4 * hidden, 1.6));
        for given in [points, 1] {
            let gates = numbers((given, rows, 4 * hidden), 0.9);
            let upstream = numbers((points, rows, hidden), 2.).as_tensor().clone();
            let run = |fused: bool| {
                let f = if fused { lstm_states } else { in_steps };
                let h = f(gates.as_tensor(), weight.as_tensor(), bias.as_tensor(), points).unwrap();
                let grads = (&h * &upstream).unwrap().sum_all().unwrap().backward().unwrap();
                (h, [&gates, &weight, &bias].map(|var| grads.get(var).unwrap().clone()))
            };
            let ((h, [dg, dw, db]), (h2, [dg2, dw2, db2])) = (run(true), run(false));
            assert_eq!(h.dims(), [points, rows, hidden]);
            assert!(largest(&h, &h2) < 1e-6);
            assert!(largest(&dg, &dg2) < 1e-5);
            assert!(largest(&dw, &dw2) < 1e-4, "{}", largest(&dw, &dw2));
            assert!(largest(&db, &db2) < 1e-4, "{}", largest(&db, &db2));
        }
    }

    #[test]
    fn widths_that_make_no_vectors_take_the_graph() {
        let gates = Tensor::zeros((3, 2, 12), DType::F32, &Device::Cpu).unwrap();
        let weight = Tensor::zeros((12, 3), DType::F32, &Device::Cpu).unwrap();
        let bias = Tensor::zeros(12, DType::F32, &Device::Cpu).unwrap();
        assert_eq!(lstm_states(&gates, &weight, &bias, 3).unwrap().dims(), [3, 2, 3]);
    }
}
