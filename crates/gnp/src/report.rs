//! `report`: everything about a run in one HTML file.

mod clip;
mod player;
mod replay;

use std::path::PathBuf;

use crate::error::{Context as _, Result};
use gnp_data::Split;
use gnp_plot::{Figure, Report, ReportTable};

pub use self::replay::{Replayed, can_replay, write_replay};

use crate::data::ingest::IngestSummary;
use crate::evaluation::fold;
use crate::figures;
use crate::run::Run;
use crate::run::folder::write;
use crate::stages::kinds;

/// Writes `report.html` to the folder of a finished run, and says where it is and which figures are in it.
///
/// # Errors
/// When a file of the run cannot be used or the page cannot be written.
pub fn write_report(run: &Run) -> Result<(PathBuf, Vec<Figure>)> {
    let set = run.windows()?;
    let split = run.split(&set)?;
    let state = &run.folder.state;
    let path = run.folder.path("metrics.md");
    let markdown = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut tables = vec![quality(&run.folder.read_json("ingest.json")?)];
    tables.extend(scores(&markdown));
    let report = Report {
        title: format!("GNP: {}", state.data.description.replace('*', "")),
        simulated: state.data.simulated,
        facts: facts(run, &split),
        tables,
        figures: figures::draw(run, None)?,
        player: player::recording(run, &set, &split)?,
    };
    let out = run.folder.path("report.html");
    write(&out, report.html()?.as_bytes())?;
    Ok((out, report.figures))
}

fn facts(run: &Run, split: &Split) -> Vec<(String, String)> {
    let (state, config) = (&run.folder.state, &run.config);
    let protocols: Vec<&str> = config.evaluate.protocols.iter().map(|protocol| protocol.name()).collect();
    let simulated = if state.data.simulated { "simulated" } else { "real" };
    let leaks = if split.leaks() { " (leaks)" } else { "" };
    let counts = format!("{} / {} / {}", split.train().len(), split.validation().len(), split.test().len());
    let seconds: f64 = state.finished.values().sum();
    [
        ("data", state.data.description.replace('*', "")),
        ("kind of data", simulated.to_owned()),
        ("protocols", protocols.join(", ")),
        ("neighbours in the future", config.predict.neighbours.name().to_owned()),
        ("split by", format!("{}{}{leaks}", kinds(split.kinds()), fold(&run.config.split))),
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
    .to_vec()
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
    let row = |report: &crate::data::ingest::RecordingReport| {
        let (q, w) = (&report.quality, &report.windows);
        let left_out = w.gap + w.track_too_short + w.past_track_end;
        let mut row = vec![q.recording.clone(), q.site.clone()];
        let counts = [q.rows, q.vehicles, q.duplicates + q.conflicts, q.gaps, q.jumps, q.overlaps, q.lane_flips];
        row.extend(counts.iter().map(u64::to_string));
        row.extend([w.windows, left_out].map(|n| n.to_string()));
        row
    };
    let mut notes = vec![
        "duplicates: rows that repeat or contradict an earlier one, left out. Windows left out: at a gap, on a track too \
         short, at a track's end."
            .to_owned(),
    ];
    for report in &report.recordings {
        let reasons = report.quality.skipped_rows.iter().map(|(why, n)| format!("{n} rows left out: {why}"));
        notes.extend(
            reasons.chain(report.quality.notes.iter().cloned()).map(|n| format!("{}: {n}", report.quality.recording)),
        );
    }
    ReportTable {
        title: "Ingest quality".to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows: report.recordings.iter().map(row).collect(),
        notes,
    }
}

/// The tables of `metrics.md`: a table takes the line above it as its title.
fn scores(markdown: &str) -> Vec<ReportTable> {
    let mut tables: Vec<ReportTable> = Vec::new();
    let plain = |text: &str| text.replace(['*', '`'], "").replace("<br>", " ").trim().to_owned();
    let titled = |title| ReportTable { title, ..ReportTable::default() };
    let mut in_table = false;
    for line in markdown.lines().map(str::trim).filter(|line| !line.is_empty()) {
        if let Some(cells) = line.strip_prefix('|') {
            let cells: Vec<String> = cells.trim_end_matches('|').split('|').map(plain).collect();
            if !in_table {
                let title = tables.last_mut().and_then(|above| above.notes.pop()).unwrap_or_default();
                tables.push(ReportTable { head: cells, ..titled(title) });
            } else if let Some(table) = tables.last_mut()
                && !cells.iter().all(|cell| cell.chars().all(|c| c == '-' || c == ':' || c == ' '))
            {
                table.rows.push(cells);
            }
            in_table = true;
            continue;
        }
        in_table = false;
        match (line.strip_prefix('#'), tables.last_mut()) {
            (None, Some(table)) => table.notes.push(plain(line)),
            (heading, _) => tables.push(titled(plain(heading.unwrap_or(line).trim_start_matches('#')))),
        }
    }
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_markdown_are_read() {
        let text = "# Scores\n\nOn *simulated* data.\n\nall sites: clean\n\n| model | 1 s |\n|:---|---:|\n| gnp | 0.5 |\n\nA note.\n";
        let tables = scores(text);
        assert_eq!(tables.len(), 2);
        assert_eq!((tables[0].title.as_str(), tables[0].notes[0].as_str()), ("Scores", "On simulated data."));
        assert_eq!(
            (&tables[1].title, &tables[1].head, &tables[1].rows),
            (
                &"all sites: clean".to_owned(),
                &vec!["model".into(), "1 s".into()],
                &vec![vec!["gnp".into(), "0.5".into()]]
            )
        );
        assert_eq!(tables[1].notes, ["A note."]);
    }
}
