//! Tracks from one format to another.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use gnp_data::{Dataset, Format, IngestReport, TrackOptions, Tracks, Written, format_of};

use crate::error::{Context as _, Result, bail};
use crate::inside::inside;
use crate::machine::Machine;
use crate::predict::input::Input;

/// From what to what.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Conversion {
    /// File or folder of tracks.
    pub input: PathBuf,
    /// Its format; told by what is in it where `None`.
    pub from: Option<Dataset>,
    /// Format to write.
    pub to: Dataset,
    /// A file, whose name ends as files of the format do, for one recording; else a folder.
    pub output: PathBuf,
    /// What is known of the road, for formats whose tracks lie along one.
    pub options: TrackOptions,
}

impl Conversion {
    /// Of tracks whose format is told by what is in them, on a straight road.
    #[must_use]
    pub fn new(input: impl Into<PathBuf>, to: Dataset, output: impl Into<PathBuf>) -> Self {
        let (input, output) = (input.into(), output.into());
        Self { input, from: None, to, output, options: TrackOptions::default() }
    }
}

/// What was converted.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Converted {
    /// Format that was read.
    pub from: Dataset,
    /// Format that was written.
    pub to: Dataset,
    /// Recordings.
    pub recordings: usize,
    /// Files, rows, vehicles and what the format does not hold.
    pub written: Written,
    /// Rows and vehicles that were read and left out, or assumptions that were made: sentences.
    pub left_out: Vec<String>,
}

impl Converted {
    /// The lines that a user reads.
    #[must_use]
    pub fn text(&self) -> String {
        let Written { files, rows, vehicles, lost, .. } = &self.written;
        let mut text = format!(
            "{} -> {}: {} {} with {vehicles} vehicles in {rows} rows, {} {}\n",
            self.from,
            self.to,
            self.recordings,
            if self.recordings == 1 { "recording" } else { "recordings" },
            files.len(),
            if files.len() == 1 { "file" } else { "files" },
        );
        // Writing to a String cannot fail.
        for line in &self.left_out {
            let _ = writeln!(text, "in reading: {line}");
        }
        for (what, count) in lost {
            let _ = writeln!(text, "lost: {what} ({count})");
        }
        if lost.is_empty() {
            text += "nothing is lost\n";
        }
        text
    }
}

/// Reads tracks in one format and writes them in another, a recording at a time.
///
/// Formats whose tracks lie in a plane (plain tracks, SUMO, Argoverse 2) are converted into one another as they are; those
/// whose tracks lie along a road (NGSIM, highD) take and give recordings.
///
/// # Errors
/// When the input cannot be read or its format not be told, several recordings are to go into one file, the format does
/// not take them, or a file cannot be written.
pub fn convert(conversion: &Conversion, machine: &Machine) -> Result<Converted> {
    let Conversion { input, from, to, output, options } = conversion;
    let target = format_of(*to)?;
    if target.written_as().is_empty() {
        bail!(Unavailable, "{} is read and not written; convert to one of: {}", target.title(), writable());
    }
    let found = Input::find(input, *from)?;
    let format = format_of(found.dataset)?;
    found.notes.iter().for_each(|note| machine.progress.note(note));
    let single = is_file(target, output);
    let mut converted = Converted {
        from: format.dataset(),
        to: target.dataset(),
        recordings: 0,
        written: Written::default(),
        left_out: Vec::new(),
    };
    let work = machine.work("convert", found.sources.len(), "recordings");
    let several = |count: usize| -> Result<()> {
        if single && count > 1 {
            bail!(
                Recordings,
                "{}: {count} recordings do not go into one file; name a folder, without an ending such as {}",
                output.display(),
                target.written_as()[0]
            );
        }
        Ok(())
    };
    several(found.sources.len())?;
    let mut inputs = BTreeSet::new();
    for (done, source) in found.sources.iter().enumerate() {
        machine.stop.check()?;
        work.at(done as u64, &source.name);
        inputs.extend(source.files.iter().filter_map(|file| file.canonicalize().ok()));
        let all = Tracks::of(format, source, options)?;
        several(all.len())?;
        for (tracks, report) in all {
            let place = if single { output.clone() } else { place(output, tracks.name(), target)? };
            if place.canonicalize().is_ok_and(|place| inputs.contains(&place)) {
                bail!(Folder, "{}: this is the input; name another output", place.display());
            }
            let written = target.write(&tracks, options, &place)?;
            if tracks.is_simulated() && !single {
                let mark = output.join("SIMULATED");
                gnp_file::save(&mark, b"").with_context(|| format!("cannot write {}", mark.display()))?;
            }
            converted.recordings += 1;
            converted.written.add(written);
            converted.left_out.extend(said(&tracks, report.as_ref()));
        }
    }
    Ok(converted)
}

/// Sentences on what was left out or assumed in reading.
fn said(tracks: &Tracks, report: Option<&IngestReport>) -> Vec<String> {
    let name = tracks.name();
    let skipped = |rows: &BTreeMap<String, u64>| -> Vec<String> {
        rows.iter().map(|(why, rows)| format!("{name}: {rows} rows are left out: {why}")).collect()
    };
    match (tracks, report) {
        (Tracks::Table(table), _) => {
            let notes = table.notes.iter().map(|note| format!("{name}: {note}"));
            skipped(&table.skipped_rows).into_iter().chain(notes).collect()
        }
        (_, Some(report)) => {
            let repeated = report.duplicates + report.conflicts;
            let repeats =
                (repeated > 0).then(|| format!("{name}: {repeated} rows are left out that repeat a vehicle and frame"));
            let vehicles = report.vehicles_left_out.iter();
            let vehicles = vehicles.map(|(why, count)| format!("{name}: {count} vehicles are left out that {why}"));
            let notes = report.notes.iter().map(|note| format!("{name}: {note}"));
            skipped(&report.skipped_rows).into_iter().chain(vehicles).chain(repeats).chain(notes).collect()
        }
        _ => Vec::new(),
    }
}

/// Whether an output is a file of the format, by how its name ends.
fn is_file(target: &dyn Format, output: &Path) -> bool {
    let name = output.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let ends = |end: &&str| !end.is_empty() && (name.ends_with(end) || name.ends_with(&format!("{end}.gz")));
    !output.is_dir() && target.written_as().iter().any(ends)
}

/// Where a recording goes in a folder.
fn place(folder: &Path, name: &str, target: &dyn Format) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    inside(folder, &format!("{name}{}", target.written_as()[0]))
}

/// Names of formats that are written.
fn writable() -> String {
    let named = gnp_data::FORMATS.iter().filter(|format| !format.written_as().is_empty());
    named.map(|format| format.dataset().to_string()).collect::<Vec<_>>().join(", ")
}
