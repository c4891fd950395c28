//! Rules in the simulator: one's own, and those of the literature as they are written there.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, Driver, Ego, Extent, Follower, Idm, MotorwayRule, Newell, Noise, Other, PairRule, Platoon, Profile, Reach,
    Road, Rule, Simulator, SimulatorParams, State, Vehicle, VehicleId, following_acceleration, na::Vector2,
};
use std::sync::Arc;

const Y: f64 = 1.875;

fn road() -> Road<f64> {
    Road::motorway(1, 3.75).unwrap()
}

fn cruise(x: f64, v: f64, speed: f64) -> Vehicle<f64> {
    Vehicle::car(State::new(x, Y, v, 0.0), Drive::Cruise { speed, y: Y })
}

fn x_of<R: PairRule<f64>>(scene: &Simulator<f64, R>, id: VehicleId) -> f64 {
    scene.vehicle(id).unwrap().state.position.x
}

/// Brakes with all it has for whatever is nearer than its stopping distance and 5 m.
#[derive(Clone, Debug)]
struct Careful {
    braking: f64,
}

impl PairRule<f64> for Careful {
    fn reach(&self) -> Reach {
        Reach { ahead: 1, behind: 0, beside_ahead: 0, beside_behind: 0 }
    }

    fn push(&self, me: &Ego<f64>, other: &Other<f64>) -> Vector2<f64> {
        let v = me.state.velocity.x;
        let near = me.separation_from(other).ahead < 5.0 + v * v / (2.0 * self.braking);
        Vector2::new(if near { -self.braking - self.free(me) } else { 0.0 }, 0.0)
    }
}

#[test]
fn a_rule_of_ones_own_drives_a_vehicle() {
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.04), road()).unwrap();
    let rule = Careful { braking: 4.0 };
    let car = scene.add(cruise(0.0, 25.0, 25.0).with_rule(rule.clone())).unwrap();
    let wall = scene.add(Vehicle::obstacle(300.0, Y, Extent::car()).with_rule(rule)).unwrap();
    let (mut hardest, mut pushed_by) = (0.0_f64, Vec::new());
    for _ in 0..1500 {
        let forces = scene.explain(car).unwrap();
        if forces.forces.neighbours_total().x < 0.0 {
            hardest = hardest.min(forces.total().x);
            pushed_by = forces.pushed_by;
        }
        assert!(scene.step().is_empty());
    }
    assert_eq!(pushed_by, [gnp_force::Obstacle::Vehicle(wall)]);
    assert!((hardest + 4.0).abs() < 1e-9, "its own braking: {hardest}");
    let gap = x_of(&scene, wall) - x_of(&scene, car) - 4.6;
    assert!((4.0..5.5).contains(&gap), "{gap} m");
}

#[test]
fn the_intelligent_driver_of_the_simulator_is_that_of_the_functions() {
    let driver = Driver::motorway();
    let free_of_limits = gnp_force::Limits { acceleration: 100.0, braking: 100.0, lateral: 100.0 };
    for (v, leader, way) in [(30.0, 25.0, 40.0), (10.0, 20.0, 30.0), (33.0, 33.0, 60.0), (20.0, 0.0, 300.0)] {
        let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.04), road()).unwrap();
        let car = Vehicle { limits: free_of_limits, ..cruise(0.0, v, driver.desired_speed) };
        let car = scene.add(car.with_rule(Idm::of(&driver))).unwrap();
        scene.add(cruise(way, leader, leader).with_rule(Idm::of(&driver))).unwrap();
        let expected = following_acceleration(way, 4.6, v, leader, &driver);
        let acceleration = scene.explain(car).unwrap().total().x;
        assert!((acceleration - expected).abs() < 1e-12, "{acceleration} is not {expected}");
    }
}

#[test]
fn a_column_of_the_simulator_drives_as_the_platoon_does() {
    let (driver, v, steps, dt) = (Driver::<f64>::motorway(), 20.0, 3000, 0.01);
    let pitch = 40.0;
    let mut column: Vec<Follower<f64>> = Vec::new();
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(dt), road()).unwrap();
    let mut ids = Vec::new();
    for i in 0..5_usize {
        let position = -pitch * i as f64;
        column.push(Follower { position, speed: v, length: 4.6, leader: i.checked_sub(1), driver, habit: 0.0 });
        let drive = Drive::Cruise { speed: driver.desired_speed, y: Y };
        let vehicle = Vehicle::car(State::new(position, Y, v, 0.0), if i == 0 { Drive::Steady } else { drive });
        ids.push(scene.add(vehicle.with_rule(Idm::of(&driver))).unwrap());
    }
    let platoon = Platoon::roll_out(&column, dt, steps, 1.0).unwrap();
    let mut furthest = 0.0_f64;
    for step in 0..steps {
        scene.step();
        for (car, id) in ids.iter().enumerate() {
            furthest = furthest.max((x_of(&scene, *id) - platoon.positions()[car * steps + step]).abs());
        }
    }
    // The platoon's steps are of second order, the simulator's of first: half a step of speed differs.
    assert!(furthest < 0.1, "{furthest} m");
    let moved = x_of(&scene, ids[4]) + 4.0 * pitch - v * 30.0;
    assert!(moved.abs() > 5.0, "it did not just drive on: {moved} m");
}

#[test]
fn newells_followers_repeat_the_path_ahead_later_and_further_back() {
    let rule = Newell::<f64>::standard();
    let (dt, count, v) = (0.04, 20_usize, 25.0);
    let shift = 4.6 + rule.standstill_gap;
    let pitch = shift + rule.wave_time * v;
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(dt), road()).unwrap();
    // The leader slows down to 15 m/s and speeds up again.
    let profile = Profile::speeds(&[(5.0, v), (15.0, 15.0), (20.0, 15.0), (30.0, v)]).unwrap();
    let ids: Vec<VehicleId> = (0..count)
        .map(|i| {
            let drive =
                if i == 0 { Drive::Follow(Arc::new(profile.clone())) } else { Drive::Cruise { speed: 30.0, y: Y } };
            let vehicle = Vehicle::car(State::new(-pitch * i as f64, Y, v, 0.0), drive);
            scene.add(vehicle.with_rule(rule)).unwrap()
        })
        .collect();
    let mut paths = vec![Vec::new(); count];
    let mut disturbance = vec![0.0; count];
    for _ in 0..2500 {
        for (car, id) in ids.iter().enumerate() {
            let state = scene.vehicle(*id).unwrap().state;
            paths[car].push(state.position.x);
            disturbance[car] += (state.velocity.x - v).powi(2) * dt;
        }
        scene.step();
    }
    let later = (rule.wave_time / dt).round() as usize;
    let mut furthest = 0.0_f64;
    for car in 1..count {
        for step in later..2500 {
            let expected = paths[car - 1][step - later] - shift;
            furthest = furthest.max((paths[car][step] - expected).abs());
        }
    }
    assert!(furthest < 0.6, "the path ahead, shifted, to 0.6 m at 1 m/s²: {furthest} m");
    assert!(disturbance.windows(2).all(|pair| pair[1] < pair[0]), "a disturbance fades: {disturbance:?}");
    assert!(disturbance[count - 1] > 0.5 * disturbance[0], "slowly: {disturbance:?}");
}

#[test]
fn every_driver_keeps_the_gap_of_his_own_rule() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), road()).unwrap();
    let leader = scene.add(cruise(400.0, 20.0, 20.0)).unwrap();
    let mut ids = vec![leader];
    let motorway = MotorwayRule::<f64>::standard();
    let idm = Idm::of(&Driver::motorway());
    let newell = Newell::<f64>::standard();
    // With the gaps that each keeps at 20 m/s; 35 m/s is wished, so that the rules want what they can have.
    let driver = Driver { desired_speed: 35.0, ..idm.driver(35.0) };
    let tight = Idm { time_gap: 0.5, ..idm };
    let drivers: [(Rule<f64>, f64); 5] = [
        (motorway.into(), 2.0 + 1.2 * 20.0),
        (MotorwayRule { headway: 2.0, ..motorway }.into(), 2.0 + 2.0 * 20.0),
        (idm.into(), driver.equilibrium_gap(20.0).unwrap()),
        (tight.into(), tight.driver(35.0).equilibrium_gap(20.0).unwrap()),
        (newell.into(), 2.0 + 1.2 * 20.0),
    ];
    for (i, (rule, _)) in drivers.iter().enumerate() {
        ids.push(scene.add(cruise(350.0 - 50.0 * i as f64, 20.0, 35.0).with_rule(*rule)).unwrap());
    }
    for _ in 0..10_000 {
        scene.step();
    }
    for (pair, (rule, expected)) in ids.windows(2).zip(drivers) {
        let gap = scene.gap_ahead(pair[1]).unwrap().unwrap();
        assert_eq!(gap.to, gnp_force::Obstacle::Vehicle(pair[0]));
        // A social force also feels the second ahead, a little.
        assert!((gap.distance - expected).abs() < 1.5, "{rule:?}: {} m, not {expected}", gap.distance);
    }
}

#[test]
fn an_intelligent_driver_who_wishes_to_stand_comes_to_rest() {
    let mut scene = Simulator::for_rules(SimulatorParams::motorway(0.04), road()).unwrap();
    let id = scene.add(cruise(0.0, 20.0, 0.0).with_rule(Idm::of(&Driver::motorway()))).unwrap();
    let mut hardest = 0.0_f64;
    for _ in 0..1500 {
        let before = scene.vehicle(id).unwrap().state.velocity.x;
        scene.step();
        hardest = hardest.max((before - scene.vehicle(id).unwrap().state.velocity.x) / 0.04);
    }
    assert!(hardest < 1.5 + 1e-9, "comfortably: {hardest}");
    assert!(scene.vehicle(id).unwrap().state.velocity.x < 1e-6);
}

/// Ten seconds of two unsteady drivers far apart, or of the first alone: the first's states.
fn unsteady(seed: u64, company: bool) -> Vec<State<f64>> {
    let params = SimulatorParams { seed, ..SimulatorParams::motorway(0.04) };
    let mut scene = Simulator::new(params, road()).unwrap();
    let unsteady = |x| Vehicle { noise: Some(Noise { sigma: 0.3, correlation: 2.0 }), ..cruise(x, 25.0, 25.0) };
    let first = scene.add(unsteady(0.0)).unwrap();
    if company {
        scene.add(unsteady(5000.0)).unwrap();
    }
    let mut states = Vec::new();
    for _ in 0..250 {
        let expected = scene.explain(first).unwrap().total().x;
        let before = scene.vehicle(first).unwrap().state.velocity.x;
        scene.step();
        let state = scene.vehicle(first).unwrap().state;
        assert!((state.velocity.x - before - expected * 0.04).abs() < 1e-12, "the explanation knows the noise");
        states.push(state);
    }
    states
}

#[test]
fn unsteadiness_comes_from_the_seed_and_nothing_else() {
    let states = unsteady(4, false);
    assert_eq!(states, unsteady(4, false));
    assert_eq!(states, unsteady(4, true), "others may come and go");
    assert_ne!(states, unsteady(5, false));
    let spread = states.iter().map(|state| (state.velocity.x - 25.0).abs()).fold(0.0, f64::max);
    assert!((0.05..3.0).contains(&spread), "{spread} m/s");
}
