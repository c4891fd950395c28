//! Which window goes to which part.

use std::collections::{BTreeMap, BTreeSet};

use rand::seq::SliceRandom;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest as _, Sha256};

use super::{SplitKind, Subset, frames_of};
use crate::overlap::Drivers;
use crate::window::WindowId;
use crate::windows::WindowSet;

/// Windows by part, and how many are in none, by recording.
#[derive(Default)]
pub(super) struct Assigned {
    pub(super) parts: [Vec<WindowId>; 3],
    /// Those between two stretches of time.
    pub(super) dropped_at_boundary: BTreeMap<String, usize>,
    /// Those of drivers who are kept elsewhere.
    pub(super) dropped_drivers: BTreeMap<String, usize>,
}

/// How things are dealt out to the parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dealing {
    /// Share of each part; with folds, that of the test part is one by their number.
    pub(super) shares: [f64; 3],
    /// Number of folds; 1 is a single split.
    pub(super) folds: usize,
    /// The fold that is tested, from 0.
    pub(super) fold: usize,
}

impl Dealing {
    /// The part of a place between 0 and 1 when the folds lie end to end. The tested fold is
    /// compared as a whole number, so that over all folds each place is tested exactly once.
    fn part_at(self, place: f64) -> Subset {
        if self.folds == 1 {
            return part_at(place, self.shares);
        }
        let at = place * self.folds as f64;
        let own = (at as usize).min(self.folds - 1);
        let after = (own + self.folds - self.fold - 1) % self.folds;
        if after == self.folds - 1 {
            return Subset::Test;
        }
        // Of what is not tested, in order from the tested fold on.
        let place = (after as f64 + at.fract()) / (self.folds - 1) as f64;
        if place < self.shares[0] / (self.shares[0] + self.shares[1]) { Subset::Train } else { Subset::Validation }
    }
}

/// Parts the windows `ids` of `set`, all of one kind. Recordings with equal `groups` belong together, and so do the tracks
/// of one of `drivers` by kinds that promise that.
pub(super) fn assign(
    set: &WindowSet<'_>,
    ids: Vec<WindowId>,
    kind: SplitKind,
    groups: &[usize],
    drivers: &Drivers,
    dealing: Dealing,
    seed: u64,
) -> Assigned {
    let mut assigned = Assigned::default();
    let mut by_name: BTreeMap<&str, Vec<WindowId>> = BTreeMap::new();
    let name = |recording: usize| set.recordings()[recording].meta().name.as_str();
    let together: Vec<&str> = if kind == SplitKind::Recording {
        // A group is known by its first name, which does not depend on the order of recordings.
        let members = |of: usize| (0..groups.len()).filter(move |other| groups[*other] == groups[of]);
        (0..groups.len()).map(|of| members(of).map(name).min().unwrap_or_else(|| name(of))).collect()
    } else {
        (0..groups.len()).map(name).collect()
    };
    for id in ids {
        by_name.entry(together[id.recording as usize]).or_default().push(id);
    }
    if kind == SplitKind::Recording {
        // Windows of one vehicle are alike: a long scene is worth its vehicles, not its windows.
        let vehicles =
            |ids: &Vec<WindowId>| ids.iter().map(|id| (id.recording, id.track)).collect::<BTreeSet<_>>().len();
        let sizes: Vec<usize> = by_name.values().map(vehicles).collect();
        let parts = whole_groups(&sizes, dealing, &mut rng(seed, "recordings"));
        // Dealt before a window is dropped, so that recordings fall where they would without shared drivers.
        let homes = homes(&by_name, drivers);
        for (part, (group, ids)) in parts.into_iter().zip(by_name) {
            for id in ids {
                if driver(drivers, id).is_none_or(|driver| homes[&driver] == group) {
                    assigned.parts[part as usize].push(id);
                } else {
                    *assigned.dropped_drivers.entry(name(id.recording as usize).to_owned()).or_insert(0) += 1;
                }
            }
        }
        return assigned;
    }
    if kind == SplitKind::Vehicle {
        assign_by_driver(
            set,
            by_name,
            drivers,
            |name, count| drawn(count, dealing, &mut rng(seed, name)),
            &mut assigned,
        );
        return assigned;
    }
    for (name, ids) in by_name {
        match kind {
            SplitKind::Time => {
                let dropped_at_boundary = assign_by_time(set, &ids, dealing.shares, &mut assigned.parts);
                assigned.dropped_at_boundary.insert(name.to_owned(), dropped_at_boundary);
            }
            SplitKind::Window | SplitKind::Vehicle | SplitKind::Recording => {
                let parts = drawn(ids.len(), dealing, &mut rng(seed, name));
                for (part, id) in parts.into_iter().zip(ids) {
                    assigned.parts[part as usize].push(id);
                }
            }
        }
    }
    assigned
}

fn driver(drivers: &Drivers, id: WindowId) -> Option<usize> {
    drivers.driver(id.recording as usize, id.track as usize)
}

/// For each driver the recordings (under the name of what is kept together) in which it has most windows; of several the
/// first by name.
fn homes<'a>(by_name: &BTreeMap<&'a str, Vec<WindowId>>, drivers: &Drivers) -> BTreeMap<usize, &'a str> {
    let mut most: BTreeMap<usize, (usize, &str)> = BTreeMap::new();
    for (name, ids) in by_name {
        let mut windows: BTreeMap<usize, usize> = BTreeMap::new();
        for driver in ids.iter().filter_map(|id| driver(drivers, *id)) {
            *windows.entry(driver).or_insert(0) += 1;
        }
        for (driver, count) in windows {
            let home = most.entry(driver).or_insert((0, *name));
            if count > home.0 {
                *home = (count, *name);
            }
        }
    }
    most.into_iter().map(|(driver, (_, name))| (driver, name)).collect()
}

/// Draws the drivers of each recording, those who are most often in it; their windows elsewhere go with them.
fn assign_by_driver(
    set: &WindowSet<'_>,
    by_name: BTreeMap<&str, Vec<WindowId>>,
    drivers: &Drivers,
    draw: impl Fn(&str, usize) -> Vec<Subset>,
    assigned: &mut Assigned,
) {
    let homes = homes(&by_name, drivers);
    let mut part_of: BTreeMap<usize, Subset> = BTreeMap::new();
    for (name, ids) in &by_name {
        // In the order of vehicle numbers, which does not depend on other recordings.
        let mut vehicles: BTreeMap<usize, u32> = BTreeMap::new();
        for id in ids {
            if let Some(driver) = driver(drivers, *id).filter(|driver| homes[driver] == *name) {
                let vehicle = set.recordings()[id.recording as usize].tracks()[id.track as usize].vehicle;
                vehicles.entry(driver).and_modify(|least| *least = vehicle.min(*least)).or_insert(vehicle);
            }
        }
        let mut order: Vec<(u32, usize)> = vehicles.into_iter().map(|(driver, vehicle)| (vehicle, driver)).collect();
        order.sort_unstable();
        part_of.extend(order.iter().map(|(_, driver)| *driver).zip(draw(name, order.len())));
    }
    for id in by_name.into_values().flatten() {
        if let Some(part) = driver(drivers, id).and_then(|driver| part_of.get(&driver)) {
            assigned.parts[*part as usize].push(id);
        }
    }
}

/// A generator for one recording, so that what is drawn for it does not depend on the others.
fn rng(seed: u64, name: &str) -> ChaCha8Rng {
    let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(name.as_bytes()).finalize();
    ChaCha8Rng::from_seed(digest.into())
}

/// A part for each of `count` things, drawn without replacement: the shares hold to within one thing,
/// and on average exactly, also where `count` is small.
fn drawn(count: usize, dealing: Dealing, rng: &mut ChaCha8Rng) -> Vec<Subset> {
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(rng);
    let phase: f64 = rng.random();
    let mut parts = vec![Subset::Train; count];
    for (place, thing) in order.into_iter().enumerate() {
        parts[thing] = dealing.part_at((place as f64 + phase) / count as f64);
    }
    parts
}

/// The part of a place between 0 and 1 when the parts lie end to end.
fn part_at(place: f64, shares: [f64; 3]) -> Subset {
    if place < shares[0] {
        Subset::Train
    } else if place < shares[0] + shares[1] || shares[2] == 0. {
        Subset::Validation
    } else {
        Subset::Test
    }
}

/// Orders in which groups are dealt out, of which the one that comes nearest to the shares is kept.
const DEALS: usize = 64;

/// A part for each group of windows, whole, so that each part gets a group if there are three.
///
/// Folds are dealt first, the same whichever is tested; what is not tested is dealt out once more.
fn whole_groups(sizes: &[usize], dealing: Dealing, rng: &mut ChaCha8Rng) -> Vec<Subset> {
    let Dealing { shares: [train, validation, test], folds, fold } = dealing;
    let part = |of: usize| Subset::ALL[of];
    if folds == 1 {
        let shares = [train, validation, test];
        let given = if test > 0. { &shares[..] } else { &shares[..2] };
        return best_deal(sizes, given, rng).into_iter().map(part).collect();
    }
    let folds = best_deal(sizes, &vec![test; folds], rng);
    let (rest, others): (Vec<usize>, Vec<usize>) =
        sizes.iter().copied().enumerate().filter(|(group, _)| folds[*group] != fold).unzip();
    let mut parts = vec![Subset::Test; sizes.len()];
    for (group, of) in rest.into_iter().zip(best_deal(&others, &[train, validation], rng)) {
        parts[group] = part(of);
    }
    parts
}

/// A receiver for each group, each with about its share of the whole, none empty if it can be.
///
/// Groups may differ much in size, so that one deal can miss the shares by far: of several, all
/// drawn, the one with the smallest sum of (vehicles - due)² / due is taken, the first of equals.
fn best_deal(sizes: &[usize], shares: &[f64], rng: &mut ChaCha8Rng) -> Vec<usize> {
    let total = sizes.iter().sum::<usize>() as f64 / shares.iter().sum::<f64>();
    let due: Vec<f64> = shares.iter().map(|share| share * total).collect();
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    let mut best = (f64::INFINITY, Vec::new());
    for _ in 0..DEALS {
        order.shuffle(rng);
        let (receivers, lacking) = deal(sizes, &order, &due);
        let miss: f64 = lacking.iter().zip(&due).map(|(lacking, due)| lacking * lacking / due).sum();
        if miss < best.0 {
            best = (miss, receivers);
        }
    }
    best.1
}

/// Deals groups out in an order, each to the receiver that lacks the largest share of its due; the
/// last ones go to receivers that are still empty. Returns the receivers, and the vehicles that each
/// lacks in the end.
fn deal(sizes: &[usize], order: &[usize], due: &[f64]) -> (Vec<usize>, Vec<f64>) {
    let mut lacking = due.to_vec();
    let mut empty = vec![true; due.len()];
    let mut receivers = vec![0; sizes.len()];
    for (place, group) in order.iter().enumerate() {
        let left = sizes.len() - place;
        let must_fill = left <= empty.iter().filter(|empty| **empty).count();
        let open = (0..due.len()).filter(|receiver| !must_fill || empty[*receiver]);
        let share = |receiver: &usize| lacking[*receiver] / due[*receiver];
        let receiver = open.max_by(|a, b| share(a).total_cmp(&share(b))).unwrap_or(0);
        lacking[receiver] -= sizes[*group] as f64;
        empty[receiver] = false;
        receivers[*group] = receiver;
    }
    (receivers, lacking)
}

/// Parts windows of one recording by stretches of its frames; returns how many lie in two.
fn assign_by_time(set: &WindowSet<'_>, ids: &[WindowId], shares: [f64; 3], parts: &mut [Vec<WindowId>; 3]) -> usize {
    let Some(recording) = ids.first().and_then(|id| set.recording(*id)) else { return 0 };
    let first = recording.tracks().iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(first);
    let frames = f64::from(last - first) + 1.;
    let part_of = |frame: u32| part_at((f64::from(frame - first) + 0.5) / frames, shares);
    let mut dropped_at_boundary = 0;
    for id in ids {
        match frames_of(set, *id).map(|(from, to)| (part_of(from), part_of(to))) {
            Some((from, to)) if from == to => parts[from as usize].push(*id),
            _ => dropped_at_boundary += 1,
        }
    }
    dropped_at_boundary
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONCE: Dealing = Dealing { shares: [0.7, 0.1, 0.2], folds: 1, fold: 0 };

    fn thirds(fold: usize) -> Dealing {
        Dealing { shares: [0.5, 1. / 6., 1. / 3.], folds: 3, fold }
    }

    /// Each thing is tested in one fold; the rest trains and validates three to one.
    fn holds_for_folds(sizes: &[usize], deal: impl Fn(usize) -> Vec<Subset>, off: f64) {
        let total = sizes.iter().sum::<usize>() as f64;
        let folds: Vec<Vec<Subset>> = (0..3).map(deal).collect();
        for thing in 0..sizes.len() {
            assert_eq!(folds.iter().filter(|parts| parts[thing] == Subset::Test).count(), 1, "{thing}: {folds:?}");
        }
        for parts in &folds {
            let of = |part| parts.iter().zip(sizes).filter(|(p, _)| **p == part).map(|(_, size)| size).sum::<usize>();
            for (part, share) in [(Subset::Train, 0.5), (Subset::Validation, 1. / 6.), (Subset::Test, 1. / 3.)] {
                assert!((of(part) as f64 - share * total).abs() <= off, "{part:?}: {}, {parts:?}", of(part));
            }
        }
    }

    #[test]
    fn over_all_folds_each_group_and_each_thing_is_tested_once() {
        let sizes = [30, 11, 86, 25, 14, 40, 20, 33, 17, 9];
        for seed in 0..20 {
            let deal = |fold| whole_groups(&sizes, thirds(fold), &mut ChaCha8Rng::seed_from_u64(seed));
            holds_for_folds(&sizes, deal, 24.);
            let deal = |fold| drawn(100, thirds(fold), &mut ChaCha8Rng::seed_from_u64(seed));
            holds_for_folds(&[1; 100], deal, 2.);
        }
    }

    #[test]
    fn one_large_group_trains_and_the_rest_is_shared_out() {
        let sizes = [30, 11, 860, 25, 14, 40, 20];
        for seed in 0..20 {
            let parts = whole_groups(&sizes, ONCE, &mut ChaCha8Rng::seed_from_u64(seed));
            assert_eq!(parts[2], Subset::Train, "seed {seed}: {parts:?}");
            let of = |part| parts.iter().zip(sizes).filter(|(p, _)| **p == part).map(|(_, size)| size).sum::<usize>();
            assert!((30..=60).contains(&of(Subset::Validation)), "seed {seed}: {parts:?}");
            assert!((80..=110).contains(&of(Subset::Test)), "seed {seed}: {parts:?}");
        }
    }

    #[test]
    fn shares_of_drawn_things_hold_to_within_one() {
        for count in [1, 2, 3, 7, 10, 33, 100] {
            let parts = drawn(count, ONCE, &mut ChaCha8Rng::seed_from_u64(9));
            for (part, share) in Subset::ALL.into_iter().zip([0.7, 0.1, 0.2]) {
                let got = parts.iter().filter(|p| **p == part).count() as f64;
                assert!((got - share * count as f64).abs() <= 1., "{count}: {parts:?}");
            }
        }
    }
}
