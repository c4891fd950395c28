//! Vehicles that close in on each other do not touch in the documented range.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, Extent, MotorwayRule, Published, Road, Rule, Simulator, SimulatorParams, State, Vehicle, VehicleId,
};

const Y: f64 = 1.875;

fn scene(params: SimulatorParams<f64>, lanes: usize) -> Simulator<f64> {
    Simulator::new(params, Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

fn cruise(x: f64, y: f64, v: f64, speed: f64) -> Vehicle<f64> {
    Vehicle::car(State::new(x, y, v, 0.0), Drive::Cruise { speed, y })
}

/// Smallest gap from bumper to bumper while `follower` closes in on `leader`, which starts `gap` m ahead.
fn smallest_gap(params: SimulatorParams<f64>, leader: Vehicle<f64>, follower: Vehicle<f64>, gap: f64) -> f64 {
    let mut scene = scene(params, 1);
    let lengths = (leader.extent.length + follower.extent.length) / 2.0;
    let mut leader = leader;
    leader.state.position.x = follower.state.position.x + gap + lengths;
    let (leader, follower) = (scene.add(leader).unwrap(), scene.add(follower).unwrap());
    let mut smallest = f64::INFINITY;
    for _ in 0..(40.0 / params.dt) as usize {
        scene.step();
        let x = |id| scene.vehicle(id).unwrap().state.position.x;
        smallest = smallest.min(x(leader) - x(follower) - lengths);
    }
    smallest
}

#[test]
fn closing_vehicles_do_not_touch_in_the_documented_range() {
    // The range in the documentation of `MotorwayRule`: braking with the limit less the acceleration must do.
    for dt in [0.04, 0.1, 0.2] {
        let params = SimulatorParams::motorway(dt);
        let rule = MotorwayRule::<f64>::standard();
        let most = cruise(0.0, Y, 0.0, 0.0).limits.braking - rule.acceleration;
        for (v, ahead) in (0..=10).flat_map(|v| (0..=v).map(move |ahead| (f64::from(v) * 5.0, f64::from(ahead) * 5.0)))
        {
            let w = v - ahead;
            let gap = 2.0 + w * w / (2.0 * most) + w * dt;
            for (leader, wish) in [(cruise(0.0, Y, ahead, ahead), v), (cruise(0.0, Y, ahead, ahead), v + 20.0)] {
                for (long_leader, long_follower) in [(false, false), (true, false), (false, true)] {
                    let long = |vehicle: Vehicle<f64>, long| {
                        if long { Vehicle { extent: Extent::truck(), ..vehicle } } else { vehicle }
                    };
                    let follower = long(cruise(0.0, Y, v, wish), long_follower);
                    let least = smallest_gap(params, long(leader.clone(), long_leader), follower, gap);
                    assert!(least > 1.0, "{v} m/s behind {ahead} m/s, {gap} m apart, dt {dt}: {least} m");
                }
            }
        }
    }
}

#[test]
fn closing_cars_under_the_published_law_do_not_touch_in_the_documented_range() {
    let params = SimulatorParams::motorway(0.04);
    let published = |vehicle: Vehicle<f64>| vehicle.with_rule(Rule::Published(Published::standard()));
    for ahead in [0.0, 10.0, 30.0] {
        for w in [2.0, 5.0, 8.0, 10.0] {
            for gap in [20.0, 40.0, 100.0] {
                let [leader, follower] = [ahead, ahead + w].map(|v| published(cruise(0.0, Y, v, v)));
                let least = smallest_gap(params, leader, follower, gap);
                assert!(least > 0.5, "closing at {w} m/s on {ahead} m/s from {gap} m: {least} m");
            }
        }
    }
}

#[test]
fn a_platoon_survives_an_emergency_stop_of_its_leader() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 1);
    let ids: Vec<VehicleId> = (0..15)
        .map(|i| {
            let vehicle = cruise(-43.0 * f64::from(i), Y, 30.0, 32.0);
            scene.add(if i == 0 { Vehicle { drive: Drive::Steady, ..vehicle } } else { vehicle }).unwrap()
        })
        .collect();
    for step in 0..2500 {
        let state = scene.vehicle(ids[0]).unwrap().state;
        let v = if step < 500 { 30.0 } else { (state.velocity.x - 8.0 * 0.04).max(0.0) };
        scene.set_state(ids[0], State::new(state.position.x, Y, v, 0.0)).unwrap();
        scene.step();
        for pair in ids.windows(2) {
            let x = |id| scene.vehicle(id).unwrap().state.position.x;
            let gap = x(pair[0]) - x(pair[1]) - 4.6;
            assert!(gap > 1.0, "step {step}: {gap} m between {} and {}", pair[0], pair[1]);
        }
    }
}

#[test]
fn the_desired_gap_is_kept() {
    // Where the wish to accelerate is limited, the push balances it exactly at 2 m + 1.2 s v.
    let mut scene = scene(SimulatorParams::motorway(0.04), 1);
    let leader = scene.add(cruise(100.0, Y, 20.0, 20.0)).unwrap();
    let follower = scene.add(cruise(0.0, Y, 20.0, 35.0)).unwrap();
    for _ in 0..2500 {
        scene.step();
    }
    let x = |id| scene.vehicle(id).unwrap().state.position.x;
    assert!((x(leader) - x(follower) - 4.6 - 26.0).abs() < 0.1, "{}", x(leader) - x(follower) - 4.6);
}
