//! Dropout whose masks repeat: candle's own generator cannot be seeded.

use candle_core::{Result, Tensor};

/// Inverted dropout with a generator of its own; one for a training run, none for inference.
///
/// A mask is a hash of its number and the index of the value, not a stream: any thread can work out
/// any part of it, in the forward pass and again in the backward pass, for a few instructions a
/// value.
#[derive(Clone, Debug)]
pub struct Dropout {
    rate: f32,
    seed: u64,
    drawn: u64,
}

impl Dropout {
    /// Drops a share `rate` (0 to below 1) of the values; the masks are fixed by `seed`.
    #[must_use]
    pub fn new(rate: f32, seed: u64) -> Self {
        Self { rate: rate.clamp(0., 0.99), seed, drawn: 0 }
    }

    /// `x` with dropped values set to 0 and the others scaled by `1 / (1 - rate)`; any shape.
    ///
    /// # Errors
    /// When candle cannot make or multiply the mask.
    pub fn apply(&mut self, x: &Tensor) -> Result<Tensor> {
        self.draw().apply(x)
    }

    /// The next mask, for operations that apply it themselves.
    pub fn draw(&mut self) -> DropoutMask {
        let key = splitmix(self.seed ^ splitmix(self.drawn));
        self.drawn += 1;
        DropoutMask {
            low: key as u32,
            high: (key >> 32) as u32,
            // Values are kept where a uniform 32-bit hash reaches this; rate 0 keeps all.
            dropped_below: (f64::from(self.rate) * 4_294_967_296.) as u32,
            kept: 1. / (1. - self.rate),
        }
    }
}

/// One mask of a [`Dropout`].
#[derive(Clone, Copy, Debug)]
pub struct DropoutMask {
    low: u32,
    high: u32,
    dropped_below: u32,
    kept: f32,
}

impl DropoutMask {
    /// A mask that keeps everything as it is.
    pub const NONE: Self = Self { low: 0, high: 0, dropped_below: 0, kept: 1. };

    /// Whether it keeps everything as it is.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.dropped_below == 0
    }

    /// `x` with the mask applied; any shape.
    ///
    /// # Errors
    /// When candle cannot make or multiply the mask.
    pub fn apply(&self, x: &Tensor) -> Result<Tensor> {
        if self.is_none() {
            return Ok(x.clone());
        }
        let mask: Vec<f32> = (0..x.elem_count()).map(|i| self.factor(i)).collect();
        x * Tensor::from_vec(mask, x.shape(), x.device())?
    }

    /// What value `i` in row-major order is multiplied with: 0 or `1 / (1 - rate)`.
    #[must_use]
    #[inline(always)]
    pub fn factor(&self, i: usize) -> f32 {
        // The "lowbias32" mixer, keyed before and in the middle so that no mask is another, shifted.
        let mut x = (i as u32) ^ self.low;
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_add(self.high).wrapping_mul(0x846c_a68b);
        if (x ^ (x >> 16)) < self.dropped_below { 0. } else { self.kept }
    }
}

/// The output function of the SplitMix64 generator: neighbouring numbers become unrelated ones.
fn splitmix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
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

    #[test]
    fn masks_of_a_run_are_unrelated() {
        let mut dropout = Dropout::new(0.5, 8);
        let masks: Vec<DropoutMask> = (0..6).map(|_| dropout.draw()).collect();
        let n = 40_000;
        for (a, first) in masks.iter().enumerate() {
            for second in &masks[a + 1..] {
                let both = (0..n).filter(|i| first.factor(*i) > 0. && second.factor(*i) > 0.).count();
                // A quarter, five standard deviations either way.
                assert!((both as f64 - 10_000.).abs() < 5. * (n as f64 * 3. / 16.).sqrt(), "{both}");
            }
            let runs = (1..n).filter(|i| first.factor(i - 1) == first.factor(*i)).count();
            assert!((runs as f64 - 20_000.).abs() < 5. * (n as f64 / 4.).sqrt(), "{runs}");
        }
    }

    #[test]
    fn no_rate_no_change() -> Result<()> {
        let x = Tensor::new(&[0.3f32, -1.2], &Device::Cpu)?;
        assert_eq!(Dropout::new(0., 1).apply(&x)?.to_vec1::<f32>()?, [0.3, -1.2]);
        assert!(Dropout::new(0., 1).draw().is_none());
        assert_eq!(DropoutMask::NONE.factor(7), 1.);
        Ok(())
    }
}
