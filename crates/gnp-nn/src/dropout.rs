//! Dropout whose masks repeat: candle's own generator cannot be seeded.

use candle_core::{Result, Tensor};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Inverted dropout with a generator of its own; one for a training step, none for inference.
#[derive(Debug)]
pub struct Dropout {
    rate: f32,
    rng: ChaCha8Rng,
}

impl Dropout {
    /// Drops a share `rate` (0 to below 1) of the values, from a stream fixed by `seed`.
    #[must_use]
    pub fn new(rate: f32, seed: u64) -> Self {
        Self { rate: rate.clamp(0., 0.99), rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// `x` with dropped values set to 0 and the others scaled by `1 / (1 - rate)`; any shape.
    ///
    /// # Errors
    /// When candle cannot make or multiply the mask.
    pub fn apply(&mut self, x: &Tensor) -> Result<Tensor> {
        if self.rate == 0. {
            return Ok(x.clone());
        }
        let kept = 1. / (1. - self.rate);
        let mask: Vec<f32> =
            (0..x.elem_count()).map(|_| if self.rng.random::<f32>() < self.rate { 0. } else { kept }).collect();
        x * Tensor::from_vec(mask, x.shape(), x.device())?
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{DType, Device};

    #[test]
    fn masks_repeat_with_the_seed_and_keep_the_mean() -> Result<()> {
        let x = Tensor::ones((100, 100), DType::F32, &Device::Cpu)?;
        let once = Dropout::new(0.1, 3).apply(&x)?.flatten_all()?.to_vec1::<f32>()?;
        let again = Dropout::new(0.1, 3).apply(&x)?.flatten_all()?.to_vec1::<f32>()?;
        assert_eq!(once, again);
        let mean = once.iter().sum::<f32>() / once.len() as f32;
        assert!((mean - 1.).abs() < 0.02, "{mean}");
        Ok(())
    }
}
