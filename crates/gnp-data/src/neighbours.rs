//! The eight neighbour slots from lane numbers and positions along the road, for data that does not
//! name them all.

use rayon::prelude::*;

use crate::lookup::FrameIndex;
use crate::recording::{NO_TRACK, SLOTS, Slot, Track};

/// Ramp lanes: numbers from here on all lie to the right of the lane before, at different places
/// along the road.
const RAMP: i16 = 7;

/// Frames whose slots are computed before they are written back: bounds the memory in use.
const FRAMES: usize = 512;

/// A vehicle in a frame.
#[derive(Clone, Copy)]
struct Present {
    lane: i16,
    x: f32,
    half_length: f32,
    track: u32,
    row: u32,
}

/// Slots of every row. Lane 1 is the leftmost; in the lanes beside, a body that overlaps lengthwise
/// is alongside (the nearest of several), otherwise the nearest ahead precedes and the nearest
/// behind follows. Rows without a lane number have no neighbours and are nobody's.
pub(crate) fn from_lanes(tracks: &[Track], frames: &FrameIndex, x: &[f32], lane: &[i16]) -> Vec<[u32; SLOTS]> {
    let mut slots = vec![[NO_TRACK; SLOTS]; x.len()];
    let Some(first) = tracks.iter().map(|track| track.first_frame).min() else { return slots };
    let last = tracks.iter().map(Track::last_frame).max().unwrap_or(first);
    for block in (first..=last).step_by(FRAMES) {
        let end = last.min(block.saturating_add(FRAMES as u32 - 1));
        let found: Vec<(u32, [u32; SLOTS])> = (block..=end)
            .into_par_iter()
            .flat_map_iter(|frame| in_frame(tracks, frames.present(frame), frame, x, lane))
            .collect();
        for (row, neighbours) in found {
            slots[row as usize] = neighbours;
        }
    }
    slots
}

/// Row and slots of every vehicle of a frame.
fn in_frame(tracks: &[Track], present: &[u32], frame: u32, x: &[f32], lane: &[i16]) -> Vec<(u32, [u32; SLOTS])> {
    let mut vehicles: Vec<Present> = present
        .iter()
        .filter_map(|track| {
            let it = &tracks[*track as usize];
            let row = it.row_at(frame)?;
            let lane = lane[row].min(RAMP);
            let known = Present { lane, x: x[row], half_length: it.length / 2., track: *track, row: row as u32 };
            (lane > 0).then_some(known)
        })
        .collect();
    vehicles.sort_unstable_by(|a, b| a.lane.cmp(&b.lane).then(a.x.total_cmp(&b.x)).then(a.track.cmp(&b.track)));
    let lane_of = |number: i16| {
        let from = vehicles.partition_point(|other| other.lane < number);
        let to = vehicles.partition_point(|other| other.lane <= number);
        &vehicles[from..to]
    };
    let slots = vehicles.iter().enumerate().map(|(i, me)| {
        let mut slots = [NO_TRACK; SLOTS];
        let same = |other: Option<&Present>| other.filter(|o| o.lane == me.lane).map_or(NO_TRACK, |o| o.track);
        slots[Slot::Preceding as usize] = same(vehicles.get(i + 1));
        slots[Slot::Following as usize] = same(i.checked_sub(1).and_then(|i| vehicles.get(i)));
        let sides = [
            (me.lane - 1, [Slot::LeftPreceding, Slot::LeftAlongside, Slot::LeftFollowing]),
            (me.lane + 1, [Slot::RightPreceding, Slot::RightAlongside, Slot::RightFollowing]),
        ];
        for (number, [ahead, beside, behind]) in sides {
            let found = beside_of(me, lane_of(number));
            slots[ahead as usize] = found[0];
            slots[beside as usize] = found[1];
            slots[behind as usize] = found[2];
        }
        (me.row, slots)
    });
    slots.collect()
}

/// Tracks ahead of, alongside and behind `me` in a lane sorted by x.
fn beside_of(me: &Present, lane: &[Present]) -> [u32; 3] {
    let overlaps = |other: &Present| (other.x - me.x).abs() < other.half_length + me.half_length;
    let middle = lane.partition_point(|other| other.x < me.x);
    let (behind, ahead) = lane.split_at(middle);
    let name = |other: Option<&Present>| other.map_or(NO_TRACK, |other| other.track);
    // Bodies differ in length, so the nearest centre may be clear while one further off overlaps.
    let near_ahead = ahead.iter().take_while(|other| other.x - me.x < LONGEST).find(|other| overlaps(other));
    let near_behind = behind.iter().rev().take_while(|other| me.x - other.x < LONGEST).find(|other| overlaps(other));
    let alongside = match (near_ahead, near_behind) {
        (Some(a), Some(b)) => Some(if a.x - me.x <= me.x - b.x { a } else { b }),
        (a, b) => a.or(b),
    };
    [
        name(ahead.iter().find(|other| !overlaps(other))),
        name(alongside),
        name(behind.iter().rev().find(|other| !overlaps(other))),
    ]
}

/// No two bodies whose centres are further apart overlap lengthwise, m.
const LONGEST: f32 = 40.;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::VehicleClass;

    /// Slots in one frame of vehicles given as (lane, x, length), in a fixed order of slots.
    fn slots(vehicles: &[(i16, f32, f32)]) -> Vec<[u32; SLOTS]> {
        let tracks: Vec<Track> = vehicles
            .iter()
            .enumerate()
            .map(|(i, (_, _, length))| Track {
                vehicle: i as u32 + 10,
                segment: 0,
                road: 0,
                class: VehicleClass::Car,
                length: *length,
                width: 1.8,
                first_frame: 3,
                rows: i..i + 1,
            })
            .collect();
        let frames = FrameIndex::new(&vec![(3, 3); tracks.len()]);
        let x: Vec<f32> = vehicles.iter().map(|v| v.1).collect();
        let lane: Vec<i16> = vehicles.iter().map(|v| v.0).collect();
        from_lanes(&tracks, &frames, &x, &lane)
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
            (0, 100., 5.), // no lane: nobody
        ]);
        assert_eq!(found[0], [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(found[9], [N, 1, N, N, 3, N, N, 6]);
        assert_eq!(found[10], [N; SLOTS]);
    }

    #[test]
    fn left_of_the_leftmost_and_right_of_the_ramp_is_nobody() {
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
}
