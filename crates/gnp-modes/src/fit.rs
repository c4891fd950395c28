//! From futures to modes.

use kmeans::{EuclideanDistance, KMeans, KMeansConfig};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::error::ModeError;
use crate::lloyd::{Clusters, settle};
use crate::modes::Modes;
use crate::normalise::ModeFrame;
use crate::params::{FARTHEST, ModeParams};
use crate::start::plus_plus;

/// Clusters `futures` `[n, t_pred, 2]`, in m and already in `frame`, into `params.modes` modes by
/// k-means: starts by k-means++, iterations by the `kmeans` crate, the last ones in f64.
///
/// The same seed gives the same bits on any number of threads: threads only share out samples, and
/// every sum is taken in sample order.
///
/// # Errors
/// A parameter out of range; futures that are not `[n, t_pred, 2]`; a coordinate that is no position;
/// fewer different futures than modes; an empty cluster from every start.
pub fn fit(futures: &[f32], t_pred: usize, frame: ModeFrame, params: &ModeParams) -> Result<Modes, ModeError> {
    params.check()?;
    let dims = 2 * t_pred;
    if dims == 0 || !futures.len().is_multiple_of(dims) {
        return Err(ModeError::Shape { found: futures.len(), t_pred });
    }
    let wrong = |v: &f32| !v.is_finite() || v.abs() > FARTHEST;
    if let Some(at) = futures.iter().position(wrong) {
        return Err(ModeError::Coordinate { sample: at / dims, step: at % dims / 2, value: futures[at] });
    }
    let samples = futures.len() / dims;
    if samples < params.modes {
        return Err(ModeError::TooFewDistinct { modes: params.modes, samples, distinct: distinct(futures, dims) });
    }
    let engine: KMeans<f32, 8, _> = KMeans::new(futures, samples, dims, EuclideanDistance);
    let mut best: Option<Clusters> = None;
    let mut abandoned = 0;
    for restart in 0..params.restarts {
        let mut rng = ChaCha8Rng::seed_from_u64(params.seed);
        rng.set_stream(restart as u64);
        let start = plus_plus(futures, dims, params.modes, &mut rng).map_err(|distinct| ModeError::TooFewDistinct {
            modes: params.modes,
            samples,
            distinct,
        })?;
        let rough = engine.kmeans_lloyd(
            params.modes,
            params.max_iterations,
            KMeans::init_precomputed(start),
            &KMeansConfig::default(),
        );
        let clusters = settle(futures, dims, rough.centroids.to_vec(), params.max_iterations);
        if clusters.sizes.contains(&0) {
            abandoned += 1;
        } else if best.as_ref().is_none_or(|best| clusters.inertia < best.inertia) {
            best = Some(clusters);
        }
    }
    let best = best.ok_or(ModeError::EmptyCluster { modes: params.modes, restarts: params.restarts })?;
    Ok(by_size(best, t_pred, frame, params.seed, abandoned))
}

/// Number of different samples.
fn distinct(samples: &[f32], dims: usize) -> usize {
    let mut rows: Vec<&[f32]> = samples.chunks_exact(dims).collect();
    rows.sort_by(|a, b| by_value(a, b));
    rows.dedup();
    rows.len()
}

fn by_value(a: &[f32], b: &[f32]) -> std::cmp::Ordering {
    a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}

/// Largest cluster first, equals by value: the order does not depend on the start.
fn by_size(clusters: Clusters, t_pred: usize, frame: ModeFrame, seed: u64, abandoned: usize) -> Modes {
    let mut rows: Vec<(usize, &[f32])> =
        clusters.sizes.iter().copied().zip(clusters.centres.chunks_exact(2 * t_pred)).collect();
    rows.sort_by(|a, b| b.0.cmp(&a.0).then_with(|| by_value(a.1, b.1)));
    Modes {
        centres: rows.iter().flat_map(|(_, centre)| *centre).copied().collect(),
        t_pred,
        sizes: rows.iter().map(|(size, _)| *size).collect(),
        inertia: clusters.inertia,
        converged: clusters.converged,
        abandoned,
        seed,
        frame,
    }
}
