//! Two-dimensional Gaussians at every point of a future: the head, its density, its losses.

use std::f64::consts::TAU;

use candle_core::{D, Result, Tensor};

/// Largest size of the logarithm of 1/sigma: beyond it the density overflows.
const LOG_SCALE: f64 = 10.;
/// Largest size of a correlation.
const CORRELATION: f64 = 0.999;

/// A Gaussian at every point; leading dimensions are any, such as `[batch, modes, points]`.
///
/// Lengths are in the network's unit, the first axis to the right, the second forward.
#[derive(Clone, Debug)]
pub(crate) struct Gaussians {
    /// Mean, `[.., 2]`.
    pub(crate) mean: Tensor,
    /// Logarithm of 1/sigma by axis, `[.., 2]`. The published head gives 1/sigma, not sigma.
    log_scale: Tensor,
    /// Correlation, `[.., 1]`.
    rho: Tensor,
}

impl Gaussians {
    /// From the five numbers that a head gives, `[.., points, 5]`: means, logarithms of 1/sigma, and what
    /// the hyperbolic tangent makes a correlation of (Deo and Trivedi 2018).
    pub(crate) fn from_head(raw: &Tensor) -> Result<Self> {
        Ok(Self {
            mean: raw.narrow(D::Minus1, 0, 2)?,
            log_scale: raw.narrow(D::Minus1, 2, 2)?.clamp(-LOG_SCALE, LOG_SCALE)?,
            rho: raw.narrow(D::Minus1, 4, 1)?.tanh()?.clamp(-CORRELATION, CORRELATION)?,
        })
    }

    /// The same with means that are steps from point to point, summed up along the points (PiP).
    pub(crate) fn from_steps(raw: &Tensor) -> Result<Self> {
        let mut gaussians = Self::from_head(raw)?;
        gaussians.mean = gaussians.mean.contiguous()?.cumsum(gaussians.mean.rank() - 2)?;
        Ok(gaussians)
    }

    /// In the shape `[.., points]` of `dims` instead, which has as many points in all.
    pub(crate) fn reshape(self, dims: &[usize]) -> Result<Self> {
        let to = |x: &Tensor| {
            let mut dims = dims.to_vec();
            dims.push(x.dim(D::Minus1)?);
            x.contiguous()?.reshape(dims)
        };
        Ok(Self { mean: to(&self.mean)?, log_scale: to(&self.log_scale)?, rho: to(&self.rho)? })
    }

    /// Minus the logarithm of the density at `truth` `[.., 2]`, `[..]`; leading dimensions broadcast.
    pub(crate) fn nll(&self, truth: &Tensor) -> Result<Tensor> {
        let off = truth.broadcast_sub(&self.mean)?.broadcast_mul(&self.log_scale.exp()?)?;
        let (right, forward) = (off.narrow(D::Minus1, 0, 1)?, off.narrow(D::Minus1, 1, 1)?);
        let free = (1. - self.rho.sqr()?)?;
        let cross = (&right * &forward)?.broadcast_mul(&self.rho)?;
        let square = ((right.sqr()? + forward.sqr()?)? - (cross * 2.)?)?;
        let exponent = square.broadcast_div(&(&free * 2.)?)?;
        let size = (self.log_scale.sum_keepdim(D::Minus1)? - (free.log()? * 0.5)?)?;
        (exponent.broadcast_sub(&size)? + TAU.ln())?.squeeze(D::Minus1)
    }

    /// Squared distance of `truth` `[.., 2]` from the mean, `[..]`.
    pub(crate) fn squared_error(&self, truth: &Tensor) -> Result<Tensor> {
        truth.broadcast_sub(&self.mean)?.sqr()?.sum(D::Minus1)
    }
}

/// Minus the logarithm of a mixture's density, `[batch, points]`, from `nll` `[batch, modes, points]`
/// and the modes' log-probabilities `[batch, modes]`.
pub(crate) fn mixture_nll(nll: &Tensor, log_probability: &Tensor) -> Result<Tensor> {
    log_probability.unsqueeze(2)?.broadcast_sub(nll)?.log_sum_exp(1)?.neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    const HEAD: [f32; 5] = [0.4, -1.1, -0.3, 0.5, 0.7];

    fn head() -> Tensor {
        Tensor::new(&HEAD, &Device::Cpu).unwrap().reshape((1, 5)).unwrap()
    }

    #[test]
    fn the_density_sums_to_one_with_the_moments_it_names() {
        let gaussians = Gaussians::from_head(&head()).unwrap();
        let step = 0.05f64;
        let axis: Vec<f32> = (-200..=200).map(|i| (i as f64 * step) as f32).collect();
        let points: Vec<f32> = axis.iter().flat_map(|x| axis.iter().flat_map(|y| [*x, *y])).collect();
        let truth = Tensor::from_slice(&points, (axis.len() * axis.len(), 2), &Device::Cpu).unwrap();
        let density: Vec<f32> = gaussians.nll(&truth).unwrap().neg().unwrap().exp().unwrap().to_vec1().unwrap();
        let sum = |f: &dyn Fn(f64, f64) -> f64| {
            let terms = density.iter().zip(points.chunks(2));
            terms.map(|(p, at)| f64::from(*p) * f(at[0].into(), at[1].into())).sum::<f64>() * step * step
        };
        let [mx, my, sx, sy, r] = HEAD.map(f64::from);
        assert!((sum(&|_, _| 1.) - 1.).abs() < 1e-4);
        assert!((sum(&|x, _| x) - mx).abs() < 1e-3);
        assert!((sum(&|_, y| y) - my).abs() < 1e-3);
        // 1/sigma is what the head gives: variances are exp(-2 s).
        assert!((sum(&|x, _| (x - mx).powi(2)) - (-2. * sx).exp()).abs() < 1e-2);
        let covariance = r.tanh() * (-sx - sy).exp();
        assert!((sum(&|x, y| (x - mx) * (y - my)) - covariance).abs() < 1e-2);
    }

    #[test]
    fn a_mixture_sums_to_one() {
        let raw =
            Tensor::new(&[HEAD, [-2., 1., 0.2, -0.1, -1.2]], &Device::Cpu).unwrap().reshape((1, 2, 1, 5)).unwrap();
        let gaussians = Gaussians::from_head(&raw).unwrap();
        let log_p = Tensor::new(&[[0.3f32, 0.7]], &Device::Cpu).unwrap().log().unwrap();
        let mut sum = 0f64;
        for i in -80..=80 {
            for j in -80..=80 {
                let at = Tensor::new(&[i as f32 * 0.1, j as f32 * 0.1], &Device::Cpu).unwrap();
                let nll = mixture_nll(&gaussians.nll(&at).unwrap(), &log_p).unwrap();
                sum += f64::from(-nll.flatten_all().unwrap().to_vec1::<f32>().unwrap()[0]).exp() * 0.01;
            }
        }
        assert!((sum - 1.).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn gradients_are_differences() {
        let raw = Var::from_tensor(&head()).unwrap();
        let truth = Tensor::new(&[[0.9f32, -0.2]], &Device::Cpu).unwrap();
        let nll = |raw: &Tensor| Gaussians::from_head(raw).unwrap().nll(&truth).unwrap().sum_all().unwrap();
        let grads = nll(raw.as_tensor()).backward().unwrap();
        let grad = grads.get(&raw).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        for i in 0..5 {
            let at = |delta: f32| {
                let mut moved = HEAD;
                moved[i] += delta;
                let raw = Tensor::new(&moved, &Device::Cpu).unwrap().reshape((1, 5)).unwrap();
                nll(&raw).to_scalar::<f32>().unwrap()
            };
            let difference = (at(5e-3) - at(-5e-3)) / 1e-2;
            assert!((difference - grad[i]).abs() < 5e-3 * (1. + difference.abs()), "{i}: {} {difference}", grad[i]);
        }
    }

    #[test]
    fn wild_numbers_stay_finite() {
        let raw = Tensor::new(&[[0f32, 0., 90., -90., 40.]], &Device::Cpu).unwrap();
        let truth = Tensor::new(&[[3f32, 3.]], &Device::Cpu).unwrap();
        let nll = Gaussians::from_head(&raw).unwrap().nll(&truth).unwrap().to_vec1::<f32>().unwrap();
        assert!(nll[0].is_finite(), "{nll:?}");
    }

    #[test]
    fn steps_add_up() {
        let raw = Tensor::new(&[[[1f32, 2., 0., 0., 0.], [3., -1., 0., 0., 0.]]], &Device::Cpu).unwrap();
        let mean = Gaussians::from_steps(&raw).unwrap().mean.to_vec3::<f32>().unwrap();
        assert_eq!(mean, [[[1., 2.], [4., 1.]]]);
    }
}
