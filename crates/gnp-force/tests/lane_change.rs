//! MOBIL: who overtakes, who comes back, whom nobody may cut off.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, Driver, Event, Idm, Mobil, MotorwayRule, Road, Rule, Simulator, SimulatorParams, State, Vehicle, VehicleId,
};

fn centre(lane: usize) -> f64 {
    1.875 + 3.75 * lane as f64
}

fn rules() -> [Rule<f64>; 2] {
    [MotorwayRule::standard().into(), Idm::of(&Driver::motorway()).into()]
}

fn scene(lanes: usize) -> Simulator<f64> {
    Simulator::new(SimulatorParams::motorway(0.1), Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

fn car(rule: Rule<f64>, x: f64, lane: usize, v: f64, speed: f64) -> Vehicle<f64> {
    let y = centre(lane);
    let vehicle = Vehicle::car(State::new(x, y, v, 0.0), Drive::Cruise { speed, y }).with_rule(rule);
    Vehicle { lane_change: Some(Mobil::standard()), ..vehicle }
}

fn changes(scene: &mut Simulator<f64>, steps: usize) -> Vec<(VehicleId, usize, usize)> {
    let mut changes = Vec::new();
    for _ in 0..steps {
        for event in scene.step() {
            match event {
                Event::LaneChange { id, from, to } => changes.push((*id, *from, *to)),
                other => panic!("{other:?}"),
            }
        }
    }
    changes
}

#[test]
fn a_slower_lorry_is_overtaken_and_the_lane_left_again() {
    for rule in rules() {
        let mut scene = scene(2);
        let lorry = Drive::Cruise { speed: 22.0, y: centre(0) };
        scene.add(Vehicle::truck(State::new(150.0, centre(0), 22.0, 0.0), lorry)).unwrap();
        let fast = scene.add(car(rule, 0.0, 0, 33.0, 33.0)).unwrap();
        assert_eq!(changes(&mut scene, 600), [(fast, 0, 1), (fast, 1, 0)]);
        let state = scene.vehicle(fast).unwrap().state;
        assert!(state.position.x > 150.0 + 22.0 * 60.0 + 100.0 && (state.position.y - centre(0)).abs() < 0.1);
    }
}

#[test]
fn whoever_may_not_change_stays_behind() {
    for rule in rules() {
        let mut scene = scene(2);
        let lorry = Drive::Cruise { speed: 22.0, y: centre(0) };
        scene.add(Vehicle::truck(State::new(150.0, centre(0), 22.0, 0.0), lorry)).unwrap();
        let patient = Vehicle { lane_change: None, ..car(rule, 0.0, 0, 33.0, 33.0) };
        let patient = scene.add(patient).unwrap();
        assert!(changes(&mut scene, 600).is_empty());
        assert!((scene.vehicle(patient).unwrap().state.velocity.x - 22.0).abs() < 0.5);
    }
}

#[test]
fn nobody_is_cut_off_harder_than_is_safe() {
    // A car wants to pass a lorry; on the left another comes up from behind, from ever nearer.
    for rule in rules() {
        let (mut waited, mut went) = (0, 0);
        for start in 0..60 {
            let mut scene = scene(2);
            let lorry = Drive::Cruise { speed: 20.0, y: centre(0) };
            scene.add(Vehicle::truck(State::new(80.0, centre(0), 20.0, 0.0), lorry)).unwrap();
            let slow = scene.add(car(rule, 0.0, 0, 22.0, 33.0)).unwrap();
            let from_behind = Vehicle { lane_change: None, ..car(rule, -5.0 * f64::from(start), 1, 36.0, 36.0) };
            let from_behind = scene.add(from_behind).unwrap();
            let mut hardest = 0.0_f64;
            let (mut changed, mut ahead_of_it) = (false, false);
            for _ in 0..300 {
                let before = scene.vehicle(from_behind).unwrap().state.velocity.x;
                for event in scene.step() {
                    match event {
                        Event::LaneChange { id, to: 1, .. } if *id == slow && !changed => changed = true,
                        Event::LaneChange { .. } => {}
                        other => panic!("{start}: {other:?}"),
                    }
                }
                let [a, b] = [slow, from_behind].map(|id| scene.vehicle(id).unwrap().state);
                ahead_of_it |= changed && scene.road().lane_at(a.position.y) == 1 && a.position.x > b.position.x;
                hardest = hardest.max((before - b.velocity.x) / 0.1);
            }
            assert!(changed, "{start}: sooner or later it passes");
            // The decision weighs the present; on the way the demand may grow a little.
            assert!(hardest < 3.6, "{rule:?}, {} m behind: {hardest} m/s²", 5 * start);
            waited += u32::from(!ahead_of_it);
            went += u32::from(ahead_of_it);
        }
        assert!(waited >= 5 && went >= 5, "both happen: {waited} waited, {went} went");
    }
}

#[test]
fn two_drivers_from_both_sides_never_take_the_same_gap() {
    // Lanes 0 and 2 are blocked by lorries, the gap between is in lane 1.
    for rule in rules() {
        for shift in 0..40 {
            let mut scene = scene(3);
            for lane in [0, 2] {
                let drive = Drive::Cruise { speed: 15.0, y: centre(lane) };
                scene.add(Vehicle::truck(State::new(70.0, centre(lane), 15.0, 0.0), drive)).unwrap();
            }
            let right = scene.add(car(rule, 0.0, 0, 25.0, 33.0)).unwrap();
            let left = scene.add(car(rule, f64::from(shift) - 20.0, 2, 25.0, 33.0)).unwrap();
            let mut in_the_middle = [false; 2];
            for _ in 0..400 {
                let contact = scene.step().iter().any(|event| matches!(event, Event::Contact { .. }));
                assert!(!contact, "{rule:?}, {shift}");
                for (id, seen) in [right, left].iter().zip(&mut in_the_middle) {
                    *seen |= scene.road().lane_at(scene.vehicle(*id).unwrap().state.position.y) == 1;
                }
            }
            assert_eq!(in_the_middle, [true; 2], "both pass, one after the other");
        }
    }
}

#[test]
fn somebody_who_comes_into_the_lane_is_seen_beyond_the_nearest_beside() {
    // A queue stands in the right lane; its fourth moves out in front of a car that comes along on the left.
    for rule in rules() {
        let mut scene = scene(2);
        let mut queue = Vec::new();
        for i in 0..5 {
            let x = 160.0 + 7.0 * f64::from(i);
            let stands = Vehicle::car(State::new(x, centre(0), 0.0, 0.0), Drive::Cruise { speed: 0.0, y: centre(0) });
            queue.push(scene.add(stands.with_rule(rule)).unwrap());
        }
        let passing = Vehicle { lane_change: None, ..car(rule, 70.0, 1, 20.0, 20.0) };
        let passing = scene.add(passing).unwrap();
        let calm = scene.explain(passing).unwrap();
        scene.set_drive(queue[3], Drive::Cruise { speed: 3.0, y: centre(1) }).unwrap();
        let alarmed = scene.explain(passing).unwrap();
        let other = gnp_force::Obstacle::Vehicle(queue[3]);
        assert!(!calm.pushed_by.contains(&other) && alarmed.pushed_by.contains(&other), "{:?}", alarmed.pushed_by);
        assert!(alarmed.total().x < calm.total().x - 1.0, "it brakes at once");
        for _ in 0..300 {
            assert!(!scene.step().iter().any(|event| matches!(event, Event::Contact { .. })), "{rule:?}");
        }
    }
}

#[test]
fn politeness_spares_those_behind() {
    // A small gain of one's own against a large loss of the one behind: the egoist goes, the polite one stays.
    let decides = |politeness: f64| {
        let mut scene = scene(2);
        let rule = rules()[1];
        let lorry = Drive::Cruise { speed: 27.0, y: centre(0) };
        scene.add(Vehicle::truck(State::new(70.5, centre(0), 27.0, 0.0), lorry)).unwrap();
        let mobil = Mobil { politeness, ..Mobil::standard() };
        let me = Vehicle { lane_change: Some(mobil), ..car(rule, 0.0, 0, 28.0, 33.0) };
        let me = scene.add(me).unwrap();
        let behind = Vehicle { lane_change: None, ..car(rule, -95.0, 1, 33.0, 36.0) };
        scene.add(behind).unwrap();
        (0..8).for_each(|_| {
            scene.step();
        });
        matches!(scene.vehicle(me).unwrap().drive, Drive::Cruise { y, .. } if y == centre(1))
    };
    assert!(decides(0.0) && !decides(1.0));
}

#[test]
fn whoever_finds_somebody_beside_him_turns_back() {
    for rule in rules() {
        let mut scene = scene(2);
        let steady = Vehicle { drive: Drive::Steady, ..car(rule, 2.0, 1, 25.0, 25.0) };
        scene.add(steady).unwrap();
        let me = scene.add(car(rule, 0.0, 0, 25.0, 25.0)).unwrap();
        scene.set_drive(me, Drive::Cruise { speed: 25.0, y: centre(1) }).unwrap();
        assert!(changes(&mut scene, 200).is_empty(), "nor is there a contact");
        assert!((scene.vehicle(me).unwrap().state.position.y - centre(0)).abs() < 0.2, "{rule:?}");
    }
}
