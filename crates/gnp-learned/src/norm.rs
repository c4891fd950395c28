//! Batch normalisation over the last dimension.

use candle_core::{D, Result, Tensor, Var};
use candle_nn::{Init, VarBuilder};

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
        let (mean, variance) =
            if training { self.batch(x)? } else { (self.running_mean.clone(), self.running_var.clone()) };
        let scale = (&self.weight / (variance + EPSILON)?.sqrt()?)?;
        x.broadcast_sub(&mean)?.broadcast_mul(&scale)?.broadcast_add(&self.bias)
    }

    /// The batch's mean and variance, which enter the running ones.
    fn batch(&self, x: &Tensor) -> Result<(Tensor, Tensor)> {
        let flat = x.contiguous()?.reshape(((), x.dim(D::Minus1)?))?;
        let mean = flat.mean(0)?;
        let variance = flat.broadcast_sub(&mean)?.sqr()?.mean(0)?;
        let rows = flat.dim(0)? as f64;
        // The running variance is unbiased, as PyTorch keeps it.
        let unbiased = (variance.detach() * (rows / (rows - 1.).max(1.)))?;
        for (running, fresh) in [(&self.running_mean, mean.detach()), (&self.running_var, unbiased)] {
            if running.is_variable() {
                let moved = ((running.detach() * (1. - MOMENTUM))? + (fresh * MOMENTUM)?)?;
                Var::from_tensor(running)?.set(&moved)?;
            }
        }
        Ok((mean, variance))
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
