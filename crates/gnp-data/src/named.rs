//! The eight neighbour slots as a file names them, taken where positions and lanes do not contradict.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::limits::MAX_LANE_WIDTH;
use crate::parts::track_at;
use crate::recording::{NO_TRACK, Track};
use crate::slot::{SLOTS, Slot};

/// A neighbour may be this far on the wrong side, m: boxes and lanes are known to half of that.
const TOLERANCE: f32 = 1.;

/// Vehicles with different lane numbers that are laterally nearer than this, m, may be in one lane:
/// one of them is changing it.
const HALF_LANE: f32 = 2.;

/// Rows to which the file gives neighbours, by track.
pub(crate) struct Placed<'a> {
    pub(crate) tracks: &'a [Track],
    /// Centre, forward, m.
    pub(crate) x: &'a [f32],
    /// Centre, to the left, m.
    pub(crate) y: &'a [f32],
    pub(crate) lane: &'a [i16],
}

/// What became of the names in a slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Names {
    /// Vehicles named.
    pub(crate) named: usize,
    /// Of them those that cannot be there; the slot is left empty.
    pub(crate) wrong: usize,
    /// The first row of the data with such a one.
    pub(crate) first: Option<usize>,
}

/// Slots of every row and what was not taken.
#[derive(Debug, Default)]
pub(crate) struct Named {
    pub(crate) slots: Vec<[u32; SLOTS]>,
    /// Names of vehicles without a row in the frame.
    pub(crate) absent: u64,
    /// Other names that were not taken, by reason.
    pub(crate) not_taken: BTreeMap<&'static str, u64>,
    pub(crate) by_slot: [Names; SLOTS],
}

impl Placed<'_> {
    /// The slots from the vehicles that the file names, in the order of [`Slot::ALL`]; `pick` gives
    /// the row in `ids` of a row here.
    pub(crate) fn named(&self, ids: &[Vec<i32>; SLOTS], pick: impl Fn(usize) -> usize + Sync) -> Named {
        let mut slots = vec![[NO_TRACK; SLOTS]; self.x.len()];
        let mut rest = slots.as_mut_slice();
        let mut of_track = Vec::with_capacity(self.tracks.len());
        for track in self.tracks {
            let (mine, after) = rest.split_at_mut(track.rows.len());
            of_track.push((track, mine));
            rest = after;
        }
        let found = of_track.into_par_iter().map(|(track, mine)| self.fill(track, mine, ids, &pick));
        let sum = found.reduce(Named::default, Named::merge);
        Named { slots, ..sum }
    }

    /// Fills the slots of a track's rows; the result has no slots.
    fn fill(
        &self,
        track: &Track,
        mine: &mut [[u32; SLOTS]],
        ids: &[Vec<i32>; SLOTS],
        pick: &impl Fn(usize) -> usize,
    ) -> Named {
        let mut found = Named::default();
        // A neighbour stays the same over many rows: its track is looked up once.
        let mut last = [None::<(u32, usize)>; SLOTS];
        for (i, slots) in mine.iter_mut().enumerate() {
            let row = track.rows.start + i;
            let frame = track.first_frame + i as u32;
            let given = pick(row);
            for slot in Slot::ALL {
                let s = slot.index();
                // -1 stands for none as well as 0.
                let id = ids[s][given];
                if id == 0 || id == -1 {
                    continue;
                }
                found.by_slot[s].named += 1;
                let there = |vehicle: u32| {
                    let present =
                        |t: usize| self.tracks[t].vehicle == vehicle && self.tracks[t].row_at(frame).is_some();
                    let known = last[s].filter(|(same, t)| *same == vehicle && present(*t)).map(|(_, t)| t);
                    known.or_else(|| track_at(self.tracks, vehicle, frame))
                };
                let wrong = match u32::try_from(id).map(|vehicle| (vehicle, there(vehicle))) {
                    Err(_) => Some("a negative number"),
                    Ok((vehicle, _)) if vehicle == track.vehicle => Some("the vehicle itself"),
                    Ok((_, None)) => {
                        found.absent += 1;
                        found.by_slot[s].note(given);
                        continue;
                    }
                    Ok((vehicle, Some(t))) => {
                        last[s] = Some((vehicle, t));
                        slots[s] = t as u32;
                        self.tracks[t].row_at(frame).and_then(|other| self.doubt(slot, (track, row), (t, other)))
                    }
                };
                if let Some(reason) = wrong {
                    slots[s] = NO_TRACK;
                    *found.not_taken.entry(reason).or_insert(0) += 1;
                    found.by_slot[s].note(given);
                }
            }
        }
        found
    }

    /// Why a vehicle cannot be in a slot of another by where both are.
    fn doubt(&self, slot: Slot, (track, row): (&Track, usize), (t, other): (usize, usize)) -> Option<&'static str> {
        let its = &self.tracks[t];
        if its.road != track.road {
            return Some("a vehicle of the other carriageway");
        }
        let (ahead, left) = (self.x[other] - self.x[row], self.y[other] - self.y[row]);
        // 0 is an unknown lane: then the distance across the road alone tells.
        let unknown = self.lane[row] == 0 || self.lane[other] == 0;
        let same_lane = !unknown && self.lane[other] == self.lane[row];
        let near = if unknown { HALF_LANE + TOLERANCE } else { HALF_LANE };
        let lengthwise = match slot {
            Slot::Preceding | Slot::LeftPreceding | Slot::RightPreceding => ahead >= -TOLERANCE,
            Slot::Following | Slot::LeftFollowing | Slot::RightFollowing => ahead <= TOLERANCE,
            Slot::LeftAlongside | Slot::RightAlongside => {
                ahead.abs() <= f32::midpoint(its.length, track.length) + TOLERANCE
            }
        };
        let lateral = match slot {
            Slot::Preceding | Slot::Following => same_lane || left.abs() < near,
            Slot::LeftPreceding | Slot::LeftAlongside | Slot::LeftFollowing => {
                left > -TOLERANCE && (!same_lane || left > HALF_LANE)
            }
            Slot::RightPreceding | Slot::RightAlongside | Slot::RightFollowing => {
                left < TOLERANCE && (!same_lane || left < -HALF_LANE)
            }
        };
        if !lengthwise {
            Some("a vehicle that is elsewhere along the road")
        } else if !lateral || left.abs() > MAX_LANE_WIDTH {
            Some("a vehicle that is in another lane")
        } else {
            None
        }
    }
}

impl Names {
    fn note(&mut self, row: usize) {
        self.wrong += 1;
        self.first = Some(self.first.map_or(row, |first| first.min(row)));
    }

    fn merge(self, other: Self) -> Self {
        let first = [self.first, other.first].into_iter().flatten().min();
        Self { named: self.named + other.named, wrong: self.wrong + other.wrong, first }
    }
}

impl Named {
    fn merge(mut self, other: Self) -> Self {
        for (reason, count) in other.not_taken {
            *self.not_taken.entry(reason).or_insert(0) += count;
        }
        let by_slot = std::array::from_fn(|s| self.by_slot[s].merge(other.by_slot[s]));
        Self { absent: self.absent + other.absent, by_slot, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether vehicle 2 at `(x, y)` in `lane`, 5 m long as all, is taken for `slot` of vehicle 1, which is at the
    /// origin in lane 3.
    fn taken(slot: Slot, x: f32, y: f32, lane: i16) -> bool {
        taken_in([3, lane], slot, x, y)
    }

    /// The same with the lanes of both.
    fn taken_in(lanes: [i16; 2], slot: Slot, x: f32, y: f32) -> bool {
        let tracks = [Track::new(1, [5., 2.], 0, 0..1), Track::new(2, [5., 2.], 0, 1..2)];
        let placed = Placed { tracks: &tracks, x: &[0., x], y: &[0., y], lane: &lanes };
        let mut ids: [Vec<i32>; SLOTS] = std::array::from_fn(|_| vec![0, 0]);
        ids[slot.index()][0] = 2;
        let named = placed.named(&ids, |row| row);
        assert_eq!(named.slots[0][slot.index()] == NO_TRACK, named.by_slot[slot.index()].wrong == 1);
        named.slots[0][slot.index()] == 1
    }

    #[test]
    fn a_neighbour_is_where_its_slot_says() {
        let left = [Slot::LeftPreceding, Slot::LeftAlongside, Slot::LeftFollowing];
        let right = [Slot::RightPreceding, Slot::RightAlongside, Slot::RightFollowing];
        for (i, x) in [20., 3., -20.].into_iter().enumerate() {
            for (slot, y, lane) in [(left[i], 3.5, 2), (right[i], -3.5, 4)] {
                assert!(taken(slot, x, y, lane), "{slot:?}");
                assert!(!taken(slot, x, -y, lane), "{slot:?} on the other side");
                assert!(!taken(slot, if i == 1 { 7. } else { -x }, y, lane), "{slot:?} elsewhere along the road");
                assert!(!taken(slot, x, 0., 3), "{slot:?} in the same lane");
                assert!(!taken(slot, x, 3. * y, lane), "{slot:?} lanes away");
            }
        }
        assert!(taken(Slot::Preceding, 20., 3., 3) && taken(Slot::Preceding, 20., 1., 2));
        assert!(!taken(Slot::Preceding, -20., 0., 3) && !taken(Slot::Preceding, 20., 3.5, 2));
        assert!(taken(Slot::Following, -20., 0., 3) && !taken(Slot::Following, 20., 0., 3));
    }

    #[test]
    fn unknown_lanes_are_judged_by_the_distance_across_the_road() {
        for lanes in [[0, 0], [0, 3], [3, 0]] {
            assert!(!taken_in(lanes, Slot::Preceding, 20., 3.5) && taken_in(lanes, Slot::Preceding, 20., 2.5));
            assert!(
                taken_in(lanes, Slot::LeftPreceding, 20., 1.5) && taken_in(lanes, Slot::RightFollowing, -20., -1.5)
            );
            assert!(!taken_in(lanes, Slot::LeftPreceding, 20., -3.5));
        }
    }

    #[test]
    fn oneself_and_negative_numbers_are_nobody() {
        let tracks = [Track::new(1, [5., 2.], 0, 0..1)];
        let placed = Placed { tracks: &tracks, x: &[0.], y: &[0.], lane: &[3] };
        let mut ids: [Vec<i32>; SLOTS] = std::array::from_fn(|_| vec![-1]);
        (ids[0][0], ids[1][0], ids[2][0]) = (1, -7, 9);
        let named = placed.named(&ids, |row| row);
        assert_eq!(named.slots, [[NO_TRACK; SLOTS]]);
        assert_eq!(named.absent, 1);
        assert_eq!(named.not_taken, BTreeMap::from([("a negative number", 1), ("the vehicle itself", 1)]));
        assert_eq!(named.by_slot.map(|names| (names.named, names.wrong)).iter().filter(|n| **n == (1, 1)).count(), 3);
    }
}
