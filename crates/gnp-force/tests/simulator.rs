//! What a scene of vehicles promises: arriving, symmetry, no contact in the stated range, bounded speed, repeatability.
use gnp_force::{
    CruiseParams, Drive, Extent, Integrator, Repulsion, Road, Simulator, SimulatorParams, State, Surroundings, Vehicle,
    VehicleId,
    nalgebra::{Point2, Vector2},
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const Y: f64 = 1.875;

fn scene(params: SimulatorParams<f64>, lanes: usize) -> Simulator<f64> {
    Simulator::new(params, Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

fn cruise(x: f64, y: f64, v: f64, speed: f64) -> Vehicle<f64> {
    Vehicle::car(State::new(x, y, v, 0.0), Drive::Cruise { speed, y })
}

/// Vehicles at random places, some on top of each other, with random sizes, wishes and lanes.
fn random_scene(rng: &mut ChaCha8Rng, lanes: usize, vehicles: usize) -> Simulator<f64> {
    let dt = rng.random_range(0.02..0.2);
    let mut params = if rng.random_bool(0.5) { SimulatorParams::motorway(dt) } else { SimulatorParams::published(dt) };
    params.integrator = if rng.random_bool(0.5) { Integrator::SemiImplicitEuler } else { Integrator::ExplicitEuler };
    let mut scene = scene(params, lanes);
    let width = 3.75 * lanes as f64;
    for _ in 0..vehicles {
        let state = State::new(
            f64::from(rng.random_range(-20..20_i32)) * 2.5,
            if rng.random_bool(0.5) { Y } else { rng.random_range(-5.0..width + 5.0) },
            rng.random_range(-10.0..60.0),
            rng.random_range(-3.0..3.0),
        );
        let drive = match rng.random_range(0..3) {
            0 => Drive::Goal {
                goal: Point2::new(rng.random_range(-300.0..300.0), rng.random_range(0.0..width)),
                due: rng.random_range(0.5..8.0),
            },
            1 => Drive::Cruise { speed: rng.random_range(0.0..70.0), y: rng.random_range(0.0..width) },
            _ => Drive::Steady,
        };
        let extent = if rng.random_bool(0.3) { Extent::truck() } else { Extent::car() };
        scene.add(Vehicle { state, extent, drive, tau: rng.random_range(dt..3.0) }).unwrap();
    }
    scene
}

#[test]
fn a_lone_vehicle_reaches_its_goal_on_time() {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::open()).unwrap();
    let goal = Point2::new(140.0, 3.5);
    let id = scene.add(Vehicle::car(State::new(0.0, 0.0, 31.0, 0.2), Drive::Goal { goal, due: 5.0 })).unwrap();
    for _ in 0..124 {
        assert!(scene.step().is_empty(), "not before its time");
    }
    let arrivals = scene.step();
    assert_eq!(arrivals.len(), 1);
    assert_eq!(arrivals[0].id, id);
    assert!((arrivals[0].vehicle.state.position - goal).norm() < 1e-9, "{:?}", arrivals[0]);
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
    let mut scene = Simulator::new(SimulatorParams::published(0.04), Road::open()).unwrap();
    let mut add = |x: f64, y: f64, v: f64| {
        let drive = Drive::Goal { goal: Point2::new(-x, -y), due: 6.0 };
        scene.add(Vehicle::car(State::new(x, y, v, 0.0), drive)).unwrap()
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
    let mut scene = Simulator::new(SimulatorParams::published(0.04), Road::open()).unwrap();
    let drive = |x| Drive::Goal { goal: Point2::new(x, 0.0), due: 9.0 };
    let a = scene.add(Vehicle::car(State::new(-80.0, 0.0, 15.0, 0.0), drive(80.0))).unwrap();
    let b = scene.add(Vehicle::car(State::new(80.0, 0.0, -15.0, 0.0), drive(-80.0))).unwrap();
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
    // The range in the documentation of `MotorwayRule`: braking with grip - acceleration must do.
    for dt in [0.04, 0.1, 0.2] {
        let params = SimulatorParams::motorway(dt);
        let most = params.grip - params.cruise.acceleration;
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
                    let least = smallest_gap(params, long(leader, long_leader), follower, gap);
                    assert!(least > 1.0, "{v} m/s behind {ahead} m/s, {gap} m apart, dt {dt}: {least} m");
                }
            }
        }
    }
}

#[test]
fn closing_cars_under_the_published_law_do_not_touch_in_the_documented_range() {
    let params = SimulatorParams::published(0.04);
    for ahead in [0.0, 10.0, 30.0] {
        for w in [2.0, 5.0, 8.0, 10.0] {
            for gap in [20.0, 40.0, 100.0] {
                let least =
                    smallest_gap(params, cruise(0.0, Y, ahead, ahead), cruise(0.0, Y, ahead + w, ahead + w), gap);
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
fn ten_thousand_random_scenes_stay_finite_and_under_the_bound() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let mut fastest_share = 0.0_f64;
    for case in 0..10_000 {
        let (lanes, vehicles) = (rng.random_range(1..4), rng.random_range(2..9));
        let mut scene = random_scene(&mut rng, lanes, vehicles);
        let bound = scene.speed_bound();
        for step in 0..30 {
            let arrivals: Vec<_> = scene.step().iter().map(|arrival| arrival.vehicle).collect();
            for vehicle in scene.vehicles().map(|(_, vehicle)| vehicle).chain(&arrivals) {
                let speed = vehicle.state.velocity.norm();
                assert!(vehicle.state.is_finite(), "case {case}, step {step}: {vehicle:?}");
                assert!(speed <= bound, "case {case}, step {step}: {speed} above {bound} m/s: {vehicle:?}");
                fastest_share = fastest_share.max(speed / bound);
            }
        }
    }
    assert!(fastest_share > 0.5, "the bound is worth stating: {fastest_share}");
}

#[test]
fn the_same_scene_gives_the_same_bits_and_a_clone_goes_the_same_way() {
    let run = || {
        let mut scene = random_scene(&mut ChaCha8Rng::seed_from_u64(5), 3, 40);
        let mut clone = None;
        for step in 0..200 {
            if step == 77 {
                clone = Some(scene.clone());
            }
            scene.step();
        }
        (scene, clone.unwrap())
    };
    let states = |scene: &Simulator<f64>| scene.vehicles().map(|(id, vehicle)| (id, *vehicle)).collect::<Vec<_>>();
    let ((one, mut clone), (two, _)) = (run(), run());
    assert_eq!(states(&one), states(&two));
    for _ in 77..200 {
        clone.step();
    }
    assert_eq!(states(&one), states(&clone));
}

#[test]
fn surroundings_are_those_of_a_search_through_all() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for _ in 0..50 {
        let mut scene = random_scene(&mut rng, 4, 30);
        for _ in 0..rng.random_range(0..20) {
            scene.step();
        }
        let all: Vec<_> = scene.vehicles().map(|(id, vehicle)| (id, vehicle.state.position)).collect();
        for (id, me) in &all {
            let lane = scene.road().lane_at(me.y) as isize;
            let in_lane = |beside: isize| {
                let road = scene.road();
                all.iter().filter(move |(_, p)| road.lane_at(p.y) as isize == lane + beside)
            };
            // Vehicles at the same x count by number, as in the order along the lane.
            let place = |id: &VehicleId, p: &Point2<f64>| (p.x, *id);
            let ahead = |beside| {
                let found = in_lane(beside).filter(|(other, p)| place(other, p) > place(id, me));
                found.min_by(|a, b| place(&a.0, &a.1).partial_cmp(&place(&b.0, &b.1)).unwrap()).map(|found| found.0)
            };
            let behind = |beside| {
                let found = in_lane(beside).filter(|(other, p)| place(other, p) < place(id, me));
                found.max_by(|a, b| place(&a.0, &a.1).partial_cmp(&place(&b.0, &b.1)).unwrap()).map(|found| found.0)
            };
            let expected = Surroundings {
                ahead: ahead(0),
                behind: behind(0),
                left_ahead: ahead(1),
                left_behind: behind(1),
                right_ahead: ahead(-1),
                right_behind: behind(-1),
            };
            assert_eq!(scene.surroundings(*id).unwrap(), expected);
        }
    }
}

#[test]
fn an_explanation_adds_up_to_the_motion() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for _ in 0..20 {
        let mut scene = random_scene(&mut rng, 2, 12);
        let dt = scene.params().dt;
        let before: Vec<_> = scene
            .vehicles()
            .map(|(id, vehicle)| (id, vehicle.state.velocity, scene.explain(id).unwrap().forces.total()))
            .collect();
        scene.step();
        for (id, velocity, force) in before {
            let Some(vehicle) = scene.vehicle(id) else { continue };
            let stopped = vehicle.state.velocity.x == 0.0 && !matches!(vehicle.drive, Drive::Steady);
            let expected = velocity + force * dt;
            let difference = vehicle.state.velocity - expected;
            let share = if stopped { Vector2::new(0.0, difference.y) } else { difference };
            assert!(share.norm() < 1e-9, "{id}: {:?} is not {expected:?}", vehicle.state.velocity);
        }
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

#[test]
fn a_vehicle_that_left_the_road_is_brought_back() {
    let mut scene = scene(SimulatorParams::motorway(0.04), 2);
    let id =
        scene.add(Vehicle { drive: Drive::Cruise { speed: 25.0, y: 5.6 }, ..cruise(0.0, 9.0, 25.0, 25.0) }).unwrap();
    for _ in 0..400 {
        scene.step();
    }
    assert!(scene.vehicle(id).unwrap().state.position.y < 6.0);
}

#[test]
fn single_precision_drives_as_double_does() {
    fn end<T: gnp_force::nalgebra::RealField + Copy>() -> f64 {
        let lit = gnp_force::nalgebra::convert::<f64, T>;
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
fn what_the_physics_does_not_allow_is_refused_by_name() {
    let road = || Road::motorway(2, 3.75).unwrap();
    let good = SimulatorParams::motorway(0.04);
    let CruiseParams { .. } = good.cruise;
    for (params, key) in [
        (SimulatorParams { dt: 0.0, ..good }, "dt"),
        (SimulatorParams { dt: f64::NAN, ..good }, "dt"),
        (SimulatorParams { grip: -1.0, ..good }, "grip"),
        (SimulatorParams { max_speed: f64::INFINITY, ..good }, "max_speed"),
        (SimulatorParams { repulsion: Repulsion::Published { k: 1.0, r_col: 0.0 }, ..good }, "repulsion.r_col"),
        (SimulatorParams { cruise: CruiseParams { preview: 0.0, ..good.cruise }, ..good }, "cruise.preview"),
    ] {
        let error = Simulator::new(params, road()).unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    let mut scene = Simulator::new(good, road()).unwrap();
    let car = cruise(0.0, Y, 30.0, 30.0);
    for (vehicle, key) in [
        (Vehicle { tau: 0.01, ..car }, "vehicle.tau"),
        (Vehicle { state: State::new(f64::NAN, 0.0, 0.0, 0.0), ..car }, "vehicle.state"),
        (Vehicle { extent: Extent { length: -1.0, width: 2.0 }, ..car }, "vehicle.extent.length"),
        (Vehicle { drive: Drive::Cruise { speed: 100.0, y: Y }, ..car }, "drive.speed"),
        (Vehicle { drive: Drive::Goal { goal: Point2::origin(), due: 0.0 }, ..car }, "drive.due"),
    ] {
        let error = scene.add(vehicle).unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    assert_eq!(scene.vehicles().len(), 0, "nothing refused was kept");
    let id = scene.add(car).unwrap();
    assert_eq!(scene.remove(id).unwrap(), car);
    assert!(scene.remove(id).unwrap_err().to_string().contains("no vehicle 0"));
    assert!(scene.set_state(id, car.state).is_err() && scene.explain(id).is_err() && scene.surroundings(id).is_err());
    assert!(Road::motorway(0, 3.75).is_err() && Road::motorway(2, f64::NAN).is_err());
}
