//! No drive and no rule asks a vehicle for more than it can do, and whoever arrives may drive on.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    AfterGoal, Drive, Driver, Event, Idm, Integrator, Limits, MotorwayRule, Newell, Noise, Published, Road, Rule,
    Simulator, SimulatorParams, State, Vehicle, VehicleId, na::Point2,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const Y: f64 = 1.875;

fn rules() -> [Rule<f64>; 4] {
    [
        Published::standard().into(),
        MotorwayRule::standard().into(),
        Idm::of(&Driver::motorway()).into(),
        Newell::standard().into(),
    ]
}

/// Takes a step, and checks that nobody's velocity changed by more than its limits allow.
fn step_within_limits(scene: &mut Simulator<f64>) {
    let dt = scene.params().dt;
    let before: Vec<(VehicleId, State<f64>, Limits<f64>)> =
        scene.vehicles().map(|(id, vehicle)| (id, vehicle.state, vehicle.limits)).collect();
    let mut arrived: Vec<(VehicleId, State<f64>)> = Vec::new();
    for event in scene.step() {
        if let Event::Arrived { id, vehicle } = event {
            arrived.push((*id, vehicle.state));
        }
    }
    for (id, was, limits) in before {
        let gone = arrived.iter().find(|(other, _)| *other == id).map(|(_, state)| *state);
        let is = gone.or_else(|| scene.vehicle(id).map(|vehicle| vehicle.state)).unwrap();
        let a = (is.velocity - was.velocity) / dt;
        let (forward, braking) = if was.velocity.x < 0.0 {
            (limits.braking, limits.acceleration)
        } else {
            (limits.acceleration, limits.braking)
        };
        let time = scene.time();
        assert!(a.x < forward + 1e-6 && a.x > -braking - 1e-6, "vehicle {id} at {time} s: {a:?}, {was:?}, {is:?}");
        assert!(a.y.abs() < limits.lateral + 1e-6, "vehicle {id} at {time} s: {a:?}");
    }
}

#[test]
fn a_goal_behind_a_truck_asks_for_no_more_than_the_car_can_do() {
    // Before, the last step of such a car was one with 121 m/s².
    for rule in rules() {
        for then in [AfterGoal::Leave, AfterGoal::Cruise] {
            let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::motorway(1, 3.75).unwrap()).unwrap();
            let goal = Drive::Goal { goal: Point2::new(120.0, Y), due: 5.0, then };
            let car = scene.add(Vehicle::car(State::new(0.0, Y, 22.0, 0.0), goal).with_rule(rule)).unwrap();
            let truck = Drive::Cruise { speed: 15.0, y: Y };
            scene.add(Vehicle::truck(State::new(40.0, Y, 15.0, 0.0), truck)).unwrap();
            for _ in 0..250 {
                step_within_limits(&mut scene);
            }
            match (then, scene.vehicle(car)) {
                (AfterGoal::Leave, left) => assert!(left.is_none(), "its time was up"),
                (AfterGoal::Cruise, vehicle) => {
                    let vehicle = vehicle.unwrap();
                    assert!(matches!(vehicle.drive, Drive::Cruise { y, .. } if y == Y), "{:?}", vehicle.drive);
                    assert!(
                        vehicle.state.position.x > 100.0 && vehicle.state.velocity.x > 1.0,
                        "{rule:?}: {:?}",
                        vehicle.state
                    );
                }
            }
        }
    }
}

#[test]
fn whoever_drives_on_after_the_goal_keeps_his_speed_and_lane() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::motorway(2, 3.75).unwrap()).unwrap();
    let drive = Drive::Goal { goal: Point2::new(130.0, 5.625), due: 5.0, then: AfterGoal::Cruise };
    let car = scene.add(Vehicle::car(State::new(0.0, Y, 25.0, 0.0), drive)).unwrap();
    (0..125).for_each(|_| assert!(scene.step().iter().all(|event| matches!(event, Event::LaneChange { .. }))));
    let speed = scene.vehicle(car).unwrap().state.velocity.x;
    (0..500).for_each(|_| assert!(scene.step().is_empty()));
    let state = scene.vehicle(car).unwrap().state;
    assert!((state.velocity.x - speed).abs() < 0.05 && (state.position.y - 5.625).abs() < 0.1, "{speed}: {state:?}");
    assert!((state.position.x - 130.0 - 20.0 * speed).abs() < 1.0, "{state:?}");
}

#[test]
fn no_drive_exceeds_the_limits_in_random_scenes() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    for case in 0..1500 {
        let dt = rng.random_range(0.02..0.2);
        let explicit = rng.random_bool(0.5);
        let integrator = if explicit { Integrator::ExplicitEuler } else { Integrator::SemiImplicitEuler };
        let params = SimulatorParams { integrator, seed: case, ..SimulatorParams::motorway(dt) };
        let road = Road::motorway(2, 3.75).unwrap().closing(1, 60.0, 90.0).unwrap();
        let mut scene = Simulator::new(params, road).unwrap();
        for _ in 0..rng.random_range(1..9) {
            let (x, y) = (rng.random_range(-60.0..60.0), rng.random_range(-1.0..8.5));
            let state = State::new(x, y, rng.random_range(-5.0..45.0), rng.random_range(-2.0..2.0));
            let drive = match rng.random_range(0..3) {
                0 => Drive::Goal {
                    goal: Point2::new(rng.random_range(-200.0..300.0), rng.random_range(0.0..7.5)),
                    due: rng.random_range(0.3..6.0),
                    then: if rng.random_bool(0.5) { AfterGoal::Leave } else { AfterGoal::Cruise },
                },
                1 => Drive::Cruise { speed: rng.random_range(0.0..50.0), y: rng.random_range(0.0..7.5) },
                _ => Drive::Accelerate(rng.random_range(-30.0..30.0)),
            };
            let vehicle = if rng.random_bool(0.3) { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
            let noise = rng.random_bool(0.5).then_some(Noise { sigma: 2.0, correlation: 1.0 });
            let vehicle = Vehicle { noise, tau: rng.random_range(dt..2.0), ..vehicle };
            scene.place(vehicle.with_rule(rules()[rng.random_range(0..4)])).unwrap();
        }
        (0..40).for_each(|_| step_within_limits(&mut scene));
    }
}

#[test]
fn whoever_rolls_backwards_brakes_to_a_standstill_and_drives_on() {
    // The rule's 1.5 m/s² where the driver has a wish, the brakes' 9 m/s² where he is told.
    for (drive, after) in [(Drive::Cruise { speed: 20.0, y: Y }, -9.85), (Drive::Accelerate(2.0), -9.1)] {
        let mut scene = Simulator::new(SimulatorParams::motorway(0.1), Road::motorway(1, 3.75).unwrap()).unwrap();
        let id = scene.add(Vehicle::car(State::new(0.0, Y, -10.0, 0.0), drive)).unwrap();
        step_within_limits(&mut scene);
        assert!((scene.vehicle(id).unwrap().state.velocity.x - after).abs() < 1e-9);
        (0..200).for_each(|_| step_within_limits(&mut scene));
        assert!(scene.vehicle(id).unwrap().state.velocity.x > 10.0);
    }
}
