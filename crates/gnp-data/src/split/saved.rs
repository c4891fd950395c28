//! A split as a file: windows by name, under a hash that names them; all of it under a checksum.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Origin, Split, SplitKind, Subset};
use crate::error::DataError;
use crate::overlap::Overlap;
use crate::window::WindowId;
use crate::window_shape::WindowShape;
use crate::windows::WindowSet;

const VERSION: u32 = 3;

/// Windows of a part: recording, then vehicles, then last observed frames.
type Names = BTreeMap<String, Vec<Snippet>>;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Snippet {
    vehicle: u32,
    segment: u16,
    t0: Vec<u32>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SplitFile {
    version: u32,
    hash: String,
    shape: WindowShape,
    kinds: BTreeMap<String, SplitKind>,
    leaks: bool,
    seed: u64,
    dropped_at_boundary: BTreeMap<String, usize>,
    /// Absent where no driver was known to be in several recordings.
    #[serde(default)]
    dropped_drivers: BTreeMap<String, usize>,
    overlaps: Vec<Overlap>,
    train: Names,
    validation: Names,
    test: Names,
}

impl Split {
    /// Writes the split as JSON, windows by name, under a temporary name first.
    ///
    /// # Errors
    /// [`DataError::Io`] when the folder cannot be written.
    pub fn save(&self, set: &WindowSet<'_>, path: &Path) -> Result<(), DataError> {
        let io = |source| DataError::Io { file: path.into(), source };
        let file = SplitFile {
            version: VERSION,
            hash: self.hash.clone(),
            shape: set.shape(),
            kinds: self.kinds.clone(),
            leaks: self.leaks(),
            seed: self.seed,
            dropped_at_boundary: self.dropped_at_boundary.clone(),
            dropped_drivers: self.dropped_drivers.clone(),
            overlaps: self.overlaps.clone(),
            train: names(set, self.train()),
            validation: names(set, self.validation()),
            test: names(set, self.test()),
        };
        let text = gnp_file::json_line(&file).map_err(io)?;
        gnp_file::save(path, text.as_bytes()).map_err(io)
    }

    /// Reads a split that [`Split::save`] wrote, for the same recordings, which may stand in another
    /// order or among others.
    ///
    /// # Errors
    /// [`DataError::Io`] when the file cannot be read; [`DataError::SplitFile`] when it is no split, was changed,
    /// is of windows of another shape, or names a window that `set` does not hold;
    /// that of [`Split::check`] when it does not pass [`Split::check`].
    pub fn load(set: &WindowSet<'_>, path: &Path) -> Result<Self, DataError> {
        let bytes = std::fs::read(path).map_err(|source| DataError::Io { file: path.into(), source })?;
        let split = parse(set, &bytes).map_err(|reason| DataError::SplitFile { file: path.into(), reason })?;
        split.check(set)?;
        Ok(split)
    }
}

fn parse(set: &WindowSet<'_>, bytes: &[u8]) -> Result<Split, String> {
    let file: SplitFile = gnp_file::parse_json(bytes).map_err(|problem| format!("it {problem}"))?;
    if file.version != VERSION {
        return Err(format!("the file has format version {}, this program reads {VERSION}", file.version));
    }
    let (found, wanted) = (file.shape, set.shape());
    if !found.fits(&wanted) {
        return Err(format!("it parts windows of {found}, these have {wanted}"));
    }
    let parts = [ids(set, &file.train)?, ids(set, &file.validation)?, ids(set, &file.test)?];
    let SplitFile { kinds, seed, dropped_at_boundary, dropped_drivers, overlaps, .. } = file;
    let split = Split::with_hash(set, parts, Origin { kinds, seed, dropped_at_boundary, dropped_drivers, overlaps });
    if split.hash != file.hash {
        return Err(format!("its windows have the hash {}, it says {}: it was changed", split.hash, file.hash));
    }
    Ok(split)
}

/// Ids by name, sorted.
fn ids(set: &WindowSet<'_>, names: &Names) -> Result<Vec<WindowId>, String> {
    let recordings: BTreeMap<&str, usize> =
        set.recordings().iter().enumerate().map(|(i, recording)| (recording.meta().name.as_str(), i)).collect();
    let mut ids = Vec::new();
    for (name, snippets) in names {
        let index = *recordings.get(name.as_str()).ok_or_else(|| format!("recording {name} is not there"))?;
        let tracks = set.recordings()[index].tracks();
        for Snippet { vehicle, segment, t0 } in snippets {
            let key = (*vehicle, *segment);
            let missing = |frame: u32| {
                format!("recording {name} has no window of vehicle {vehicle} (segment {segment}) at frame {frame}")
            };
            let track = tracks.binary_search_by_key(&key, |track| (track.vehicle, track.segment));
            for frame in t0 {
                let track = track.map_err(|_| missing(*frame))?;
                let row = tracks[track].row_at(*frame).ok_or_else(|| missing(*frame))?;
                let id = WindowId { recording: index as u32, track: track as u32, row: row as u32 };
                ids.push(set.get(id).map(|_| id).ok_or_else(|| missing(*frame))?);
            }
        }
    }
    ids.sort_unstable();
    if ids.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err("it names a window twice in one part".to_owned());
    }
    Ok(ids)
}

/// Names of sorted ids. Vehicles are in the order of tracks, which is that of their numbers.
fn names(set: &WindowSet<'_>, ids: &[WindowId]) -> Names {
    let mut names = Names::new();
    for key in ids.iter().filter_map(|id| set.get(*id)).map(|window| window.key()) {
        let snippets = names.entry(key.recording).or_default();
        match snippets.last_mut() {
            Some(last) if (last.vehicle, last.segment) == (key.vehicle, key.segment) => last.t0.push(key.t0),
            _ => snippets.push(Snippet { vehicle: key.vehicle, segment: key.segment, t0: vec![key.t0] }),
        }
    }
    names
}

/// SHA-256 of the canonical text: a line with the windows' shape, then a line a window, by part,
/// recording name, vehicle, segment and frame.
pub(super) fn hash(set: &WindowSet<'_>, parts: &[Vec<WindowId>; 3]) -> String {
    let shape = set.shape();
    let mut text = format!("windows {} {} {}\n", shape.t_obs, shape.t_pred, shape.rate_hz);
    for (part, ids) in Subset::ALL.into_iter().zip(parts) {
        for (recording, snippets) in names(set, ids) {
            for Snippet { vehicle, segment, t0 } in snippets {
                for frame in t0 {
                    // Writing to a String cannot fail.
                    let _ = writeln!(text, "{} {recording} {vehicle} {segment} {frame}", part as usize);
                }
            }
        }
    }
    gnp_file::sha256([text.as_bytes()])
}
