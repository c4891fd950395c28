//! Recordings whose vehicle numbers mean the same vehicles, also where a pair of them has too few to show it.
//!
//! Numbers that mean the same in A and B, and in B and C, do so in A and C. So recordings are joined step by step, the
//! surest first, and what few vehicles of a pair cannot show, those of all connected recordings may.

use super::drivers::{CHANCE, LEAST_AGREEMENT, Sizes, agreement};
use super::{Overlap, SharedBy, by_index, same_site};
use crate::recording::Recording;

/// Largest probability that sizes at random agree as often, where none contradicts. Generous: a driver wrongly taken for
/// another costs a few windows, one that is not recognised is known from training.
const CHANCE_IF_NONE_CONTRADICTS: f64 = 0.05;

/// For each recording the number of its numbering: equal numbers, equal meaning.
pub(super) fn numberings(recordings: &[Recording], sizes: &[Sizes], overlaps: &[Overlap]) -> Vec<usize> {
    // By name, so that the result does not depend on the order of the recordings.
    let mut order: Vec<usize> = (0..recordings.len()).collect();
    order.sort_by_key(|i| &recordings[*i].meta().name);
    let mut classes: Vec<Class> =
        order.into_iter().map(|i| Class { members: vec![i], sizes: sizes[i].clone() }).collect();
    let mut by_drivers: Vec<_> =
        by_index(recordings, overlaps).into_iter().filter(|(_, _, it)| it.found == SharedBy::Drivers).collect();
    let name = |recording: usize| &recordings[recording].meta().name;
    by_drivers.sort_by_key(|(a, b, _)| (name(*a).min(name(*b)), name(*a).max(name(*b))));
    for (a, b, _) in by_drivers {
        let of = |member: usize| classes.iter().position(|class| class.members.contains(&member));
        if let (Some(a), Some(b)) = (of(a), of(b)) {
            join(&mut classes, a, b);
        }
    }
    while let Some((a, b)) = surest(&classes, recordings) {
        join(&mut classes, a, b);
    }
    let mut numbering = vec![0; recordings.len()];
    for (number, class) in classes.iter().enumerate() {
        for member in &class.members {
            numbering[*member] = number;
        }
    }
    numbering
}

/// Recordings of one numbering, and the vehicles of all of them.
struct Class {
    members: Vec<usize>,
    sizes: Sizes,
}

fn join(classes: &mut Vec<Class>, a: usize, b: usize) {
    let (a, b) = (a.min(b), a.max(b));
    if a != b {
        let Class { members, sizes } = classes.remove(b);
        classes[a].members.extend(members);
        for (vehicle, size) in sizes {
            classes[a].sizes.entry(vehicle).or_insert(size);
        }
    }
}

/// The two classes that are most surely one, if any are.
fn surest(classes: &[Class], recordings: &[Recording]) -> Option<(usize, usize)> {
    let first = |class: &Class| &recordings[class.members[0]];
    let mut best = None;
    for (a, one) in classes.iter().enumerate() {
        for (b, other) in
            classes.iter().enumerate().skip(a + 1).filter(|(_, other)| same_site(first(one), first(other)))
        {
            if let Some(chance) = one_numbering(&one.sizes, &other.sizes)
                && best.is_none_or(|(least, _)| chance < least)
            {
                best = Some((chance, (a, b)));
            }
        }
    }
    best.map(|(_, pair)| pair)
}

/// Probability that numbers agree by chance as these do, if that is small enough to say that they mean the same.
fn one_numbering(a: &Sizes, b: &Sizes) -> Option<f64> {
    let agreement = agreement(a, b).filter(|it| it.same as f64 >= LEAST_AGREEMENT * it.both as f64)?;
    let enough = if agreement.same == agreement.both { CHANCE_IF_NONE_CONTRADICTS } else { CHANCE };
    let chance = agreement.by_chance(a, b);
    (chance <= enough).then_some(chance)
}
