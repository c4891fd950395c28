//! What candle does slowly on the CPU to rows of values: bias and rectifier as one operation whose
//! gradient adds up rows in memory order. candle's own sum over rows divides indices for every value.

use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor};
use candle_nn::Linear;
use rayon::prelude::*;

/// Rows that are added up before they join the sum: fixed, so that the result does not depend on
/// threads, and small, so that little of a long sum is rounded away.
const BLOCK: usize = 256;

/// The values of a contiguous tensor on the CPU.
pub(crate) fn slice<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    let (from, to) =
        layout.contiguous_offsets().ok_or_else(|| candle_core::Error::msg("an operation on rows: not contiguous"))?;
    Ok(&storage.as_slice::<f32>()?[from..to])
}

/// Sum of each of `columns` columns over all rows of `term`, which is given the index of a row's first
/// value and adds the row to the sums.
pub(crate) fn sum_rows(rows: usize, columns: usize, term: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let block = |first: usize| {
        let mut sums = vec![0f32; columns];
        (first..rows.min(first + BLOCK)).for_each(|row| term(row * columns, &mut sums));
        sums
    };
    let blocks: Vec<Vec<f32>> = (0..rows).into_par_iter().step_by(BLOCK).map(block).collect();
    let mut all = vec![0f32; columns];
    for block in &blocks {
        all.iter_mut().zip(block).for_each(|(sum, more)| *sum += more);
    }
    all
}

/// `values + more`, value by value.
pub(crate) fn add_row(sums: &mut [f32], row: &[f32]) {
    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
}

/// `layer` on the last dimension of `x`, then a rectifier: see [`rectified`].
pub(crate) fn dense(layer: &Linear, x: &Tensor, slope: f32) -> Result<Tensor> {
    let mut dims = x.dims().to_vec();
    let (output, input) = layer.weight().dims2()?;
    let product = x.contiguous()?.reshape(((), input))?.matmul(&layer.weight().t()?)?;
    let product = match layer.bias() {
        Some(bias) => rectified(&product, bias, slope)?,
        None => rectified(&product, &Tensor::zeros(output, x.dtype(), x.device())?, slope)?,
    };
    if let Some(last) = dims.last_mut() {
        *last = output;
    }
    product.reshape(dims)
}

/// `x` `[rows, columns]` plus `bias` `[columns]`, what is below 0 times `slope`: 0 for ReLU, 1 for nothing.
pub(crate) fn rectified(x: &Tensor, bias: &Tensor, slope: f32) -> Result<Tensor> {
    if x.device().is_cpu() {
        return x.contiguous()?.apply_op2(&bias.contiguous()?, Rectified { slope });
    }
    in_graph(x, bias, slope)
}

/// The same from candle's operations: for other devices, and to test against.
fn in_graph(x: &Tensor, bias: &Tensor, slope: f32) -> Result<Tensor> {
    let x = x.broadcast_add(bias)?;
    if slope == 1. { Ok(x) } else { candle_nn::ops::leaky_relu(&x, slope.into()) }
}

#[derive(Debug)]
struct Rectified {
    slope: f32,
}

impl CustomOp2 for Rectified {
    fn name(&self) -> &'static str {
        "rectified-rows"
    }

    fn cpu_fwd(&self, s1: &CpuStorage, l1: &Layout, s2: &CpuStorage, l2: &Layout) -> Result<(CpuStorage, Shape)> {
        let (x, bias, slope) = (slice(s1, l1)?, slice(s2, l2)?, self.slope);
        let mut y = Vec::with_capacity(x.len());
        for row in x.chunks_exact(bias.len().max(1)) {
            y.extend(row.iter().zip(bias).map(|(x, bias)| {
                let sum = x + bias;
                if sum > 0. { sum } else { slope * sum }
            }));
        }
        Ok((CpuStorage::F32(y), l1.shape().clone()))
    }

    fn bwd(&self, _: &Tensor, bias: &Tensor, res: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let grad = grad.contiguous()?;
        let dx =
            if self.slope == 1. { grad } else { grad.apply_op2_no_bwd(&res.detach(), &Below { slope: self.slope })? };
        let dbias = dx.apply_op1_no_bwd(&Columns(bias.elem_count()))?;
        Ok((Some(dx), Some(dbias)))
    }
}

/// A gradient times the rectifier's slope at a result.
#[derive(Debug)]
struct Below {
    slope: f32,
}

impl CustomOp2 for Below {
    fn name(&self) -> &'static str {
        "rectified-rows-adjoint"
    }

    fn cpu_fwd(&self, s1: &CpuStorage, l1: &Layout, s2: &CpuStorage, l2: &Layout) -> Result<(CpuStorage, Shape)> {
        let (grad, y, slope) = (slice(s1, l1)?, slice(s2, l2)?, self.slope);
        // A slope of 0 or more keeps the side.
        let dx = grad.iter().zip(y).map(|(grad, y)| if *y > 0. { *grad } else { slope * grad }).collect();
        Ok((CpuStorage::F32(dx), l1.shape().clone()))
    }
}

/// Sums of this many columns.
#[derive(Debug)]
struct Columns(usize);

impl CustomOp1 for Columns {
    fn name(&self) -> &'static str {
        "sum-rows"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (values, columns) = (slice(storage, layout)?, self.0.max(1));
        let row = |at: usize, sums: &mut [f32]| add_row(sums, &values[at..at + columns]);
        let sums = sum_rows(values.len() / columns, columns, row);
        Ok((CpuStorage::F32(sums), self.0.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn values_and_gradients_are_those_of_the_graph() {
        let numbers = |shape: &[usize], from: f32| {
            let count = shape.iter().product::<usize>();
            let values: Vec<f32> = (0..count).map(|i| (from + 1.7 * i as f32).sin()).collect();
            Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
        };
        // More rows than a block has.
        let (x, bias) = (numbers(&[2 * BLOCK + 3, 5], 0.2), numbers(&[5], 1.1));
        let upstream = numbers(&[2 * BLOCK + 3, 5], 2.3);
        for slope in [0., 0.1, 1.] {
            let of = |y: Tensor| {
                let grads = (&y * upstream.as_tensor()).unwrap().sum_all().unwrap().backward().unwrap();
                [y, grads.get(&x).unwrap().clone(), grads.get(&bias).unwrap().clone()]
            };
            let ours = of(rectified(&x, &bias, slope).unwrap());
            for (ours, theirs) in ours.iter().zip(of(in_graph(&x, &bias, slope).unwrap())) {
                let off = (ours - theirs).unwrap().abs().unwrap().flatten_all().unwrap();
                let off = off.max(0).unwrap().to_scalar::<f32>().unwrap();
                assert!(off < 1e-4, "{slope}: {off}");
            }
        }
    }
}
