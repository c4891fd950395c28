//! Motions that are given: an acceleration, velocities over time; and orders that stay orders whatever is moved.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    Drive, ForceError, Profile, Road, Simulator, SimulatorParams, State, Surroundings, Vehicle, VehicleId, na::Vector2,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const Y: f64 = 1.875;

fn scene(lanes: usize) -> Simulator<f64> {
    Simulator::new(SimulatorParams::motorway(0.04), Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

#[test]
fn an_emergency_braking_stops_and_stays() {
    let mut scene = scene(1);
    let car = scene.add(Vehicle::car(State::new(0.0, Y, 30.0, 0.5), Drive::Accelerate(-8.0))).unwrap();
    let mut last = scene.vehicle(car).unwrap().state;
    for step in 1..=200 {
        scene.step();
        let state = scene.vehicle(car).unwrap().state;
        let speed = (30.0 - 8.0 * 0.04 * f64::from(step)).max(0.0);
        assert!((state.velocity.x - speed).abs() < 1e-9, "{state:?}");
        if step > 94 {
            assert_eq!(state.velocity, Vector2::zeros());
            assert!(step < 96 || state == last, "it stays: {state:?}");
        }
        last = state;
    }
    // 30² / 16 = 56.25 m; a step of first order is half a step of the speed off.
    assert!((last.position.x - 56.25).abs() < 30.0 * 0.04 / 2.0 + 1e-9, "{last:?}");
    assert!((last.position.y - Y).abs() < 0.1, "and does not slide aside: {last:?}");
}

#[test]
fn a_given_acceleration_keeps_to_the_limits_and_the_highest_speed() {
    let mut scene = scene(1);
    let car = scene.add(Vehicle::car(State::new(0.0, Y, 0.0, 0.0), Drive::Accelerate(50.0))).unwrap();
    scene.step();
    assert!((scene.vehicle(car).unwrap().state.velocity.x - 4.0 * 0.04).abs() < 1e-12, "a car's 4 m/s²");
    (0..1000).for_each(|_| {
        scene.step();
    });
    assert!((scene.vehicle(car).unwrap().state.velocity.x - 70.0).abs() < 1e-9);
}

#[test]
fn a_profile_is_followed_exactly_whatever_the_step() {
    // Knots between steps; the true position is the integral.
    let knots = [(0.51, 20.0, 0.0), (1.77, 5.0, 1.0), (3.0, 5.0, -0.5), (3.01, 12.0, 0.0)];
    let profile = Profile::new(knots.map(|(t, x, y)| (t, Vector2::new(x, y))).to_vec()).unwrap();
    for dt in [0.04, 0.1, 0.33] {
        let mut scene = Simulator::new(SimulatorParams::motorway(dt), Road::motorway(2, 3.75).unwrap()).unwrap();
        let drive = Drive::Follow(profile.clone().into());
        let car = scene.add(Vehicle::car(State::new(7.0, Y, 20.0, 0.0), drive)).unwrap();
        while scene.time() < 5.0 {
            scene.step();
            let fine = 20_000;
            let h = scene.time() / f64::from(fine);
            let way = (0..fine).map(|i| profile.velocity_at((f64::from(i) + 0.5) * h) * h).sum::<Vector2<f64>>();
            let state = scene.vehicle(car).unwrap().state;
            assert!((state.position.coords - Vector2::new(7.0, Y) - way).norm() < 1e-4, "{state:?}, {way:?}");
            assert_eq!(state.velocity, profile.velocity_at(scene.time()));
        }
    }
}

#[test]
fn profiles_that_are_none_are_refused() {
    for knots in [&[][..], &[(0.0, f64::NAN)], &[(1.0, 5.0), (1.0, 6.0)], &[(f64::INFINITY, 5.0)]] {
        assert!(matches!(Profile::speeds(knots), Err(ForceError::Value { .. })), "{knots:?}");
    }
    let mut scene = scene(1);
    let id = scene.add(Vehicle::car(State::new(0.0, Y, 0.0, 0.0), Drive::Steady)).unwrap();
    for drive in [Drive::Accelerate(f64::NAN), Drive::Cruise { speed: -1.0, y: Y }, Drive::Cruise { speed: 71.0, y: Y }]
    {
        assert!(matches!(scene.set_drive(id, drive), Err(ForceError::Value { .. })));
    }
    assert!(scene.set_state(id, State::new(0.0, f64::NAN, 0.0, 0.0)).is_err());
    assert_eq!(scene.vehicle(id).unwrap().drive, Drive::Steady, "nothing of that was taken over");
}

/// Who is around, by a search through all.
fn searched(scene: &Simulator<f64>, id: VehicleId) -> Surroundings {
    let road = scene.road();
    let place = |id: VehicleId| (scene.vehicle(id).unwrap().state.position.x, id);
    let lane = |id: VehicleId| road.lane_at(scene.vehicle(id).unwrap().state.position.y) as isize;
    let find = |beside: isize, ahead: bool| {
        let there = scene.vehicles().map(|(other, _)| other).filter(|other| lane(*other) == lane(id) + beside);
        let there = there.filter(|other| if ahead { place(*other) > place(id) } else { place(*other) < place(id) });
        let order = |a: &VehicleId, b: &VehicleId| place(*a).partial_cmp(&place(*b)).unwrap();
        if ahead { there.min_by(order) } else { there.max_by(order) }
    };
    Surroundings {
        ahead: find(0, true),
        behind: find(0, false),
        left_ahead: find(1, true),
        left_behind: find(1, false),
        right_ahead: find(-1, true),
        right_behind: find(-1, false),
    }
}

#[test]
fn sweeps_of_given_states_and_questions_find_whom_a_search_finds() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut scene = scene(4);
    let mut state = |x: f64| State::new(x + rng.random_range(-60.0..60.0), rng.random_range(-1.0..16.0), 20.0, 0.0);
    let ids: Vec<VehicleId> =
        (0..60).map(|i| scene.place(Vehicle::car(state(5.0 * f64::from(i)), Drive::Steady)).unwrap()).collect();
    for i in 0..1000 {
        let id = ids[(i * 7) % ids.len()];
        let x = scene.vehicle(id).unwrap().state.position.x;
        scene.set_state(id, state(x)).unwrap();
        let asked = ids[(i * 11) % ids.len()];
        assert_eq!(scene.surroundings(asked).unwrap(), searched(&scene, asked), "{i}");
    }
}

#[test]
fn whatever_was_done_to_a_scene_it_goes_on_as_one_that_was_built_so() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    for case in 0..60 {
        let mut scene = scene(3);
        let state = |rng: &mut ChaCha8Rng| {
            // Places on a coarse grid, so that some are the same.
            let x = f64::from(rng.random_range(0..60_i32)) * 5.0;
            State::new(x, rng.random_range(0.0..11.0), rng.random_range(0.0..35.0), 0.0)
        };
        let drive = |rng: &mut ChaCha8Rng| match rng.random_range(0..3) {
            0 => Drive::Steady,
            _ => Drive::Cruise { speed: 30.0, y: 1.875 + 3.75 * f64::from(rng.random_range(0..3_i32)) },
        };
        for _ in 0..80 {
            let ids: Vec<VehicleId> = scene.vehicles().map(|(id, _)| id).collect();
            let any = (!ids.is_empty()).then(|| ids[rng.random_range(0..ids.len().max(1))]);
            match (rng.random_range(0..7), any) {
                (0, Some(id)) => drop(scene.remove(id).unwrap()),
                (1, Some(id)) => scene.set_drive(id, drive(&mut rng)).unwrap(),
                (2, Some(id)) => scene.set_state(id, state(&mut rng)).unwrap(),
                (3, _) => drop(scene.step()),
                (4, _) => drop(scene.enter(Vehicle::car(state(&mut rng), drive(&mut rng))).unwrap()),
                _ => drop(scene.place(Vehicle::car(state(&mut rng), drive(&mut rng))).unwrap()),
            }
        }
        // Read from text, the order is made anew from where the vehicles are.
        let text = serde_json::to_string(&scene).unwrap();
        let mut fresh: Simulator<f64> = serde_json::from_str(&text).unwrap();
        for (id, _) in fresh.vehicles() {
            assert_eq!(scene.surroundings(id).unwrap(), fresh.surroundings(id).unwrap(), "case {case}, {id}");
            let gaps = [&scene, &fresh].map(|scene| scene.gap_ahead(id).unwrap().map(|gap| gap.to));
            assert_eq!(gaps[0], gaps[1], "case {case}, {id}");
            let [was, is] = [&scene, &fresh].map(|scene| scene.explain(id).unwrap());
            assert_eq!(was.pushed_by, is.pushed_by, "case {case}, {id}");
            // Text may lose the last bit of a number.
            assert!((was.total() - is.total()).norm() < 1e-9, "case {case}, {id}: {was:?}, {is:?}");
        }
        for _ in 0..20 {
            let [told, fresh_told] = [&mut scene, &mut fresh].map(|scene| scene.step().len());
            assert_eq!(told, fresh_told, "case {case}");
        }
    }
}
