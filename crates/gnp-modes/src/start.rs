//! Starting centres by k-means++ (Arthur and Vassilvitskii 2007).
//!
//! kmeans' own start takes a generator that we cannot seed from our version of `rand`, compares each
//! sample with all centres chosen so far for every new one, and panics when no different sample is
//! left. This one keeps each sample's distance to the nearest centre and says how many there are.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::distance::squared_distance;

/// `k` centres out of `samples` `[n, dims]`, each drawn with a probability proportional to its
/// squared distance to the nearest centre before it.
///
/// # Errors
/// The number of different samples, when it is below `k`.
pub(crate) fn plus_plus(samples: &[f32], dims: usize, k: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f32>, usize> {
    let count = samples.len() / dims;
    let mut centres = Vec::with_capacity(k * dims);
    let mut nearest = vec![f32::INFINITY; count];
    let mut chosen = rng.random_range(0..count);
    for found in 1..=k {
        let centre = &samples[chosen * dims..(chosen + 1) * dims];
        centres.extend_from_slice(centre);
        if found == k {
            break;
        }
        nearest
            .par_iter_mut()
            .zip(samples.par_chunks_exact(dims))
            .for_each(|(nearest, sample)| *nearest = nearest.min(squared_distance(sample, centre)));
        // One sum in sample order: the same on any number of threads.
        let total: f64 = nearest.iter().copied().map(f64::from).sum();
        if total <= 0. {
            return Err(found);
        }
        let mut left = rng.random_range(0. ..total);
        // Rounding may leave a remainder past the last sample: then it is the last with any weight.
        for (i, distance) in nearest.iter().enumerate().filter(|(_, distance)| **distance > 0.) {
            chosen = i;
            left -= f64::from(*distance);
            if left < 0. {
                break;
            }
        }
    }
    Ok(centres)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn centres_are_different_samples() {
        let samples: Vec<f32> = (0..40).map(|i| (i % 4) as f32).collect();
        for seed in 0..20 {
            let mut centres = plus_plus(&samples, 1, 4, &mut ChaCha8Rng::seed_from_u64(seed)).unwrap();
            centres.sort_by(f32::total_cmp);
            assert_eq!(centres, [0., 1., 2., 3.]);
        }
    }

    #[test]
    fn too_few_different_samples_are_counted() {
        let samples: Vec<f32> = (0..60).map(|i| (i % 3) as f32).collect();
        assert_eq!(plus_plus(&samples, 1, 4, &mut ChaCha8Rng::seed_from_u64(1)), Err(3));
    }
}
