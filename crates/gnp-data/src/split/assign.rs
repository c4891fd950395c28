//! Which window goes to which part.

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest as _, Sha256};

use super::{Part, SplitKind, frames_of};
use crate::window::WindowId;
use crate::windows::WindowSet;

/// Windows by part, and how many fell between two, by recording.
pub(super) struct Assigned {
    pub(super) parts: [Vec<WindowId>; 3],
    pub(super) straddling: BTreeMap<String, usize>,
}

/// Parts the windows `ids` of `set`, all of one kind.
pub(super) fn assign(
    set: &WindowSet<'_>,
    ids: Vec<WindowId>,
    kind: SplitKind,
    shares: [f64; 3],
    seed: u64,
) -> Assigned {
    let mut assigned = Assigned { parts: Default::default(), straddling: BTreeMap::new() };
    let mut by_name: BTreeMap<&str, Vec<WindowId>> = BTreeMap::new();
    for id in ids {
        if let Some(recording) = set.recording(id) {
            by_name.entry(&recording.meta().name).or_default().push(id);
        }
    }
    if kind == SplitKind::Recording {
        let sizes: Vec<usize> = by_name.values().map(Vec::len).collect();
        let parts = whole_groups(&sizes, shares, &mut rng(seed, "recordings"));
        for (part, ids) in parts.into_iter().zip(by_name.into_values()) {
            assigned.parts[part as usize].extend(ids);
        }
        return assigned;
    }
    for (name, ids) in by_name {
        match kind {
            SplitKind::Vehicle => {
                let mut of_vehicle: BTreeMap<u32, Vec<WindowId>> = BTreeMap::new();
                for id in ids {
                    let tracks = set.recordings()[id.recording as usize].tracks();
                    of_vehicle.entry(tracks[id.track as usize].vehicle).or_default().push(id);
                }
                let parts = drawn(of_vehicle.len(), shares, &mut rng(seed, name));
                for (part, ids) in parts.into_iter().zip(of_vehicle.into_values()) {
                    assigned.parts[part as usize].extend(ids);
                }
            }
            SplitKind::Time => {
                let straddling = assign_by_time(set, &ids, shares, &mut assigned.parts);
                assigned.straddling.insert(name.to_owned(), straddling);
            }
            SplitKind::Window | SplitKind::Recording => {
                let parts = drawn(ids.len(), shares, &mut rng(seed, name));
                for (part, id) in parts.into_iter().zip(ids) {
                    assigned.parts[part as usize].push(id);
                }
            }
        }
    }
    assigned
}

/// A generator for one recording, so that what is drawn for it does not depend on the others.
fn rng(seed: u64, name: &str) -> ChaCha8Rng {
    let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(name.as_bytes()).finalize();
    ChaCha8Rng::from_seed(digest.into())
}

/// A part for each of `count` things, drawn without replacement: the shares hold to within one thing,
/// and on average exactly, also where `count` is small.
fn drawn(count: usize, shares: [f64; 3], rng: &mut ChaCha8Rng) -> Vec<Part> {
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(rng);
    let phase: f64 = rng.random();
    let mut parts = vec![Part::Train; count];
    for (place, thing) in order.into_iter().enumerate() {
        parts[thing] = part_at((place as f64 + phase) / count as f64, shares);
    }
    parts
}

/// The part of a place between 0 and 1 when the parts lie end to end.
fn part_at(place: f64, shares: [f64; 3]) -> Part {
    if place < shares[0] {
        Part::Train
    } else if place < shares[0] + shares[1] {
        Part::Validation
    } else {
        Part::Test
    }
}

/// A part for each group of windows, whole. In a drawn order each group goes to the part that lacks
/// most windows; the last groups go to parts that are still empty, so that each part gets one.
fn whole_groups(sizes: &[usize], shares: [f64; 3], rng: &mut ChaCha8Rng) -> Vec<Part> {
    let total: usize = sizes.iter().sum();
    let mut lacking = shares.map(|share| share * total as f64);
    let mut empty = [true; 3];
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.shuffle(rng);
    let mut parts = vec![Part::Train; sizes.len()];
    for (place, group) in order.into_iter().enumerate() {
        let left = sizes.len() - place;
        let must_fill = left <= empty.iter().filter(|empty| **empty).count();
        let open = Part::ALL.into_iter().filter(|part| !must_fill || empty[*part as usize]);
        let part = open.max_by(|a, b| lacking[*a as usize].total_cmp(&lacking[*b as usize])).unwrap_or(Part::Train);
        lacking[part as usize] -= sizes[group] as f64;
        empty[part as usize] = false;
        parts[group] = part;
    }
    parts
}

/// Parts windows of one recording by stretches of its frames; returns how many lie in two.
fn assign_by_time(set: &WindowSet<'_>, ids: &[WindowId], shares: [f64; 3], parts: &mut [Vec<WindowId>; 3]) -> usize {
    let Some(recording) = ids.first().and_then(|id| set.recording(*id)) else { return 0 };
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(first);
    let frames = f64::from(last - first) + 1.;
    let part_of = |frame: u32| part_at((f64::from(frame - first) + 0.5) / frames, shares);
    let mut straddling = 0;
    for id in ids {
        match frames_of(set, *id).map(|(from, to)| (part_of(from), part_of(to))) {
            Some((from, to)) if from == to => parts[from as usize].push(*id),
            _ => straddling += 1,
        }
    }
    straddling
}
