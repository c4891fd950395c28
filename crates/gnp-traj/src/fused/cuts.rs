//! Where the groups of a chunk begin.

use std::ops::Range;

/// Windows whose gradients are summed by themselves before they join the sum of the batch. A fixed number, so
/// that sums come in the same order however many windows a thread takes at once.
pub(crate) const GROUP: usize = 16;

/// Where each group of a chunk begins among the chunk's windows, rows, pairs or slots, and where the last one ends.
#[derive(Clone, Debug)]
pub(crate) struct Cuts(Vec<usize>);

impl Cuts {
    /// Of `windows` windows, each with `each` rows.
    pub(crate) fn of_windows(windows: usize, each: usize) -> Self {
        Self((0..windows).step_by(GROUP).chain([windows]).map(|window| window * each).collect())
    }

    /// Of entries that lie in the order of their windows, of which `windows` there are.
    pub(crate) fn of_entries(windows: usize, of: impl ExactSizeIterator<Item = usize>) -> Self {
        let mut counts = vec![0; windows.div_ceil(GROUP)];
        of.for_each(|window| counts[window / GROUP] += 1);
        let mut cuts = vec![0];
        cuts.extend(counts.iter().scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        }));
        Self(cuts)
    }

    /// Number of entries of all groups.
    pub(crate) fn len(&self) -> usize {
        self.0.last().copied().unwrap_or_default()
    }

    /// The groups in order.
    pub(crate) fn groups(&self) -> impl ExactSizeIterator<Item = Range<usize>> + '_ {
        self.0.windows(2).map(|pair| pair[0]..pair[1])
    }

    /// The parts of the groups that lie in `range`, counted from its start.
    pub(crate) fn within(&self, range: Range<usize>) -> Self {
        Self(self.0.iter().map(|cut| (*cut).clamp(range.start, range.end) - range.start).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups(cuts: &Cuts) -> Vec<Range<usize>> {
        cuts.groups().collect()
    }

    #[test]
    fn groups_are_cut_after_the_same_windows_whatever_is_counted() {
        assert_eq!(groups(&Cuts::of_windows(40, 3)), [0..48, 48..96, 96..120]);
        // Windows with 0, 1, 2, 0, ... entries.
        let entries: Vec<usize> = (0..40).flat_map(|window| std::iter::repeat_n(window, window % 3)).collect();
        let cuts = Cuts::of_entries(40, entries.iter().copied());
        assert_eq!(groups(&cuts), [0..15, 15..31, 31..39]);
        assert_eq!(cuts.len(), entries.len());
        assert_eq!(groups(&cuts.within(10..20)), [0..5, 5..10, 10..10]);
        assert_eq!((groups(&Cuts::of_windows(0, 1)).len(), Cuts::of_windows(0, 1).len()), (0, 0));
    }
}
