//! Random scenes, some with vehicles on top of each other: finite, bounded, repeatable, explained.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    AfterGoal, Drive, Extent, Integrator, Limits, MotorwayRule, Published, Road, Rule, Simulator, SimulatorParams,
    State, Surroundings, Vehicle, VehicleId,
    na::{Point2, Vector2},
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const Y: f64 = 1.875;

/// Vehicles at random places, some on top of each other, with random sizes, wishes and lanes.
fn random_scene(rng: &mut ChaCha8Rng, lanes: usize, vehicles: usize) -> Simulator<f64> {
    let dt = rng.random_range(0.02..0.2);
    let mut params = SimulatorParams { decision_interval: 0.5, ..SimulatorParams::motorway(dt) };
    let rule =
        if rng.random_bool(0.5) { MotorwayRule::standard().into() } else { Rule::Published(Published::standard()) };
    params.integrator = if rng.random_bool(0.5) { Integrator::SemiImplicitEuler } else { Integrator::ExplicitEuler };
    let mut scene = Simulator::new(params, Road::motorway(lanes, 3.75).unwrap()).unwrap();
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
                then: if rng.random_bool(0.5) { AfterGoal::Leave } else { AfterGoal::Cruise },
            },
            1 => Drive::Cruise { speed: rng.random_range(0.0..70.0), y: rng.random_range(0.0..width) },
            _ => Drive::Steady,
        };
        let extent = if rng.random_bool(0.3) { Extent::truck() } else { Extent::car() };
        let tau = rng.random_range(dt..3.0);
        scene.place(Vehicle { extent, tau, rule, limits: Limits::car(), ..Vehicle::car(state, drive) }).unwrap();
    }
    scene
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
            scene.step();
            for (_, vehicle) in scene.vehicles() {
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
    let states =
        |scene: &Simulator<f64>| scene.vehicles().map(|(id, vehicle)| (id, vehicle.clone())).collect::<Vec<_>>();
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
    let mut shortened = 0;
    for _ in 0..20 {
        let mut scene = random_scene(&mut rng, 2, 12);
        let dt = scene.params().dt;
        for (id, _) in scene.vehicles() {
            let push = scene.explain(id).unwrap().forces.neighbours_total().norm();
            let most = Limits::<f64>::car().braking + Limits::<f64>::car().acceleration;
            assert!(push <= most + 1e-9, "{id} is pushed with {push} m/s²");
            shortened += u32::from(push > most - 1e-9);
        }
        let before: Vec<_> = scene
            .vehicles()
            .map(|(id, vehicle)| (id, vehicle.state.velocity, scene.explain(id).unwrap().total()))
            .collect();
        scene.step();
        for (id, velocity, force) in before {
            let Some(vehicle) = scene.vehicle(id) else { continue };
            // Cruising vehicles are not pushed backwards, those that roll backwards not faster.
            let stopped = vehicle.state.velocity.x == velocity.x.min(0.0) && !matches!(vehicle.drive, Drive::Steady);
            let expected = velocity + force * dt;
            let difference = vehicle.state.velocity - expected;
            let share = if stopped { Vector2::new(0.0, difference.y) } else { difference };
            assert!(share.norm() < 1e-9, "{id}: {:?} is not {expected:?}", vehicle.state.velocity);
        }
    }
    assert!(shortened > 0, "the limit must have been met");
}
