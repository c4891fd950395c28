//! What the `serde` feature writes it reads again, and nothing it does not know.
use gnp_force::{Drive, Forces, Line, Road, SimulatorParams, State, Vehicle};

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

    let mut lines: Vec<Line<f64>> = Road::motorway(1, 3.75).unwrap().into();
    lines[1].y = lines[0].y;
    let text = serde_json::to_string(&lines).unwrap();
    let error = serde_json::from_str::<Road<f64>>(&text).unwrap_err().to_string();
    assert!(error.contains("different for every line"), "{error}");
}

#[test]
fn types_go_between_threads() {
    fn both<T: Send + Sync>() {}
    both::<gnp_force::Simulator<f64>>();
    both::<Forces<f32>>();
    both::<gnp_force::ForceError>();
}
