//! What is to be said of tracks and forecasts beside their numbers.

use gnp_data::IngestReport;
use pyo3::prelude::*;

/// Sentences for the user.
#[derive(Clone, Debug, Default, IntoPyObject)]
pub(crate) struct Remarks {
    /// What was found and assumed.
    pub(crate) notes: Vec<String>,
    /// What was left out: a warning.
    pub(crate) left_out: Vec<String>,
}

impl Remarks {
    /// Adds what a report says.
    pub(crate) fn add(&mut self, report: &IngestReport) {
        let mut remarks = report.remarks();
        // What was left out comes first, a sentence a reason.
        let left_out = report.skipped_rows.len() + report.vehicles_left_out.len();
        let notes = remarks.split_off(left_out.min(remarks.len()));
        self.left_out.extend(report.repeated_rows());
        self.left_out.extend(remarks);
        self.notes.extend(notes);
    }
}
