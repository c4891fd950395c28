//! Who is whose neighbour in a changed scene: one rule for all changes.

use crate::neighbours::{LanePosition, find_neighbours};
use crate::slot::SLOTS;

/// A vehicle on a carriageway.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) vehicle: u32,
    pub(super) road: u16,
    pub(super) position: LanePosition,
}

/// Numbers of the vehicles in the slots of each of `placed` by their places; of the first `seen` of them, which the
/// others see, too.
pub(super) fn by_place(placed: &[Placed], seen: usize) -> Vec<[Option<u32>; SLOTS]> {
    let mut found = vec![[None; SLOTS]; placed.len()];
    let mut roads: Vec<u16> = placed.iter().map(|it| it.road).collect();
    roads.sort_unstable();
    roads.dedup();
    for road in roads {
        let here: Vec<usize> = (0..placed.len()).filter(|i| placed[*i].road == road).collect();
        let positions: Vec<LanePosition> = here.iter().map(|i| placed[*i].position).collect();
        for (i, slots) in here.iter().zip(find_neighbours(&positions)) {
            let number = |other: usize| (here[other] < seen).then(|| placed[here[other]].vehicle);
            found[*i] = slots.map(|other| other.and_then(number)).0;
        }
    }
    found
}

/// A slot of a vehicle before any change.
#[derive(Clone, Copy, Debug)]
pub(super) struct Before {
    /// Whom the data names.
    pub(super) named: Option<u32>,
    /// Who is there by places.
    pub(super) found: Option<u32>,
}

/// Who is in a slot after the changes; `found` by places. `stays` says whether a vehicle is there and where it was.
pub(super) fn after(before: Before, found: Option<u32>, owner_stays: bool, stays: impl Fn(u32) -> bool) -> Option<u32> {
    let Before { named, found: was } = before;
    let unchanged = found == was;
    // The data knows what places do not tell, as long as nobody concerned is moved.
    let data_knows = named != was && owner_stays && found.is_none_or(&stays);
    if named.is_none_or(&stays) && (unchanged || data_knows) { named } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_data_names_stays_unless_the_change_speaks_against_it() {
        let after = |named, was, found, moved: &[u32]| {
            after(Before { named, found: was }, found, true, |vehicle| !moved.contains(&vehicle))
        };
        // Nothing changed for this slot.
        assert_eq!(after(Some(7), Some(7), Some(7), &[9]), Some(7));
        assert_eq!(after(None, Some(7), Some(7), &[9]), None);
        assert_eq!(after(Some(8), Some(7), Some(7), &[9]), Some(8));
        // Who was there is gone, or moved out of the slot.
        assert_eq!(after(Some(7), Some(7), Some(5), &[7]), Some(5));
        assert_eq!(after(Some(8), Some(7), Some(7), &[8]), Some(7));
        // Moved within the slot.
        assert_eq!(after(Some(7), Some(7), Some(7), &[7]), Some(7));
        // Another one comes between.
        assert_eq!(after(Some(7), Some(7), Some(9), &[9]), Some(9));
        assert_eq!(after(None, Some(7), Some(9), &[9]), Some(9));
        // The data named another one than places did, and he is still there.
        assert_eq!(after(Some(8), Some(7), Some(5), &[7]), Some(8));
        assert_eq!(after(None, Some(7), Some(5), &[7]), None);
        // Of one that is moved itself, places alone tell.
        assert_eq!(super::after(Before { named: Some(8), found: Some(7) }, Some(5), false, |_| true), Some(5));
    }
}
