//! Recordings that show the same vehicles.
//!
//! Scenes cut from one measurement may overlap in time, or show the same drivers at another time.
//! Held-out scenes are only held out if such scenes stay together. The first are found from the
//! motion itself, whatever the vehicles are called: several vehicles of the same length that do the
//! same, and distinctive, thing at the same shift in time. The second are found from the vehicles'
//! numbers and sizes ([`drivers`]).

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::recording::Recording;

mod drivers;
mod event;
mod identity;
mod meeting;
mod numbering;

pub use identity::Drivers;

/// Length of the snippets of motion that are compared, s.
const STRETCH_S: f64 = 1.2;
/// Speeds of a snippet that enter its signature.
const SAMPLES: usize = 5;
/// Width of a speed bin of a signature, m/s. Coarser than the noise between two cuts of one scene.
const SPEED_BIN: f32 = 0.3;
/// Two snippets are one when speeds and positions relative to their start agree within this.
const SPEED_TOLERANCE: f32 = 0.1;
const LATERAL_TOLERANCE: f32 = 0.06;
const LONGITUDINAL_TOLERANCE: f32 = 0.2;
/// A snippet must change its speed by at least this to tell drivers apart, m/s.
const DISTINCTIVE: f32 = 0.15;
/// A signature that more snippets than this have tells no vehicles apart.
const COMMON: usize = 256;
/// Vehicles that must agree at one shift in time and in space. One or two may do so by chance.
const VEHICLES: usize = 3;
/// Shifts in space that count as one, m: scenes may start at different points of the road.
const PLACE: f32 = 0.5;
/// Rows above which only a fraction of the signatures is kept, chosen by the signature itself.
const ROWS_IN_FULL: usize = 1_000_000;

/// Two recordings that show the same vehicles.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Overlap {
    /// Name of the first recording.
    pub first: String,
    /// Name of the second recording.
    pub second: String,
    /// Site of both.
    pub site: String,
    /// Vehicles found in both.
    pub vehicles: usize,
    /// What they were found by.
    pub found: SharedBy,
}

/// What tells that two recordings show the same vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SharedBy {
    /// They move alike at one time.
    Motion {
        /// Frames to add to a frame of the second to get the frame of the first.
        shift: i64,
    },
    /// They have the same numbers and sizes, at any time.
    Drivers,
}

impl fmt::Display for Overlap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { first, second, vehicles, .. } = self;
        match self.found {
            SharedBy::Motion { .. } => {
                write!(f, "{first} and {second} show {vehicles} of the same vehicles at one time")
            }
            SharedBy::Drivers => write!(f, "{first} and {second} have {vehicles} drivers in common"),
        }
    }
}

/// Pairs of tracks that move alike at one shift in time, with their shift in space, m.
type Places = BTreeMap<(u32, u32), f32>;

/// A snippet of motion: where it is, under a signature of what it is.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Snippet {
    signature: u64,
    recording: u32,
    track: u32,
    row: u32,
}

/// Pairs of recordings of one site that show the same vehicles, by name; a pair may be found in both ways.
///
/// By motion, at one rate: overlaps of two seconds or more with at least three vehicles that change their speed; nothing
/// is said of shorter ones. By drivers: at least three vehicles, and a fifth of the smaller recording, with the same
/// number, length and width, where the numbers of both recordings mean the same vehicles: nine in ten numbers that both
/// have stand for the same size, far more than by chance.
#[must_use]
pub fn overlaps(recordings: &[Recording]) -> Vec<Overlap> {
    let mut found = same_motion(recordings);
    found.extend(drivers::same_drivers(recordings));
    found
}

fn same_motion(recordings: &[Recording]) -> Vec<Overlap> {
    let rows: usize = recordings.iter().map(Recording::len).sum();
    let share = 1 + (rows / ROWS_IN_FULL) as u64;
    let mut snippets = Vec::new();
    for (index, recording) in recordings.iter().enumerate() {
        collect(index as u32, recording, share, &mut snippets);
    }
    snippets.sort_unstable();
    // (recording a, recording b, shift in time) -> pairs of tracks that move alike, with their shift in space; snippets
    let mut alike: BTreeMap<(u32, u32, i64), (Places, usize)> = BTreeMap::new();
    for run in snippets.chunk_by(|a, b| a.signature == b.signature).filter(|run| run.len() <= COMMON) {
        for (i, a) in run.iter().enumerate() {
            for b in run[i + 1..].iter().filter(|b| b.recording != a.recording) {
                let (ra, rb) = (&recordings[a.recording as usize], &recordings[b.recording as usize]);
                if comparable(ra, rb) && agree(ra, a, rb, b) {
                    let shift = frame(ra, a) - frame(rb, b);
                    let place = ra.columns().x[a.row as usize] - rb.columns().x[b.row as usize];
                    let (places, count) = alike.entry((a.recording, b.recording, shift)).or_default();
                    places.insert((a.track, b.track), place);
                    *count += 1;
                }
            }
        }
    }
    // A frame aside, what moves evenly still looks alike: of shifts with as many vehicles the one with most snippets.
    let mut found: BTreeMap<(u32, u32), (usize, usize, i64)> = BTreeMap::new();
    for ((a, b, shift), (pairs, snippets)) in alike {
        let vehicles = at_one_place(&pairs);
        let rank = |(vehicles, snippets, shift): (usize, usize, i64)| (vehicles, snippets, Reverse(shift.abs()));
        let best = found.entry((a, b)).or_insert((0, 0, shift));
        if rank((vehicles, snippets, shift)) > rank(*best) {
            *best = (vehicles, snippets, shift);
        }
    }
    let meta = |index: u32| recordings[index as usize].meta().clone();
    found
        .into_iter()
        .filter(|(_, (vehicles, _, _))| *vehicles >= VEHICLES)
        .map(|((a, b), (vehicles, _, shift))| {
            let first = meta(a);
            let found = SharedBy::Motion { shift };
            Overlap { first: first.name, second: meta(b).name, site: first.site, vehicles, found }
        })
        .collect()
}

fn comparable(a: &Recording, b: &Recording) -> bool {
    same_site(a, b) && a.meta().rate_hz == b.meta().rate_hz
}

fn same_site(a: &Recording, b: &Recording) -> bool {
    a.meta().dataset == b.meta().dataset && a.meta().site == b.meta().site
}

fn stretch_frames(recording: &Recording) -> usize {
    ((STRETCH_S * recording.meta().rate_hz).round() as usize).max(SAMPLES)
}

fn collect(index: u32, recording: &Recording, share: u64, out: &mut Vec<Snippet>) {
    let frames = stretch_frames(recording);
    let vx = &recording.columns().vx;
    for (track, t) in recording.tracks().iter().enumerate() {
        // The last row's velocity is one-sided, and so are a cut's ends: leave them out.
        for row in t.rows.start + 1..t.rows.end.saturating_sub(frames) {
            let speeds: [f32; SAMPLES] = std::array::from_fn(|i| vx[row + i * (frames - 1) / (SAMPLES - 1)]);
            let (low, high) = speeds.iter().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            if high - low < DISTINCTIVE {
                continue;
            }
            let length = (t.length * 10.).round() as i64;
            let bins = speeds.iter().map(|v| (v / SPEED_BIN).round() as i64);
            let signature = std::iter::once(length).chain(bins).fold(0xcbf2_9ce4_8422_2325u64, |hash, value| {
                (hash ^ value as u64).wrapping_mul(0x0100_0000_01b3).rotate_left(17)
            });
            if signature.is_multiple_of(share) {
                out.push(Snippet { signature, recording: index, track: track as u32, row: row as u32 });
            }
        }
    }
}

/// Whether two snippets are one motion, frame by frame.
fn agree(ra: &Recording, a: &Snippet, rb: &Recording, b: &Snippet) -> bool {
    let (ca, cb) = (ra.columns(), rb.columns());
    let (a, b) = (a.row as usize, b.row as usize);
    (0..stretch_frames(ra)).all(|i| {
        let along = (ca.x[a + i] - ca.x[a]) - (cb.x[b + i] - cb.x[b]);
        let across = (ca.y[a + i] - ca.y[a]) - (cb.y[b + i] - cb.y[b]);
        (ca.vx[a + i] - cb.vx[b + i]).abs() < SPEED_TOLERANCE
            && along.abs() < LONGITUDINAL_TOLERANCE
            && across.abs() < LATERAL_TOLERANCE
    })
}

fn frame(recording: &Recording, snippet: &Snippet) -> i64 {
    let track = &recording.tracks()[snippet.track as usize];
    i64::from(track.first_frame) + (snippet.row as usize - track.rows.start) as i64
}

/// The most vehicles that share one shift in space, each in one pair only: at one instant a vehicle
/// of the first recording can be one of the second.
fn at_one_place(pairs: &Places) -> usize {
    let near = |centre: f32| {
        let (mut left, mut right) = (BTreeSet::new(), BTreeSet::new());
        pairs
            .iter()
            .filter(|(_, place)| (*place - centre).abs() < PLACE)
            .filter(|((a, b), _)| !left.contains(a) && !right.contains(b) && left.insert(*a) && right.insert(*b))
            .count()
    };
    pairs.values().map(|place| near(*place)).max().unwrap_or(0)
}

/// Overlaps with the indices of their two recordings, those of recordings that are there.
fn by_index<'o>(recordings: &[Recording], overlaps: &'o [Overlap]) -> Vec<(usize, usize, &'o Overlap)> {
    let index: BTreeMap<&str, usize> =
        recordings.iter().enumerate().map(|(i, recording)| (recording.meta().name.as_str(), i)).collect();
    let of = |name: &str| index.get(name).copied();
    overlaps.iter().filter_map(|it| Some((of(&it.first)?, of(&it.second)?, it))).collect()
}

/// For each recording the first recording (by index) that it is connected with through overlaps,
/// itself if with none: equal numbers must stay in one part of a split.
#[must_use]
pub fn groups(recordings: &[Recording], overlaps: &[Overlap]) -> Vec<usize> {
    let mut group: Vec<usize> = (0..recordings.len()).collect();
    for (a, b, _) in by_index(recordings, overlaps) {
        let (low, high) = (group[a].min(group[b]), group[a].max(group[b]));
        for member in &mut group {
            if *member == high {
                *member = low;
            }
        }
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::recording::{Columns, NO_TRACK, RecordingMeta, Road, Track};
    use crate::slot::SLOTS;

    /// A cut of frames `from..from + 60` of made-up traffic: vehicle `i` speeds up and slows down
    /// in its own rhythm. `noise` moves every value a little, as a second measurement would.
    pub(super) fn cut(name: &str, vehicles: std::ops::Range<u32>, from: u32, noise: f32) -> Recording {
        let (mut tracks, mut columns) = (Vec::new(), Columns::default());
        for (n, i) in vehicles.enumerate() {
            let start = columns.x.len();
            for row in 0..60u32 {
                let t = (from + row) as f32 * 0.1;
                let (pace, swing) = (0.7 + 0.13 * i as f32, 2. + 0.1 * i as f32);
                columns.x.push(20. * t - swing / pace * (pace * t).cos() + noise);
                columns.y.push(0.3 * (0.5 * pace * t).sin() + noise);
                columns.vx.push(20. + swing * (pace * t).sin() + noise * 0.5);
                columns.vy.push(0.);
                columns.lane.push(1);
                columns.neighbours.push([NO_TRACK; SLOTS]);
            }
            let size = [4. + 0.1 * i as f32, 2.];
            tracks.push(Track::new(n as u32 + 1, size, 1, start..columns.x.len()));
        }
        let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", name, 10.);
        let roads = vec![Road { driving_direction: 2, lines: Vec::new(), fitted: false, axis: None }];
        Recording::from_parts(meta, roads, tracks, columns).unwrap()
    }

    #[test]
    fn finds_two_cuts_of_one_measurement_and_their_shift() {
        let recordings =
            [cut("a", 0..6, 100, 0.), cut("b", 20..26, 100, 0.), cut("c", 2..8, 115, 0.02), cut("d", 5..9, 130, 0.)];
        let found = overlaps(&recordings);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].first.as_str(), found[0].second.as_str()), ("a", "c"));
        assert_eq!((found[0].vehicles, found[0].found), (4, SharedBy::Motion { shift: 15 }));
        assert_eq!((found[1].first.as_str(), found[1].second.as_str()), ("c", "d"));
        assert_eq!((found[1].vehicles, found[1].found), (3, SharedBy::Motion { shift: 15 }));
        // a and d share one vehicle at most: they are together because c connects them.
        assert_eq!(groups(&recordings, &found), [0, 1, 0, 0]);
    }

    #[test]
    fn one_vehicle_alike_is_chance() {
        assert_eq!(overlaps(&[cut("a", 0..6, 100, 0.), cut("d", 5..9, 110, 0.)]), []);
    }
}
