//! Batch normalisation over the last dimension.

use candle_core::{CpuStorage, CustomOp3, D, Layout, Result, Shape, Tensor, Var};
use candle_nn::{Init, VarBuilder};
use gnp_nn::kernels::{add_rows, read, sum_rows, values};

/// Normalises each channel by the batch in training, by running statistics otherwise. These are
/// weights that no gradient moves.
#[derive(Clone, Debug)]
pub(crate) struct BatchNorm {
    weight: Tensor,
    bias: Tensor,
    running_mean: Tensor,
    running_var: Tensor,
}

/// Share of a new batch in the running statistics.
const MOMENTUM: f64 = 0.1;
const EPSILON: f64 = 1e-5;

impl BatchNorm {
    /// For `channels` channels, with PyTorch's names and first values.
    pub(crate) fn new(channels: usize, vb: &VarBuilder) -> Result<Self> {
        let get = |name, value| vb.get_with_hints(channels, name, Init::Const(value));
        Ok(Self {
            weight: get("weight", 1.)?,
            bias: get("bias", 0.)?,
            running_mean: get("running_mean", 0.)?,
            running_var: get("running_var", 1.)?,
        })
    }

    /// `x` `[.., channels]`, normalised.
    pub(crate) fn forward(&self, x: &Tensor, training: bool) -> Result<Tensor> {
        if !training {
            return self.scaled(x, &self.running_mean, &self.running_var);
        }
        let x = x.contiguous()?;
        let rows = x.elem_count() / x.dim(D::Minus1)?.max(1);
        if x.device().is_cpu() {
            let (mean, variance) = moments(&read(&x)?, rows);
            let tensor = |values: &[f32]| Tensor::from_slice(values, values.len(), x.device());
            let deviation = (tensor(&variance)? + EPSILON)?.sqrt()?.recip()?.to_vec1()?;
            self.remember(&tensor(&mean)?, &tensor(&variance)?, rows)?;
            return x.apply_op3(&self.weight, &self.bias, Normalise { mean, deviation });
        }
        let flat = x.reshape((rows, ()))?;
        let mean = flat.mean(0)?;
        let variance = flat.broadcast_sub(&mean)?.sqr()?.mean(0)?;
        self.remember(&mean.detach(), &variance.detach(), rows)?;
        self.scaled(&x, &mean, &variance)
    }

    fn scaled(&self, x: &Tensor, mean: &Tensor, variance: &Tensor) -> Result<Tensor> {
        let scale = (&self.weight / (variance + EPSILON)?.sqrt()?)?;
        x.broadcast_sub(mean)?.broadcast_mul(&scale)?.broadcast_add(&self.bias)
    }

    /// The batch's mean and variance enter the running ones.
    fn remember(&self, mean: &Tensor, variance: &Tensor, rows: usize) -> Result<()> {
        // The running variance is unbiased, as PyTorch keeps it.
        let unbiased = (variance * (rows as f64 / (rows as f64 - 1.).max(1.)))?;
        for (running, fresh) in [(&self.running_mean, mean), (&self.running_var, &unbiased)] {
            if running.is_variable() {
                let moved = ((running.detach() * (1. - MOMENTUM))? + (fresh * MOMENTUM)?)?;
                Var::from_tensor(running)?.set(&moved)?;
            }
        }
        Ok(())
    }
}

/// Mean and variance of every channel, each `[channels]`, of `x` `[rows, channels]`.
fn moments(x: &[f32], rows: usize) -> (Vec<f32>, Vec<f32>) {
    let (channels, scale) = (x.len() / rows.max(1), 1. / rows.max(1) as f32);
    let row = |row: usize| &x[row * channels..][..channels];
    let mut mean = sum_rows(rows, channels, |at, sums| add_rows(sums, row(at)));
    mean.iter_mut().for_each(|sum| *sum *= scale);
    let mut variance = sum_rows(rows, channels, |at, sums| {
        let row = row(at).iter().zip(&mean);
        sums.iter_mut().zip(row).for_each(|(sum, (x, mean))| *sum += (x - mean) * (x - mean));
    });
    variance.iter_mut().for_each(|sum| *sum *= scale);
    (mean, variance)
}

/// Brings `x` to mean 0 and deviation 1 by channel, then to `bias` and `weight`; the moments are its own,
/// and the gradient knows it.
#[derive(Debug)]
struct Normalise {
    mean: Vec<f32>,
    /// One over the standard deviation.
    deviation: Vec<f32>,
}

impl CustomOp3 for Normalise {
    fn name(&self) -> &'static str {
        "batch-norm"
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
        let (x, weight, bias) = (values(s1, l1)?, values(s2, l2)?, values(s3, l3)?);
        let scale: Vec<f32> = weight.iter().zip(&self.deviation).map(|(w, d)| w * d).collect();
        let shift: Vec<f32> = bias.iter().zip(self.mean.iter().zip(&scale)).map(|(b, (m, s))| b - m * s).collect();
        let mut y = Vec::with_capacity(x.len());
        for row in x.chunks_exact(scale.len().max(1)) {
            y.extend(row.iter().zip(scale.iter().zip(&shift)).map(|(x, (scale, shift))| x * scale + shift));
        }
        Ok((CpuStorage::F32(y), l1.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        _: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let Self { mean, deviation } = self;
        let grad = grad.contiguous()?;
        let (values, grad, scale) = (read(x)?, read(&grad)?, read(weight)?);
        let channels = mean.len();
        let rows = values.len() / channels.max(1);
        // By channel, the sum of the gradient and of the gradient times the normalised value.
        let sums = sum_rows(rows, 2 * channels, |row, sums| {
            let (x, grad) = (&values[row * channels..][..channels], &grad[row * channels..][..channels]);
            let (plain, bent) = sums.split_at_mut(channels);
            for c in 0..channels {
                plain[c] += grad[c];
                bent[c] += grad[c] * (x[c] - mean[c]) * deviation[c];
            }
        });
        let (share, (plain, bent)) = (1. / rows.max(1) as f32, sums.split_at(channels));
        let mut dx = vec![0f32; values.len()];
        let lines = values.chunks_exact(channels.max(1)).zip(grad.chunks_exact(channels.max(1)));
        for (dx, (x, grad)) in dx.chunks_exact_mut(channels.max(1)).zip(lines) {
            for c in 0..channels {
                let bend = (x[c] - mean[c]) * deviation[c] * bent[c];
                dx[c] = scale[c] * deviation[c] * (grad[c] - share * (plain[c] + bend));
            }
        }
        let tensor = |values: &[f32]| Tensor::from_slice(values, channels, x.device()).map(Some);
        Ok((Some(Tensor::from_vec(dx, x.shape(), x.device())?), tensor(bent)?, tensor(plain)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;
    use gnp_nn::Weights;

    #[test]
    fn a_batch_is_normalised_and_remembered() {
        let weights = Weights::seeded(1, &Device::Cpu);
        let norm = BatchNorm::new(1, &weights.builder()).unwrap();
        let x = Tensor::new(&[[1f32], [3.], [5.]], &Device::Cpu).unwrap();
        let y = norm.forward(&x, true).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let root = (8f32 / 3. + 1e-5).sqrt();
        for (y, expected) in y.iter().zip([-2. / root, 0., 2. / root]) {
            assert!((y - expected).abs() < 1e-6, "{y} {expected}");
        }
        let named = weights.named();
        let value = |name: &str| named[name].to_vec1::<f32>().unwrap()[0];
        assert!((value("running_mean") - 0.3).abs() < 1e-6);
        assert!((value("running_var") - (0.9 + 0.1 * 4.)).abs() < 1e-6);
        // Otherwise the running ones are used, and stay.
        let y = norm.forward(&x, false).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert!((y[0] - 0.7 / (1.3f32 + 1e-5).sqrt()).abs() < 1e-5);
        assert!((value("running_mean") - 0.3).abs() < 1e-6);
    }
}
