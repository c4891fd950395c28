//! A road closed to a ring is the same everywhere: neighbours, gaps, contacts, detectors and motion know no seam.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Detector, Drive, Driver, Event, Extent, Idm, Mobil, MotorwayRule, Noise, Obstacle, Road, Rule, Simulator,
    SimulatorParams, State, Vehicle, VehicleId,
};

const Y: f64 = 1.875;
const LENGTH: f64 = 230.0;

fn ring(lanes: usize, length: f64) -> Simulator<f64> {
    let road = Road::motorway(lanes, 3.75).unwrap().ring(length).unwrap();
    Simulator::new(SimulatorParams { seed: 5, ..SimulatorParams::motorway(0.1) }, road).unwrap()
}

fn at(x: f64, v: f64, drive: Drive<f64>) -> Vehicle<f64> {
    Vehicle::car(State::new(x, Y, v, 0.0), drive)
}

fn cruise(x: f64, v: f64, speed: f64) -> Vehicle<f64> {
    at(x, v, Drive::Cruise { speed, y: Y })
}

/// The 22 vehicles of Sugiyama and others (2008), unsteady, `offset` m along the ring.
fn sugiyama(rule: Rule<f64>, offset: f64) -> Simulator<f64> {
    let mut scene = ring(1, LENGTH);
    for i in 0..22 {
        let vehicle = cruise(offset + LENGTH / 22.0 * f64::from(i), 4.0, 30.0 / 3.6).with_rule(rule);
        scene.add(Vehicle { noise: Some(Noise { sigma: 0.2, correlation: 5.0 }), ..vehicle }).unwrap();
    }
    scene
}

fn rules() -> [Rule<f64>; 2] {
    [MotorwayRule::standard().into(), Idm::of(&Driver::motorway()).into()]
}

#[test]
fn twenty_two_vehicles_drive_around_without_passing_through_each_other_or_the_seam() {
    for rule in rules() {
        let mut scene = sugiyama(rule, 0.0);
        let ids: Vec<VehicleId> = scene.vehicles().map(|(id, _)| id).collect();
        let (mut laps, mut way) = (vec![0_usize; ids.len()], vec![0.0; ids.len()]);
        let mut detector = Detector::new(0.0);
        for _ in 0..6000 {
            let before: Vec<f64> = scene.vehicles().map(|(_, vehicle)| vehicle.state.position.x).collect();
            assert!(scene.step().is_empty(), "no contact, nobody leaves");
            detector.watch(&scene);
            for (i, (_, vehicle)) in scene.vehicles().enumerate() {
                let x = vehicle.state.position.x;
                assert!((0.0..LENGTH).contains(&x), "{x}");
                laps[i] += usize::from(x < before[i] - LENGTH / 2.0);
                way[i] += (x - before[i]).rem_euclid(LENGTH);
            }
            for (i, id) in ids.iter().enumerate() {
                let next = scene.gap_ahead(*id).unwrap().unwrap();
                assert_eq!(next.to, Obstacle::Vehicle(ids[(i + 1) % ids.len()]), "nobody overtakes on one lane");
            }
            let sum: f64 = ids.iter().map(|id| scene.gap_ahead(*id).unwrap().unwrap().distance + 4.6).sum();
            assert!((sum - LENGTH).abs() < 1e-9, "the gaps and cars fill the ring: {sum}");
        }
        assert_eq!(detector.passages().len(), laps.iter().sum::<usize>(), "the detector at the seam sees every lap");
        for (i, laps) in laps.into_iter().enumerate() {
            let whole = ((LENGTH / 22.0 * i as f64 + way[i]) / LENGTH) as usize;
            assert!(laps == whole && laps > 3, "{laps} laps of {whole}");
        }
    }
}

#[test]
fn moved_along_the_ring_the_same_scene_drives_the_same_way() {
    let path = |rule: Rule<f64>, offset: f64| {
        let mut scene = sugiyama(rule, offset);
        (0..300).for_each(|_| assert!(scene.step().is_empty()));
        scene.vehicles().map(|(_, vehicle)| (vehicle.state, offset)).collect::<Vec<_>>()
    };
    for rule in rules() {
        let plain = path(rule, 0.0);
        for offset in [1.0, 77.7, 229.9] {
            for ((a, _), (b, _)) in plain.iter().zip(path(rule, offset)) {
                let way = (b.position.x - a.position.x - offset).rem_euclid(LENGTH);
                assert!(way.min(LENGTH - way) < 1e-9 && (a.velocity - b.velocity).norm() < 1e-9, "{a:?}, {b:?}");
            }
        }
    }
}

#[test]
fn lanes_of_a_ring_are_changed_over_the_seam_as_elsewhere() {
    // A lorry, and faster cars that overtake it, wherever the seam is.
    let path = |offset: f64| {
        let mut scene = ring(2, 600.0);
        let lorry = Drive::Cruise { speed: 20.0, y: Y };
        scene.add(Vehicle::truck(State::new(offset, Y, 20.0, 0.0), lorry)).unwrap();
        for i in 1..6 {
            let car = cruise(offset - 45.0 * f64::from(i), 25.0, 28.0 + f64::from(i));
            scene.add(Vehicle { lane_change: Some(Mobil::standard()), ..car }).unwrap();
        }
        let mut changes = Vec::new();
        for step in 0..900 {
            for event in scene.step() {
                match event {
                    Event::LaneChange { id, from, to } => changes.push((step, *id, *from, *to)),
                    other => panic!("{other:?}"),
                }
            }
        }
        changes
    };
    let plain = path(0.0);
    assert!(plain.len() >= 10, "out and back again: {plain:?}");
    for offset in [100.0, 300.0, 550.0] {
        assert_eq!(path(offset), plain);
    }
}

#[test]
fn gaps_and_contacts_reach_over_the_seam() {
    let mut scene = ring(1, LENGTH);
    let behind = scene.add(at(225.0, 10.0, Drive::Steady)).unwrap();
    let before = scene.add(at(5.0, 6.0, Drive::Steady)).unwrap();
    let gap = scene.gap_ahead(behind).unwrap().unwrap();
    assert_eq!(gap.to, Obstacle::Vehicle(before));
    assert!((gap.distance - 5.4).abs() < 1e-9 && (gap.ttc().unwrap() - 1.35).abs() < 1e-9, "{gap:?}");
    assert!((scene.gap_behind(before).unwrap().unwrap().distance - 5.4).abs() < 1e-9);
    assert!((scene.gap_ahead(before).unwrap().unwrap().distance - 215.4).abs() < 1e-9, "and around the other way");
    assert_eq!(scene.add(at(228.0, 0.0, Drive::Steady)).unwrap_err(), gnp_force::ForceError::Occupied { id: behind });
    assert!(scene.add(at(0.5, 0.0, Drive::Steady)).is_err() && scene.add(at(-1.0, 0.0, Drive::Steady)).is_err());
    let mut contacts = Vec::new();
    for _ in 0..20 {
        let time = scene.time();
        contacts.extend(scene.step().iter().cloned().map(|event| (time, event)));
    }
    let expected = Event::Contact { id: behind, with: Obstacle::Vehicle(before) };
    let [(time, event)] = contacts.as_slice() else { panic!("one contact, not {contacts:?}") };
    assert!(*event == expected && (time - 1.3).abs() < 0.11, "{event:?} at {time} s");
}

#[test]
fn a_closure_at_the_seam_is_approached_and_touched_over_it() {
    let road = Road::motorway(1, 3.75).unwrap().closing(0, 0.0, 20.0).unwrap().ring(500.0).unwrap();
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
    let careful = scene.add(cruise(250.0, 25.0, 25.0)).unwrap();
    let blind = scene.add(at(300.0, 20.0, Drive::Steady)).unwrap();
    let contacts: Vec<_> = (0..600).flat_map(|_| scene.step().to_vec()).collect();
    let first = Event::Contact { id: blind, with: Obstacle::Closure(0) };
    assert_eq!(contacts.first(), Some(&first));
    assert!(
        !contacts
            .iter()
            .any(|event| matches!(event, Event::Contact { id, with: Obstacle::Closure(_) } if *id == careful))
    );
    let x = scene.vehicle(careful).unwrap().state.position.x;
    assert!((493.0..497.7).contains(&x), "it stands before the seam: {x}");
}

#[test]
fn a_vehicle_alone_on_a_ring_does_not_follow_itself() {
    let mut scene = ring(2, 60.0);
    let vehicle = Vehicle { lane_change: Some(Mobil::standard()), ..cruise(0.0, 20.0, 30.0) };
    let id = scene.add(Vehicle { extent: Extent::truck(), ..vehicle }).unwrap();
    (0..600).for_each(|_| assert!(scene.step().is_empty()));
    assert!((scene.vehicle(id).unwrap().state.velocity.x - 30.0).abs() < 0.01);
    assert_eq!(scene.gap_ahead(id), Ok(None));
}
