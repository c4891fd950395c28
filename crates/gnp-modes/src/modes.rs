//! The modes themselves, and how far a path is from them.

use serde::{Deserialize, Serialize};

use crate::distance::{nearest, squared_distance};
use crate::error::ModeError;
use crate::normalise::ModeFrame;

/// Intention modes: cluster centres of futures, largest cluster first.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Centres `[modes, t_pred, 2]`, m, in `frame`.
    pub centres: Vec<f32>,
    /// Steps of a centre.
    pub t_pred: usize,
    /// Futures in each cluster.
    pub sizes: Vec<usize>,
    /// Sum of squared distances of the futures to their centres, m².
    pub inertia: f64,
    /// No future would change its cluster. Otherwise more `max_iterations` would improve the modes.
    pub converged: bool,
    /// Starts that ended with an empty cluster and were left out.
    pub abandoned: usize,
    /// Seed the modes were found with.
    pub seed: u64,
    /// What the coordinates mean.
    pub frame: ModeFrame,
}

/// How the distance between two paths is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModeDistance {
    /// Sum of squared displacements, m²: what the clusters minimise, and the paper's distance.
    SquaredSum,
    /// Its square root, m: the published code's distance.
    Euclidean,
    /// Mean displacement over the steps, m.
    MeanDisplacement,
}

impl Modes {
    /// Number of modes `L`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.sizes.len()
    }

    /// Whether there is no mode; `fit` never gives that.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sizes.is_empty()
    }

    /// Centre of mode `i`, `[t_pred, 2]`, m; `None` beyond the last mode.
    #[must_use]
    pub fn centre(&self, i: usize) -> Option<&[f32]> {
        self.centres.chunks_exact((2 * self.t_pred).max(1)).nth(i)
    }

    /// The mode nearest to `path` `[t_pred, 2]`, in m and in the modes' frame, by the sum of squares;
    /// the first among equals.
    ///
    /// # Errors
    /// When the path has another number of steps.
    pub fn nearest(&self, path: &[f32]) -> Result<usize, ModeError> {
        self.check(path)?;
        Ok(nearest(path, &self.centres).0)
    }

    /// Distance of `path` `[t_pred, 2]`, in m and in the modes' frame, to every mode, `[modes]`.
    ///
    /// # Errors
    /// When the path has another number of steps.
    pub fn distances(&self, path: &[f32], metric: ModeDistance) -> Result<Vec<f32>, ModeError> {
        self.check(path)?;
        let distance = |centre: &[f32]| match metric {
            ModeDistance::SquaredSum => squared_distance(path, centre),
            ModeDistance::Euclidean => squared_distance(path, centre).sqrt(),
            ModeDistance::MeanDisplacement => {
                let pairs = path.chunks_exact(2).zip(centre.chunks_exact(2));
                pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).sum::<f32>() / self.t_pred as f32
            }
        };
        Ok(self.centres.chunks_exact(path.len()).map(distance).collect())
    }

    fn check(&self, path: &[f32]) -> Result<(), ModeError> {
        if path.len() == 2 * self.t_pred && !path.is_empty() {
            Ok(())
        } else {
            Err(ModeError::Shape { found: path.len(), t_pred: self.t_pred })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> Modes {
        Modes {
            centres: vec![1., 0., 2., 0., 1., 3., 2., 4.],
            t_pred: 2,
            sizes: vec![5, 4],
            inertia: 0.,
            converged: true,
            abandoned: 0,
            seed: 0,
            frame: ModeFrame::Position,
        }
    }

    #[test]
    fn distances_are_known() {
        let path = [1., 0., 2., 0.];
        for (metric, there) in
            [(ModeDistance::SquaredSum, 25.), (ModeDistance::Euclidean, 5.), (ModeDistance::MeanDisplacement, 3.5)]
        {
            assert_eq!(two().distances(&path, metric).unwrap(), [0., there], "{metric:?}");
        }
        assert_eq!(two().nearest(&path).unwrap(), 0);
        assert_eq!(two().nearest(&[1., 2., 2., 3.]).unwrap(), 1);
    }

    #[test]
    fn a_path_of_another_length_is_refused() {
        let message = two().nearest(&[1., 0., 2.]).unwrap_err().to_string();
        assert!(message.contains("3 values") && message.contains("2 steps"), "{message}");
        assert!(two().distances(&[], ModeDistance::SquaredSum).is_err());
    }
}
