//! A table as files: Markdown for a page, CSV for a spreadsheet, JSON for a program.

use std::fmt::Write as _;
use std::path::Path;

use crate::error::Result;
use gnp_data::Split;
use gnp_eval::{Comparison, Evaluation, Score, csv, save_comparisons};
use gnp_plot::Source;
use serde::Serialize;

use crate::evaluation::Scores;
use crate::evaluation::faithfulness::{Faithfulness, Measured};
use crate::evaluation::systems::System;
use crate::figures;
use crate::run::Run;
use crate::run::folder::{write, write_json};
use crate::tables::fit::{self, Fit, Row};
use crate::tables::printed::{self, Printed};

/// What a table is made of.
pub(crate) struct Report<'a> {
    /// `table1` or `table2`: the stem of its files.
    pub(crate) stem: &'static str,
    /// Heading.
    pub(crate) title: &'static str,
    /// What it shows, in a sentence or two.
    pub(crate) about: &'static str,
    /// The system that the others are compared with.
    pub(crate) ours: &'static str,
    /// Systems that are missing, and why.
    pub(crate) missing: &'a [String],
    /// Seeds that what is learned was trained with.
    pub(crate) seeds: usize,
    /// Learned systems that were trained with the first alone.
    pub(crate) one_seed: &'a [&'a str],
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
    /// From `seed` on, of what is learned; a score says how many entered.
    seeds: usize,
    version: &'static str,
    systems: &'a [String],
    missing: &'a [String],
    scores: &'a [Score],
    differences: &'a [Comparison],
    faithfulness: &'a [Faithfulness],
    training: &'a [Row],
    printed_not_re_run: &'a [Printed],
}

/// Systems scored: of one split, or of the folds of one pooled.
pub(crate) struct Scored {
    evaluation: Evaluation,
    faithfulness: Measured,
    fit: Fit,
    /// Names, in the order of the rows.
    systems: Vec<String>,
    /// How the windows were parted, in words.
    split: String,
    hashes: Vec<String>,
    /// The run of the full model, of the first fold.
    pub(crate) run: Run,
}

impl Scored {
    /// What `systems` got on a part of a split.
    pub(crate) fn new(
        systems: &[System],
        (evaluation, faithfulness, fit): (Evaluation, Measured, Fit),
        words: String,
        split: &Split,
        run: Run,
    ) -> Self {
        Self {
            evaluation,
            faithfulness,
            fit,
            systems: systems.iter().map(|system| system.name().to_owned()).collect(),
            split: words,
            hashes: vec![split.hash().to_owned()],
            run,
        }
    }

    /// This and another fold of the same split as one.
    ///
    /// # Errors
    /// When the folds do not have the same systems.
    pub(crate) fn pooled(mut self, fold: Self) -> Result<Self> {
        self.evaluation = self.evaluation.pooled(fold.evaluation)?;
        self.faithfulness = self.faithfulness.pooled(fold.faithfulness);
        self.fit = self.fit.with(fold.fit);
        self.hashes.extend(fold.hashes);
        Ok(self)
    }

    /// What was scored, in words.
    fn subset(&self) -> String {
        let part = self.run.config.evaluate.subset.name();
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
    let Scored { evaluation, run, .. } = scored;
    let bootstrap = &run.config.evaluate.bootstrap;
    let mut scores = Scores::of(evaluation, &scored.faithfulness, report.ours, scored.split(), bootstrap)?;
    let training = scored.fit.rows();
    scores.tables.extend(fit::tables(&training));
    run.result(&format!("\n{} on {}", report.title, run.folder.state.data.description));
    scores.show(run.machine.progress.as_ref());
    let markdown = scores.markdown(&heading(report, scored)) + &printed::markdown(report.printed);
    for missing in report.missing {
        run.note(&format!("{}: {missing}", report.stem));
    }
    let split = scored.split();
    let content = Content {
        data: &run.folder.state.data.description,
        simulated: run.folder.state.data.simulated,
        split: &split,
        split_hashes: &scored.hashes,
        windows: evaluation.setting().windows,
        rate_hz: evaluation.setting().rate_hz,
        seed: run.config.seed,
        seeds: report.seeds,
        version: env!("CARGO_PKG_VERSION"),
        systems: &scored.systems,
        missing: report.missing,
        scores: &scores.scores,
        differences: &scores.differences,
        faithfulness: &scores.faithfulness,
        training: &training,
        printed_not_re_run: report.printed,
    };
    save_comparisons(&folder.join("differences.json"), &scores.differences)?;
    let cells = csv(&scores.tables) + &printed::csv(report.printed);
    write(&folder.join(format!("{}.csv", report.stem)), cells.as_bytes())?;
    write_json(&folder.join(format!("{}.json", report.stem)), &content)?;
    write(&folder.join(format!("{}.md", report.stem)), markdown.as_bytes())?;
    let names: Vec<&str> = scored.systems.iter().map(String::as_str).collect();
    let figure = figures::scores::Scored {
        ours: report.ours,
        systems: &names,
        scores: &scores.scores,
        differences: &scores.differences,
        source: Source {
            words: format!("{}, {}", run.folder.state.data.description, scored.subset()),
            simulated: run.folder.state.data.simulated,
        },
    };
    figures::scores::save(report.stem, &figure, folder)?;
    let place = folder.join(report.stem);
    run.note(&format!("table: {0}.md, {0}.csv, {0}.json", place.display()));
    Ok(())
}

fn heading(report: &Report<'_>, scored: &Scored) -> String {
    let run = &scored.run;
    let folds = match scored.hashes.len() {
        1 => String::new(),
        folds => format!(
            " Cross-validation in {folds} folds: each window is scored once, by models trained on the other folds."
        ),
    };
    let first = run.config.seed;
    let seeds = match report.seeds {
        1 => format!("Seed {first}."),
        seeds => {
            let alone = report.one_seed.iter().map(|name| format!(" ({name}: the first alone)")).collect::<String>();
            format!(
                "Seeds: everything learned was trained with {seeds}, {first} to {}{alone}. A row of {seeds} seeds is the \
                 mean over them of what each window contributes, and its intervals are wider by how the trainings differ.",
                first.wrapping_add(seeds as u64 - 1)
            )
        }
    };
    let mut text = format!(
        "# {}\n\n{} On {}. {seeds} All systems are scored on the same windows.{folds} Lengths in m. Intervals of 95 % from {} \
         draws of drivers with replacement, in square brackets of events where there are 3 or more. Systems marked *future input* are handed recorded futures.\n",
        report.title, report.about, run.folder.state.data.description, run.config.evaluate.bootstrap.resamples
    );
    if !report.missing.is_empty() {
        let _ = write!(text, "\nNot in this table:\n\n");
        for missing in report.missing {
            let _ = writeln!(text, "- {missing}");
        }
    }
    text
}
