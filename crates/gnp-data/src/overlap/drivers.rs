//! The same drivers, at whatever time: vehicles with the same number, length and width.
//!
//! Numbers mean the same vehicles where recordings were cut from one measurement. Elsewhere vehicles
//! are numbered anew, and numbers and sizes coincide by chance, often so where sizes are few. Two
//! things tell them apart: where numbers mean the same, (nearly) each number that both recordings have
//! stands for one size; and so many equal sizes are beyond what sizes drawn at random would give.

use std::collections::BTreeMap;

use super::{Overlap, SharedBy, VEHICLES, same_site};
use crate::recording::Recording;

/// Sizes that count as one differ by no more, m.
const SIZE_TOLERANCE: f32 = 1e-3;
/// Least fraction of the smaller recording's vehicles that must be in both: a few on the edge are no reason to keep two
/// recordings together.
const LEAST_SHARE: f64 = 0.2;
/// Least fraction of the numbers in both that must stand for one size.
pub(super) const LEAST_AGREEMENT: f64 = 0.9;
/// Largest probability that sizes at random agree as often.
pub(super) const CHANCE: f64 = 1e-4;

/// Length and width of each vehicle, m.
pub(super) type Sizes = BTreeMap<u32, [f32; 2]>;

/// Pairs of recordings that show the same drivers.
pub(super) fn same_drivers(recordings: &[Recording]) -> Vec<Overlap> {
    let sizes: Vec<Sizes> = recordings.iter().map(sizes).collect();
    let mut found = Vec::new();
    for (a, first) in recordings.iter().enumerate() {
        for (b, second) in recordings.iter().enumerate().skip(a + 1).filter(|(_, second)| same_site(first, second)) {
            if let Some(vehicles) = in_common(&sizes[a], &sizes[b]) {
                let (first, second) = (first.meta(), second.meta().name.clone());
                let (name, site) = (first.name.clone(), first.site.clone());
                found.push(Overlap { first: name, second, site, vehicles, found: SharedBy::Drivers });
            }
        }
    }
    found
}

pub(super) fn sizes(recording: &Recording) -> Sizes {
    recording.tracks().iter().map(|track| (track.vehicle, [track.length, track.width])).collect()
}

pub(super) fn alike(a: &[f32; 2], b: &[f32; 2]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SIZE_TOLERANCE)
}

/// Vehicles of the same number and size, if they are the same drivers.
fn in_common(a: &Sizes, b: &Sizes) -> Option<usize> {
    let agreement = agreement(a, b)?;
    let Agreement { same, both } = agreement;
    let smaller = a.len().min(b.len()) as f64;
    let enough = same >= VEHICLES && same as f64 >= LEAST_SHARE * smaller;
    if !enough || (same as f64) < LEAST_AGREEMENT * both as f64 {
        return None;
    }
    (agreement.by_chance(a, b) <= CHANCE).then_some(same)
}

/// Numbers that two recordings share.
pub(super) struct Agreement {
    /// Numbers in both.
    pub(super) both: usize,
    /// Those that stand for one size.
    pub(super) same: usize,
}

/// `None` without a number in both.
pub(super) fn agreement(a: &Sizes, b: &Sizes) -> Option<Agreement> {
    let both = a.iter().filter_map(|(vehicle, size)| Some(alike(size, b.get(vehicle)?)));
    let (both, same) = both.fold((0, 0), |(both, same), alike| (both + 1, same + usize::from(alike)));
    (both > 0).then_some(Agreement { both, same })
}

impl Agreement {
    /// Probability that as many numbers stand for one size if sizes are drawn at random.
    pub(super) fn by_chance(&self, a: &Sizes, b: &Sizes) -> f64 {
        // A vehicle of the one and any vehicle of the other.
        let equal: usize = a.values().map(|size| b.values().filter(|other| alike(size, other)).count()).sum();
        at_least(self.same, self.both, equal as f64 / (a.len() * b.len()) as f64)
    }
}

/// Probability that of `of` draws, each a success with `probability`, at least `successes` are.
fn at_least(successes: usize, of: usize, probability: f64) -> f64 {
    if probability >= 1. {
        return 1.;
    }
    // Logarithms, since for many draws the terms are small beyond what a double holds.
    let log_of = |n: usize| (1..=n).map(|i| (i as f64).ln()).sum::<f64>();
    let (hit, miss) = (probability.ln(), (1. - probability).ln());
    let term = |k: usize| log_of(of) - log_of(k) - log_of(of - k) + k as f64 * hit + (of - k) as f64 * miss;
    (successes..=of).map(|k| term(k).exp()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vehicles of these numbers, the size of each by `size`.
    fn vehicles(numbers: impl Iterator<Item = u32>, size: impl Fn(u32) -> [f32; 2]) -> Sizes {
        numbers.map(|number| (number, size(number))).collect()
    }

    /// One of `kinds` sizes, at random by number and seed.
    fn drawn(kinds: u32, seed: u32) -> impl Fn(u32) -> [f32; 2] {
        move |number| {
            let hash = (number.wrapping_mul(2_654_435_761) ^ seed.wrapping_mul(40_503)).wrapping_mul(2_246_822_519);
            [4. + 0.1 * ((hash >> 13) % kinds) as f32, 1.8]
        }
    }

    #[test]
    fn the_same_numbers_and_sizes_are_the_same_drivers() {
        let first = vehicles(0..30, drawn(20, 1));
        // Twenty go, forty come; sizes are rounded otherwise.
        let rounded = |number| drawn(20, 1)(number).map(|side: f32| side + 4e-4);
        assert_eq!(in_common(&first, &vehicles(20..60, rounded)), Some(10));
        assert_eq!(in_common(&first, &vehicles(20..60, |n| drawn(20, 1)(n).map(|side| side + 4e-3))), None);
        // 5 of 30 are less than a fifth, 6 are a fifth.
        assert_eq!(in_common(&first, &vehicles(25..60, drawn(20, 1))), None);
        assert_eq!(in_common(&first, &vehicles(24..60, drawn(20, 1))), Some(6));
        // Two vehicles are too few, whatever the share.
        assert_eq!(in_common(&vehicles(0..2, drawn(20, 1)), &first), None);
    }

    #[test]
    fn vehicles_numbered_anew_are_not() {
        // From sizes nearly all different to three types.
        for kinds in [3, 20, 400] {
            for seed in 2..40 {
                let (one, other) = (vehicles(1..200, drawn(kinds, 1)), vehicles(1..150, drawn(kinds, seed)));
                assert_eq!(in_common(&one, &other), None, "{kinds} sizes, seed {seed}");
            }
        }
        // All of one size, and nineteen in twenty.
        assert_eq!(in_common(&vehicles(0..200, |_| [4.5, 1.8]), &vehicles(0..200, |_| [4.5, 1.8])), None);
        let mostly = |seed| move |n| if drawn(20, seed)(n)[0] < 4.05 { [12., 2.5] } else { [4.5, 1.8] };
        for seed in 2..40 {
            assert_eq!(in_common(&vehicles(0..200, mostly(1)), &vehicles(0..200, mostly(seed))), None, "seed {seed}");
        }
    }

    #[test]
    fn numbers_that_mean_other_vehicles_contradict() {
        // Two periods, numbered from 1 each: ten of forty coincide.
        let other = |number: u32| if number < 10 { drawn(20, 1)(number) } else { [9., 2.] };
        assert_eq!(in_common(&vehicles(0..40, drawn(20, 1)), &vehicles(0..40, other)), None);
    }

    #[test]
    fn probabilities_are_those_of_the_binomial() {
        assert!((at_least(2, 3, 0.5) - 0.5).abs() < 1e-12);
        assert!((at_least(3, 3, 0.1) - 1e-3).abs() < 1e-12);
        assert!((at_least(0, 50, 0.3) - 1.).abs() < 1e-9);
        assert!(at_least(900, 1000, 0.5) < 1e-100);
        assert_eq!(at_least(5, 5, 1.), 1.);
    }
}
