//! Numbers that the physics does not allow are refused, with the name of the field.
use gnp_force::{
    AfterGoal, Drive, Extent, Limits, Noise, Published, Road, Rule, Simulator, SimulatorParams, State, Steering,
    Vehicle, na::Point2,
};

#[test]
fn what_the_physics_does_not_allow_is_refused_by_name() {
    let road = || Road::motorway(2, 3.75).unwrap();
    let good = SimulatorParams::motorway(0.04);
    for (params, key) in [
        (SimulatorParams { dt: 0.0, ..good }, "dt"),
        (SimulatorParams { dt: f64::NAN, ..good }, "dt"),
        (SimulatorParams { decision_interval: 0.01, ..good }, "decision_interval"),
        (SimulatorParams { max_speed: f64::INFINITY, ..good }, "max_speed"),
        (SimulatorParams { steering: Steering { preview: 0.0, ..good.steering }, ..good }, "steering.preview"),
    ] {
        let error = Simulator::new(params, road()).unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    let mut scene = Simulator::new(good, road()).unwrap();
    let car = Vehicle::car(State::new(0.0, 1.9, 30.0, 0.0), Drive::Cruise { speed: 30.0, y: 1.9 });
    let goal = |due| Drive::Goal { goal: Point2::origin(), due, then: AfterGoal::Leave };
    for (vehicle, key) in [
        (Vehicle { rule: Rule::Published(Published { k: 1.0, r_col: 0.0 }), ..car.clone() }, "published.r_col"),
        (Vehicle { limits: Limits { braking: -1.0, ..car.limits }, ..car.clone() }, "limits.braking"),
        (Vehicle { noise: Some(Noise { sigma: 0.1, correlation: 0.0 }), ..car.clone() }, "noise.correlation"),
        (Vehicle { tau: 0.01, ..car.clone() }, "vehicle.tau"),
        (Vehicle { state: State::new(f64::NAN, 0.0, 0.0, 0.0), ..car.clone() }, "vehicle.state"),
        (Vehicle { extent: Extent { length: -1.0, width: 2.0 }, ..car.clone() }, "vehicle.extent.length"),
        (Vehicle { drive: Drive::Cruise { speed: 100.0, y: 1.9 }, ..car.clone() }, "drive.speed"),
        (Vehicle { drive: goal(0.0), ..car.clone() }, "drive.due"),
    ] {
        let error = scene.add(vehicle).unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{key}` is ")), "{error}");
    }
    assert_eq!(scene.vehicles().len(), 0, "nothing refused was kept");
    let id = scene.add(car.clone()).unwrap();
    assert_eq!(scene.remove(id).unwrap(), car);
    assert!(scene.remove(id).unwrap_err().to_string().contains("no vehicle 0"));
    assert!(scene.set_state(id, car.state).is_err() && scene.explain(id).is_err() && scene.surroundings(id).is_err());
    assert!(Road::motorway(0, 3.75).is_err() && Road::motorway(2, f64::NAN).is_err());
}
