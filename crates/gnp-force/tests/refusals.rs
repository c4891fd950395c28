//! Numbers that the physics does not allow are refused, with the name of the field.
use gnp_force::{
    CruiseParams, Drive, Extent, Repulsion, Road, Simulator, SimulatorParams, State, Vehicle, nalgebra::Point2,
};

#[test]
fn what_the_physics_does_not_allow_is_refused_by_name() {
    let road = || Road::motorway(2, 3.75).unwrap();
    let good = SimulatorParams::motorway(0.04);
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
    let car = Vehicle::car(State::new(0.0, 1.9, 30.0, 0.0), Drive::Cruise { speed: 30.0, y: 1.9 });
    for (vehicle, key) in [
        (Vehicle { tau: 0.01, ..car }, "vehicle.tau"),
        (Vehicle { state: State::new(f64::NAN, 0.0, 0.0, 0.0), ..car }, "vehicle.state"),
        (Vehicle { extent: Extent { length: -1.0, width: 2.0 }, ..car }, "vehicle.extent.length"),
        (Vehicle { drive: Drive::Cruise { speed: 100.0, y: 1.9 }, ..car }, "drive.speed"),
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
