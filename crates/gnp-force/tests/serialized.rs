//! What the `serde` feature writes it reads again, and nothing it does not know.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
use gnp_force::{
    AfterGoal, Drive, Driver, Forces, Idm, Mobil, MotorwayRule, Newell, Noise, Profile, Road, Rule, Simulator,
    SimulatorParams, State, Vehicle, na::Point2,
};

#[test]
fn parameters_roads_and_vehicles_survive_json() {
    let params = SimulatorParams::motorway(0.04);
    let text = serde_json::to_string(&params).unwrap();
    assert_eq!(serde_json::from_str::<SimulatorParams<f64>>(&text).unwrap(), params);

    let road = Road::motorway(3, 3.75).unwrap();
    let text = serde_json::to_string(&road).unwrap();
    assert_eq!(serde_json::from_str::<Road<f64>>(&text).unwrap(), road);

    let vehicle = Vehicle::truck(State::new(1.0, 2.0, 3.0, 4.0), Drive::Cruise { speed: 23.0, y: 1.875 });
    let text = serde_json::to_string(&vehicle).unwrap();
    assert_eq!(serde_json::from_str::<Vehicle<f64>>(&text).unwrap(), vehicle);
}

#[test]
fn unknown_keys_and_impossible_roads_are_refused() {
    let text = serde_json::to_string(&SimulatorParams::motorway(0.04)).unwrap();
    let more = text.replacen('{', "{\"speed_limit\": 30, ", 1);
    let error = serde_json::from_str::<SimulatorParams<f64>>(&more).unwrap_err().to_string();
    assert!(error.contains("speed_limit"), "{error}");

    let road = serde_json::to_string(&Road::motorway(1, 3.75).unwrap()).unwrap();
    let twice = road.replacen("\"y\":3.75", "\"y\":0.0", 1);
    let error = serde_json::from_str::<Road<f64>>(&twice).unwrap_err().to_string();
    assert!(error.contains("different for every line"), "{error}");
}

#[test]
fn numbers_that_the_physics_does_not_allow_are_not_read() {
    let text = serde_json::to_string(&SimulatorParams::motorway(0.04)).unwrap();
    let backwards = text.replacen("0.04", "-1.0", 1);
    let error = serde_json::from_str::<SimulatorParams<f64>>(&backwards).unwrap_err().to_string();
    assert!(error.contains("`dt` is -1"), "{error}");

    let scene = busy_scene();
    let text = serde_json::to_string(&scene).unwrap();
    for (from, to, key) in [
        ("\"dt\":0.04", "\"dt\":-1.0", "dt"),
        ("\"tau\":1.0", "\"tau\":0.0", "vehicle.tau"),
        ("\"ids\":[0,", "\"ids\":[9,", "ids"),
        ("\"steps\":", "\"stops\":", "stops"),
    ] {
        let wrong = text.replacen(from, to, 1);
        assert_ne!(wrong, text, "{from} is in the text");
        let error = serde_json::from_str::<Simulator<f64>>(&wrong).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

/// Vehicles of every kind of drive and rule, after some steps.
fn busy_scene() -> Simulator<f64> {
    let road = Road::motorway(2, 3.75).unwrap().closing(1, 900.0, 950.0).unwrap();
    let mut scene = Simulator::new(SimulatorParams { seed: 3, ..SimulatorParams::motorway(0.04) }, road).unwrap();
    let profile = Profile::speeds(&[(1.0, 25.0), (4.0, 10.0)]).unwrap();
    let drives = [
        Drive::Cruise { speed: 30.0, y: 1.875 },
        Drive::Goal { goal: Point2::new(400.0, 1.875), due: 9.0, then: AfterGoal::Cruise },
        Drive::Accelerate(-2.0),
        Drive::Follow(profile.into()),
        Drive::Steady,
    ];
    let idm = Idm::of(&Driver::motorway());
    let rules = [Rule::Motorway(MotorwayRule::standard()), idm.into(), Newell::standard().into()];
    for (i, drive) in drives.iter().cycle().take(15).enumerate() {
        let (lane, x) = (i % 2, 40.0 * i as f64);
        let state = State::new(x, 1.875 + 3.75 * lane as f64, 25.0, 0.0);
        let vehicle = Vehicle::car(state, drive.clone()).with_rule(rules[i % 3]);
        let (noise, lane_change) = (Some(Noise { sigma: 0.2, correlation: 3.0 }), Some(Mobil::standard()));
        scene.add(Vehicle { noise, lane_change, ..vehicle }).unwrap();
    }
    for _ in 0..100 {
        scene.step();
    }
    scene
}

#[test]
fn a_simulator_that_was_written_goes_on_where_it_stood() {
    let mut scene = busy_scene();
    let text = serde_json::to_string(&scene).unwrap();
    let mut read: Simulator<f64> = serde_json::from_str(&text).unwrap();
    for _ in 0..300 {
        assert_eq!(scene.step(), read.step());
    }
    assert_eq!(scene.vehicles().collect::<Vec<_>>(), read.vehicles().collect::<Vec<_>>());
    assert_eq!(serde_json::to_string(&scene).unwrap(), serde_json::to_string(&read).unwrap());
}

#[test]
fn types_go_between_threads() {
    fn both<T: Send + Sync>() {}
    both::<gnp_force::Simulator<f64>>();
    both::<Forces<f32>>();
    both::<gnp_force::ForceError>();
}
