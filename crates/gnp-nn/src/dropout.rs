//! Dropout whose masks repeat: candle's own generator cannot be seeded.

use candle_core::{D, DType, Device, Result, Tensor};

use crate::launch::LaunchCache;

/// Inverted dropout with a generator of its own; one for a training run, none for inference.
///
/// A mask is a hash of its number and the index of the value, not a stream: any thread can work out
/// any part of it, in the forward pass and again in the backward pass, for a few instructions a
/// value. On a GPU masks are made there, of other hashes: the same seed gives the same masks on every GPU, but not those
/// of the CPU.
#[derive(Clone, Debug)]
pub struct Dropout {
    rate: f32,
    seed: u64,
    drawn: u64,
    first: usize,
}

impl Dropout {
    /// Drops a share `rate` (0 to below 1) of the values; the masks are fixed by `seed`.
    #[must_use]
    pub fn new(rate: f32, seed: u64) -> Self {
        Self { rate: rate.clamp(0., 0.99), seed, drawn: 0, first: 0 }
    }

    /// The same for windows of a batch from window `first` on: each has the masks that it has in the whole batch. On the
    /// CPU alone.
    #[must_use]
    pub fn from_window(self, first: usize) -> Self {
        Self { first, ..self }
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
            first: self.first,
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
    first: usize,
}

impl DropoutMask {
    /// A mask that keeps everything as it is.
    pub const NONE: Self = Self { low: 0, high: 0, dropped_below: 0, kept: 1., first: 0 };

    /// Whether it keeps everything as it is.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.dropped_below == 0
    }

    /// Place in the batch of the first window that it is for ([`Dropout::from_window`]).
    #[must_use]
    pub fn first_window(&self) -> usize {
        self.first
    }

    /// `x` `[windows, ..]` with the mask applied.
    ///
    /// # Errors
    /// When candle cannot make or multiply the mask, or on a GPU for windows that are not the first of their batch.
    pub fn apply(&self, x: &Tensor) -> Result<Tensor> {
        if self.is_none() {
            return Ok(x.clone());
        }
        if x.device().is_cuda() {
            if self.first > 0 {
                candle_core::bail!("on a GPU a mask begins with the first window of a batch, not with {}", self.first);
            }
            let width = x.dim(D::Minus1)?;
            return x * self.outer(x.elem_count() / width.max(1), width, x.device())?.reshape(x.shape())?;
        }
        let first = self.first * x.dims().iter().skip(1).product::<usize>();
        let mask: Vec<f32> = (first..first + x.elem_count()).map(|i| self.factor(i)).collect();
        x * Tensor::from_vec(mask, x.shape(), x.device())?
    }

    /// Factors `[rows, width]` made on `device`, to which only a key for each row and each column goes.
    ///
    /// The fraction of the product of two random numbers of many binary places is uniform, and independent of that of
    /// any other pair. Each operation is exact or rounds once, so that every device gives the same bits.
    fn outer(&self, rows: usize, width: usize, device: &Device) -> Result<Tensor> {
        // Fewer would be kept for ever by a launch cache.
        let count = (rows + width).max(LaunchCache::KEPT / size_of::<f64>() + 1);
        let key = |i: usize| 1024. + f64::from(self.hash(i)) / f64::from(1 << 22);
        let keys = Tensor::from_vec((0..count).map(key).collect::<Vec<f64>>(), count, device)?;
        let (of_rows, of_columns) = (keys.narrow(0, 0, rows)?, keys.narrow(0, rows, width)?);
        let product = of_rows.reshape((rows, 1))?.broadcast_mul(&of_columns.reshape((1, width))?)?;
        let uniform = (&product - product.floor()?)?;
        // 1 where the uniform number is above the rate, else 0.
        let kept = (uniform - f64::from(self.dropped_below) / 4_294_967_296.)?.ceil()?;
        kept.to_dtype(DType::F32)? * f64::from(self.kept)
    }

    /// What value `i` in row-major order is multiplied with: 0 or `1 / (1 - rate)`.
    #[must_use]
    #[inline(always)]
    pub fn factor(&self, i: usize) -> f32 {
        if self.hash(i) < self.dropped_below { 0. } else { self.kept }
    }

    #[inline(always)]
    fn hash(&self, i: usize) -> u32 {
        // The "lowbias32" mixer, keyed before and in the middle so that no mask is another, shifted.
        let mut x = (i as u32) ^ self.low;
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_add(self.high).wrapping_mul(0x846c_a68b);
        x ^ (x >> 16)
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

    /// Six masks of `rows * width` values each, in the form of CPUs and in that of GPUs.
    fn masks(rate: f32, rows: usize, width: usize) -> [Vec<Vec<f32>>; 2] {
        let mut dropout = Dropout::new(rate, 8);
        let drawn: Vec<DropoutMask> = (0..6).map(|_| dropout.draw()).collect();
        let outer = |mask: &DropoutMask| {
            mask.outer(rows, width, &Device::Cpu).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
        };
        let each = |mask: &DropoutMask| (0..rows * width).map(|i| mask.factor(i)).collect();
        [drawn.iter().map(each).collect(), drawn.iter().map(outer).collect()]
    }

    #[test]
    fn masks_of_a_run_are_unrelated() {
        let (rows, width) = (625, 64);
        let n = rows * width;
        for masks in masks(0.5, rows, width) {
            for (a, first) in masks.iter().enumerate() {
                for second in &masks[a + 1..] {
                    let both = first.iter().zip(second).filter(|(a, b)| **a > 0. && **b > 0.).count();
                    // A quarter, five standard deviations either way.
                    assert!((both as f64 - 10_000.).abs() < 5. * (n as f64 * 3. / 16.).sqrt(), "{both}");
                }
                for apart in [1, width, width + 1, 7 * width] {
                    let same = (apart..n).filter(|i| first[i - apart] == first[*i]).count() as f64;
                    let expected = (n - apart) as f64 / 2.;
                    assert!((same - expected).abs() < 5. * (n as f64 / 4.).sqrt(), "{apart} apart: {same}");
                }
            }
        }
    }

    #[test]
    fn the_dropped_share_is_the_rate_in_both_forms() {
        for masks in masks(0.1, 400, 32) {
            let (dropped, kept): (Vec<f32>, Vec<f32>) = masks.concat().into_iter().partition(|factor| *factor == 0.);
            let share = dropped.len() as f64 / (dropped.len() + kept.len()) as f64;
            // Five standard deviations of 76,800 draws.
            assert!((share - 0.1).abs() < 0.0055, "{share}");
            assert!(kept.iter().all(|factor| (factor - 1. / 0.9).abs() < 1e-6));
        }
    }

    #[test]
    fn windows_of_a_part_have_the_masks_that_they_have_in_the_batch() -> Result<()> {
        let x = Tensor::ones((7, 3, 5), DType::F32, &Device::Cpu)?;
        let whole = Dropout::new(0.5, 3).apply(&x)?;
        let part = Dropout::new(0.5, 3).from_window(4).apply(&x.narrow(0, 4, 3)?)?;
        assert_eq!(part.to_vec3::<f32>()?, whole.narrow(0, 4, 3)?.to_vec3::<f32>()?);
        Ok(())
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
