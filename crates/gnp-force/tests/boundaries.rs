//! Where traffic enters, leaves and is narrowed: nobody is lost, nobody enters into a contact, a lane drop is passed.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Detector, Drive, Driver, Event, Extent, ForceError, Headways, Idm, Inflow, Mobil, MotorwayRule, Obstacle, Road,
    Rule, Simulator, SimulatorParams, State, Vehicle, VehicleId,
};
use std::collections::BTreeMap;

fn centre(lane: usize) -> f64 {
    1.875 + 3.75 * lane as f64
}

fn driver(rule: Rule<f64>, lane: usize, number: u64) -> Vehicle<f64> {
    let share = (number as f64 * 0.618_033_988_75).fract();
    let y = centre(lane);
    let lorry = lane == 0 && number.is_multiple_of(4);
    let speed = if lorry { 23.0 } else { 28.0 + 8.0 * share };
    let (state, drive) = (State::new(0.0, y, speed, 0.0), Drive::Cruise { speed, y });
    let vehicle = if lorry { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
    Vehicle { lane_change: Some(Mobil::standard()), ..vehicle }.with_rule(rule)
}

fn rules() -> [Rule<f64>; 2] {
    [MotorwayRule::standard().into(), Idm::of(&Driver::motorway()).into()]
}

#[test]
fn an_inflow_keeps_its_rate_from_the_moment_it_is_set() {
    for headways in [Headways::Even, Headways::Random] {
        let road = Road::motorway(1, 3.75).unwrap().ending_at(500.0).unwrap();
        let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
        let mut inflow = Inflow::new(0.0, headways, 3).unwrap();
        let mut entered = [0; 4];
        // Nobody for 10 minutes, then 900 vehicles an hour, then nobody, then 600.
        for (part, flow) in [0.0, 900.0, 0.0, 600.0].into_iter().enumerate() {
            inflow.set_flow(flow, scene.time()).unwrap();
            for _ in 0..6000 {
                let admitted = scene.admit(&mut inflow, |n| driver(MotorwayRule::standard().into(), 0, n)).unwrap();
                entered[part] += u64::from(admitted.is_some());
                scene.step();
            }
        }
        assert_eq!(inflow.entered(), entered.iter().sum::<u64>());
        let spread = if headways == Headways::Even { 1 } else { 40 };
        assert!(entered[0] == 0 && entered[2] <= 1, "{entered:?}");
        assert!(entered[1].abs_diff(150) <= spread && entered[3].abs_diff(100) <= spread, "{entered:?}");
    }
    assert!(Inflow::new(-1.0, Headways::Even, 0).is_err() && Inflow::new(f64::NAN, Headways::Even, 0).is_err());
}

#[test]
fn random_headways_are_spread_as_those_of_independent_arrivals() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.01), Road::motorway(1, 3.75).unwrap()).unwrap();
    let mut inflow = Inflow::new(1800.0, Headways::Random, 11).unwrap();
    let mut times = Vec::new();
    for _ in 0..400_000 {
        // A vehicle that is gone at once: only the arrivals are looked at.
        let car = |_| driver(MotorwayRule::standard().into(), 0, 1);
        if let Some(id) = scene.admit(&mut inflow, car).unwrap() {
            times.push(scene.time());
            scene.remove(id).unwrap();
        }
        scene.step();
    }
    let headways: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let count = headways.len() as f64;
    let mean = headways.iter().sum::<f64>() / count;
    let longer = headways.iter().filter(|headway| **headway > 2.0).count() as f64 / count;
    assert!((mean - 2.0).abs() < 0.12, "{mean} s");
    assert!((longer - (-1.0_f64).exp()).abs() < 0.03, "{longer}");
}

#[test]
fn whoever_entered_is_on_the_road_or_has_left() {
    for rule in rules() {
        let road = Road::motorway(2, 3.75).unwrap().ending_at(800.0).unwrap();
        let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
        let mut inflows = [0, 1].map(|lane| Inflow::new(2200.0, Headways::Random, lane).unwrap());
        let mut left = Vec::new();
        let mut lanes = BTreeMap::<VehicleId, usize>::new();
        for _ in 0..6000 {
            for (lane, inflow) in inflows.iter_mut().enumerate() {
                if let Some(id) = scene.admit(inflow, |number| driver(rule, lane, number)).unwrap() {
                    lanes.insert(id, lane);
                    let gap = scene.gap_ahead(id).unwrap();
                    assert!(gap.is_none_or(|gap| gap.distance > 1.0), "{gap:?}");
                }
            }
            for event in scene.step() {
                match event {
                    Event::Left { id, vehicle } => {
                        assert!(vehicle.state.position.x > 800.0 && lanes.remove(id).is_some());
                        left.push(*id);
                    }
                    Event::LaneChange { id, from, to } => assert_eq!(lanes.insert(*id, *to), Some(*from), "{id}"),
                    other => panic!("{other:?}"),
                }
            }
            // Every change of lane was told, also in steps in which somebody left.
            for (id, vehicle) in scene.vehicles() {
                assert_eq!(lanes[&id], scene.road().lane_at(vehicle.state.position.y), "{id}");
            }
            let entered: u64 = inflows.iter().map(Inflow::entered).sum();
            assert_eq!(entered as usize, left.len() + scene.vehicles().len());
        }
        // Two lanes at capacity; before, the lorries starved behind cars that had just entered beside them.
        assert!(left.len() > 500, "{}", left.len());
        assert!(inflows.iter().any(|inflow| inflow.waiting() > 0), "the demand is more than a lane takes");
    }
}

#[test]
fn nobody_enters_where_there_is_no_room() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), Road::motorway(1, 3.75).unwrap()).unwrap();
    scene.add(Vehicle::obstacle(25.0, centre(0), Extent::car())).unwrap();
    let fast = driver(MotorwayRule::standard().into(), 0, 1);
    let entered = scene.enter(fast.clone()).unwrap();
    let speed = entered.map(|id| scene.vehicle(id).unwrap().state.velocity.x);
    assert_eq!(speed, Some(0.0), "behind one that stands it enters at a standstill");
    let before = serde_json::to_string(&scene).unwrap();
    assert_eq!(scene.enter(fast.clone()), Ok(None), "where it is now there is no room");
    let nobody = |text: &str| text.split("\"vehicles\"").nth(1).map(str::to_string);
    assert_eq!(nobody(&serde_json::to_string(&scene).unwrap()), nobody(&before), "and nothing has changed");
    let mut close_behind = Simulator::new(SimulatorParams::motorway(0.1), Road::motorway(1, 3.75).unwrap()).unwrap();
    let from_behind = Vehicle { state: State::new(-30.0, centre(0), 35.0, 0.0), ..fast.clone() };
    close_behind.add(from_behind).unwrap();
    let slow = Vehicle { state: State::new(0.0, centre(0), 10.0, 0.0), ..fast };
    assert_eq!(close_behind.enter(slow), Ok(None), "not in front of one who would have to brake hard");
}

#[test]
fn a_lane_drop_is_passed_by_merging_at_less_than_the_demand() {
    for rule in rules() {
        let road = Road::motorway(3, 3.75).unwrap().closing(2, 1500.0, 2500.0).unwrap().ending_at(2500.0).unwrap();
        let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
        let mut inflows = [0, 1, 2].map(|lane| Inflow::new(1900.0, Headways::Random, lane).unwrap());
        let mut detectors = [Detector::new(300.0), Detector::new(2400.0)];
        let (mut contacts, mut merged) = (Vec::new(), 0);
        for _ in 0..9000 {
            for (lane, inflow) in inflows.iter_mut().enumerate() {
                scene.admit(inflow, |number| driver(rule, lane, number)).unwrap();
            }
            for event in scene.step() {
                match event {
                    Event::Contact { id, with } => contacts.push((*id, *with)),
                    Event::LaneChange { from: 2, to: 1, .. } => merged += 1,
                    _ => {}
                }
            }
            detectors.iter_mut().for_each(|detector| detector.watch(&scene));
        }
        assert!(contacts.is_empty(), "{contacts:?}");
        assert!(merged > 100, "{merged}");
        let [before, after] = &detectors;
        assert!(after.passages().iter().all(|passage| passage.lane < 2), "nobody passes in the closed lane");
        let out = after.flow(None, 300.0, 900.0).unwrap();
        let demand = 3.0 * 1900.0;
        assert!((2000.0..0.9 * demand).contains(&out), "{out} vehicles an hour of {demand}");
        let waiting: u64 = inflows.iter().map(Inflow::waiting).sum();
        let queued = waiting as usize + scene.vehicles().len();
        assert!(queued > 150, "the others wait: {queued}");
        assert!(before.flow(None, 0.0, 300.0).unwrap() > out, "before the queue is there more comes than passes");
    }
}

#[test]
fn nobody_changes_into_a_lane_beside_the_stretch_where_it_is_closed() {
    // Without the lorry's neighbour lane, and with keep-right from the left, the closed lanes would be the better ones.
    for closed in [0, 2] {
        let road = Road::motorway(3, 3.75).unwrap().closing(closed, 100.0, 2900.0).unwrap();
        let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
        let rule = Idm::of(&Driver::motorway()).into();
        let lorry = Drive::Cruise { speed: 15.0, y: centre(1) };
        scene.add(Vehicle::truck(State::new(400.0, centre(1), 15.0, 0.0), lorry).with_rule(rule)).unwrap();
        let mut car = driver(rule, 1, 3);
        car.state.position.x = 200.0;
        let car = scene.add(car).unwrap();
        while scene.vehicle(car).unwrap().state.position.x < 2800.0 {
            let events = scene.step();
            assert!(!events.iter().any(|event| matches!(event, Event::LaneChange { to, .. } if *to == closed)));
            assert!(!events.iter().any(|event| matches!(event, Event::Contact { .. })));
        }
    }
}

#[test]
fn a_closure_passed_at_speed_is_a_contact_and_nothing_worse() {
    let road = Road::motorway(2, 3.75).unwrap().closing(0, 100.0, 150.0).unwrap();
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
    let blind = scene.add(Vehicle::car(State::new(0.0, centre(0), 30.0, 0.0), Drive::Steady)).unwrap();
    let inside = scene.add(driver(rules()[0], 0, 1)).err();
    assert!(inside.is_some(), "the place is taken");
    let mut placed = driver(rules()[0], 0, 1);
    placed.state.position.x = 120.0;
    let placed = scene.place(placed).unwrap();
    let mut contacts = Vec::new();
    for _ in 0..100 {
        contacts.extend(scene.step().iter().filter_map(|event| match event {
            Event::Contact { id, with: Obstacle::Closure(number) } => Some((*id, *number)),
            _ => None,
        }));
    }
    assert_eq!(contacts, [(placed, 0), (blind, 0)], "once each");
    assert_eq!(scene.contacts().len(), 0, "both are past it");
    assert!([placed, blind].iter().all(|id| scene.vehicle(*id).unwrap().state.position.x > 150.0));
}

#[test]
fn nobody_is_put_where_nobody_can_drive() {
    let road = Road::motorway(2, 3.75).unwrap().ending_at(1000.0).unwrap().closing(1, 300.0, 400.0).unwrap();
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
    let car = |x: f64, y: f64| Vehicle::car(State::new(x, y, 20.0, 0.0), Drive::Cruise { speed: 20.0, y });
    for (x, y) in [(350.0, 5.625), (299.0, 5.625), (402.0, 5.625), (1000.1, 1.875)] {
        assert!(matches!(scene.add(car(x, y)), Err(ForceError::Closed { .. })), "{x}, {y}");
        assert!(matches!(scene.enter(car(x, y)), Err(ForceError::Closed { .. })), "{x}, {y}");
    }
    assert!(scene.add(car(350.0, 1.875)).is_ok() && scene.add(car(290.0, 5.625)).is_ok());
    assert!(Inflow::new(1e6, Headways::Even, 0).is_err() && Inflow::new(-1.0, Headways::Even, 0).is_err());
}

#[test]
fn a_detector_counts_vehicles_that_are_moved_from_outside_once() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), Road::motorway(1, 3.75).unwrap()).unwrap();
    let id = scene.add(Vehicle::car(State::new(0.0, 1.875, 20.0, 0.0), Drive::Steady)).unwrap();
    let [mut moving, mut standing] = [Detector::new(50.0), Detector::new(20.1)];
    for step in 0..60 {
        // Positions off by up to 0.3 m either way, as recorded ones are; velocities in the first half only.
        let off = [0.3, -0.3, 0.0][step % 3];
        let v = if step > 15 { 20.0 } else { 0.0 };
        scene.set_state(id, State::new(2.0 * step as f64 + off, 1.875, v, 0.0)).unwrap();
        scene.step();
        moving.watch(&scene);
        standing.watch(&scene);
    }
    assert_eq!((moving.passages().len(), standing.passages().len()), (1, 1));
}
