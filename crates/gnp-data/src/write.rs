//! Tracks written in the layouts of the formats, and what a layout does not hold.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::error::DataError;
use crate::lanes::lane_at;
use crate::recording::{Recording, Road, Track};
use crate::track_options::TrackOptions;
use crate::tracks::Tracks;

pub(crate) mod argoverse;
mod columns;
pub(crate) mod fcd;
pub(crate) mod highd;
pub(crate) mod ngsim;
pub(crate) mod plain;
mod plane;

pub use self::fcd::{write_fcd, write_fcd_types};

/// What was written of tracks, and what of them the layout does not hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Written {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Rows in them.
    pub rows: u64,
    /// Vehicles in them.
    pub vehicles: u64,
    /// What is not in them: a sentence, and of how many rows, vehicles or lines it is true.
    pub lost: BTreeMap<String, u64>,
}

impl Written {
    /// Counts what the layout does not hold; nothing where `count` is 0.
    pub fn lose(&mut self, what: &str, count: usize) {
        if count > 0 {
            *self.lost.entry(what.to_owned()).or_default() += count as u64;
        }
    }

    /// The same with what else was written.
    pub fn add(&mut self, other: Self) {
        self.files.extend(other.files);
        self.rows += other.rows;
        self.vehicles += other.vehicles;
        for (what, count) in other.lost {
            *self.lost.entry(what).or_default() += count;
        }
    }
}

/// Writes tracks in a layout along a road, and counts what of tracks in a plane is left out there.
pub(crate) fn along_road(
    tracks: &Tracks,
    options: &TrackOptions,
    write: impl Fn(&Recording) -> Result<Written, DataError>,
) -> Result<Written, DataError> {
    let mut written = Written::default();
    for (recording, left_out) in tracks.recordings(options)? {
        written.add(write(&recording)?);
        written.add(Written { lost: left_out, ..Written::default() });
    }
    Ok(written)
}

/// Writes a file, packed where its name ends with `.gz`; whole or not at all.
pub(crate) fn to_file(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), DataError> {
    let packed = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("gz"));
    atomically(path, |file| {
        let mut out = BufWriter::with_capacity(1 << 18, file);
        if packed {
            let mut packer = GzEncoder::new(&mut out, Compression::default());
            fill(&mut packer)?;
            packer.finish()?;
        } else {
            fill(&mut out)?;
        }
        out.flush()
    })
}

/// Writes a file, whole or not at all.
pub(crate) fn atomically(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), DataError> {
    let write = || {
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let mut file = gnp_file::beside(path)?;
        fill(file.as_file_mut())?;
        file.persist(path)
    };
    write().map_err(|source| DataError::Io { file: path.into(), source })
}

/// `path` with `-part` behind the name of the file, before its extension.
pub(crate) fn numbered(path: &Path, part: &str) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    // A name may begin with a dot, which starts no extension.
    let end = name.char_indices().skip(1).find(|(_, c)| *c == '.').map_or(name.len(), |(place, _)| place);
    path.with_file_name(format!("{}-{part}{}", &name[..end], &name[end..]))
}

/// Lane of a row, 1 the leftmost, 0 unknown: by the number that the data has, where the order of these is known, else by
/// the lines.
pub(crate) fn lane(recording: &Recording, road: &Road, row: usize) -> i16 {
    let number = recording.columns.lane[row];
    let placed = recording.lane_order.as_ref().and_then(|order| order.get(&number)).filter(|place| **place > 0);
    placed.copied().unwrap_or_else(|| lane_at(&road.lines, recording.columns.y[row]))
}

/// Frame of a row of a track.
pub(crate) fn frame(track: &Track, row: usize) -> u32 {
    track.first_frame + (row - track.rows.start) as u32
}

/// What is added to frames so that frame 0 is at the zero of the clock; `None` where that is before it or too far after.
pub(crate) fn frames_since_zero(recording: &Recording) -> Option<u32> {
    let frames = recording.meta().start_s * recording.meta().rate_hz;
    let near = (0. ..=1e7).contains(&frames) && (frames - frames.round()).abs() < 0.05;
    near.then_some(frames.round() as u32)
}

/// Vehicle of a neighbour of a row; 0 for none.
pub(crate) fn neighbour(recording: &Recording, row: usize, slot: crate::Slot) -> u32 {
    recording.neighbour(row, slot).map_or(0, |track| recording.tracks()[track].vehicle)
}

/// Vehicles that have another name in the data than their number.
pub(crate) fn renamed(recording: &Recording) -> usize {
    let mut vehicles: Vec<u32> = recording.tracks().iter().map(|track| track.vehicle).collect();
    vehicles.dedup();
    vehicles.into_iter().filter(|vehicle| recording.vehicle_name(*vehicle) != vehicle.to_string()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_numbered_before_the_extension() {
        assert_eq!(numbered(Path::new("a/b.csv.gz"), "2"), Path::new("a/b-2.csv.gz"));
        assert_eq!(numbered(Path::new("b"), "x"), Path::new("b-x"));
        assert_eq!(numbered(Path::new(".b.csv"), "1"), Path::new(".b-1.csv"));
    }
}
