//! An LSTM layer, a step at a time or over whole sequences.
//!
//! On the CPU a sequence is one operation with its gradient derived by hand. The products of the inputs with
//! their weights are made for all points at once; then chunks of rows go through all steps side by side. What comes
//! out of a row does not depend on the others of its chunk, so that the chunks may be as many as suit the threads.

use std::sync::{Mutex, PoisonError};

use candle_core::{CpuStorage, CustomOp3, D, Device, Layout, Result, Shape, Tensor};
use candle_nn::VarBuilder;
use rayon::prelude::*;

use crate::kernels::{
    LINE, Panels, Rows, RowsMut, Start, add_rows, lstm, lstm_adjoint, product, read, sum_rows, values,
};
use crate::layers::uniform;

/// An LSTM layer with PyTorch's names (`weight_ih`, `weight_hh`, `bias_ih`, `bias_hh`), gate order
/// (input, forget, cell, output) and initialisation (uniform in `+-1/sqrt(hidden)`).
#[derive(Clone, Debug)]
pub struct Lstm {
    weight_ih: Tensor,
    weight_hh: Tensor,
    bias_ih: Tensor,
    bias_hh: Tensor,
}

/// What an [`Lstm`] carries from step to step.
#[derive(Clone, Debug)]
pub struct LstmState {
    /// Output, `[rows, hidden]`.
    pub h: Tensor,
    /// Cell, `[rows, hidden]`.
    pub c: Tensor,
}

impl Lstm {
    /// A layer of `hidden` units on `input` values.
    ///
    /// # Errors
    /// When `vb` holds weights of another shape under these names.
    pub fn new(input: usize, hidden: usize, vb: VarBuilder) -> Result<Self> {
        let init = uniform(hidden);
        Ok(Self {
            weight_ih: vb.get_with_hints((4 * hidden, input), "weight_ih", init)?,
            weight_hh: vb.get_with_hints((4 * hidden, hidden), "weight_hh", init)?,
            bias_ih: vb.get_with_hints(4 * hidden, "bias_ih", init)?,
            bias_hh: vb.get_with_hints(4 * hidden, "bias_hh", init)?,
        })
    }

    /// One step on `x` `[rows, input]` from candle's operations; no state means zeros.
    ///
    /// # Errors
    /// When a shape differs from the layer's.
    pub fn step(&self, x: &Tensor, state: Option<&LstmState>) -> Result<LstmState> {
        let sums = x.matmul(&self.weight_ih.t()?)?.broadcast_add(&self.bias()?)?;
        step(sums, &self.weight_hh, state)
    }

    /// The output at every point, `[points, rows, hidden]`, for `x` `[points, rows, input]`; the start is
    /// zero.
    ///
    /// # Errors
    /// When a shape differs from the layer's, or there is no point.
    pub fn states(&self, x: &Tensor) -> Result<Tensor> {
        states(&self.inputs(x)?, &self.weight_hh, &self.bias()?, x.dim(0)?)
    }

    /// The output at each of `points` points, `[points, rows, hidden]`, for the same input `x`
    /// `[rows, input]` at all of them; the start is zero.
    ///
    /// # Errors
    /// As [`Lstm::states`].
    pub fn repeated(&self, x: &Tensor, points: usize) -> Result<Tensor> {
        states(&self.inputs(&x.unsqueeze(0)?)?, &self.weight_hh, &self.bias()?, points)
    }

    fn bias(&self) -> Result<Tensor> {
        &self.bias_ih + &self.bias_hh
    }

    /// What the inputs bring to the gates, `[points, rows, 4 * hidden]`.
    fn inputs(&self, x: &Tensor) -> Result<Tensor> {
        let (points, rows, input) = x.dims3()?;
        let flat = x.contiguous()?.reshape((points * rows, input))?;
        let sums = flat.matmul(&self.weight_ih.t()?)?;
        sums.reshape((points, rows, sums.dim(1)?))
    }
}

/// One step on `sums` `[rows, 4 * hidden]`, what enters the gates but for the recurrent part.
fn step(mut sums: Tensor, weight: &Tensor, state: Option<&LstmState>) -> Result<LstmState> {
    let hidden = weight.dim(1)?;
    if let Some(state) = state {
        sums = (sums + state.h.matmul(&weight.t()?)?)?;
    }
    let part = |of: &Tensor, i: usize| of.narrow(D::Minus1, i * hidden, hidden);
    // Of all four, though one has a tanh: a GPU waits for launches, not for values.
    let open = candle_nn::ops::sigmoid(&sums)?;
    let fresh = (part(&open, 0)? * part(&sums, 2)?.tanh()?)?;
    let c = match state {
        Some(state) => (fresh + (part(&open, 1)? * &state.c)?)?,
        None => fresh,
    };
    let h = (part(&open, 3)? * c.tanh()?)?;
    Ok(LstmState { h, c })
}

/// `h` of every point, `[points, rows, hidden]`, from what enters the gates but for the recurrent
/// part: `gates` `[points, rows, 4 * hidden]`, or `[1, rows, 4 * hidden]` for the same input at all
/// `points`. The start is zero; `weight` `[4 * hidden, hidden]`, `bias` `[4 * hidden]`.
fn states(gates: &Tensor, weight: &Tensor, bias: &Tensor, points: usize) -> Result<Tensor> {
    if weight.device().is_cpu() && weight.dim(1)?.is_multiple_of(LINE) && gates.dim(1)? > 0 {
        let each = rows_each(gates.dim(1)?, rayon::current_num_threads());
        let op = Steps { points, each, keep: gates.track_op() || weight.track_op(), kept: Mutex::default() };
        return gates.contiguous()?.apply_op3(&weight.contiguous()?, &bias.contiguous()?, op);
    }
    in_steps(gates, weight, bias, points)
}

/// The same from candle's operations: for other devices and widths, and to test against.
fn in_steps(gates: &Tensor, weight: &Tensor, bias: &Tensor, points: usize) -> Result<Tensor> {
    let gates = gates.broadcast_add(bias)?;
    let constant = gates.dim(0)? == 1;
    let mut state: Option<LstmState> = None;
    let mut all = Vec::with_capacity(points);
    for t in 0..points {
        let next = step(gates.get(if constant { 0 } else { t })?, weight, state.as_ref())?;
        all.push(next.h.clone());
        state = Some(next);
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
    /// Rows of a chunk, forward and backward.
    each: usize,
    keep: bool,
    kept: Mutex<Vec<Kept>>,
}

/// Rows of a chunk, at most: small enough that a chunk's states stay in the cache.
const MOST: usize = 64;
/// Rows of a chunk, at least: enough to use a weight often once it is fetched.
const LEAST: usize = 16;

/// Rows of a chunk, of which there is then a multiple of the threads if that leaves enough rows to each.
fn rows_each(rows: usize, threads: usize) -> usize {
    let chunks = rows.div_ceil(MOST).next_multiple_of(threads.max(1));
    rows.div_ceil(chunks.max(1)).next_multiple_of(8).clamp(LEAST, MOST)
}

/// Sizes of one call.
#[derive(Clone, Copy)]
struct Sizes {
    points: usize,
    rows: usize,
    /// Rows of a chunk.
    each: usize,
    hidden: usize,
    constant: bool,
}

impl Sizes {
    /// First row and number of rows of each chunk.
    fn chunks(self) -> Vec<(usize, usize)> {
        (0..self.rows).step_by(self.each).map(|first| (first, self.each.min(self.rows - first))).collect()
    }

    /// Where row `first` of point `t` begins in the input gates, in units of rows.
    fn input(self, t: usize, first: usize) -> usize {
        if self.constant { first } else { t * self.rows + first }
    }

    /// The chunk's `h` `[points, count, hidden]` and what is kept; `weight` is `[hidden, 4 * hidden]`.
    fn forward(self, first: usize, count: usize, gates: &[f32], weight: &Panels, bias: &[f32]) -> (Vec<f32>, Kept) {
        let (points, n) = (self.points, self.hidden);
        let size = count * n;
        let mut h = vec![0f32; points * size];
        let mut kept = Kept { gates: vec![0.; points * 4 * size], cells: vec![0.; points * size] };
        let mut recurrent = vec![0f32; 4 * size];
        for t in 0..points {
            let sums = &mut kept.gates[t * 4 * size..][..4 * size];
            let given = gates[self.input(t, first) * 4 * n..].chunks_exact(4 * n);
            for (sums, given) in sums.chunks_exact_mut(4 * n).zip(given) {
                sums.iter_mut().zip(given.iter().zip(bias)).for_each(|(sum, (given, bias))| *sum = given + bias);
            }
            if t > 0 {
                let before = Rows::new(&h[(t - 1) * size..], n);
                product(count, before, weight, Start::Zero, false, RowsMut::new(&mut recurrent, 4 * n));
                add_rows(sums, &recurrent);
                kept.cells.copy_within((t - 1) * size..t * size, t * size);
            }
            lstm(n, sums, &mut kept.cells[t * size..][..size], RowsMut::new(&mut h[t * size..], n));
        }
        (h, kept)
    }

    /// Gradients of what enters the gates, `[points, count, 4 * hidden]`; `weight` is `[4 * hidden, hidden]`.
    fn backward(self, first: usize, count: usize, kept: Kept, dh: &[f32], weight: &Panels) -> Vec<f32> {
        let (rows, n) = (self.rows, self.hidden);
        let size = count * n;
        let Kept { gates: mut dgates, cells } = kept;
        let (mut dcell, mut carried, zeros) = (vec![0f32; size], vec![0f32; size], vec![0f32; size]);
        for t in (0..self.points).rev() {
            add_rows(&mut carried, &dh[(t * rows + first) * n..][..size]);
            let before = if t > 0 { &cells[(t - 1) * size..][..size] } else { &zeros };
            let (after, now) = (&cells[t * size..][..size], &mut dgates[t * 4 * size..][..4 * size]);
            lstm_adjoint(n, now, before, after, Rows::new(&carried, n), &mut dcell);
            if t > 0 {
                let to = RowsMut::new(&mut carried, n);
                product(count, Rows::new(now, 4 * n), weight, Start::Zero, false, to);
            }
        }
        dgates
    }
}

/// Puts the parts `[points, count, width]` of chunks of rows together, `[points, rows, width]`.
fn together(sizes: Sizes, width: usize, mut parts: Vec<Vec<f32>>) -> Vec<f32> {
    if parts.len() == 1 {
        return parts.swap_remove(0);
    }
    let (chunks, row) = (sizes.chunks(), sizes.rows * width);
    let mut all = vec![0f32; sizes.points * row];
    all.par_chunks_exact_mut(row.max(1)).enumerate().for_each(|(t, all)| {
        for ((first, count), part) in chunks.iter().zip(&parts) {
            all[first * width..][..count * width].copy_from_slice(&part[t * count * width..][..count * width]);
        }
    });
    all
}

/// The sum over the points of `x` `[points, size]`, point by point; candle's own divides indices for every value.
fn sum_points(x: &[f32], points: usize, size: usize) -> Vec<f32> {
    const PART: usize = 4096;
    let mut sums = vec![0f32; size];
    sums.par_chunks_mut(PART).enumerate().for_each(|(part, sums)| {
        (0..points).for_each(|t| {
            let (from, len) = (t * size + part * PART, sums.len());
            add_rows(sums, &x[from..from + len]);
        });
    });
    sums
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
        let (points, hidden) = (self.points, l2.shape().dims2()?.1);
        let sizes = Sizes { points, rows, each: self.each, hidden, constant: first_dim == 1 };
        if !(sizes.constant || first_dim == points) {
            candle_core::bail!("lstm: {first_dim} points of input for {points} points");
        }
        let (gates, bias) = (values(s1, l1)?, values(s3, l3)?);
        let weight = Panels::pack_transposed(values(s2, l2)?, hidden, hidden, 4 * hidden);
        let chunks = sizes.chunks();
        let (parts, kept): (Vec<Vec<f32>>, Vec<Kept>) =
            chunks.par_iter().map(|(first, count)| sizes.forward(*first, *count, gates, &weight, bias)).unzip();
        let h = together(sizes, hidden, parts);
        if self.keep {
            *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = kept;
        }
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
        let sizes = Sizes { points, rows, each: self.each, hidden, constant: gates.dim(0)? == 1 };
        let kept = std::mem::take(&mut *self.kept.lock().unwrap_or_else(PoisonError::into_inner));
        let grad = grad.contiguous()?;
        let (dh, width) = (read(&grad)?, 4 * hidden);
        let dh = &*dh;
        let panels = Panels::pack(&read(weight)?, width, hidden);
        let chunks = sizes.chunks();
        if kept.len() != chunks.len() {
            candle_core::bail!("lstm: a sequence passes its gradient back once; go forward again before the next pass");
        }
        let parts: Vec<Vec<f32>> = chunks
            .par_iter()
            .zip(kept)
            .map(|((first, count), kept)| sizes.backward(*first, *count, kept, dh, &panels))
            .collect();
        let all = together(sizes, width, parts);
        let dbias = sum_rows(points * rows, width, |row, sums| add_rows(sums, &all[row * width..][..width]));
        let dbias = Tensor::from_vec(dbias, width, &Device::Cpu)?;
        let summed = if sizes.constant { sum_points(&all, points, rows * width) } else { Vec::new() };
        let all = Tensor::from_vec(all, (points, rows, width), &Device::Cpu)?;
        let dweight = if points > 1 {
            let later = all.narrow(0, 1, points - 1)?.flatten(0, 1)?;
            let earlier = res.detach().narrow(0, 0, points - 1)?.flatten(0, 1)?;
            later.t()?.matmul(&earlier)?
        } else {
            weight.zeros_like()?
        };
        let dgates = if sizes.constant { Tensor::from_vec(summed, (1, rows, width), &Device::Cpu)? } else { all };
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
                let f = if fused { states } else { in_steps };
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
    fn the_same_bits_come_out_on_any_number_of_threads() {
        let (points, rows, hidden) = (4, 75, 32);
        let (weight, bias) = (numbers((4 * hidden, hidden), 0.3), numbers(4 * hidden, 1.6));
        let gates = numbers((points, rows, 4 * hidden), 0.9);
        let upstream = numbers((points, rows, hidden), 2.).as_tensor().clone();
        let bits = |x: &Tensor| -> Vec<u32> {
            x.flatten_all().unwrap().to_vec1::<f32>().unwrap().into_iter().map(f32::to_bits).collect()
        };
        let run = || {
            let h = states(gates.as_tensor(), weight.as_tensor(), bias.as_tensor(), points).unwrap();
            let grads = (&h * &upstream).unwrap().sum_all().unwrap().backward().unwrap();
            [
                bits(&h),
                bits(grads.get(&gates).unwrap()),
                bits(grads.get(&weight).unwrap()),
                bits(grads.get(&bias).unwrap()),
            ]
        };
        let on = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(run);
        // A multiple of the threads where that leaves enough rows to a chunk.
        assert_eq!([1, 2, 3, 8].map(|threads| rows_each(rows, threads)), [40, 40, 32, 16]);
        let one = on(1);
        for threads in [2, 3, 8] {
            assert!(on(threads) == one, "{threads} threads");
        }
    }

    #[test]
    fn widths_that_make_no_vectors_take_the_graph() {
        let gates = Tensor::zeros((3, 2, 12), DType::F32, &Device::Cpu).unwrap();
        let weight = Tensor::zeros((12, 3), DType::F32, &Device::Cpu).unwrap();
        let bias = Tensor::zeros(12, DType::F32, &Device::Cpu).unwrap();
        assert_eq!(states(&gates, &weight, &bias, 3).unwrap().dims(), [3, 2, 3]);
    }
}
