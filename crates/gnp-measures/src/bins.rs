//! A range cut into bins.

use serde::Serialize;

/// A range of time or place cut into bins, which fill it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bins {
    /// Start of the first bin, m or s.
    pub from: f64,
    /// End of the last bin, m or s.
    pub to: f64,
    /// Width of each bin but the last, m or s.
    pub step: f64,
    /// Number of bins, at least 1.
    pub count: usize,
}

impl Bins {
    /// Bins of exactly `step`; the last one takes what is left, between half of `step` and one and a half.
    pub(crate) fn covering(from: f64, to: f64, step: f64) -> Self {
        Self { from, to, step, count: number(from, to, step) }
    }

    /// Equal bins, about as wide as `step`.
    pub(crate) fn even(from: f64, to: f64, step: f64) -> Self {
        let count = number(from, to, step);
        Self { from, to, step: (to - from) / count as f64, count }
    }

    /// Start of bin `i`, which is the end of the one before.
    #[must_use]
    pub fn edge(&self, i: usize) -> f64 {
        if i >= self.count { self.to } else { self.from + self.step * i as f64 }
    }

    /// Start and end of bin `i`.
    #[must_use]
    pub fn range(&self, i: usize) -> [f64; 2] {
        [self.edge(i), self.edge(i + 1)]
    }

    /// Middle of bin `i`.
    #[must_use]
    pub fn middle(&self, i: usize) -> f64 {
        (self.edge(i) + self.edge(i + 1)) / 2.
    }

    /// Width of bin `i`.
    #[must_use]
    pub fn width(&self, i: usize) -> f64 {
        self.edge(i + 1) - self.edge(i)
    }

    /// Edges strictly between two values, the last one perhaps twice.
    pub(crate) fn edges_within(&self, [low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
        let near = |value: f64| (((value - self.from) / self.step).max(0.) as usize).min(self.count);
        let edges = near(low)..=near(high).saturating_add(1).min(self.count);
        edges.chain([self.count]).map(|i| self.edge(i)).filter(move |edge| *edge > low && *edge < high)
    }

    /// The bin of `value`; the end of the range belongs to the last one.
    #[must_use]
    pub fn index(&self, value: f64) -> Option<usize> {
        let inside = value >= self.from && value <= self.to;
        inside.then(|| (((value - self.from) / self.step) as usize).min(self.count - 1))
    }
}

/// Whole steps nearest to the range, at least one. Casting saturates; callers bound what they allocate.
fn number(from: f64, to: f64, step: f64) -> usize {
    ((to - from) / step).round().max(1.) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_fill_the_range() {
        let time = Bins::covering(0., 80., 30.);
        assert_eq!((0..3).map(|i| time.width(i)).collect::<Vec<_>>(), [30., 30., 20.]);
        let short = Bins::covering(0., 10., 60.);
        assert_eq!((short.count, short.range(0)), (1, [0., 10.]));
        let place = Bins::even(100., 520., 100.);
        assert_eq!((place.count, place.range(3), place.middle(0)), (4, [415., 520.], 152.5));
        assert_eq!(time.edges_within([25., 60.5]).collect::<Vec<_>>(), [30., 60.]);
        assert_eq!(time.edges_within([30., 59.]).count(), 0);
        assert_eq!([99., 100., 204.9, 520., 520.1].map(|v| place.index(v)), [None, Some(0), Some(0), Some(3), None]);
    }
}
