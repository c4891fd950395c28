//! Ingest: recordings are read a few at a time, reported on and kept in columns.

use std::fs;
use std::path::Path;
use std::time::Instant;

use crate::error::{Context as _, Result, bail};
use comfy_table::{CellAlignment, ContentArrangement, Table, TableComponent, presets};
use gnp_data::{
    DataError, Expectation, IngestReport, JUMP_ACCELERATION, JUMP_SPEED, LaneSource, Recording, RecordingDrops, read,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::RunConfig;
use crate::data::source::Found;
use crate::machine::Machine;
use crate::memory;
use crate::run::folder::{DataState, write, write_json};
use crate::text::{COLUMNS, fitted};

/// Folder of the kept recordings in a run folder.
pub(crate) const RECORDINGS: &str = "recordings";

/// Most files that are read at once, each on its own thread.
const AT_ONCE: usize = 4;

/// `ingest.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct IngestSummary {
    /// Where the recordings come from.
    pub data: DataState,
    /// Every recording, in the order of the files.
    pub recordings: Vec<RecordingReport>,
    /// Time to read, check and keep them all, s.
    pub seconds: f64,
    /// Rows of the files read in a second.
    pub rows_per_second: f64,
    /// Largest resident size so far, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// One recording of `ingest.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RecordingReport {
    /// Where it is kept, from the run folder.
    pub file: String,
    /// What was found in it.
    pub quality: IngestReport,
    /// What becomes of its candidate windows.
    pub windows: RecordingDrops,
}

/// Reads every source into `folder`, a few at a time: memory does not grow with their number.
///
/// # Errors
/// The first thing that is wrong with a recording; when no track is long enough for a window.
pub(crate) fn run(found: Found, config: &RunConfig, folder: &Path, machine: &Machine) -> Result<IngestSummary> {
    let expect = Expectation { dataset: config.dataset, rate_hz: Some(config.data.rate_hz) };
    let kept = folder.join(RECORDINGS);
    fs::create_dir(&kept).with_context(|| format!("cannot make the folder {}", kept.display()))?;
    let work = machine.work("ingest", found.sources.len(), "files");
    let started = Instant::now();
    let mut recordings: Vec<RecordingReport> = Vec::new();
    let (mut rows, mut longest_s) = (0u64, 0f64);
    let at_once = rayon::current_num_threads().clamp(1, AT_ONCE);
    for (group, sources) in found.sources.chunks(at_once).enumerate() {
        machine.stop.check()?;
        work.at((group * at_once) as u64, &sources[0].name);
        let read: Vec<_> = sources.par_iter().map(|source| read(source, &expect)).collect();
        let mut to_save = Vec::new();
        for (source, read) in sources.iter().zip(read) {
            for (index, (recording, mut quality)) in read?.into_iter().enumerate() {
                let name = &recording.meta().name;
                if recordings.iter().any(|earlier| earlier.quality.recording == *name) {
                    bail!(
                        Recordings,
                        "{}: a second recording called {name}; put each recording into the folder once",
                        source.name
                    );
                }
                let windows = config.windows.count(&recording)?;
                let frames = recording.tracks().iter().map(|track| track.rows.len()).max().unwrap_or(0);
                longest_s = longest_s.max(frames.saturating_sub(1) as f64 / recording.meta().rate_hz);
                rows += quality.rows_read;
                if index == 0 {
                    quality.notes.extend(source.notes.iter().cloned());
                }
                let file = format!("{RECORDINGS}/{:04}-{}.rec", recordings.len(), plain(name));
                to_save.push((folder.join(&file), recording));
                recordings.push(RecordingReport { file, quality, windows });
            }
        }
        to_save.par_iter().try_for_each(|(path, recording)| recording.save(path))?;
    }
    drop(work);
    if recordings.iter().all(|report| report.windows.windows == 0) {
        let needed_s = config.windows.observed_s + config.windows.predicted_s;
        return Err(DataError::NoWindow { needed_s, longest_s }.into());
    }
    let seconds = started.elapsed().as_secs_f64();
    let report = IngestSummary {
        data: found.data,
        recordings,
        seconds,
        rows_per_second: rows as f64 / seconds.max(1e-9),
        peak_memory_bytes: memory::peak(),
    };
    write_json(&folder.join("ingest.json"), &report)?;
    let text = report.text();
    write(&folder.join("ingest.txt"), text.as_bytes())?;
    machine.progress.result(&text);
    machine.progress.note(&format!(
        "ingest: {rows} rows in {seconds:.2} s, {:.2} million rows/s; peak memory {}",
        report.rows_per_second / 1e6,
        memory::peak_text()
    ));
    Ok(report)
}

/// Letters, digits, `-`, `_` and `.`; a file name on every system.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

impl IngestSummary {
    /// The recordings that were kept in `folder`.
    ///
    /// # Errors
    /// When one is missing or damaged.
    pub(crate) fn load(&self, folder: &Path, machine: &Machine) -> Result<Vec<Recording>> {
        let work = machine.work("recordings", self.recordings.len(), "files");
        let mut recordings = Vec::with_capacity(self.recordings.len());
        for (done, kept) in self.recordings.iter().enumerate() {
            machine.stop.check()?;
            work.at(done as u64, "");
            recordings.push(Recording::load(&folder.join(&kept.file))?);
        }
        Ok(recordings)
    }

    /// The table for people.
    #[must_use]
    pub fn text(&self) -> String {
        let mut sizes = table(&["recording", "site", "lanes", "rows", "vehicles"], 3);
        let mut quality = table(&["recording", "duplicates", "gaps", "jumps", "overlaps", "flips"], 1);
        let mut windows = table(&["recording", "windows", "at gap", "short", "at end"], 1);
        let mut total = [0u64; 11];
        for report in &self.recordings {
            let (q, w) = (&report.quality, &report.windows);
            let lanes = match q.lanes {
                LaneSource::Given => "given",
                LaneSource::Fitted => "fitted",
                LaneSource::Absent => "none",
            };
            let counts = [q.rows, q.vehicles, q.duplicates + q.conflicts, q.gaps, q.jumps, q.overlaps, q.lane_flips];
            let cut = [w.windows, w.gap, w.track_too_short, w.past_track_end].map(|n| n as u64);
            for (sum, n) in total.iter_mut().zip(counts.iter().chain(&cut)) {
                *sum += n;
            }
            sizes.add_row(row(&[&q.recording, &q.site, lanes], &counts[..2]));
            quality.add_row(row(&[&q.recording], &counts[2..]));
            windows.add_row(row(&[&q.recording], &cut));
        }
        sizes.add_row(row(&["all", "", ""], &total[..2]));
        quality.add_row(row(&["all"], &total[2..7]));
        windows.add_row(row(&["all"], &total[7..]));
        let tables = [sizes, quality, windows].map(|table| table.trim_fmt() + "\n");
        let mut text = format!("Recordings: {}\n{}", self.data.description, tables.join("\n"));
        text.push_str(&format!(
            "duplicates: rows that repeat or contradict an earlier one of vehicle and frame, left out. jumps: rows faster \
             than {JUMP_SPEED} m/s or with more than {JUMP_ACCELERATION} m/s² over half a second, kept. overlaps: pairs \
             of boxes by frame. flips: changes of lane undone within 1 s. Windows left out: at a gap, on a track too \
             short, at a track's end.\n"
        ));
        for report in &self.recordings {
            for remark in report.quality.remarks() {
                text.push_str(&format!("{}: {remark}\n", report.quality.recording));
            }
        }
        fitted(&text)
    }
}

/// A table with words in its first columns and numbers in the others.
fn table(head: &[&str], words: usize) -> Table {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING);
    // Long names of recordings are broken, so that the numbers stay beside them.
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(COLUMNS as u16);
    table.set_style(TableComponent::HeaderLines, '─').set_style(TableComponent::MiddleHeaderIntersections, '─');
    table.set_header(head);
    for (number, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 1));
        if number >= words {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

fn row(words: &[&str], numbers: &[u64]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).chain(numbers.iter().map(u64::to_string)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_file_names() {
        assert_eq!(plain("us-101 07:50/a.b"), "us-101_07_50_a.b");
    }
}
