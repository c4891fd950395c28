//! The last Lloyd iterations, with sums in f64 and in sample order.
//!
//! kmeans adds the samples of a cluster in f32 and fills a cluster that ran empty with the farthest
//! sample, and it stops on a sum of squares in f32. From its centres these iterations go on to a
//! fixed point, so that sizes, inertia and centres belong together.

use rayon::prelude::*;

use crate::distance::nearest;

/// Clusters after the last iteration.
#[derive(Debug)]
pub(crate) struct Clusters {
    /// `[k, dims]`.
    pub(crate) centres: Vec<f32>,
    /// Samples of each cluster; a zero where it is empty.
    pub(crate) sizes: Vec<usize>,
    /// Sum of squared distances to the own centre.
    pub(crate) inertia: f64,
    /// No sample changed its cluster in the last iteration.
    pub(crate) converged: bool,
}

/// Lloyd iterations from `centres` until no sample changes its cluster, `max_iterations` at most.
pub(crate) fn settle(samples: &[f32], dims: usize, mut centres: Vec<f32>, max_iterations: usize) -> Clusters {
    let mut assigned = assign(samples, dims, &centres);
    let mut converged = false;
    for _ in 0..max_iterations {
        centres = means(samples, dims, &assigned, centres);
        let next = assign(samples, dims, &centres);
        converged = next.iter().zip(&assigned).all(|(a, b)| a.0 == b.0);
        assigned = next;
        if converged {
            break;
        }
    }
    let mut sizes = vec![0; centres.len() / dims];
    for (cluster, _) in &assigned {
        sizes[*cluster] += 1;
    }
    let inertia = assigned.iter().map(|(_, distance)| f64::from(*distance)).sum();
    Clusters { centres, sizes, inertia, converged }
}

/// Each sample's nearest centre, the first among equals, and the squared distance to it.
fn assign(samples: &[f32], dims: usize, centres: &[f32]) -> Vec<(usize, f32)> {
    samples.par_chunks_exact(dims).map(|sample| nearest(sample, centres)).collect()
}

/// The mean of each cluster; an empty one keeps its centre.
fn means(samples: &[f32], dims: usize, assigned: &[(usize, f32)], mut centres: Vec<f32>) -> Vec<f32> {
    let mut sums = vec![0f64; centres.len()];
    let mut sizes = vec![0u64; centres.len() / dims];
    for (sample, (cluster, _)) in samples.chunks_exact(dims).zip(assigned) {
        sizes[*cluster] += 1;
        for (sum, x) in sums[cluster * dims..(cluster + 1) * dims].iter_mut().zip(sample) {
            *sum += f64::from(*x);
        }
    }
    let clusters = centres.chunks_exact_mut(dims).zip(sums.chunks_exact(dims)).zip(sizes);
    for ((centre, sum), size) in clusters.filter(|(_, size)| *size > 0) {
        for (c, s) in centre.iter_mut().zip(sum) {
            *c = (s / size as f64) as f32;
        }
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_settles_on_the_means() {
        let clusters = settle(&[0., 1., 10., 12.], 1, vec![0., 1.], 20);
        assert_eq!(clusters.centres, [0.5, 11.]);
        assert_eq!(clusters.sizes, [2, 2]);
        assert_eq!(clusters.inertia, 0.5 + 2.);
        assert!(clusters.converged);
    }

    #[test]
    fn a_limit_that_is_too_low_is_admitted() {
        let samples: Vec<f32> = (0..50).map(|i| (i * i) as f32).collect();
        assert!(!settle(&samples, 1, vec![0., 1., 2., 3.], 1).converged);
    }
}
