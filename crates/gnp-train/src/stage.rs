//! What the training loop asks of the thing that it trains.

use std::collections::BTreeMap;

use candle_core::{Tensor, Var};

use crate::error::TrainError;

/// A network with its windows and its loss: goals, attraction or repulsion.
pub trait Stage {
    /// Name in messages, histories and curves, such as `goal`.
    fn name(&self) -> &'static str;

    /// The weights that training moves, under their checkpoint names; frozen ones are left out.
    fn trainable(&self) -> BTreeMap<String, Var>;

    /// Number of training windows.
    fn train_len(&self) -> usize;

    /// Number of validation windows.
    fn validation_len(&self) -> usize;

    /// Mean loss over the training windows at the indices `batch`, a scalar. Every draw (dropout,
    /// noise) is fixed by `step_seed`.
    ///
    /// # Errors
    /// When a window cannot be read or the network fails.
    fn loss(&self, batch: &[usize], step_seed: u64) -> Result<Tensor, TrainError>;

    /// Scores over the validation windows at the indices `batch`; lower is better, and the first
    /// one chooses the best epoch.
    ///
    /// # Errors
    /// When a window cannot be read or the network fails.
    fn validate(&self, batch: &[usize]) -> Result<Sums, TrainError>;
}

/// Named sums over windows, so that their means are exact when batches differ in size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums {
    count: usize,
    sums: Vec<(&'static str, f64)>,
}

impl Sums {
    /// Sums over `count` windows, in the order of importance.
    #[must_use]
    pub fn new(count: usize, sums: impl IntoIterator<Item = (&'static str, f64)>) -> Self {
        Self { count, sums: sums.into_iter().collect() }
    }

    /// Adds the sums over other windows. `false`, and nothing added, when the names differ.
    #[must_use]
    pub fn add(&mut self, other: &Self) -> bool {
        if self.count == 0 {
            self.clone_from(other);
            return true;
        }
        let names = |of: &Self| of.sums.iter().map(|(name, _)| *name).collect::<Vec<_>>();
        if names(self) != names(other) {
            return false;
        }
        self.count += other.count;
        for ((_, sum), (_, more)) in self.sums.iter_mut().zip(&other.sums) {
            *sum += more;
        }
        true
    }

    /// The mean of each, in the same order; nothing over no windows.
    #[must_use]
    pub fn means(&self) -> Vec<(&'static str, f64)> {
        if self.count == 0 {
            return Vec::new();
        }
        self.sums.iter().map(|(name, sum)| (*name, sum / self.count as f64)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_weigh_every_window_alike() {
        let mut sums = Sums::default();
        assert!(sums.add(&Sums::new(3, [("loss", 6.), ("fde", 9.)])));
        assert!(sums.add(&Sums::new(1, [("loss", 10.), ("fde", 1.)])));
        assert_eq!(sums.means(), [("loss", 4.), ("fde", 2.5)]);
        assert!(!sums.add(&Sums::new(1, [("fde", 10.), ("loss", 1.)])));
        assert_eq!(sums.means(), [("loss", 4.), ("fde", 2.5)]);
    }
}
