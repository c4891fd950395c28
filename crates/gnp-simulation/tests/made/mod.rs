//! Recordings made by known drivers.
#![allow(clippy::unwrap_used)] // only tests call these
use gnp_data::{LaneMarking, NeighbourSource, Recording, Road, Rows, VehicleBody};
use gnp_force::{
    Drive, Driver, Headways, Idm, Inflow, Line, MarkingKind, Side, Simulator, SimulatorParams, State, Vehicle,
};
use gnp_simulation::Recorder;
use std::collections::BTreeMap;

/// Lane lines of three lanes.
const LINES: [f64; 4] = [0.0, 3.75, 7.5, 11.25];

/// The driver of a vehicle by its number in the recording.
pub(crate) fn driver(vehicle: u32) -> Driver<f64> {
    let spread = f64::from(vehicle * 7 % 5) / 4.0;
    Driver {
        desired_speed: 17.0 + 11.0 * spread,
        time_gap: 1.8 - 0.8 * spread,
        standstill_gap: 2.0,
        acceleration: 0.8 + spread,
        braking: 2.0,
    }
}

/// 60 s of three lanes over 700 m, at 10 Hz, with everybody who drove.
pub(crate) fn recording() -> (Recording, BTreeMap<u32, Driver<f64>>) {
    let line = |y: &f64| Line { kind: MarkingKind::LaneDivider, y: *y, road: Side::Left, k: 0.0 };
    let road = gnp_force::Road::new(LINES.iter().map(line).collect()).unwrap().ending_at(700.0).unwrap();
    let mut scene = Simulator::new(SimulatorParams::motorway(0.1), road).unwrap();
    let mut inflows = [3, 4, 5].map(|seed| Inflow::new(1500.0, Headways::Random, seed).unwrap());
    let mut recorder = Recorder::new(scene.road(), "made", "idm", 10.0);
    let mut drivers = BTreeMap::new();
    let mut number = 1;
    for frame in 0..1000 {
        for (lane, inflow) in inflows.iter_mut().enumerate() {
            let driver = driver(number);
            let y = LINES[lane] + 1.875;
            let make = |_| {
                let drive = Drive::Cruise { speed: driver.desired_speed, y };
                Vehicle { rule: Idm::of(&driver).into(), ..Vehicle::car(State::new(5.0, y, 18.0, 0.0), drive) }
            };
            if let Some(id) = scene.admit(inflow, make).unwrap() {
                number = id.0 as u32 + 2;
                drivers.insert(id.0 as u32 + 1, driver);
            }
        }
        scene.step();
        if frame >= 400 {
            recorder.take(&scene).unwrap();
        }
    }
    (recorder.finish().unwrap(), drivers)
}

/// The same recording with other positions.
pub(crate) fn changed(recording: &Recording, mut x: impl FnMut(u32, u32, f32) -> f32) -> Recording {
    let columns = recording.columns();
    let mut rows = Rows::new(vec![], vec![], vec![], columns.y.clone());
    let mut bodies = vec![];
    for track in recording.tracks() {
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            rows.vehicle.push(track.vehicle);
            rows.frame.push(frame);
            rows.x.push(x(track.vehicle, frame, columns.x[row]));
            bodies.push(VehicleBody { class: track.class, length: track.length, width: track.width, road: 0 });
        }
    }
    rows.lane = columns.lane.clone();
    rows.velocity = Some([columns.vx.clone(), columns.vy.clone()]);
    rows.neighbours = NeighbourSource::Lanes(|lane| lane);
    let lines = LINES.map(|y| LaneMarking::new(y as f32, false)).to_vec();
    let road = Road { driving_direction: 2, lines, fitted: false, axis: None };
    Recording::from_rows(recording.meta().clone(), vec![road], rows, |row| bodies[row]).unwrap().0
}
