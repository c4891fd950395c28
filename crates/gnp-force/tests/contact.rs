//! Who drives into somebody is an event, once; nobody is put where somebody is.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, Driver, Event, Extent, ForceError, Idm, MotorwayRule, Newell, Obstacle, PairRule, Published, Road,
    Simulator, SimulatorParams, State, Vehicle, VehicleId,
};

const Y: f64 = 1.875;

fn road() -> Road<f64> {
    Road::motorway(2, 3.75).unwrap()
}

fn cruise(x: f64, speed: f64) -> Vehicle<f64> {
    Vehicle::car(State::new(x, Y, speed, 0.0), Drive::Cruise { speed, y: Y })
}

/// Contacts of two vehicles that drive 30 m/s, 43 m apart by centre, when the first brakes to a stop, and where the
/// second is in the end, from the first.
fn behind_a_braking_leader<R: PairRule<f64>>(rule: &R, braking: f64) -> (Vec<(VehicleId, Obstacle)>, f64) {
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.04), road()).unwrap();
    let leader = scene.add(cruise(43.0, 30.0).with_rule(rule.clone())).unwrap();
    let follower = scene.add(cruise(0.0, 30.0).with_rule(rule.clone())).unwrap();
    scene.set_drive(leader, Drive::Accelerate(-braking)).unwrap();
    let mut contacts = Vec::new();
    for _ in 0..1000 {
        contacts.extend(scene.step().iter().filter_map(|event| match event {
            Event::Contact { id, with } => Some((*id, *with)),
            _ => None,
        }));
        let overlap = {
            let [a, b] = [leader, follower].map(|id| scene.vehicle(id).unwrap());
            let gap = a.separation_from(b);
            gap.ahead < 0.0 && gap.beside < 0.0
        };
        assert_eq!(scene.contacts().len(), usize::from(overlap));
    }
    let [a, b] = [leader, follower].map(|id| scene.vehicle(id).unwrap().state.position.x);
    (contacts, b - a)
}

#[test]
fn the_published_law_drives_through_a_braking_leader_and_says_so_once() {
    for braking in [4.0, 8.0] {
        let (contacts, way) = behind_a_braking_leader(&Published::standard(), braking);
        assert_eq!(contacts, [(VehicleId(0), Obstacle::Vehicle(VehicleId(1)))], "{braking} m/s²");
        assert!(way > 0.0, "it is through: {way} m");
    }
}

#[test]
fn the_other_rules_stop_behind_a_braking_leader() {
    for braking in [4.0, 8.0] {
        for (contacts, way) in [
            behind_a_braking_leader(&MotorwayRule::standard(), braking),
            behind_a_braking_leader(&Idm::of(&Driver::motorway()), braking),
            behind_a_braking_leader(&Newell::standard(), braking),
        ] {
            assert!(contacts.is_empty() && way < -5.0, "{contacts:?}, {way} m");
        }
    }
}

#[test]
fn vehicles_are_added_only_where_there_is_room_on_the_road() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), road()).unwrap();
    let first = scene.add(cruise(0.0, 20.0)).unwrap();
    assert_eq!(scene.add(cruise(4.5, 20.0)), Err(ForceError::Occupied { id: first }));
    let at = |y| Vehicle::car(State::new(50.0, y, 20.0, 0.0), Drive::Steady);
    for y in [-0.1, 7.6] {
        assert_eq!(scene.add(at(y)), Err(ForceError::OffRoad { y }));
        assert_eq!(scene.enter(at(y)), Err(ForceError::OffRoad { y }));
    }
    assert_eq!(scene.vehicles().len(), 1, "nothing of what was refused is there");
    assert_eq!(scene.add(cruise(4.7, 20.0)), Ok(VehicleId(1)), "and no number was used up");
    let on_top = scene.place(cruise(1.0, 20.0)).unwrap();
    let contact = |event: &Event<f64, _>| match event {
        Event::Contact { id, with: Obstacle::Vehicle(other) } => Some([*id, *other]),
        _ => None,
    };
    let contacts: Vec<_> = scene.step().iter().filter_map(contact).collect();
    assert_eq!(contacts, [[first, on_top], [VehicleId(1), on_top]], "recorded vehicles may touch");
    scene.remove(on_top).unwrap();
    assert_eq!(scene.contacts().len(), 0, "who left touches nobody");
}

#[test]
fn vehicles_of_no_size_touch_nobody_but_are_touched() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), road()).unwrap();
    let point = |x| Vehicle { extent: Extent::point(), ..Vehicle::car(State::new(x, Y, 0.0, 0.0), Drive::Steady) };
    scene.add(point(0.0)).unwrap();
    scene.add(point(0.0)).unwrap();
    assert!(scene.step().is_empty(), "two points have no room to overlap");
    assert_eq!(scene.add(cruise(1.0, 0.0)), Err(ForceError::Occupied { id: VehicleId(0) }));
}

#[test]
fn an_empty_scene_and_a_lone_vehicle_are_no_special_case() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), road()).unwrap();
    (0..10).for_each(|_| assert!(scene.step().is_empty()));
    assert_eq!(scene.contacts().len(), 0);
    let unknown = VehicleId(0);
    assert_eq!(scene.gap_ahead(unknown), Err(ForceError::UnknownVehicle { id: unknown }));
    assert_eq!(scene.remove(unknown).unwrap_err(), ForceError::UnknownVehicle { id: unknown });
    let id = scene.add(cruise(0.0, 20.0)).unwrap();
    (0..10).for_each(|_| assert!(scene.step().is_empty()));
    assert_eq!((scene.gap_ahead(id), scene.gap_behind(id)), (Ok(None), Ok(None)));
    scene.retain(|_, _| false);
    (0..10).for_each(|_| assert!(scene.step().is_empty()));
}
