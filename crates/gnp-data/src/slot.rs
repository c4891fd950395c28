//! The eight neighbour slots.

use std::ops::{Index, IndexMut};

use serde::{Deserialize, Serialize};

/// The eight neighbour slots, in the order of every array that has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // the names say it
pub enum Slot {
    Preceding,
    Following,
    LeftPreceding,
    LeftAlongside,
    LeftFollowing,
    RightPreceding,
    RightAlongside,
    RightFollowing,
}

/// Number of neighbour slots.
pub const SLOTS: usize = 8;

impl Slot {
    /// All slots, in order.
    pub const ALL: [Self; SLOTS] = [
        Self::Preceding,
        Self::Following,
        Self::LeftPreceding,
        Self::LeftAlongside,
        Self::LeftFollowing,
        Self::RightPreceding,
        Self::RightAlongside,
        Self::RightFollowing,
    ];

    /// Its place in [`Slot::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The slot seen in a mirror along the road: left and right change places.
    #[must_use]
    pub fn mirrored(self) -> Self {
        match self {
            Self::Preceding => Self::Preceding,
            Self::Following => Self::Following,
            Self::LeftPreceding => Self::RightPreceding,
            Self::LeftAlongside => Self::RightAlongside,
            Self::LeftFollowing => Self::RightFollowing,
            Self::RightPreceding => Self::LeftPreceding,
            Self::RightAlongside => Self::LeftAlongside,
            Self::RightFollowing => Self::LeftFollowing,
        }
    }
}

/// One value a slot, indexed by [`Slot`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct BySlot<T>(
    /// In the order of [`Slot::ALL`].
    pub [T; SLOTS],
);

impl<T> BySlot<T> {
    /// The value that `of` gives for each slot.
    pub fn from_fn(of: impl FnMut(Slot) -> T) -> Self {
        Self(Slot::ALL.map(of))
    }

    /// The same slots with other values.
    pub fn map<U>(self, f: impl FnMut(T) -> U) -> BySlot<U> {
        BySlot(self.0.map(f))
    }

    /// Slots and their values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Slot, &T)> {
        Slot::ALL.into_iter().zip(&self.0)
    }

    /// Values, in the order of [`Slot::ALL`].
    pub fn values(&self) -> std::slice::Iter<'_, T> {
        self.0.iter()
    }
}

impl<T> Index<Slot> for BySlot<T> {
    type Output = T;

    fn index(&self, slot: Slot) -> &T {
        &self.0[slot.index()]
    }
}

impl<T> IndexMut<Slot> for BySlot<T> {
    fn index_mut(&mut self, slot: Slot) -> &mut T {
        &mut self.0[slot.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_finds_its_own_value() {
        let mut by_slot = BySlot::from_fn(Slot::index);
        for (i, slot) in Slot::ALL.into_iter().enumerate() {
            assert_eq!((by_slot[slot], slot.index(), slot.mirrored().mirrored()), (i, i, slot));
        }
        by_slot[Slot::LeftAlongside] = 70;
        assert_eq!(by_slot.map(|value| value + 1).0, [1, 2, 3, 71, 5, 6, 7, 8]);
    }
}
