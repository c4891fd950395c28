//! A table as files: Markdown for a page, CSV for a spreadsheet, JSON for a program.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use gnp_data::{Split, WindowSet};
use gnp_eval::{Comparison, Score, TableHead, comparison_tables, csv, save_comparisons, tables};
use gnp_plot::Source;
use serde::Serialize;

use crate::figures;
use crate::figures::scores::Scored;
use crate::modes::kinds;
use crate::run_folder::{write, write_json};
use crate::session::Session;
use crate::tables::printed::{self, Printed};
use crate::tables::systems::{self, System};

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
    /// In the order of the rows.
    pub(crate) systems: &'a [System],
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
    split_hash: &'a str,
    windows: usize,
    rate_hz: f64,
    seed: u64,
    version: &'static str,
    systems: Vec<&'a str>,
    missing: &'a [String],
    scores: &'a [Score],
    differences: &'a [Comparison],
    printed_not_re_run: &'a [Printed],
}

/// Scores the systems on the test part of a run and writes the table to `folder`.
///
/// # Errors
/// When a system fails or a file cannot be written.
pub(crate) fn write_report(report: &Report<'_>, session: &Session, set: &WindowSet<'_>, folder: &Path) -> Result<()> {
    let split = Split::load(set, &session.folder.path("split.json"))?;
    let (config, terminal) = (&session.config.evaluate, session.terminal());
    let evaluation = systems::score(set, split.test(), report.systems, config, terminal)?;
    let scores = evaluation.scores(&config.bootstrap);
    let differences = evaluation.comparisons(report.ours, &config.bootstrap)?;

    let leaks = if split.leaks() { " (leaks)" } else { "" };
    let head = TableHead { split: format!("{}{leaks}", kinds(split.kinds())), rate_hz: set.shape().rate_hz };
    let mut shown = tables(&scores, &head);
    terminal.result(&format!("\n{} on {}", report.title, session.folder.state.data.words));
    for table in shown.iter().filter(|table| !table.detail) {
        terminal.result(&format!("\n{}", table.terminal()));
    }
    shown.extend(comparison_tables(&differences, &head));

    let mut markdown = heading(report, session);
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
        split_hash: split.hash(),
        windows: split.test().len(),
        rate_hz: head.rate_hz,
        seed: session.config.seed,
        version: env!("CARGO_PKG_VERSION"),
        systems: report.systems.iter().map(System::name).collect(),
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
    let scored = Scored {
        ours: report.ours,
        systems: &content.systems,
        scores: &scores,
        differences: &differences,
        source: Source {
            words: format!("{}, test part", session.folder.state.data.words),
            simulated: session.folder.state.data.simulated,
        },
    };
    figures::scores::save(report.stem, &scored, folder)?;
    let place = folder.join(report.stem);
    terminal.note(&format!("table: {0}.md, {0}.csv, {0}.json", place.display()));
    Ok(())
}

fn heading(report: &Report<'_>, session: &Session) -> String {
    let mut text = format!(
        "# {}\n\n{} On {}. Seed {}. All systems are scored on the same windows. Lengths in m. Intervals: middle 95 % \
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
