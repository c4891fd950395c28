//! The modes themselves, and how far a path is from them.

use crate::distance::nearest;
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
    fn a_path_of_another_length_is_refused() {
        let message = two().nearest(&[1., 0., 2.]).unwrap_err().to_string();
        assert!(message.contains("3 values") && message.contains("2 steps"), "{message}");
    }
}
