//! The step backwards against finite differences: every integrator, drive and rule, on roads of every kind.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
mod differences;

use differences::{Compared, Vehicles, compare, scene};
use gnp_force::{
    AfterGoal, Drive, Event, Idm, Integrator, Mobil, MotorwayRule, Newell, Noise, Profile, Published, Road, Rule,
    SceneGradient, SimulatorParams, State, Vehicle, VehicleId, na::Point2,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

const STEP: (f64, f64) = (1e-5, 1e-8);

fn params(integrator: Integrator) -> SimulatorParams<f64> {
    SimulatorParams { integrator, ..SimulatorParams::motorway(0.1) }
}

fn every_rule() -> [Rule<f64>; 4] {
    let idm = Idm { time_gap: 1.1, standstill_gap: 2.0, acceleration: 1.4, braking: 2.0 };
    [MotorwayRule::standard().into(), idm.into(), Newell::standard().into(), Published::standard().into()]
}

/// A weighted sum of all states and wishes after one step; its gradient with respect to the scene before.
fn weighted(
    params: SimulatorParams<f64>,
    road: &Road<f64>,
    vehicles: &Vehicles,
    seed: u64,
) -> (SceneGradient<f64>, Compared) {
    let weights = |id: VehicleId| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (id.0 << 8));
        [(); 6].map(|()| rng.random_range(-1.0..1.0))
    };
    let before = scene(params, road, vehicles);
    let mut after = before.clone();
    after.step();
    let mut gradient = SceneGradient::zeros(&after);
    for (id, vehicle) in after.vehicles() {
        let [x, y, vx, vy, wish, aside] = weights(id);
        let own = gradient.of(id).unwrap();
        (own.state.position, own.state.velocity) = ([x, y].into(), [vx, vy].into());
        if let Drive::Cruise { .. } = vehicle.drive {
            own.wish = [wish, aside].into();
        }
    }
    before.step_vjp(&mut gradient);
    let loss = |vehicles: &[Vehicle<f64>]| {
        let mut scene = scene(params, road, vehicles);
        scene.step();
        let of = |(id, vehicle): (VehicleId, &Vehicle<f64>)| {
            let [x, y, vx, vy, wish, aside] = weights(id);
            let State { position: p, velocity: v } = vehicle.state;
            let wishes = match vehicle.drive {
                Drive::Cruise { speed, y } => wish * speed + aside * y,
                _ => 0.0,
            };
            x * p.x + y * p.y + vx * v.x + vy * v.y + wishes
        };
        scene.vehicles().map(of).sum::<f64>()
    };
    let compared = compare(vehicles, &gradient, loss, STEP);
    (gradient, compared)
}

/// Dense traffic on `lanes` lanes, every driver with another rule and some with another drive.
fn traffic(rng: &mut ChaCha8Rng, lanes: usize, count: usize, pitch: f64) -> Vehicles {
    let profile = Arc::new(Profile::speeds(&[(-1.0, 20.0), (0.03, 21.0), (1.0, 15.0)]).unwrap());
    (0..count)
        .map(|i| {
            let y = 1.875 + 3.75 * (i % lanes) as f64;
            let x = (i / lanes) as f64 * pitch + 5.0 + rng.random_range(-6.0..6.0);
            let v = rng.random_range(14.0..26.0);
            let state = State::new(x, y + rng.random_range(-0.7..0.7), v, rng.random_range(-0.3..0.3));
            let aim = y + rng.random_range(-1.0..1.0) + if i % 5 == 4 && i % lanes > 0 { -3.75 } else { 0.0 };
            let drive = match i % 9 {
                2 => Drive::Goal {
                    goal: Point2::new(x + v * 3.0 + rng.random_range(-6.0..6.0), y + 0.4),
                    due: 3.0,
                    then: AfterGoal::Leave,
                },
                5 => Drive::Accelerate(-2.0),
                7 => Drive::Follow(profile.clone()),
                _ => Drive::Cruise { speed: v + rng.random_range(-3.0..3.0), y: aim },
            };
            let vehicle = if i % 4 == 1 { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
            let tau = rng.random_range(0.7..1.6);
            Vehicle { tau, ..vehicle }.with_rule(every_rule()[i % 4])
        })
        .collect()
}

#[test]
fn of_dense_traffic_of_every_rule_and_drive_under_every_integrator() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let mut all = Compared::default();
    for case in 0..8 {
        let vehicles = traffic(&mut rng, 3, 14, 40.0);
        for integrator in [Integrator::SemiImplicitEuler, Integrator::ExplicitEuler, Integrator::RungeKutta4] {
            let road = Road::motorway(3, 3.75).unwrap();
            let (_, compared) = weighted(params(integrator), &road, &vehicles, case);
            all.numbers += compared.numbers;
            all.nonzero += compared.nonzero;
        }
    }
    assert!(all.numbers > 3000 && all.nonzero * 3 > all.numbers * 2, "{all:?}");
}

#[test]
fn of_a_ring_over_its_seam_and_of_lanes_that_end() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    let ring = Road::motorway(2, 3.75).unwrap().ring(240.0).unwrap();
    let works = Road::motorway(2, 3.75).unwrap().closing(0, 150.0, 400.0).unwrap();
    for case in 0..6 {
        for integrator in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
            let vehicles = traffic(&mut rng, 2, 11, 40.0);
            weighted(params(integrator), &ring, &vehicles, case);
            let mut vehicles = traffic(&mut rng, 2, 6, 36.0);
            vehicles[4].state.velocity.x = 12.0; // the next before the works
            weighted(params(integrator), &works, &vehicles, case);
        }
    }
    // The works push along the road only, wherever in its lane the vehicle is, and under every law.
    for rule in every_rule() {
        let cruise = Drive::Cruise { speed: 22.0, y: 1.875 };
        let vehicle = Vehicle::car(State::new(110.0, 1.5, 12.0, 0.2), cruise).with_rule(rule);
        weighted(params(Integrator::SemiImplicitEuler), &works, &vec![vehicle], 2);
    }
    // Over the seam the last one follows the first.
    let car = |x: f64| {
        let state = State::new(x, 1.875, 20.0, 0.0);
        Vehicle::car(state, Drive::Cruise { speed: 24.0, y: 1.875 }).with_rule(every_rule()[1])
    };
    let (gradient, _) = weighted(params(Integrator::RungeKutta4), &ring, &vec![car(3.0), car(237.9 - 24.0)], 1);
    let follows = gradient.get(VehicleId(1)).unwrap().rule[0];
    assert!(follows.abs() > 1e-3, "{follows}");
}

#[test]
fn of_two_who_change_into_one_lane_from_both_sides() {
    let road = Road::motorway(3, 3.75).unwrap();
    let car = |x: f64, lane: f64, v: f64| {
        let state = State::new(x, 1.875 + 3.75 * lane, v, 0.1);
        Vehicle::car(state, Drive::Cruise { speed: 27.5, y: 5.5 })
    };
    for rule in every_rule() {
        let vehicles = vec![car(0.0, 0.0, 24.0).with_rule(rule), car(30.0, 2.0, 20.0).with_rule(rule)];
        for integrator in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
            weighted(params(integrator), &road, &vehicles, 12);
        }
        let mut gradient = SceneGradient::zeros(&scene(params(Integrator::SemiImplicitEuler), &road, &vehicles));
        gradient.of(VehicleId(0)).unwrap().state.velocity.x = 1.0;
        scene(params(Integrator::SemiImplicitEuler), &road, &vehicles).step_vjp(&mut gradient);
        let by_other = gradient.get(VehicleId(1)).unwrap().state.position.x;
        assert!(by_other > 0.0 || matches!(rule, Rule::Published(_)), "he sees who comes from beyond: {rule:?}");
    }
}

#[test]
fn of_vehicles_that_stop_or_are_at_their_limits() {
    let stops = |x: f64, v: f64, drive| {
        let standing = Vehicle::obstacle(x, 1.875, gnp_force::Extent::car());
        vec![standing, Vehicle::car(State::new(0.0, 1.6, v, 0.05), drive).with_rule(every_rule()[1])]
    };
    let cruise = Drive::Cruise { speed: 20.0, y: 1.875 };
    let road = Road::motorway(1, 3.75).unwrap();
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ExplicitEuler, Integrator::RungeKutta4] {
        let (gradient, _) = weighted(params(integrator), &road, &stops(5.4, 0.3, cruise.clone()), 3);
        assert_eq!(gradient.get(VehicleId(1)).unwrap().rule, [0.0; 4], "it stops, whatever its driver is like");
        weighted(params(integrator), &road, &stops(9.0, 0.5, Drive::Accelerate(-8.0)), 4);
        weighted(params(integrator), &road, &stops(9.0, 6.0, cruise.clone()), 5);
        // At the highest speed, with a wish for more than the limits give, and braking harder than possible.
        weighted(params(integrator), &road, &stops(9.0, 69.95, Drive::Accelerate(3.0)), 6);
        weighted(params(integrator), &road, &stops(9.0, 69.0, cruise.clone()), 7);
        let far = Drive::Goal { goal: Point2::new(900.0, 3.0), due: 4.0, then: AfterGoal::Leave };
        weighted(params(integrator), &road, &stops(9.0, 69.5, far), 8);
    }
}

#[test]
fn of_goals_that_are_due_in_the_step() {
    let road = Road::motorway(2, 3.75).unwrap();
    for (then, v) in [(AfterGoal::Cruise, 22.0), (AfterGoal::Cruise, -0.2), (AfterGoal::Leave, 22.0)] {
        let goal = Drive::Goal { goal: Point2::new(0.1 * v, 2.1), due: 0.1, then };
        let follower = Vehicle::car(State::new(-25.0, 1.7, 20.0, 0.0), Drive::Cruise { speed: 26.0, y: 1.875 });
        let vehicles = vec![follower, Vehicle::car(State::new(0.0, 1.9, v, 0.0), goal)];
        for integrator in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
            weighted(params(integrator), &road, &vehicles, 9);
        }
    }
}

#[test]
fn of_a_vehicle_that_leaves_as_it_left() {
    let road = Road::motorway(1, 3.75).unwrap().ending_at(100.0).unwrap();
    let car = |x: f64| {
        Vehicle::car(State::new(x, 1.875, 20.0, 0.0), Drive::Cruise { speed: 24.0, y: 1.875 })
            .with_rule(every_rule()[1])
    };
    let vehicles = vec![car(130.0 - 31.0), car(60.0)];
    let params = params(Integrator::SemiImplicitEuler);
    let before = scene(params, &road, &vehicles);
    let mut gradient = SceneGradient::zeros(&before);
    gradient.of(VehicleId(0)).unwrap().state.position.x = 2.0;
    before.step_vjp(&mut gradient);
    let loss = |vehicles: &[Vehicle<f64>]| {
        let mut scene = scene(params, &road, vehicles);
        let [Event::Left { vehicle, .. }] = scene.step() else { panic!("one leaves") };
        2.0 * vehicle.state.position.x
    };
    let compared = compare(&vehicles, &gradient, loss, STEP);
    assert!(compared.nonzero >= 3, "{compared:?}");
}

#[test]
fn with_decisions_and_chance_as_they_are() {
    let road = Road::motorway(2, 3.75).unwrap();
    let car = |x: f64, v: f64, speed: f64| {
        let vehicle = Vehicle::car(State::new(x, 1.875, v, 0.0), Drive::Cruise { speed, y: 1.875 });
        let noise = Some(Noise { sigma: 0.3, correlation: 5.0 });
        Vehicle { lane_change: Some(Mobil::standard()), noise, ..vehicle }.with_rule(every_rule()[1])
    };
    let vehicles = vec![car(0.0, 27.0, 33.0), car(35.0, 20.0, 20.0)];
    let params = SimulatorParams { seed: 5, ..params(Integrator::SemiImplicitEuler) };
    let mut after = scene(params, &road, &vehicles);
    after.step();
    let decided = after.vehicle(VehicleId(0)).unwrap();
    assert!(matches!(decided.drive, Drive::Cruise { y, .. } if y > 5.0), "moves out: {decided:?}");
    let (gradient, compared) = weighted(params, &road, &vehicles, 10);
    assert_eq!(gradient.get(VehicleId(0)).unwrap().wish.y, 0.0, "his old lane does not matter");
    assert!(compared.nonzero >= 12, "{compared:?}");
}
