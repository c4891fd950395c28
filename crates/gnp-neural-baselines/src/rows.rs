//! What candle does slowly on the CPU to rows of values: bias and rectifier as one operation whose
//! gradient adds up rows in memory order. candle's own sum over rows divides indices for every value.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor};
use candle_nn::Linear;
use gnp_nn::kernels::{add_rows, read, sum_rows, values};

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
        let (x, bias, slope) = (values(s1, l1)?, values(s2, l2)?, self.slope);
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
        let (grad, slope, columns) = (grad.contiguous()?, self.slope, bias.elem_count());
        let (values, y) = (read(&grad)?, read(res)?);
        // A slope of 0 or more keeps the side.
        let dx: Vec<f32> = values.iter().zip(&*y).map(|(grad, y)| if *y > 0. { *grad } else { slope * grad }).collect();
        let rows = dx.len() / columns.max(1);
        let dbias = sum_rows(rows, columns, |row, sums| add_rows(sums, &dx[row * columns..][..columns]));
        let tensor = |values, of: &Tensor| Tensor::from_vec(values, of.shape(), of.device()).map(Some);
        Ok((tensor(dx, res)?, tensor(dbias, bias)?))
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
        // More rows than are added up at once.
        const ROWS: usize = 515;
        let (x, bias) = (numbers(&[ROWS, 5], 0.2), numbers(&[5], 1.1));
        let upstream = numbers(&[ROWS, 5], 2.3);
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
