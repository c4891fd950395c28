//! `report`: everything about a run in one HTML file, what was found first.

mod clip;
mod replay;

use std::path::PathBuf;
use std::time::Instant;

use gnp_data::Split;
use gnp_eval::{Comparison, Protocol, Score, Table, TableHead, comparison_tables, tables};
use gnp_plot::{Figure, Report, ReportCell, ReportSection, ReportTable};

pub use self::replay::{Replayed, can_replay, write_replay};
use crate::data::ingest::{IngestSummary, RecordingReport};
use crate::error::Result;
use crate::evaluation::{faithfulness, fold, split_description};
use crate::figures;
use crate::run::Run;
use crate::run::folder::{Stage, write};
use crate::stages::kinds;

/// Name of the figure at the top of the page.
const OPENING: &str = "error-by-horizon";

/// File of the page in a run folder.
const PAGE: &str = "report.html";

/// Draws the figures of a run, and writes `report.html` and the folder `figures`, whose files are returned.
///
/// # Errors
/// As [`write_report`].
pub(crate) fn write_with_figures(run: &Run) -> Result<Vec<String>> {
    let figures = figures::draw(run, None)?;
    write_page(run, &figures)?;
    figures::save_own(run, &figures)
}

/// Writes with `some` those files of the stage, named by what is returned, that are asked for; where the stage is not
/// finished, as where others of its files were damaged, all of them with the `figures` of the run's own recordings.
///
/// # Errors
/// As [`write_report`].
pub(crate) fn renew(run: &mut Run, figures: &[Figure], some: impl FnOnce(&Run) -> Result<Vec<String>>) -> Result<()> {
    run.writing(|run| {
        if run.folder.has(Stage::Report) {
            return run.rewriting(Stage::Report, |run| Ok(((), some(run)?)));
        }
        let started = Instant::now();
        write_page(run, figures)?;
        let names = figures::save_own(run, figures)?;
        run.folder.finish(Stage::Report, started.elapsed().as_secs_f64(), names)
    })
}

/// Writes `report.html` to the folder of a run that has scores, and says where it is and which figures are in it. Where
/// the run's own figures are not there, they are written, too.
///
/// # Errors
/// When a file of the run cannot be used or the page cannot be written.
pub fn write_report(run: &mut Run) -> Result<(PathBuf, Vec<Figure>)> {
    let figures = run.writing(|run| {
        let figures = figures::draw(run, None)?;
        renew(run, &figures, |run| write_page(run, &figures).map(|()| vec![PAGE.to_owned()]))?;
        Ok(figures)
    })?;
    Ok((run.path().join(PAGE), figures))
}

/// Writes the page.
fn write_page(run: &Run, figures: &[Figure]) -> Result<()> {
    let set = run.windows()?;
    let split = run.split(&set)?;
    let data = &run.folder.state.data;
    let scores = run.scores()?;
    let head = TableHead { split: split_description(run, &split), rate_hz: set.shape().rate_hz };
    let mut report = Report::new(format!("GNP: {}", plain(&data.description)), data.simulated);
    if let Some(summary) = scores.summary() {
        report.headline = summary.sentence();
        report.summary = Some(ReportTable { title: String::new(), ..shown(&summary.table()) });
    }
    let (opening, others): (Vec<Figure>, Vec<Figure>) =
        figures.iter().cloned().partition(|figure| figure.name == OPENING);
    report.figures = opening;
    report.player = clip::clip(run, &set, &split)?;
    report.sections = score_sections(&scores.scores, &scores.differences, &head);
    let mut pictures = ReportSection::new("Figures");
    pictures.figures = others;
    // Below what is scored under the protocol that the page opens with.
    let details = report.sections.iter().take_while(|section| !section.folded).count();
    let explained = faithfulness::table(&scores.faithfulness, &head).map(|table| {
        let mut section = ReportSection::new("Faithfulness of explanations");
        section.tables = vec![shown(&table)];
        section
    });
    let opened = explained.into_iter().chain([pictures]);
    report.sections.splice(details..details, opened);
    let mut recordings = ReportSection::new("Recordings");
    recordings.tables = vec![quality(&run.folder.read_json("ingest.json")?)];
    let mut provenance = ReportSection::new("Provenance");
    provenance.facts = facts(run, &split);
    report.sections.extend([recordings, provenance]);
    write(&run.path().join(PAGE), report.html()?.as_bytes())
}

/// The tables of scores, one section a protocol: `clean` first, the others folded away.
fn score_sections(scores: &[Score], differences: &[Comparison], head: &TableHead) -> Vec<ReportSection> {
    let mut protocols: Vec<Protocol> = Vec::new();
    for score in scores {
        if !protocols.contains(&score.protocol) {
            protocols.push(score.protocol);
        }
    }
    protocols.sort_by_key(|protocol| *protocol != Protocol::Clean);
    let section = |protocol: Protocol| {
        let scores: Vec<Score> = scores.iter().filter(|score| score.protocol == protocol).cloned().collect();
        let differences: Vec<Comparison> = differences.iter().filter(|row| row.protocol == protocol).cloned().collect();
        let title = format!("Scores under protocol {}: {}", protocol.name(), protocol.summary());
        let mut section = ReportSection::new(title);
        section.folded = protocol != Protocol::Clean;
        section.tables =
            tables(&scores, head).iter().chain(&comparison_tables(&differences, head)).map(shown).collect();
        section
    };
    protocols.into_iter().map(section).collect()
}

/// A table as the page shows it: the caption below it.
fn shown(table: &Table) -> ReportTable {
    let row = |row: &Vec<gnp_eval::TableCell>| {
        row.iter().map(|cell| ReportCell { text: cell.text.clone(), interval: cell.interval_text() }).collect()
    };
    ReportTable {
        title: table.name.clone(),
        head: table.header.clone(),
        rows: table.rows.iter().map(row).collect(),
        notes: vec![plain(&table.caption)],
    }
}

/// Without the emphasis of Markdown.
fn plain(text: &str) -> String {
    text.replace('*', "")
}

fn facts(run: &Run, split: &Split) -> Vec<(String, String)> {
    let (state, config) = (&run.folder.state, &run.config);
    let protocols: Vec<&str> = config.evaluate.protocols.iter().map(|protocol| protocol.name()).collect();
    let simulated = if state.data.simulated { "simulated" } else { "real" };
    let leaks = if split.leaks() { " (leaks)" } else { "" };
    let counts = format!("{} / {} / {}", split.train().len(), split.validation().len(), split.test().len());
    let seconds: f64 = state.finished.values().sum();
    let origin = state.origin.as_ref().map(|origin| {
        let words = format!("{}, split {}", origin.folder.display(), origin.split_hash);
        ("fine-tuned from".to_owned(), words)
    });
    [
        ("data", plain(&state.data.description)),
        ("kind of data", simulated.to_owned()),
        ("protocols", protocols.join(", ")),
        ("neighbours in the future", config.predict.neighbours.name().to_owned()),
        ("split by", format!("{}{}{leaks}", kinds(split.kinds()), fold(&run.config.split))),
        ("evaluated subset", config.evaluate.subset.name().to_owned()),
        ("windows for training / validation / test", counts),
        ("split hash", state.split_hash.clone()),
        ("seed", state.seed.to_string()),
        (
            "window",
            format!(
                "{} s observed, {} s predicted, {} Hz",
                config.windows.observed_s, config.windows.predicted_s, config.windows.rate_hz
            ),
        ),
        ("version of the program", format!("{} (run), {} (report)", state.version, env!("CARGO_PKG_VERSION"))),
        ("time of all stages", format!("{seconds:.0} s")),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into_iter()
    .chain(origin)
    .collect()
}

fn quality(report: &IngestSummary) -> ReportTable {
    let head = [
        "recording",
        "site",
        "rows",
        "vehicles",
        "duplicates",
        "gaps",
        "jumps",
        "overlaps",
        "lane flips",
        "windows",
        "left out",
    ];
    let row = |report: &RecordingReport| {
        let (q, w) = (&report.quality, &report.windows);
        let left_out = w.gap + w.track_too_short + w.past_track_end;
        let mut row: Vec<ReportCell> = vec![q.recording.as_str().into(), q.site.as_str().into()];
        let counts = [q.rows, q.vehicles, q.duplicates + q.conflicts, q.gaps, q.jumps, q.overlaps, q.lane_flips];
        row.extend(counts.iter().map(|n| n.to_string().into()));
        row.extend([w.windows, left_out].map(|n| n.to_string().into()));
        row
    };
    let mut notes = vec![
        "duplicates: rows that repeat or contradict an earlier one, left out. Windows left out: at a gap, on a track \
         too short, at a track's end."
            .to_owned(),
    ];
    for report in &report.recordings {
        notes.extend(report.quality.remarks().iter().map(|remark| format!("{}: {remark}", report.quality.recording)));
    }
    notes.extend(report.omissions());
    ReportTable {
        title: "What was read, and what was left out".to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows: report.recordings.iter().map(row).collect(),
        notes,
    }
}

#[cfg(test)]
mod tests {
    use gnp_data::Dataset;

    use super::*;

    fn score(protocol: Protocol, metric: &str, k: usize) -> Score {
        Score {
            dataset: Dataset::NGSIM,
            site: "us-101".to_owned(),
            manoeuvre: None,
            model: "gnp".to_owned(),
            seeds: 1,
            protocol,
            metric: metric.to_owned(),
            k: Some(k),
            horizon_s: 5.,
            value: 5.5,
            ci_low: Some(5.25),
            ci_high: Some(5.75),
            event_ci_low: None,
            event_ci_high: None,
            windows: 12,
            vehicles: 3,
            events: 1,
            simulated: true,
            uses_future: false,
        }
    }

    #[test]
    fn clean_comes_first_and_the_other_protocols_are_folded() {
        let scores = [
            score(Protocol::Paper, "min_ade", 20),
            score(Protocol::Literature, "rmse_at", 1),
            score(Protocol::Clean, "rmse_at", 1),
        ];
        let head = TableHead { split: "recording".to_owned(), rate_hz: 10. };
        let sections = score_sections(&scores, &[], &head);
        let seen: Vec<(bool, bool)> =
            sections.iter().map(|section| (section.title.contains("protocol clean"), section.folded)).collect();
        assert_eq!(seen, [(true, false), (false, true), (false, true)]);
        let table = &sections[0].tables[0];
        assert_eq!((table.title.as_str(), table.head[0].as_str()), ("clean us-101", "model"));
        let number = &table.rows[0][1];
        assert_eq!((number.text.as_str(), number.interval.as_deref()), ("5.50", Some("(5.25 to 5.75)")));
        assert!(table.notes[0].starts_with("us-101, simulated: protocol clean"), "{:?}", table.notes);
    }

    /// The note below a table speaks of square brackets where a cell has them.
    #[test]
    fn cells_and_notes_agree_on_events() {
        let head = TableHead { split: "recording".to_owned(), rate_hz: 10. };
        let alone = score(Protocol::Clean, "rmse_at", 1);
        let with_events = Score { event_ci_low: Some(5.), event_ci_high: Some(6.), events: 3, ..alone.clone() };
        let cases = [(alone, "(5.25 to 5.75)", false), (with_events, "(5.25 to 5.75) [5.00 to 6.00]", true)];
        for (score, text, said) in cases {
            let sections = score_sections(&[score], &[], &head);
            let table = &sections[0].tables[0];
            assert_eq!(table.rows[0][1].interval.as_deref(), Some(text));
            assert_eq!(table.notes[0].contains("in square brackets by event"), said, "{:?}", table.notes);
        }
    }
}
