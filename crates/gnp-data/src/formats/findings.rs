//! What contradicts itself in a recording: counted, left out, or too much to believe the rest.

use std::collections::{BTreeMap, BTreeSet};

use super::table::Table;
use crate::error::DataError;
use crate::ingest_report::IngestReport;

/// Fraction of a recording's vehicles, or of its rows, above which a contradiction is one of the
/// whole. Wrong signs, units and files touch all vehicles or all of one carriageway; single damage
/// does not touch every tenth one, and traffic with more than that left out would be another traffic.
pub(crate) const MAX_LEFT_OUT: f64 = 0.1;

/// Fraction of the values of a column that is not needed, or known to be poor, above which the whole
/// column is not what its name says.
pub(crate) const MAX_DOUBTED: f64 = 0.5;

/// From so many things that can be judged on, a contradiction of most of them is one of the whole.
pub(super) const MIN_JUDGED: usize = 3;

/// How often something was found, and in which row of the file first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) count: usize,
    pub(crate) first: Option<usize>,
}

impl Tally {
    pub(crate) fn add(&mut self, row: usize) {
        *self = self.merge(Self { count: 1, first: Some(row) });
    }

    pub(super) fn merge(self, other: Self) -> Self {
        let first = [self.first, other.first].into_iter().flatten().min();
        Self { count: self.count + other.count, first }
    }

    pub(crate) fn of(rows: impl Iterator<Item = usize>) -> Self {
        let mut tally = Self::default();
        rows.for_each(|row| tally.add(row));
        tally
    }

    /// Whether it was found in more than a fraction of all; a single one says nothing of more than two.
    pub(crate) fn exceeds(self, fraction: f64, of: usize) -> bool {
        let alone = self.count == 1 && of > 2;
        !alone && self.count as f64 > fraction * of as f64
    }
}

/// A contradiction that is looked for.
pub(super) struct Check {
    /// The column that it shows in.
    pub(super) column: &'static str,
    /// What vehicles, rows or values do that contradict themselves, as `move backwards`.
    pub(super) says: &'static str,
    /// What becomes of those that are counted, if they are few.
    pub(super) then: &'static str,
    /// What to do about a recording that does so as a whole.
    pub(super) remedy: &'static str,
}

impl Check {
    /// The error for a recording as a whole; `who` are of which kind and how many.
    pub(super) fn error(&self, table: &Table, first: Option<usize>, who: &str) -> DataError {
        table.contradiction(first, self.column, format!("{who} {}", self.says), self.remedy)
    }
}

/// What was found in a recording.
#[derive(Debug, Default)]
pub(super) struct Findings {
    left_out: BTreeMap<u32, &'static str>,
    counted: BTreeMap<String, u64>,
}

impl Findings {
    /// Leaves out `vehicles`, each with a row of `table` where it shows.
    ///
    /// # Errors
    /// When this makes more than [`MAX_LEFT_OUT`] of the recording's `all` vehicles.
    pub(super) fn leave_out(
        &mut self,
        check: &Check,
        table: &Table,
        vehicles: &[(u32, usize)],
        all: usize,
    ) -> Result<(), DataError> {
        for (vehicle, _) in vehicles {
            self.left_out.entry(*vehicle).or_insert(check.says);
        }
        let (found, first) = (vehicles.len(), vehicles.iter().map(|(_, row)| *row).min());
        let out = self.left_out.len();
        if vehicles.is_empty() || !(Tally { count: out, first }).exceeds(MAX_LEFT_OUT, all) {
            return Ok(());
        }
        let others = if out > found { format!(" (with other contradictions {out})") } else { String::new() };
        Err(check.error(table, first, &format!("{found} of {all} vehicles{others}")))
    }

    /// Counts what is found in `tally` of `all` things of kind `what`, such as rows.
    ///
    /// # Errors
    /// When it is more than `fraction` of them.
    pub(super) fn count(
        &mut self,
        check: &Check,
        table: &Table,
        tally: Tally,
        (all, what): (usize, &str),
        fraction: f64,
    ) -> Result<(), DataError> {
        if tally.exceeds(fraction, all) {
            return Err(check.error(table, tally.first, &format!("{} of {all} {what}", tally.count)));
        }
        if tally.count > 0 {
            let kept = format!("{what} {}: {}", check.says, check.then);
            *self.counted.entry(kept).or_insert(0) += tally.count as u64;
        }
        Ok(())
    }

    pub(super) fn left_out(&self) -> BTreeSet<u32> {
        self.left_out.keys().copied().collect()
    }

    /// Puts what was found into the report; `rows` are those of the vehicles left out.
    pub(super) fn report(self, report: &mut IngestReport, rows: usize) {
        report.rows_read += rows as u64;
        for reason in self.left_out.into_values() {
            *report.vehicles_left_out.entry(reason.to_owned()).or_insert(0) += 1;
        }
        for (what, count) in self.counted {
            *report.contradictions.entry(what).or_insert(0) += count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tally_keeps_the_first_row_and_knows_its_share() {
        let tally = Tally::of([7, 3, 9].into_iter());
        assert_eq!(tally, Tally { count: 3, first: Some(3) });
        assert!(tally.exceeds(MAX_LEFT_OUT, 29) && !tally.exceeds(MAX_LEFT_OUT, 30));
        assert!(!Tally::default().exceeds(MAX_LEFT_OUT, 0));
        let one = Tally::of(std::iter::once(4));
        assert!(one.exceeds(MAX_DOUBTED, 1) && one.exceeds(MAX_LEFT_OUT, 2) && !one.exceeds(MAX_LEFT_OUT, 3));
    }
}
