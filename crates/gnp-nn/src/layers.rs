//! Linear, layer norm and multi-layer perceptron, initialised as PyTorch does.

use candle_core::{D, Result, Tensor};
use candle_nn::{Init, Module, VarBuilder};

use crate::kernels::NORM_EPSILON;

/// An affine map; its weight is `[out, in]` and its bias `[out]`, as PyTorch stores them.
pub use candle_nn::Linear;

/// A linear layer under `vb`, weights and bias uniform in `+-1/sqrt(input)` (PyTorch's default).
///
/// # Errors
/// When `vb` holds weights of another shape under these names.
pub fn linear(input: usize, output: usize, vb: VarBuilder) -> Result<Linear> {
    let init = uniform(input);
    let weight = vb.get_with_hints((output, input), "weight", init)?;
    let bias = vb.get_with_hints(output, "bias", init)?;
    Ok(Linear::new(weight, Some(bias)))
}

pub(crate) fn uniform(fan_in: usize) -> Init {
    let bound = 1. / (fan_in.max(1) as f64).sqrt();
    Init::Uniform { lo: -bound, up: bound }
}

/// Layer norm over the last dimension that passes gradients, unlike `candle_nn::layer_norm`.
#[derive(Clone, Debug)]
pub struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
}

/// A layer norm of `width` values under `vb`, starting as weight 1, bias 0.
///
/// # Errors
/// When `vb` holds weights of another shape under these names.
pub fn layer_norm(width: usize, vb: VarBuilder) -> Result<LayerNorm> {
    let weight = vb.get_with_hints(width, "weight", Init::Const(1.))?;
    let bias = vb.get_with_hints(width, "bias", Init::Const(0.))?;
    Ok(LayerNorm { weight, bias })
}

impl LayerNorm {
    /// Weight and bias, each `[width]`, for operations that normalise themselves.
    #[must_use]
    pub fn affine(&self) -> (&Tensor, &Tensor) {
        (&self.weight, &self.bias)
    }
}

impl Module for LayerNorm {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let x = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
        let deviation = (x.sqr()?.mean_keepdim(D::Minus1)? + NORM_EPSILON)?.sqrt()?;
        x.broadcast_div(&deviation)?.broadcast_mul(&self.weight)?.broadcast_add(&self.bias)
    }
}

/// Linear layers with ReLU between them and none after the last.
#[derive(Clone, Debug)]
pub struct Mlp {
    layers: Vec<Linear>,
}

impl Mlp {
    /// One linear layer for each neighbouring pair of `widths`, named `0`, `2`, `4`, ... as in a
    /// PyTorch `Sequential` with ReLU between.
    ///
    /// # Errors
    /// When `vb` holds weights of another shape under these names.
    pub fn new(widths: &[usize], vb: VarBuilder) -> Result<Self> {
        let layers = widths
            .windows(2)
            .enumerate()
            .map(|(i, pair)| linear(pair[0], pair[1], vb.pp(2 * i)))
            .collect::<Result<_>>()?;
        Ok(Self { layers })
    }

    /// The layers in order.
    #[must_use]
    pub fn layers(&self) -> &[Linear] {
        &self.layers
    }
}

impl Module for Mlp {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let mut x = x.clone();
        for (i, layer) in self.layers.iter().enumerate() {
            if i > 0 {
                x = x.relu()?;
            }
            x = layer.forward(&x)?;
        }
        Ok(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lstm, Weights};
    use candle_core::{Device, Var};

    /// Every gradient of `f` with respect to `x` and `weights` against a central difference.
    fn check(weights: &Weights, x: &Var, f: impl Fn(&Tensor) -> Result<Tensor>) -> Result<()> {
        let loss = |x: &Tensor| f(x)?.sqr()?.sum_all();
        let grads = loss(x.as_tensor())?.backward()?;
        let mut all: Vec<(String, Var)> = weights.named().into_iter().collect();
        all.push(("input".to_owned(), x.clone()));
        for (name, var) in all {
            let grad = grads.get(&var).unwrap_or_else(|| panic!("no gradient for {name}"));
            let (grad, value) = (grad.flatten_all()?.to_vec1::<f32>()?, var.flatten_all()?.to_vec1::<f32>()?);
            for i in 0..value.len() {
                let at = |delta: f32| -> Result<f32> {
                    let mut moved = value.clone();
                    moved[i] += delta;
                    var.set(&Tensor::from_vec(moved, var.shape(), &Device::Cpu)?)?;
                    loss(x.as_tensor())?.to_scalar::<f32>()
                };
                let difference = (at(1e-2)? - at(-1e-2)?) / 2e-2;
                var.set(&Tensor::from_slice(&value, var.shape(), &Device::Cpu)?)?;
                assert!(
                    (difference - grad[i]).abs() < 1e-2 * (1. + grad[i].abs()),
                    "{name}[{i}]: {} by backward, {difference} by difference",
                    grad[i]
                );
            }
        }
        Ok(())
    }

    fn input() -> Result<Var> {
        Var::from_tensor(&Tensor::new(&[[0.3f32, -1.2, 0.7], [0.1, 0.4, -0.6]], &Device::Cpu)?)
    }

    #[test]
    fn layer_norm_passes_its_gradients() -> Result<()> {
        let weights = Weights::seeded(1, &Device::Cpu);
        let norm = layer_norm(3, weights.builder().pp("norm"))?;
        let mix = linear(3, 2, weights.builder().pp("mix"))?;
        check(&weights, &input()?, |x| mix.forward(&norm.forward(x)?))
    }

    #[test]
    fn lstm_passes_its_gradients_through_two_steps() -> Result<()> {
        let weights = Weights::seeded(2, &Device::Cpu);
        let cell = Lstm::new(3, 2, weights.builder().pp("cell"))?;
        check(&weights, &input()?, |x| {
            let state = cell.step(x, None)?;
            Ok(cell.step(x, Some(&state))?.h)
        })
    }

    #[test]
    fn mlp_has_the_names_of_a_sequential() -> Result<()> {
        let weights = Weights::seeded(3, &Device::Cpu);
        let mlp = Mlp::new(&[3, 5, 2], weights.builder().pp("head"))?;
        assert_eq!(mlp.forward(input()?.as_tensor())?.dims(), [2, 2]);
        let names: Vec<String> = weights.named().into_keys().collect();
        assert_eq!(names, ["head.0.bias", "head.0.weight", "head.2.bias", "head.2.weight"]);
        Ok(())
    }
}
