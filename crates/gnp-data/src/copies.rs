//! Recordings that are copies or cuts of others.
//!
//! A row is known by its vehicle, its frame and its place, in cells of 0.25 m. A recording nine in ten of whose rows are
//! another's is a copy of it, or a cut: whatever the files, columns and sites are called and however rows are sorted.
//! Scenes that overlap in part are none; they are kept together by [`overlaps`](crate::overlaps). So are rows numbered
//! anew, in vehicles or frames: the same vehicles at other places are other traffic.

use serde::{Deserialize, Serialize};

use crate::error::DataError;
use crate::recording::{Recording, Track};
use crate::window::Window;

/// Edge of a cell of places, m: beyond what files are rounded to, below how far apart vehicles are.
const CELL: f32 = 0.25;

/// Frames from one sampled row of a track to the next. Their numbers are multiples of it, so that cuts have the same.
const EVERY: u32 = 16;

/// Share of sampled rows from which a recording is a copy of another.
const SHARE: f64 = 0.9;

/// Fewest sampled rows that show a cut. A window of the usual length has five.
const FEWEST: usize = 4;

/// Sampled rows that are looked at first.
const FIRST: usize = 64;

/// What tells a recording's rows from those of others, in half a byte a row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    name: String,
    rows: u64,
    /// Over all rows, in whatever order.
    sum: u64,
    /// Hashes of the sampled rows, sorted, so that the first are drawn at random.
    sampled: Vec<u64>,
}

/// A recording that was left out for one that has its rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LeftOut {
    /// Name of the recording left out.
    pub recording: String,
    /// Name of the one that has its rows.
    pub copy_of: String,
    /// Share of its rows that are there, from samples.
    pub share: f64,
}

impl LeftOut {
    /// A sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { recording, copy_of, share } = self;
        format!("{recording} is left out: {:.0} % of its rows are those of {copy_of}", (share * 100.).floor())
    }
}

/// What becomes of a recording among those before it.
#[derive(Clone, Debug, PartialEq)]
pub enum Taken {
    /// It is kept, and these are left out for it.
    Kept(Vec<LeftOut>),
    /// It is left out.
    LeftOut(LeftOut),
}

/// Recordings of which none is a copy of another, in the order in which they came.
#[derive(Clone, Debug, Default)]
pub struct Copies {
    kept: Vec<Fingerprint>,
}

impl Copies {
    /// Takes another recording. Of two that have the same rows the one with fewer is left out, of two with equally many
    /// the later by name.
    ///
    /// # Errors
    /// [`DataError::DuplicateRecording`] when one of its name is kept already that has other rows.
    pub fn take(&mut self, new: Fingerprint) -> Result<Taken, DataError> {
        let before = |a: &Fingerprint, b: &Fingerprint| (b.rows, &a.name) <= (a.rows, &b.name);
        let larger = self.kept.iter().filter(|kept| before(kept, &new));
        if let Some(left_out) = larger.filter_map(|kept| new.left_out_for(kept)).next() {
            return Ok(Taken::LeftOut(left_out));
        }
        let mut left_out = Vec::new();
        self.kept.retain(|kept| match kept.left_out_for(&new).filter(|_| !before(kept, &new)) {
            Some(copy) => {
                left_out.push(copy);
                false
            }
            None => true,
        });
        if self.kept.iter().any(|kept| kept.name == new.name) {
            return Err(DataError::DuplicateRecording { recording: new.name });
        }
        self.kept.push(new);
        Ok(Taken::Kept(left_out))
    }
}

impl Fingerprint {
    /// Of all rows of a recording.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let mut sum = 0u64;
        let mut sampled = Vec::with_capacity(recording.len() / EVERY as usize);
        for track in recording.tracks() {
            for (frame, row) in (track.first_frame..).zip(track.rows.clone()) {
                let hash = hash(recording, track, frame, row);
                sum = sum.wrapping_add(hash);
                if frame % EVERY == 0 {
                    sampled.push(hash);
                }
            }
        }
        sampled.sort_unstable();
        Self { name: recording.meta().name.clone(), rows: recording.len() as u64, sum, sampled }
    }

    /// Of the rows of windows' targets, observed and predicted, under the name `name`.
    #[must_use]
    pub fn of_windows<'a>(name: &str, windows: impl Iterator<Item = Window<'a>>) -> Self {
        let mut sampled: Vec<u64> = windows.flat_map(|window| sampled_rows(&window)).collect();
        sampled.sort_unstable();
        sampled.dedup();
        Self { name: name.to_owned(), rows: sampled.len() as u64, sum: 0, sampled }
    }

    /// Whether a window is a stretch of these rows: nine in ten of its target's sampled rows are among them.
    #[must_use]
    pub fn shows(&self, window: &Window<'_>) -> bool {
        let sampled = sampled_rows(window);
        let found = sampled.iter().filter(|hash| self.sampled.binary_search(hash).is_ok()).count();
        found > 0 && found as f64 >= SHARE * sampled.len() as f64
    }

    /// That this is left out for `other`, if `other` has its rows.
    fn left_out_for(&self, other: &Self) -> Option<LeftOut> {
        let share = if (self.rows, self.sum) == (other.rows, other.sum) { 1. } else { self.share_in(other)? };
        (share >= SHARE).then(|| LeftOut { recording: self.name.clone(), copy_of: other.name.clone(), share })
    }

    /// Share of the sampled rows that are among those of `other`; `None` where there are too few, or it is near zero.
    fn share_in(&self, other: &Self) -> Option<f64> {
        let share = |rows: &[u64]| {
            rows.iter().filter(|hash| other.sampled.binary_search(hash).is_ok()).count() as f64 / rows.len() as f64
        };
        let first = self.sampled.get(..FIRST.min(self.sampled.len())).filter(|first| first.len() >= FEWEST)?;
        (share(first) >= SHARE / 2.).then(|| share(&self.sampled))
    }
}

/// Hashes of the sampled rows of a window's target, observed and predicted.
fn sampled_rows(window: &Window<'_>) -> Vec<u64> {
    let seen = window.observation();
    let (shape, last) = (seen.shape(), seen.frame());
    let first = last.saturating_sub(((shape.t_obs - 1) * shape.step) as u32);
    let frames = (first..=last + (shape.t_pred * shape.step) as u32).filter(|frame| frame % EVERY == 0);
    frames.filter_map(|frame| Some(hash(seen.recording, seen.track(), frame, seen.track().row_at(frame)?))).collect()
}

/// Of a vehicle, a frame and the cell it is in.
fn hash(recording: &Recording, track: &Track, frame: u32, row: usize) -> u64 {
    let columns = recording.columns();
    let cell = |value: f32| u64::from(((value / CELL).floor() as i32).cast_unsigned());
    let names = u64::from(track.vehicle) << 32 | u64::from(frame);
    mix(mix(names) ^ (cell(columns.x[row]) << 32 | cell(columns.y[row])))
}

/// The finaliser of SplitMix64: one to one, every bit of the input moves half of the output.
fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
