//! The eight neighbour slots from lane numbers and positions along the road, for data that does not
//! name them all.

use rayon::prelude::*;

use crate::lookup::FrameIndex;
use crate::recording::{NO_TRACK, Track};
use crate::slot::{BySlot, SLOTS, Slot};

/// Frames whose slots are computed before they are written back: bounds the memory in use.
const FRAMES: usize = 512;

/// A vehicle among others at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LanePosition {
    /// Number of its lane, 1 leftmost; 0 or less where unknown.
    pub lane: i16,
    /// Centre along the road, m.
    pub x: f32,
    /// Length, m.
    pub length: f32,
}

/// A vehicle and its place in the list it was given in.
#[derive(Clone, Copy, Debug)]
struct Placed {
    it: LanePosition,
    index: usize,
}

/// The neighbours of every vehicle of `vehicles`, all at one moment on one carriageway, as indices
/// into `vehicles`.
///
/// In its own lane the next ahead precedes and the next behind follows. In the lane beside, a body
/// that overlaps lengthwise is alongside (the nearest of several), otherwise the nearest ahead
/// precedes and the nearest behind follows. Where the lane is unknown a vehicle has no neighbours
/// and is none.
///
/// ```
/// use gnp_data::{LanePosition, Slot, find_neighbours};
///
/// let at = |lane, x| LanePosition { lane, x, length: 4.5 };
/// let slots = find_neighbours(&[at(2, 0.), at(2, 30.), at(1, 3.)]);
/// assert_eq!(slots[0][Slot::Preceding], Some(1));
/// assert_eq!(slots[0][Slot::LeftAlongside], Some(2));
/// assert_eq!(slots[1][Slot::LeftFollowing], Some(2));
/// ```
#[must_use]
pub fn find_neighbours(vehicles: &[LanePosition]) -> Vec<BySlot<Option<usize>>> {
    let mut found = Neighbours::default();
    found.find(vehicles);
    found.slots
}

/// What [`find_neighbours`] finds, in buffers that are used again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    slots: Vec<BySlot<Option<usize>>>,
    /// Vehicles by lane and position.
    placed: Vec<Placed>,
}

impl Neighbours {
    /// Finds those of all vehicles of a moment.
    pub(crate) fn find(&mut self, vehicles: &[LanePosition]) {
        let Self { slots, placed } = self;
        let known = vehicles.iter().enumerate().filter(|(_, it)| it.lane > 0);
        placed.clear();
        placed.extend(known.map(|(index, it)| Placed { it: *it, index }));
        slots.clear();
        slots.resize(vehicles.len(), BySlot::default());
        find(placed, slots);
    }

    /// Those of a vehicle, in the order of [`Slot::ALL`]; none where there is no such vehicle.
    pub(crate) fn of(&self, vehicle: usize) -> [Option<usize>; SLOTS] {
        self.slots.get(vehicle).map_or([None; SLOTS], |slots| slots.0)
    }
}

fn find(placed: &mut [Placed], slots: &mut [BySlot<Option<usize>>]) {
    placed
        .sort_unstable_by(|a, b| a.it.lane.cmp(&b.it.lane).then(a.it.x.total_cmp(&b.it.x)).then(a.index.cmp(&b.index)));
    let lane_of = |number: i16| {
        let from = placed.partition_point(|other| other.it.lane < number);
        let to = placed.partition_point(|other| other.it.lane <= number);
        &placed[from..to]
    };
    for (i, me) in placed.iter().enumerate() {
        let mine = &mut slots[me.index];
        let same = |other: Option<&Placed>| other.filter(|o| o.it.lane == me.it.lane).map(|o| o.index);
        mine[Slot::Preceding] = same(placed.get(i + 1));
        mine[Slot::Following] = same(i.checked_sub(1).and_then(|i| placed.get(i)));
        let sides = [
            (me.it.lane - 1, [Slot::LeftPreceding, Slot::LeftAlongside, Slot::LeftFollowing]),
            (me.it.lane.saturating_add(1), [Slot::RightPreceding, Slot::RightAlongside, Slot::RightFollowing]),
        ];
        for (number, beside) in sides {
            for (slot, found) in beside.into_iter().zip(beside_of(&me.it, lane_of(number))) {
                mine[slot] = found;
            }
        }
    }
}

/// Slots of every row; `lane_from_left` gives a lane number of the file its place in the order that
/// [`find_neighbours`] needs.
pub(crate) fn from_lanes(
    tracks: &[Track],
    frames: &FrameIndex,
    x: &[f32],
    lane: &[i16],
    lane_from_left: fn(i16) -> i16,
) -> Vec<[u32; SLOTS]> {
    let mut slots = vec![[NO_TRACK; SLOTS]; x.len()];
    let Some(first) = tracks.iter().map(|track| track.first_frame).min() else { return slots };
    let last = tracks.iter().map(Track::last_frame).max().unwrap_or(first);
    // The vehicles of a carriageway are neighbours of one another alone.
    let in_frame = |frame: u32| {
        let mut present: Vec<(u16, u32, usize)> = frames
            .present(frame)
            .iter()
            .filter_map(|track| {
                let it = &tracks[*track as usize];
                Some((it.road, *track, it.row_at(frame)?))
            })
            .collect();
        present.sort_by_key(|(road, ..)| *road);
        let mut found = Vec::with_capacity(present.len());
        for road in present.chunk_by(|a, b| a.0 == b.0) {
            let position = |&(_, track, row): &(u16, u32, usize)| LanePosition {
                lane: lane_from_left(lane[row]),
                x: x[row],
                length: tracks[track as usize].length,
            };
            let positions: Vec<LanePosition> = road.iter().map(position).collect();
            let slots = find_neighbours(&positions);
            let named = |slots: BySlot<Option<usize>>| slots.map(|other| other.map_or(NO_TRACK, |i| road[i].1)).0;
            found.extend(road.iter().zip(slots).map(|((_, _, row), slots)| (*row, named(slots))));
        }
        found
    };
    for block in (first..=last).step_by(FRAMES) {
        let end = last.min(block.saturating_add(FRAMES as u32 - 1));
        let found: Vec<(usize, [u32; SLOTS])> = (block..=end).into_par_iter().flat_map_iter(in_frame).collect();
        for (row, neighbours) in found {
            slots[row] = neighbours;
        }
    }
    slots
}

/// Vehicles ahead of, alongside and behind `me` in a lane sorted by x.
fn beside_of(me: &LanePosition, lane: &[Placed]) -> [Option<usize>; 3] {
    let overlaps = |other: &&Placed| (other.it.x - me.x).abs() < other.it.length / 2. + me.length / 2.;
    let clear = |other: &&Placed| !overlaps(other);
    let middle = lane.partition_point(|other| other.it.x < me.x);
    let (behind, ahead) = lane.split_at(middle);
    // Bodies differ in length, so the nearest centre may be clear while one further off overlaps.
    let near_ahead = ahead.iter().take_while(|other| other.it.x - me.x < LONGEST).find(overlaps);
    let near_behind = behind.iter().rev().take_while(|other| me.x - other.it.x < LONGEST).find(overlaps);
    let alongside = match (near_ahead, near_behind) {
        (Some(a), Some(b)) => Some(if a.it.x - me.x <= me.x - b.it.x { a } else { b }),
        (a, b) => a.or(b),
    };
    [ahead.iter().find(clear), alongside, behind.iter().rev().find(clear)].map(|other| other.map(|other| other.index))
}

/// No two bodies whose centres are further apart overlap lengthwise, m.
const LONGEST: f32 = 40.;

#[cfg(test)]
mod tests {
    use super::*;

    /// Slots of vehicles given as (lane, x, length), in a fixed order of slots.
    fn slots(vehicles: &[(i16, f32, f32)]) -> Vec<[u32; SLOTS]> {
        let place = |(i, (lane, x, length)): (usize, &(i16, f32, f32))| {
            (Track::new(i as u32 + 10, [*length, 1.8], 3, i..i + 1), *x, *lane)
        };
        let (mut tracks, mut x, mut lane) = (Vec::new(), Vec::new(), Vec::new());
        for (track, at, number) in vehicles.iter().enumerate().map(place) {
            tracks.push(track);
            x.push(at);
            lane.push(number);
        }
        let frames = FrameIndex::new(&vec![(3, 3); tracks.len()]);
        from_lanes(&tracks, &frames, &x, &lane, |lane| lane.min(7))
    }

    const N: u32 = NO_TRACK;

    #[test]
    fn all_eight_slots() {
        let found = slots(&[
            (2, 100., 5.), // the one asked about
            (2, 120., 5.),
            (2, 80., 5.),
            (1, 111., 5.), // left ahead
            (1, 104., 5.), // left alongside
            (1, 70., 5.),
            (3, 105., 4.8), // right: 5 m ahead, clear of 4.9 m
            (3, 95.2, 5.),  // right alongside: 4.8 m behind, bodies overlap
            (3, 60., 5.),
            (2, 140., 5.), // hidden behind 1
            (0, 100., 5.), // no lane: no neighbour of anyone
        ]);
        assert_eq!(found[0], [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(found[9], [N, 1, N, N, 3, N, N, 6]);
        assert_eq!(found[10], [N; SLOTS]);
    }

    #[test]
    fn left_of_the_leftmost_and_right_of_the_ramp_there_is_none() {
        let found = slots(&[(1, 0., 5.), (7, 0., 5.), (8, 300., 5.), (6, 1., 5.)]);
        assert_eq!(found[0], [N; SLOTS]);
        // Both ramps are right of lane 6.
        assert_eq!(found[3], [N, N, N, N, N, 2, 1, N]);
        assert_eq!(found[1], [2, N, N, 3, N, N, N, N]);
    }

    #[test]
    fn the_nearest_of_two_alongside() {
        let found = slots(&[(2, 0., 20.), (1, 6., 5.), (1, -5., 5.), (1, 30., 5.)]);
        assert_eq!(found[0], [N, N, 3, 2, N, N, N, N]);
    }

    #[test]
    fn carriageways_do_not_mix() {
        let mut tracks = vec![Track::new(1, [5., 2.], 0, 0..1), Track::new(2, [5., 2.], 0, 1..2)];
        let found = |tracks: &[Track]| {
            from_lanes(tracks, &FrameIndex::new(&[(0, 0); 2]), &[0., 30.], &[1, 1], |lane| lane)[0][0]
        };
        assert_eq!(found(&tracks), 1);
        tracks[1].road = 1;
        assert_eq!(found(&tracks), N);
    }
}
