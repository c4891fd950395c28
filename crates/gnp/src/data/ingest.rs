//! Ingest: recordings are read a few at a time, reported on and kept in columns.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Instant;

use crate::error::{Context as _, Result};
use comfy_table::{CellAlignment, ContentArrangement, Table, TableComponent, presets};
use gnp_data::{
    Copies, DataError, Fingerprint, IngestReport, JUMP_ACCELERATION, JUMP_SPEED, LaneSource, LeftOut, Recording,
    RecordingDrops, Taken, read_with,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::RunConfig;
use crate::data::source::Found;
use crate::inside::inside;
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
    /// Every recording that is kept, in the order of the files.
    pub recordings: Vec<RecordingReport>,
    /// Recordings left out because others have their rows.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Files that were there and were not read, a sentence for each of the first and one for the others; rows skipped in the
    /// files of recordings left out.
    #[serde(default)]
    pub not_read: Vec<String>,
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
    let place = folder.join(RECORDINGS);
    fs::create_dir(&place).with_context(|| format!("cannot make the folder {}", place.display()))?;
    let work = machine.work("ingest", found.sources.len(), "files");
    let started = Instant::now();
    let (mut kept, mut rows) = (Kept::default(), 0u64);
    let at_once = rayon::current_num_threads().clamp(1, AT_ONCE);
    for (group, sources) in found.sources.chunks(at_once).enumerate() {
        machine.stop.check()?;
        work.at((group * at_once) as u64, &sources[0].name);
        let read = |source| {
            read_with(source, config.dataset, &found.options)
                .map(|all| all.into_iter().map(with_fingerprint).collect::<Vec<_>>())
        };
        let read: Vec<_> = sources.par_iter().map(read).collect();
        let mut to_save = Vec::new();
        for read in read {
            for (recording, quality, fingerprint) in read? {
                rows += quality.rows_read;
                let windows = config.windows.count(&recording)?;
                if let Some(file) = kept.take(&recording, fingerprint, quality, windows, folder)? {
                    to_save.push((file, recording));
                }
            }
        }
        to_save.retain(|(file, _)| kept.recordings.iter().any(|report| report.file == *file));
        to_save.par_iter().try_for_each(|(file, recording)| recording.save(&folder.join(file)))?;
    }
    let Kept { recordings, left_out, skipped, longest_s, .. } = kept;
    drop(work);
    if recordings.iter().all(|report| report.windows.windows == 0) {
        let needed_s = config.windows.observed_s + config.windows.predicted_s;
        return Err(DataError::NoWindow { needed_s, longest_s }.into());
    }
    let seconds = started.elapsed().as_secs_f64();
    let report = IngestSummary {
        data: found.data,
        recordings,
        left_out,
        not_read: found.not_read.into_iter().chain(skipped).collect(),
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

/// A recording that was read, what is told of it, and its rows in brief.
fn with_fingerprint((recording, quality): (Recording, IngestReport)) -> (Recording, IngestReport, Fingerprint) {
    let fingerprint = Fingerprint::of(&recording);
    (recording, quality, fingerprint)
}

/// What is kept of the recordings read so far.
#[derive(Default)]
struct Kept {
    recordings: Vec<RecordingReport>,
    left_out: Vec<LeftOut>,
    copies: Copies,
    /// Rows skipped in the files of recordings left out; a sentence each.
    skipped: Vec<String>,
    /// Files named so far.
    files: usize,
    longest_s: f64,
}

impl Kept {
    /// Takes a recording, unless it is a copy; earlier ones that are its copies go, with their files in `folder`.
    /// The file to save it to, from `folder`.
    fn take(
        &mut self,
        recording: &Recording,
        fingerprint: Fingerprint,
        quality: IngestReport,
        windows: RecordingDrops,
        folder: &Path,
    ) -> Result<Option<String>> {
        match self.copies.take(fingerprint)? {
            Taken::LeftOut(copy) => {
                self.leave_out(copy, &quality);
                return Ok(None);
            }
            Taken::Kept(copies) => copies.into_iter().try_for_each(|copy| self.forget(copy, folder))?,
        }
        let frames = recording.tracks().iter().map(|track| track.rows.len()).max().unwrap_or(0);
        self.longest_s = self.longest_s.max(frames.saturating_sub(1) as f64 / recording.meta().rate_hz);
        let file = format!("{RECORDINGS}/{:04}-{}.rec", self.files, plain(&recording.meta().name));
        self.files += 1;
        self.recordings.push(RecordingReport { file: file.clone(), quality, windows });
        Ok(Some(file))
    }

    /// Forgets an earlier recording that is a copy of one that came after it.
    fn forget(&mut self, copy: LeftOut, folder: &Path) -> Result<()> {
        let at = self.recordings.iter().position(|earlier| earlier.quality.recording == copy.recording);
        if let Some(report) = at.map(|at| self.recordings.remove(at)) {
            let file = folder.join(&report.file);
            match fs::remove_file(&file) {
                // It is not saved yet.
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                done => done.with_context(|| format!("cannot remove {}", file.display()))?,
            }
            self.leave_out(copy, &report.quality);
        }
        Ok(())
    }

    /// Says that a recording is left out. What its file says of other rows is said nowhere else.
    fn leave_out(&mut self, copy: LeftOut, quality: &IngestReport) {
        let skipped = quality.skipped_rows.iter();
        self.skipped
            .extend(skipped.map(|(reason, rows)| format!("{}: {rows} rows left out: {reason}", copy.recording)));
        self.left_out.push(copy);
    }
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
            recordings.push(Recording::load(&inside(folder, &kept.file)?)?);
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
        self.omissions().for_each(|omission| text.push_str(&format!("{omission}\n")));
        fitted(&text)
    }

    /// A sentence for each recording left out and for files that were not read.
    pub(crate) fn omissions(&self) -> impl Iterator<Item = String> {
        self.left_out.iter().map(LeftOut::sentence).chain(self.not_read.iter().cloned())
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

    /// A run may come from a stranger: what `ingest.json` names is read from the run folder or not at all.
    #[test]
    fn recordings_are_read_from_the_run_alone() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("run");
        fs::create_dir(&folder).unwrap();
        let machine = Machine::default();
        let config = RunConfig::embedded("ngsim", &["data.max_recordings=1".parse().unwrap()]).unwrap();
        let mut report = run(crate::data::source::find(&config, None).unwrap(), &config, &folder, &machine).unwrap();
        assert_eq!(report.load(&folder, &machine).unwrap().len(), 1);
        let outside = parent.path().join("outside.rec");
        fs::rename(folder.join(&report.recordings[0].file), &outside).unwrap();
        for name in ["../outside.rec", outside.to_str().unwrap()] {
            report.recordings[0].file = name.to_owned();
            let message = report.load(&folder, &machine).unwrap_err().to_string();
            assert!(message.contains("is no name of something in this folder"), "{message}");
        }
    }
}
