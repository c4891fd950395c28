//! The scene with its changes, made anew from that without.

use std::sync::Arc;

use super::NewVehicle;
use super::base::{Base, Named};
use super::edits::{Changed, Difference, Edits, speed_change};
use super::slots::{self, Placed, by_place};
use crate::neighbours::LanePosition;
use crate::recording::{NO_TRACK, NamedLeader, Recording, Track, Unchanged, VelocitySource};
use crate::slot::{SLOTS, Slot};
use crate::snapshot::{Past, Snapshot};

/// A vehicle of the changed scene.
struct Member<'a> {
    origin: Origin<'a>,
    placed: Placed,
}

#[derive(Clone, Copy)]
enum Origin<'a> {
    /// Its track before the changes.
    Recorded(usize),
    Added(&'a NewVehicle),
}

pub(super) fn scene(base: &Base, edits: &Edits) -> Snapshot {
    let from = &*base.scene;
    let Recording { meta, roads, lane_order, names, columns, .. } = from.recording();
    let mut scene = Snapshot::without_vehicles(meta.clone(), roads.clone(), from.shape());
    scene.frame = from.frame();
    scene.recording.lane_order.clone_from(lane_order);
    scene.recording.columns.named_leader = columns.named_leader.as_ref().map(|_| Vec::new());

    let speeds = edits.changed.iter().filter(|(_, changed)| changed.speed_mps.is_some()).map(|(vehicle, _)| *vehicle);
    scene.recording.unchanged = Some(Unchanged { scene: Arc::clone(&base.scene), speeds: speeds.collect() });

    let members = members(base, edits);
    for member in &members {
        match member.origin {
            Origin::Recorded(track) => add_recorded(&mut scene, base, track, edits),
            Origin::Added(new) => add_new(&mut scene, base, new, member.placed),
        }
    }
    let named = names.iter().filter(|(vehicle, _)| !edits.removed.contains(vehicle));
    scene.recording.names = named.map(|(vehicle, name)| (*vehicle, name.clone())).collect();
    let new = edits.added.values().filter_map(|new| Some((new.vehicle, new.name.clone()?)));
    scene.recording.names.extend(new);

    let mut placed: Vec<Placed> = members.iter().map(|member| member.placed).collect();
    for (i, (member, found)) in members.iter().zip(by_place(&placed, placed.len())).enumerate() {
        let slots = slots_of(member, found, base, edits);
        let index = |vehicle: u32| placed.binary_search_by_key(&vehicle, |it| it.vehicle).ok();
        scene.set_neighbours(i, slots.map(|vehicle| vehicle.and_then(index)));
    }
    if scene.recording.columns.named_leader.is_some() {
        let vehicles = placed.len();
        placed.extend(base.named.iter().map(|leader| placed_leader(leader, base, edits)));
        for (leader, found) in base.named.iter().zip(&by_place(&placed, vehicles)[vehicles..]) {
            follow(leader, found[Slot::Following.index()], &mut scene, base, edits);
        }
    }
    scene.index();
    scene
}

/// By growing number.
fn members<'a>(base: &Base, edits: &'a Edits) -> Vec<Member<'a>> {
    let recording = base.scene.recording();
    let recorded = (0..base.placed.len()).filter(|track| !edits.removed.contains(&base.placed[*track].vehicle));
    let recorded = recorded.map(|track| {
        let mut placed = base.placed[track];
        if let Some(Changed { by, .. }) = edits.changed.get(&placed.vehicle) {
            let y = recording.columns().y[recording.tracks()[track].rows.end - 1];
            placed.position = moved(placed, y, *by, base);
        }
        Member { origin: Origin::Recorded(track), placed }
    });
    let added = edits.added.values().map(|new| {
        let NewVehicle { vehicle, road, at: [x, y], size: [length, _], .. } = *new;
        let lane = base.lanes[usize::from(road)].rank_at(recording, road, y).unwrap_or(0);
        Member {
            origin: Origin::Added(new),
            placed: Placed { vehicle, road, position: LanePosition { lane, x, length } },
        }
    });
    let mut members: Vec<Member<'a>> = recorded.chain(added).collect();
    members.sort_by_key(|member| member.placed.vehicle);
    members
}

/// Where a vehicle at `y`, m, is after a move.
fn moved(placed: Placed, y: f32, [forward, left]: [f32; 2], base: &Base) -> LanePosition {
    let LanePosition { lane, x, length } = placed.position;
    let between = || base.lanes[usize::from(placed.road)].rank_at(base.scene.recording(), placed.road, y + left);
    let lane = if left == 0. { lane } else { between().unwrap_or(lane) };
    LanePosition { lane, x: x + forward, length }
}

fn slots_of(member: &Member<'_>, found: [Option<u32>; SLOTS], base: &Base, edits: &Edits) -> [Option<u32>; SLOTS] {
    let Origin::Recorded(track) = member.origin else { return found };
    let before = &base.slots[track];
    let owner_stays = edits.stays(member.placed.vehicle);
    std::array::from_fn(|slot| slots::after(before[slot], found[slot], owner_stays, |vehicle| edits.stays(vehicle)))
}

/// How a vehicle is changed in its last `rows` frames, the last first; its way along the road is in the places.
fn differences(changed: Option<&Changed>, now: Option<f32>, rows: usize, rate_hz: f64) -> Vec<Difference> {
    let Some(Changed { by: [forward, _], speed_mps }) = changed else { return vec![Difference::default(); rows] };
    let faster = speed_mps.zip(now).map_or(0., |(speed, now)| speed - now);
    let along = |it: Difference| Difference { place: forward + it.place, ..it };
    speed_change(faster, rows, rate_hz).into_iter().map(along).collect()
}

fn add_recorded(scene: &mut Snapshot, base: &Base, index: usize, edits: &Edits) {
    let from = base.scene.recording();
    let (track, columns) = (&from.tracks()[index], from.columns());
    let (start, rows) = (scene.recording.len(), track.rows.clone());
    let own = &mut scene.recording.columns;
    own.x.extend_from_slice(&columns.x[rows.clone()]);
    own.y.extend_from_slice(&columns.y[rows.clone()]);
    own.vx.extend_from_slice(&columns.vx[rows.clone()]);
    own.vy.extend_from_slice(&columns.vy[rows.clone()]);
    own.lane.extend_from_slice(&columns.lane[rows.clone()]);
    own.neighbours.resize(own.x.len(), [NO_TRACK; SLOTS]);
    let changed = edits.changed.get(&track.vehicle);
    let all = differences(changed, base.velocity(index), rows.len(), from.meta().rate_hz);
    if let (Some(leaders), Some(named)) = (&mut own.named_leader, &columns.named_leader) {
        for (row, difference) in rows.clone().zip(all.iter().rev()) {
            let leader = if edits.removed.contains(&named[row].vehicle) { NamedLeader::default() } else { named[row] };
            leaders.push(farther(leader, -difference.place));
        }
    }
    if let Some(Changed { by: [_, left], .. }) = changed {
        let recorded = from.meta().velocities == VelocitySource::Recorded;
        for (back, row) in (start..own.x.len()).rev().enumerate() {
            own.x[row] += all[back].place;
            // A derived velocity is a difference to the row after, too.
            own.vx[row] += match back.checked_sub(1) {
                Some(after) if !recorded && row == start => all[after].speed,
                Some(after) if !recorded => (all[back].speed + all[after].speed) / 2.,
                _ => all[back].speed,
            };
            if *left != 0. {
                own.y[row] += left;
                let lanes = &base.lanes[usize::from(track.road)];
                if let Some(rank) = lanes.rank_at(from, track.road, own.y[row]) {
                    own.lane[row] = lanes.number(from, rank);
                }
            }
        }
    }
    let rows = start..own.x.len();
    scene.put(Track { rows, ..track.clone() }, base.scene.pasts[index]);
}

fn add_new(scene: &mut Snapshot, base: &Base, new: &NewVehicle, placed: Placed) {
    let NewVehicle { vehicle, road, at: [x, y], speed_mps, class, size, .. } = *new;
    let from = base.scene.recording();
    // One frame more than is observed tells the velocity of the first one.
    let rows = (scene.needed() + 1).min(scene.frame as usize + 1);
    let start = scene.recording.len();
    let columns = &mut scene.recording.columns;
    let way = |back: usize| f64::from(speed_mps) * back as f64 / from.meta().rate_hz;
    columns.x.extend((0..rows).rev().map(|back| (f64::from(x) - way(back)) as f32));
    let end = columns.x.len();
    columns.y.resize(end, y);
    columns.vx.resize(end, speed_mps);
    columns.vy.resize(end, 0.);
    columns.lane.resize(end, base.lanes[usize::from(road)].number(from, placed.position.lane));
    columns.neighbours.resize(end, [NO_TRACK; SLOTS]);
    columns.named_leader.iter_mut().for_each(|leaders| leaders.resize(end, NamedLeader::default()));
    let first_frame = scene.frame + 1 - rows as u32;
    let track = Track { road, class, ..Track::new(vehicle, size, first_frame, start..end) };
    scene.put(track, Past::Full);
}

/// Where a leader without a row of its own is.
fn placed_leader(leader: &Named, base: &Base, edits: &Edits) -> Placed {
    let mut placed = leader.placed;
    if edits.removed.contains(&placed.vehicle) {
        placed.position.lane = 0;
    } else if let Some(Changed { by, .. }) = edits.changed.get(&placed.vehicle) {
        let recording = base.scene.recording();
        let y = recording.columns().y[recording.tracks()[leader.track].rows.end - 1];
        placed.position = moved(placed, y, *by, base);
    }
    placed
}

/// Says in the rows of whoever follows a leader without a row of its own where that is, and in nobody else's.
fn follow(leader: &Named, found: Option<u32>, scene: &mut Snapshot, base: &Base, edits: &Edits) {
    let vehicle = leader.placed.vehicle;
    let from = base.scene.recording();
    let (Some(leaders), Some(named)) = (&mut scene.recording.columns.named_leader, &from.columns().named_leader) else {
        return;
    };
    let gone = edits.removed.contains(&vehicle);
    let follower = if gone {
        None
    } else {
        slots::after(leader.follower, found, edits.stays(vehicle), |vehicle| edits.stays(vehicle))
    };
    let was = &from.tracks()[leader.track];
    let tracks = &scene.recording.tracks;
    let rows_of = |vehicle: u32| {
        let track = tracks.binary_search_by_key(&vehicle, |track| track.vehicle).ok()?;
        Some(&tracks[track])
    };
    let all = differences(edits.changed.get(&vehicle), leader.speed, was.rows.len(), from.meta().rate_hz);
    if let Some(track) = rows_of(was.vehicle) {
        for (row, difference) in track.rows.clone().rev().zip(&all) {
            if leaders[row].vehicle == vehicle {
                let stays = follower == Some(was.vehicle);
                leaders[row] = if stays { farther(leaders[row], difference.place) } else { NamedLeader::default() };
            }
        }
    }
    let Some(track) = follower.filter(|it| *it != was.vehicle).and_then(rows_of) else { return };
    if leaders[track.rows.end - 1].vehicle != 0 {
        return;
    }
    for ((row, before), difference) in track.rows.clone().rev().zip(was.rows.clone().rev()).zip(&all) {
        let centres = from.columns().x[before] - scene.recording.columns.x[row];
        let ahead = farther(named[before], difference.place + centres + (was.length - track.length) / 2.);
        if named[before].vehicle == vehicle && leaders[row].vehicle == 0 {
            leaders[row] = ahead;
        }
    }
}

/// A leader that is `forward` m farther ahead of its follower, if it still is ahead.
fn farther(leader: NamedLeader, forward: f32) -> NamedLeader {
    let headway = leader.headway + forward;
    if leader.vehicle != 0 && headway > 0. { NamedLeader { headway, ..leader } } else { NamedLeader::default() }
}
