//! The vehicle directly ahead: recorded, or told by its follower's rows alone.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use gnp_data::{
    Columns, Dataset, NAMED_LEADER_SIZE, NamedLeader, Observation, Recording, SLOTS, Slot, VelocitySource, WindowShape,
};
use scene::{NO_TRACK, from_positions, named};

const SHAPE: WindowShape = WindowShape { t_obs: 5, t_pred: 3, step: 1, rate_hz: 10. };
const T0: u32 = 20;

/// Vehicles 1, 2, 3 one behind the other, 10 m/s, 20 m apart; sizes are 4 m and a sixteenth of the number.
fn platoon() -> Recording {
    let ahead = |index: usize, frame: u32| {
        let mut slots = [NO_TRACK; SLOTS];
        let there = index == 1 || (index == 0 && (18..38).contains(&frame));
        slots[Slot::Preceding.index()] = if there { index as u32 + 1 } else { NO_TRACK };
        slots
    };
    let position = |(vehicle, _, first, _): scene::Snippet, i: usize| {
        [(first + i as u32) as f32 + 20. * vehicle as f32, vehicle as f32 / 10.]
    };
    from_positions(Dataset::NGSIM, "r", "s", 10., &[(1, 0, 0, 40), (2, 0, 18, 20), (3, 0, 0, 40)], &position, &ahead)
}

fn observe(recording: &Recording) -> Observation<'_> {
    Observation::new(recording, SHAPE, 0, recording.tracks()[0].row_at(T0).unwrap()).unwrap()
}

fn vehicles(observation: Observation<'_>) -> Vec<u32> {
    observation.column().map(|leader| leader.vehicle()).collect()
}

#[test]
fn a_recorded_leader_is_the_preceding_vehicle() {
    let recording = platoon();
    let observation = observe(&recording);
    let (leader, slot) = (observation.leader().unwrap(), observation.neighbour(Slot::Preceding).unwrap());
    assert_eq!((leader.vehicle(), leader.size(), leader.now()), (slot.vehicle(), slot.size(), slot.now()));
    assert_eq!(leader.velocity(), slot.velocity());
    for i in 0..=SHAPE.t_obs {
        assert_eq!(leader.state(i), slot.state(i));
    }
    assert_eq!(vehicles(observation), [2, 3]);
    assert_eq!(leader.leader().unwrap().recorded().unwrap().track_index(), 2);
    assert_eq!(slot.leader().unwrap().vehicle(), 3);
    assert!(observation.column().last().unwrap().leader().is_none());
}

#[test]
fn a_named_leader_stands_where_its_followers_row_says() {
    // Vehicle 3 names 50 in three frames of the window, at a distance that grows by 0.2 m a frame.
    let recording = named(platoon(), |vehicle, frame| match (vehicle, frame) {
        (3, 17) => Some((49, 5.)),
        (3, 18..=T0) => Some((50, 30. + 0.2 * (frame - 18) as f32)),
        (3, 21..) => Some((50, 8.)), // in the future
        _ => None,
    });
    let observation = observe(&recording);
    assert_eq!(vehicles(observation), [2, 3, 50]);
    let leader = observation.column().last().unwrap();
    assert!(leader.recorded().is_none() && leader.leader().is_none());
    assert_eq!(leader.size(), NAMED_LEADER_SIZE);
    assert!(leader.state(0).is_none() && leader.state(1).is_none(), "nobody, and another vehicle, is named there");
    assert!(leader.state(SHAPE.t_obs).is_none());
    let length = 4. + 3. / 16.;
    for (i, headway) in [(2, 30.), (3, 30.2), (4, 30.4)] {
        let state = leader.state(i).unwrap();
        let front = state.x + NAMED_LEADER_SIZE[0] / 2.;
        let follower = (i as f32 - 4.) + 40.; // 1 m a frame, 40 m before the target
        assert!((front - (follower + length / 2. + headway)).abs() < 1e-4, "frame {i}: {state:?}");
        assert!((state.y - 0.2).abs() < 1e-6, "as far left of the target as its follower");
        assert!((state.vx - 12.).abs() < 1e-2 && state.vy.abs() < 1e-3, "frame {i}: {state:?}");
    }
    assert_eq!(leader.velocity(), Some([leader.now().vx, leader.now().vy]));
}

#[test]
fn a_leader_named_for_the_first_time_moves_as_the_target() {
    let recording = named(platoon(), |vehicle, frame| (vehicle == 1 && frame >= T0).then_some((50, 9.)));
    let observation = observe(&recording);
    let leader = observation.leader().unwrap();
    assert_eq!((leader.vehicle(), leader.velocity()), (50, None));
    let target = observation.target(SHAPE.t_obs - 1);
    assert_eq!((leader.now().vx, leader.now().vy), (target.vx, target.vy));
    // It is nearer than vehicle 2, which the slot still holds; nobody is known beyond it.
    assert_eq!(vehicles(observation), [50]);
    assert_eq!(observation.neighbour(Slot::Preceding).unwrap().vehicle(), 2);
}

#[test]
fn a_column_ends_where_vehicles_name_each_other() {
    let there = platoon();
    let mut columns = there.columns().clone();
    for row in there.tracks()[2].rows.clone() {
        let frame = row - there.tracks()[2].rows.start;
        columns.neighbours[row][Slot::Preceding.index()] = if (18..38).contains(&frame) { 1 } else { NO_TRACK };
    }
    let (roads, tracks) = (there.roads().to_vec(), there.tracks().to_vec());
    let circle = Recording::from_parts(there.meta().clone(), roads, tracks, columns).unwrap();
    assert_eq!(vehicles(observe(&circle)), [2, 3]);
}

#[test]
fn recorded_velocities_do_not_reach_a_named_leader() {
    let there = named(platoon(), |vehicle, frame| (vehicle == 1).then_some((50, 1. + frame as f32)));
    let mut columns = there.columns().clone();
    columns.vx.fill(-3.);
    let meta = there.meta().clone().with_velocities(VelocitySource::Recorded);
    let recording = Recording::from_parts(meta, there.roads().to_vec(), there.tracks().to_vec(), columns).unwrap();
    let leader = observe(&recording).leader().unwrap();
    assert!((leader.now().vx - 20.).abs() < 1e-2, "1 m a frame, and 1 m further ahead");
}

#[test]
fn leaders_that_cannot_be_are_refused() {
    let there = platoon();
    let refused = |row: usize, vehicle, headway| {
        let mut leaders = vec![NamedLeader::default(); there.len()];
        leaders[row] = NamedLeader { vehicle, headway };
        let columns = Columns { named_leader: Some(leaders), ..there.columns().clone() };
        let parts = (there.roads().to_vec(), there.tracks().to_vec());
        Recording::from_parts(there.meta().clone(), parts.0, parts.1, columns).map(|_| ()).map_err(|e| e.to_string())
    };
    assert!(refused(20, 1, 9.).unwrap_err().contains("row of its own"));
    assert!(refused(20, 2, 9.).unwrap_err().contains("row of its own"));
    refused(5, 2, 9.).unwrap(); // vehicle 2 comes later
    for headway in [0., -1., f32::NAN, f32::INFINITY] {
        assert!(refused(20, 9, headway).unwrap_err().contains("must be positive"), "{headway}");
    }
    let columns = Columns { named_leader: Some(Vec::new()), ..there.columns().clone() };
    let short = Recording::from_parts(there.meta().clone(), there.roads().to_vec(), there.tracks().to_vec(), columns);
    assert!(short.unwrap_err().to_string().contains("named_leader"));
}
