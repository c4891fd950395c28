//! A table as files: Markdown for a page, CSV for a spreadsheet, JSON for a program.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use gnp_data::Split;
use gnp_eval::{Comparison, Evaluation, Score, TableHead, comparison_tables, csv, save_comparisons, tables};
use gnp_plot::Source;
use serde::Serialize;

use crate::evaluate::remarks;
use crate::figures;
use crate::modes::kinds;
use crate::run_folder::{write, write_json};
use crate::session::Session;
use crate::tables::printed::{self, Printed};
use crate::tables::systems::System;

/// What a table is made of.
pub(crate) struct Report<'a> {
    /// `table1` or `table2`: the stem of its files.
    pub(crate) stem: &'static str,
    /// Heading.
    pub(crate) title: &'static str,
    /// What it shows, in a sentence or two.
    pub(crate) about: &'static str,
    /// The system that the others are held against.
    pub(crate) ours: &'static str,
    /// Systems that are missing, and why.
    pub(crate) missing: &'a [String],
    /// What the papers print.
    pub(crate) printed: &'a [Printed],
}

/// `table1.json`, `table2.json`.
#[derive(Serialize)]
struct Content<'a> {
    data: &'a str,
    simulated: bool,
    split: &'a str,
    /// One a fold.
    split_hashes: &'a [String],
    windows: usize,
    rate_hz: f64,
    seed: u64,
    version: &'static str,
    systems: &'a [String],
    missing: &'a [String],
    scores: &'a [Score],
    differences: &'a [Comparison],
    printed_not_re_run: &'a [Printed],
}

/// Systems scored: of one split, or of the folds of one pooled.
pub(crate) struct Scored {
    evaluation: Evaluation,
    /// Names, in the order of the rows.
    systems: Vec<String>,
    /// How the windows were parted, in words.
    split: String,
    hashes: Vec<String>,
    /// The run of the full model, of the first fold.
    pub(crate) session: Session,
}

impl Scored {
    /// What `systems` got on a part of a split.
    pub(crate) fn new(systems: &[System], evaluation: Evaluation, split: &Split, session: Session) -> Self {
        let part = session.config.evaluate.part;
        Self {
            evaluation,
            systems: systems.iter().map(|system| system.name().to_owned()).collect(),
            split: format!("{}{}", kinds(split.kinds()), remarks(split, part)),
            hashes: vec![split.hash().to_owned()],
            session,
        }
    }

    /// This and another fold of the same split as one.
    ///
    /// # Errors
    /// When the folds do not have the same systems.
    pub(crate) fn pooled(mut self, fold: Self) -> Result<Self> {
        self.evaluation = self.evaluation.pooled(fold.evaluation)?;
        self.hashes.extend(fold.hashes);
        Ok(self)
    }

    /// What was scored, in words.
    fn subset(&self) -> String {
        let part = self.session.config.evaluate.part.name();
        match self.hashes.len() {
            1 => format!("{part} part"),
            folds => format!("{part} parts of {folds} folds"),
        }
    }

    /// How the windows were parted, folds included.
    fn split(&self) -> String {
        match self.hashes.len() {
            1 => self.split.clone(),
            folds => format!("{} in {folds} folds", self.split),
        }
    }
}

/// Writes the table of scored systems to `folder`.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write_report(report: &Report<'_>, scored: &Scored, folder: &Path) -> Result<()> {
    let Scored { evaluation, session, .. } = scored;
    let (bootstrap, terminal) = (&session.config.evaluate.bootstrap, session.terminal());
    let scores = evaluation.scores(bootstrap);
    let differences = evaluation.comparisons(report.ours, bootstrap)?;

    let head = TableHead { split: scored.split(), rate_hz: evaluation.setting().rate_hz };
    let mut shown = tables(&scores, &head);
    terminal.result(&format!("\n{} on {}", report.title, session.folder.state.data.words));
    for table in shown.iter().filter(|table| !table.detail) {
        terminal.result(&format!("\n{}", table.terminal()));
    }
    shown.extend(comparison_tables(&differences, &head));

    let mut markdown = heading(report, scored);
    for table in &shown {
        let _ = write!(markdown, "\n{}\n", table.markdown().trim_end());
    }
    markdown += &printed::markdown(report.printed);
    for missing in report.missing {
        terminal.note(&format!("{}: {missing}", report.stem));
    }
    let content = Content {
        data: &session.folder.state.data.words,
        simulated: session.folder.state.data.simulated,
        split: &head.split,
        split_hashes: &scored.hashes,
        windows: evaluation.setting().windows,
        rate_hz: head.rate_hz,
        seed: session.config.seed,
        version: env!("CARGO_PKG_VERSION"),
        systems: &scored.systems,
        missing: report.missing,
        scores: &scores,
        differences: &differences,
        printed_not_re_run: report.printed,
    };
    save_comparisons(&folder.join("differences.json"), &differences)?;
    let cells = csv(&shown) + &printed::csv(report.printed);
    write(&folder.join(format!("{}.csv", report.stem)), cells.as_bytes())?;
    write_json(&folder.join(format!("{}.json", report.stem)), &content)?;
    write(&folder.join(format!("{}.md", report.stem)), markdown.as_bytes())?;
    let names: Vec<&str> = scored.systems.iter().map(String::as_str).collect();
    let figure = figures::scores::Scored {
        ours: report.ours,
        systems: &names,
        scores: &scores,
        differences: &differences,
        source: Source {
            words: format!("{}, {}", session.folder.state.data.words, scored.subset()),
            simulated: session.folder.state.data.simulated,
        },
    };
    figures::scores::save(report.stem, &figure, folder)?;
    let place = folder.join(report.stem);
    terminal.note(&format!("table: {0}.md, {0}.csv, {0}.json", place.display()));
    Ok(())
}

fn heading(report: &Report<'_>, scored: &Scored) -> String {
    let session = &scored.session;
    let folds = match scored.hashes.len() {
        1 => String::new(),
        folds => format!(
            " Cross-validation in {folds} folds: each window is scored once, by models trained on the other folds."
        ),
    };
    let mut text = format!(
        "# {}\n\n{} On {}. Seed {}. All systems are scored on the same windows.{folds} Lengths in m. Intervals: middle 95 % \
         of {} draws of vehicles with replacement. Systems marked *future input* are handed recorded futures.\n",
        report.title,
        report.about,
        session.folder.state.data.words,
        session.config.seed,
        session.config.evaluate.bootstrap.resamples
    );
    if !report.missing.is_empty() {
        let _ = write!(text, "\nNot in this table:\n\n");
        for missing in report.missing {
            let _ = writeln!(text, "- {missing}");
        }
    }
    text
}
