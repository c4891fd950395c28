//! What the training loop asks of the thing that it trains.

use std::collections::BTreeMap;

use candle_core::{Tensor, Var};

use crate::error::TrainError;

/// A network with its windows and its loss: goals, attraction or repulsion. Several threads ask it at once.
pub trait Stage: Sync {
    /// Name in messages, histories and curves, such as `goal`.
    fn name(&self) -> &'static str;

    /// The weights that training moves, under their checkpoint names; frozen ones are left out.
    fn trainable(&self) -> BTreeMap<String, Var>;

    /// Number of training windows.
    fn train_len(&self) -> usize;

    /// Number of validation windows.
    fn validation_len(&self) -> usize;

    /// Site of each training window as a number, for
    /// [`TrainConfig::site_sampling_exponent`](crate::TrainConfig::site_sampling_exponent); empty where all are of one.
    fn train_sites(&self) -> Vec<u32> {
        Vec::new()
    }

    /// Site of each validation window; empty where all are of one.
    fn validation_sites(&self) -> Vec<u32> {
        Vec::new()
    }

    /// Windows of a part of a mini-batch, whose loss and gradient one thread makes by itself; threads share out the parts.
    /// The loss of the batch is the mean of the parts' losses, weighted by their windows. Nothing, which is the default,
    /// for the whole batch at once: where windows are looked at together (batch normalisation), and on a GPU.
    fn part_windows(&self) -> Option<usize> {
        None
    }

    /// Mean loss over the training windows of `part`, a scalar. Every draw (dropout, noise) is fixed by the part's seed
    /// and the place of the window in the mini-batch.
    ///
    /// # Errors
    /// When a window cannot be read or the network fails.
    fn loss(&self, part: Part<'_>) -> Result<Tensor, TrainError>;

    /// Scores over the validation windows at the indices `batch`; lower is better, and the first
    /// one chooses the best epoch.
    ///
    /// # Errors
    /// When a window cannot be read or the network fails.
    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError>;
}

/// A mini-batch, or windows on end of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part<'a> {
    /// Indices of the training windows.
    pub windows: &'a [usize],
    /// Place of the first of them in the mini-batch.
    pub first: usize,
    /// Fixes what is drawn for the mini-batch.
    pub seed: u64,
}

impl<'a> Part<'a> {
    /// All windows of a mini-batch.
    #[must_use]
    pub fn whole(windows: &'a [usize], seed: u64) -> Self {
        Self { windows, first: 0, seed }
    }
}

/// Named sums over windows, so that their means are exact when batches differ in size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BatchTotals {
    count: usize,
    sums: Vec<(&'static str, f64)>,
}

impl BatchTotals {
    /// Totals over `count` windows, in the order of importance.
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

    /// Means over several sites, where a window of each counts as much as its weight says. Names are
    /// those of the first.
    #[must_use]
    pub(crate) fn means_of(sites: &[(Self, f64)]) -> Vec<(&'static str, f64)> {
        let total: f64 = sites.iter().map(|(sums, weight)| weight * sums.count as f64).sum();
        let mut means: Vec<(&'static str, f64)> = Vec::new();
        for (sums, weight) in sites {
            for (index, (name, sum)) in sums.sums.iter().enumerate() {
                match means.get_mut(index) {
                    Some((_, mean)) => *mean += weight * sum / total,
                    None => means.push((name, weight * sum / total)),
                }
            }
        }
        means
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_weigh_every_window_alike() {
        let mut sums = BatchTotals::default();
        assert!(sums.add(&BatchTotals::new(3, [("loss", 6.), ("fde", 9.)])));
        assert!(sums.add(&BatchTotals::new(1, [("loss", 10.), ("fde", 1.)])));
        assert_eq!(sums.means(), [("loss", 4.), ("fde", 2.5)]);
        let sites = [(BatchTotals::new(3, [("loss", 6.)]), 1.), (BatchTotals::new(1, [("loss", 10.)]), 3.)];
        assert_eq!(BatchTotals::means_of(&sites), [("loss", 6.)]);
        assert!(!sums.add(&BatchTotals::new(1, [("fde", 10.), ("loss", 1.)])));
        assert_eq!(sums.means(), [("loss", 4.), ("fde", 2.5)]);
    }
}
