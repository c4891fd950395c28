//! The scene before any change, and what its changes are measured by.

use std::sync::Arc;

use super::road_lanes::RoadLanes;
use super::slots::{Before, Placed, by_place};
use crate::leader::NAMED_LEADER_SIZE;
use crate::neighbours::LanePosition;
use crate::recording::{NO_TRACK, NamedLeader, Recording, Track};
use crate::slot::{SLOTS, Slot};
use crate::snapshot::Snapshot;

/// A scene before any change.
#[derive(Debug)]
pub(super) struct Base {
    pub(super) scene: Arc<Snapshot>,
    /// By carriageway.
    pub(super) lanes: Vec<RoadLanes>,
    /// By track.
    pub(super) placed: Vec<Placed>,
    /// By track.
    pub(super) slots: Vec<[Before; SLOTS]>,
    /// Leaders that last rows name.
    pub(super) named: Vec<Named>,
}

/// A vehicle without a row of its own that the last row of a track names as its leader.
#[derive(Debug)]
pub(super) struct Named {
    /// The track.
    pub(super) track: usize,
    /// The leader where its follower's row says, as its number.
    pub(super) placed: Placed,
    /// Who follows it.
    pub(super) follower: Before,
    /// Its speed by the last two rows, m/s, where both name it.
    pub(super) speed: Option<f32>,
}

impl Base {
    pub(super) fn of(mut scene: Snapshot) -> Self {
        let Recording { tracks, names, .. } = &mut scene.recording;
        names.retain(|vehicle, _| tracks.binary_search_by_key(vehicle, |track| track.vehicle).is_ok());
        let recording = &scene.recording;
        let (tracks, columns) = (recording.tracks(), recording.columns());
        let lanes: Vec<RoadLanes> =
            (0..recording.roads().len()).map(|road| RoadLanes::of(recording, road as u16)).collect();
        let mut placed: Vec<Placed> = tracks
            .iter()
            .map(|track| {
                let lane = lanes[usize::from(track.road)].rank_of(recording, track);
                let position = LanePosition { lane, x: columns.x[track.rows.end - 1], length: track.length };
                Placed { vehicle: track.vehicle, road: track.road, position }
            })
            .collect();
        let slots = tracks.iter().zip(by_place(&placed, placed.len())).map(|(track, found)| {
            let named = columns.neighbours[track.rows.end - 1].map(|other| {
                if other == NO_TRACK { None } else { tracks.get(other as usize).map(|other| other.vehicle) }
            });
            std::array::from_fn(|slot| Before { named: named[slot], found: found[slot] })
        });
        let slots = slots.collect();
        let mut named: Vec<Named> =
            (0..tracks.len()).filter_map(|track| Named::of(recording, track, &placed)).collect();
        let vehicles = placed.len();
        placed.extend(named.iter().map(|leader| leader.placed));
        for (leader, slots) in named.iter_mut().zip(by_place(&placed, vehicles).split_off(vehicles)) {
            leader.follower.found = slots[Slot::Following.index()];
        }
        placed.truncate(vehicles);
        Self { scene: Arc::new(scene), lanes, placed, slots, named }
    }

    /// The track of a vehicle.
    pub(super) fn track(&self, vehicle: u32) -> Option<usize> {
        self.placed.binary_search_by_key(&vehicle, |it| it.vehicle).ok()
    }

    /// Its speed along the road at the moment, m/s, where that is known.
    pub(super) fn velocity(&self, track: usize) -> Option<f32> {
        let recording = self.scene.recording();
        let last = recording.tracks().get(track)?.rows.end - 1;
        recording.velocity_one_sided(track, last).map(|velocity| velocity[0])
    }

    /// Numbers that vehicles have, those without a row included.
    pub(super) fn numbers(&self) -> impl Iterator<Item = u32> {
        self.placed.iter().chain(self.named.iter().map(|leader| &leader.placed)).map(|it| it.vehicle)
    }
}

impl Named {
    fn of(recording: &Recording, track: usize, placed: &[Placed]) -> Option<Self> {
        let follower: &Track = recording.tracks().get(track)?;
        let last = follower.rows.end - 1;
        let NamedLeader { vehicle, .. } = recording.named_leader(last)?;
        let place = |row: usize| {
            let named = recording.named_leader(row).filter(|named| named.vehicle == vehicle)?;
            Some(recording.columns().x[row] + follower.length / 2. + named.headway - NAMED_LEADER_SIZE[0] / 2.)
        };
        let x = place(last)?;
        let before = last.checked_sub(1).filter(|row| follower.rows.contains(row)).and_then(place);
        let of_follower = placed[track];
        let position = LanePosition { x, length: NAMED_LEADER_SIZE[0], ..of_follower.position };
        Some(Self {
            track,
            placed: Placed { vehicle, position, ..of_follower },
            follower: Before { named: Some(of_follower.vehicle), found: None },
            speed: before.map(|before| (x - before) * recording.meta().rate_hz as f32),
        })
    }
}
