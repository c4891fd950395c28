//! Where vehicles go: to their goals and lanes, in symmetric scenes symmetrically, in either precision.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    AfterGoal, Drive, Event, Extent, Integrator, Published, Road, Rule, Simulator, SimulatorParams, State, Vehicle,
    na::Point2,
};

const Y: f64 = 1.875;

fn scene(params: SimulatorParams<f64>, lanes: usize) -> Simulator<f64> {
    Simulator::new(params, Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

fn cruise(x: f64, y: f64, v: f64, speed: f64) -> Vehicle<f64> {
    Vehicle::car(State::new(x, y, v, 0.0), Drive::Cruise { speed, y })
}

fn published(vehicle: Vehicle<f64>) -> Vehicle<f64> {
    vehicle.with_rule(Rule::Published(Published::standard()))
}

#[test]
fn a_lone_vehicle_reaches_its_goal_on_time() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::open()).unwrap();
    let goal = Point2::new(140.0, 3.5);
    let id = scene
        .add(Vehicle::car(State::new(0.0, 0.0, 31.0, 0.2), Drive::Goal { goal, due: 5.0, then: AfterGoal::Leave }))
        .unwrap();
    for _ in 0..124 {
        assert!(scene.step().is_empty(), "not before its time");
    }
    let [Event::Arrived { id: arrived, vehicle }] = scene.step() else { panic!("one arrival") };
    assert_eq!(*arrived, id);
    assert!((vehicle.state.position - goal).norm() < 1e-9, "{vehicle:?}");
    assert!(scene.vehicle(id).is_none(), "it has left the scene");
}

#[test]
fn a_lone_vehicle_reaches_its_speed_and_lane_without_overshoot() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 3);
    let lane = scene.road().lane_centre(1).unwrap();
    let id = scene.add(Vehicle { drive: Drive::Cruise { speed: 30.0, y: lane }, ..cruise(0.0, Y, 25.0, 0.0) }).unwrap();
    for _ in 0..750 {
        scene.step();
        let state = scene.vehicle(id).unwrap().state;
        assert!(state.position.y < lane + 0.05 && state.velocity.x < 30.0 + 1e-9, "{state:?}");
    }
    let state = scene.vehicle(id).unwrap().state;
    assert!((state.position.y - lane).abs() < 0.05 && (state.velocity.x - 30.0).abs() < 0.05, "{state:?}");
}

#[test]
fn head_on_scenes_stay_symmetric() {
    // Two pairs that change places: every vehicle has a partner at the point reflection of its state.
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::open()).unwrap();
    let mut add = |x: f64, y: f64, v: f64| {
        let drive = Drive::Goal { goal: Point2::new(-x, -y), due: 6.0, then: AfterGoal::Leave };
        scene.add(published(Vehicle::car(State::new(x, y, v, 0.0), drive))).unwrap()
    };
    let pairs = [[add(-60.0, 0.5, 20.0), add(60.0, -0.5, -20.0)], [add(-90.0, 3.0, 28.0), add(90.0, -3.0, -28.0)]];
    let mut nearest = f64::INFINITY;
    for _ in 0..149 {
        scene.step();
        for pair in pairs {
            let [a, b] = pair.map(|id| scene.vehicle(id).unwrap().state);
            let (position, velocity) = (a.position.coords + b.position.coords, a.velocity + b.velocity);
            assert!(position.norm() < 1e-9 && velocity.norm() < 1e-9, "{a:?} and {b:?}");
            nearest = nearest.min((a.position - b.position).norm());
        }
    }
    assert!(nearest < 15.0, "they must have met: {nearest}");
}

#[test]
fn two_vehicles_exactly_head_on_stay_on_their_line() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::open()).unwrap();
    let drive = |x| Drive::Goal { goal: Point2::new(x, 0.0), due: 9.0, then: AfterGoal::Leave };
    let a = scene.add(published(Vehicle::car(State::new(-80.0, 0.0, 15.0, 0.0), drive(80.0)))).unwrap();
    let b = scene.add(published(Vehicle::car(State::new(80.0, 0.0, -15.0, 0.0), drive(-80.0)))).unwrap();
    for _ in 0..200 {
        scene.step();
        let (a, b) = (scene.vehicle(a).unwrap().state, scene.vehicle(b).unwrap().state);
        assert_eq!((a.position.x, a.velocity.x), (-b.position.x, -b.velocity.x));
        assert_eq!((a.position.y, b.position.y), (0.0, 0.0));
    }
}

#[test]
fn a_mirrored_scene_drives_mirrored() {
    let build = |mirror: f64| {
        let width = 2.0 * 3.75;
        let at = |y: f64| width / 2.0 + mirror * (y - width / 2.0);
        let mut scene = scene(SimulatorParams::motorway(0.04), 2);
        for (x, from, to, v) in
            [(0.0, 1.9, 5.5, 31.0), (25.0, 5.6, 5.6, 24.0), (40.0, 2.0, 2.0, 22.0), (-9.0, 5.7, 5.6, 33.0)]
        {
            let drive = Drive::Cruise { speed: 31.0, y: at(to) };
            scene.add(Vehicle::car(State::new(x, at(from), v, 0.0), drive)).unwrap();
        }
        for _ in 0..250 {
            scene.step();
        }
        scene
            .vehicles()
            .map(|(_, vehicle)| (vehicle.state.position.x, at(vehicle.state.position.y)))
            .collect::<Vec<_>>()
    };
    for (plain, mirrored) in build(1.0).into_iter().zip(build(-1.0)) {
        assert!((plain.0 - mirrored.0).abs() < 1e-6 && (plain.1 - mirrored.1).abs() < 1e-6, "{plain:?}, {mirrored:?}");
    }
}

#[test]
fn a_finer_step_approaches_the_higher_order() {
    let end = |integrator, dt: f64| {
        let mut scene = scene(SimulatorParams { integrator, ..SimulatorParams::motorway(dt) }, 2);
        let id = scene.add(cruise(0.0, Y, 30.0, 33.0)).unwrap();
        scene.add(cruise(60.0, Y, 24.0, 24.0)).unwrap();
        for _ in 0..(8.0 / dt).round() as usize {
            scene.step();
        }
        scene.vehicle(id).unwrap().state.position.x
    };
    let truth = end(Integrator::RungeKutta4, 0.005);
    let errors = [0.08, 0.04, 0.02].map(|dt| (end(Integrator::SemiImplicitEuler, dt) - truth).abs());
    assert!(errors[0] > 1.6 * errors[1] && errors[1] > 1.6 * errors[2], "{errors:?}");
    let higher = (end(Integrator::RungeKutta4, 0.04) - truth).abs();
    assert!(higher < 0.1 * errors[1], "{higher} against {errors:?}");
}

#[test]
fn a_vehicle_that_left_the_road_is_brought_back() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 2);
    let id =
        scene.place(Vehicle { drive: Drive::Cruise { speed: 25.0, y: 5.6 }, ..cruise(0.0, 9.0, 25.0, 25.0) }).unwrap();
    for _ in 0..400 {
        scene.step();
    }
    assert!(scene.vehicle(id).unwrap().state.position.y < 6.0);
}

#[test]
fn single_precision_drives_as_double_does() {
    fn end<T: gnp_force::na::RealField + Copy>() -> f64 {
        let lit = gnp_force::na::convert::<f64, T>;
        let mut scene =
            Simulator::new(SimulatorParams::motorway(lit(0.04)), Road::motorway(1, lit(3.75)).unwrap()).unwrap();
        for (x, v) in [(0.0, 30.0), (70.0, 22.0)] {
            let state = State::new(lit(x), lit(Y), lit(v), lit(0.0));
            scene.add(Vehicle::car(state, Drive::Cruise { speed: lit(v), y: lit(Y) })).unwrap();
        }
        for _ in 0..250 {
            scene.step();
        }
        let first = scene.vehicles().next().unwrap().1.state.position.x;
        first.to_subset_unchecked()
    }
    assert!((end::<f32>() - end::<f64>()).abs() < 0.01);
}

#[test]
fn a_slower_vehicle_in_the_next_lane_holds_nobody_up() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 2);
    let left = scene.road().lane_centre(1).unwrap();
    let passing = scene.add(cruise(0.0, left, 32.0, 32.0)).unwrap();
    scene.add(cruise(80.0, Y, 22.0, 22.0)).unwrap();
    for _ in 0..500 {
        scene.step();
        let speed = scene.vehicle(passing).unwrap().state.velocity.x;
        assert!((speed - 32.0).abs() < 0.05, "{speed} m/s at {} s", scene.time());
    }
    assert!(scene.vehicle(passing).unwrap().state.position.x > 600.0);
}

#[test]
fn several_lanes_are_crossed_no_faster_than_wished() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 6);
    let far = scene.road().lane_centre(5).unwrap();
    let id = scene.add(Vehicle { drive: Drive::Cruise { speed: 30.0, y: far }, ..cruise(0.0, Y, 30.0, 30.0) }).unwrap();
    let mut fastest = 0.0_f64;
    for _ in 0..1000 {
        scene.step();
        fastest = fastest.max(scene.vehicle(id).unwrap().state.velocity.y);
    }
    assert!((1.0..1.4).contains(&fastest), "1.2 m/s is wished, lines add and take a little: {fastest}");
}

#[test]
fn nobody_is_pushed_backwards() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 1);
    let id = scene.add(cruise(0.0, Y, 0.5, 30.0)).unwrap();
    scene.add(Vehicle::obstacle(5.0, Y, Extent::car())).unwrap();
    let mut x = 0.0;
    for _ in 0..250 {
        scene.step();
        let state = scene.vehicle(id).unwrap().state;
        assert!(state.velocity.x >= 0.0 && state.position.x >= x, "{state:?}");
        x = state.position.x;
    }
    assert!(x < 0.4, "it stands in front of the obstacle: {x}");
}

#[test]
fn moving_a_vehicle_from_outside_changes_who_is_around() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 1);
    let (a, b) = (scene.add(cruise(0.0, Y, 30.0, 30.0)).unwrap(), scene.add(cruise(50.0, Y, 30.0, 30.0)).unwrap());
    scene.step();
    assert_eq!(scene.surroundings(a).unwrap().ahead, Some(b));
    scene.set_state(b, State::new(-50.0, Y, 30.0, 0.0)).unwrap();
    assert_eq!((scene.surroundings(a).unwrap().ahead, scene.surroundings(a).unwrap().behind), (None, Some(b)));
    scene.step();
    assert_eq!(scene.surroundings(a).unwrap().behind, Some(b));
}
