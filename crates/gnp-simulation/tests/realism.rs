//! Driving on from recordings, and how real that is: on traffic whose drivers are known.
#![allow(clippy::unwrap_used)] // also outside the test functions
mod made;

use gnp_data::{Forecast, Mode, Observation, PredictError, Predictor, WindowShape};
use gnp_force::{Driver, Mobil};
use gnp_simulation::{
    SimulationError,
    realism::{Feature, RealismSettings, Row, Table, compare},
    replay::{
        ClosedLoop, ConstantVelocity, DrivenBy, Drivers, Imported, Learned, Replay, ReplaySettings, RuleDrivers, Trace,
        export_sumo, import_sumo,
    },
};
use std::collections::BTreeMap;

const SETTINGS: ReplaySettings = ReplaySettings { past_s: 3.0, duration_s: 20.0, every_s: 20.0 };

fn idm() -> RuleDrivers {
    RuleDrivers::new("idm", Drivers::Same(Driver::motorway().into()))
}

fn own(drivers: &BTreeMap<u32, Driver<f64>>) -> RuleDrivers {
    let drivers = drivers.iter().map(|(vehicle, driver)| (*vehicle, DrivenBy::from(*driver))).collect();
    RuleDrivers::new("own", Drivers::Own(drivers, Driver::motorway().into()))
}

fn scores(systems: &[&dyn ClosedLoop], replays: &[Replay]) -> (Table, Vec<Row>) {
    let table = compare(replays, systems, &RealismSettings { roll_outs: 4, horizons_s: vec![5.0, 15.0] }).unwrap();
    let rows = table.rows.clone();
    (table, rows)
}

#[test]
fn the_drivers_who_made_a_recording_drive_it_again() {
    let (recording, drivers) = made::recording();
    let replays = Replay::all(&recording, &SETTINGS).unwrap();
    assert!(replays.len() >= 2);
    let (own, idm) = (own(&drivers), idm());
    let (table, rows) = scores(&[&own, &idm, &ConstantVelocity], &replays);
    let [happened, own, idm, constant] = &rows[..] else { panic!("{} rows", rows.len()) };
    assert!(happened.horizons.iter().all(|it| it.ade.mean == 0.0) && happened.vehicles > 40);
    // Those behind somebody who has left follow one who keeps his speed; nothing else is different.
    assert!(own.horizons[0].ade.mean < 0.1 && own.horizons[1].ade.mean < 1.0, "{:?}", own.horizons);
    assert!(idm.horizons[1].ade.mean > 5.0 * own.horizons[1].ade.mean, "{:?}", idm.horizons);
    let realism = |row: &Row| row.realism.unwrap().mean;
    assert!(realism(happened) >= realism(own) && realism(own) > 0.95 * realism(happened), "{}", table.markdown());
    assert!(realism(idm) < 0.9 * realism(own) && realism(constant) < 0.9 * realism(own), "{}", table.markdown());
    assert!(own.speed_distance.unwrap() < 0.2 * idm.speed_distance.unwrap());
    assert_eq!((happened.speed_distance, happened.gap_distance), (Some(0.0), Some(0.0)));
    assert_eq!((own.contacts_per_vehicle_h, own.lane_changes_per_vehicle_km), (Some(0.0), Some(0.0)));
    assert!(own.uses_future && !idm.uses_future && own.simulated);
    let text = table.markdown();
    assert!(text.contains("*simulated*") && text.contains("| own \\* |") && text.contains("| idm |"));
    let csv = table.csv();
    let columns = |line: &str| line.split(',').count();
    assert!(csv.lines().all(|line| columns(line) == columns(csv.lines().next().unwrap())), "{csv}");
}

#[test]
fn no_row_after_the_start_reaches_a_system() {
    let (recording, _) = made::recording();
    let start = recording.tracks().iter().map(|track| track.first_frame).min().unwrap() + 100;
    let replay = Replay::of(&recording, 0, start, &SETTINGS).unwrap();
    let scored: Vec<u32> =
        replay.scene().actors.iter().filter(|actor| actor.is_scored()).map(|actor| actor.vehicle).collect();
    assert!(scored.len() > 10);
    let other = made::changed(&recording, |vehicle, frame, x| {
        // Where the section ends stays as it is.
        if frame > start && scored.contains(&vehicle) && x < 690.0 { x * 0.5 + 100.0 } else { x }
    });
    let scrambled = Replay::of(&other, 0, start, &SETTINGS).unwrap();
    assert!(replay.truth() != scrambled.truth());
    assert!(replay.scene() == scrambled.scene());
    let mobil = idm().changing_lanes(Mobil::standard());
    assert!(mobil.drive(replay.scene(), 1).unwrap() == mobil.drive(scrambled.scene(), 1).unwrap());
    // The boundary does move as recorded.
    let heads: Vec<u32> =
        replay.scene().actors.iter().filter(|actor| !actor.is_driven()).map(|actor| actor.vehicle).collect();
    assert_eq!(heads.len(), 3, "one a lane");
    let other = made::changed(
        &recording,
        |vehicle, frame, x| {
            if frame > start && heads.contains(&vehicle) { x - 1.0 } else { x }
        },
    );
    assert!(replay.scene() != Replay::of(&other, 0, start, &SETTINGS).unwrap().scene());
}

#[test]
fn contacts_are_counted_and_lane_changes_too() {
    let (recording, _) = made::recording();
    let replays = Replay::all(&recording, &SETTINGS).unwrap();
    // A driver who wishes to be fast and changes lanes for nothing.
    let eager = Mobil { threshold: 0.0, politeness: 0.0, ..Mobil::standard() };
    let (_, rows) = scores(&[&ConstantVelocity, &idm().changing_lanes(eager)], &replays);
    assert_eq!(rows[0].contacts_per_vehicle_h, Some(0.0));
    assert!(rows[1].contacts_per_vehicle_h.unwrap() > 10.0, "those who never brake run into others: {:?}", rows[1]);
    assert!(rows[1].features[&Feature::Contact] < 0.7 && rows[0].features[&Feature::Contact] > 0.99);
    assert!(rows[2].lane_changes_per_vehicle_km.unwrap() > 0.1 && rows[1].lane_changes_per_vehicle_km == Some(0.0));
    assert!(rows[2].features[&Feature::LaneChange] < rows[1].features[&Feature::LaneChange]);
}

#[test]
fn fitted_drivers_are_those_of_others() {
    let (recording, drivers) = made::recording();
    let replay = Replay::all(&recording, &SETTINGS).unwrap().remove(0);
    let fitted: Vec<(u32, DrivenBy)> = drivers.iter().map(|(id, driver)| (*id, (*driver).into())).collect();
    let drawn = RuleDrivers::new("drawn", Drivers::Drawn(fitted.clone()));
    assert!(drawn.drive(replay.scene(), 1).unwrap() != drawn.drive(replay.scene(), 2).unwrap());
    assert!(drawn.drive(replay.scene(), 1).unwrap() == drawn.drive(replay.scene(), 1).unwrap());
    // Drivers who explain the observed seconds of a vehicle drive it better than any.
    let matched = RuleDrivers::new("matched", Drivers::Matched(fitted.clone()));
    let (_, rows) = scores(&[&drawn, &matched], &Replay::all(&recording, &SETTINGS).unwrap());
    let ade = |row: &Row| row.horizons[0].ade.mean;
    assert!(ade(&rows[2]) < 0.5 * ade(&rows[1]), "{} and {}", ade(&rows[2]), ade(&rows[1]));
    let there: Vec<u32> = replay.scene().actors.iter().map(|actor| actor.vehicle).collect();
    let themselves = fitted.into_iter().filter(|(vehicle, _)| there.contains(vehicle)).collect();
    let none = RuleDrivers::new("drawn", Drivers::Drawn(themselves)).drive(replay.scene(), 1);
    assert!(matches!(none, Err(SimulationError::NoDrivers { .. })), "{none:?}");
    let median = RuleDrivers::new("median", Drivers::Median(Vec::new())).drive(replay.scene(), 1);
    assert!(matches!(median, Err(SimulationError::NoDrivers { .. })), "{median:?}");
}

/// Two paths: at the present speed, and at 80 % of it.
struct TwoSpeeds;

impl Predictor for TwoSpeeds {
    fn name(&self) -> &'static str {
        "two speeds"
    }

    fn predict(&self, observations: &[Observation<'_>], _: usize) -> Result<Vec<Forecast>, PredictError> {
        let forecast = |observation: &Observation<'_>| {
            let shape = observation.shape();
            let speed = observation.target(shape.t_obs - 1).vx;
            let mode = |factor: f32, probability| {
                let path = (1..=shape.t_pred).map(|step| [factor * speed * step as f32 / shape.rate_hz as f32, 0.0]);
                Mode { probability, path: path.collect(), explanation: None }
            };
            Forecast { modes: vec![mode(1.0, 0.6), mode(0.8, 0.4)] }
        };
        Ok(observations.iter().map(forecast).collect())
    }
}

#[test]
fn a_predictor_drives_along_its_paths() {
    let (recording, _) = made::recording();
    let replay = Replay::all(&recording, &SETTINGS).unwrap().remove(0);
    let scene = replay.scene();
    let shape = WindowShape::new(6, 10, 5, 2.0).unwrap();
    let until = DrivenBy::from(Driver::motorway());
    let first = Learned::new("first", &TwoSpeeds, shape, false, until).drive(scene, 0).unwrap();
    let constant = ConstantVelocity.drive(scene, 0).unwrap();
    let mut compared = 0;
    for (index, actor) in scene.actors.iter().enumerate() {
        // Long enough in the recording to be predicted from the start.
        if actor.is_scored() && actor.past.len() > 25 {
            let apart = |trace: &Trace| trace.paths[index].at(60).map(|state| state.position.x);
            let (a, b) = (apart(&first).unwrap(), apart(&constant).unwrap());
            assert!((a - b).abs() < 0.05, "{a} and {b}");
            compared += 1;
        }
    }
    assert!(compared > 10);
    let drawing = Learned::new("drawn", &TwoSpeeds, shape, true, until);
    let courses = [0, 0, 1].map(|seed| drawing.drive(scene, seed).unwrap());
    assert!(courses[0] == courses[1] && courses[0] != courses[2]);
    assert!(courses[0].stood_in > 0, "those who come later have no past at first");
    // A draw is kept for 5 s: within the first second nobody changes his mind, and the slow ones are 0.4 of all.
    let slow = scene.actors.iter().enumerate().filter(|(_, actor)| actor.is_scored() && actor.past.len() > 25);
    let shares: Vec<f64> = slow
        .map(|(index, actor)| {
            let path = &courses[0].paths[index];
            (path.at(5).unwrap().position.x - actor.start.position.x) / (0.5 * actor.start.velocity.x)
        })
        .collect();
    let few = shares.iter().filter(|share| **share < 0.9).count() as f64 / shares.len() as f64;
    assert!((0.15..0.65).contains(&few), "{few} of {}", shares.len());
}

#[test]
fn courses_of_sumo_come_back_as_they_were() {
    let (recording, drivers) = made::recording();
    let replay = Replay::all(&recording, &SETTINGS).unwrap().remove(0);
    let scene = replay.scene();
    let file = export_sumo(scene, Some(&own(&drivers)), &[1, 2], 36.0).unwrap();
    let driven = scene.actors.iter().filter(|actor| actor.is_driven()).count();
    assert_eq!(file["vehicles"].as_array().unwrap().len(), driven);
    assert_eq!(file["replayed"].as_array().unwrap().len(), scene.actors.len() - driven);
    let first = &file["vehicles"][0];
    let actor = &scene.actors[first["id"].as_u64().unwrap() as usize];
    let driver = made::driver(actor.vehicle);
    assert_eq!(
        (first["desired_speed"].as_f64(), first["idm"]["tau"].as_f64()),
        (Some(driver.desired_speed), Some(driver.time_gap))
    );
    let plain = export_sumo(scene, None, &[1], 36.0).unwrap();
    assert!(plain["vehicles"][0]["idm"].is_null() && plain["vehicles"][0]["desired_speed"].is_null());

    let course = idm().drive(scene, 0).unwrap();
    let mut csv = String::from("seed,step,id,x,y,speed,lane,driven\n");
    for step in 0..=scene.frames {
        for (index, path) in course.paths.iter().enumerate() {
            if let Some(state) = path.at(step).filter(|state| state.position.x <= scene.section[1]) {
                let (x, y) = (state.position.x, state.position.y);
                csv.push_str(&format!("1,{step},{index},{x},{y},{},0,1\n", state.velocity.x));
            }
        }
    }
    let courses = import_sumo(scene, &csv).unwrap();
    let back = BTreeMap::from([(scene.name.clone(), courses)]);
    let sumo = Imported { name: "sumo".to_owned(), uses_future: false, courses: back };
    let (_, rows) = scores(&[&idm(), &sumo], std::slice::from_ref(&replay));
    let (idm, sumo) = (&rows[1], &rows[2]);
    assert_eq!((&idm.features, idm.gap_distance), (&sumo.features, sumo.gap_distance));
    assert!((idm.horizons[1].ade.mean - sumo.horizons[1].ade.mean).abs() < 0.05);
    assert_eq!(idm.late_and_never, sumo.late_and_never);

    for (broken, line) in [("seed,step,id,x,y\n", 1), ("seed,step,id,x,y,speed\n1,0,0,1,2,z\n", 2)] {
        let error = import_sumo(scene, broken).unwrap_err();
        assert!(matches!(error, SimulationError::Positions { line: at, .. } if at == line), "{error}");
    }
    let gap = "seed,step,id,x,y,speed\n1,0,0,1,2,3\n1,2,0,1,2,3\n";
    assert!(import_sumo(scene, gap).unwrap_err().to_string().contains("missing"));
    assert!(sumo_of_nothing(scene).is_err());
}

fn sumo_of_nothing(scene: &gnp_simulation::replay::Scene) -> Result<Trace, SimulationError> {
    Imported::default().drive(scene, 0)
}

#[test]
fn recordings_that_cannot_be_driven_on_from_are_refused() {
    let (recording, _) = made::recording();
    let of = |road, start| Replay::of(&recording, road, start, &SETTINGS).map(|_| ());
    assert!(matches!(of(1, 100), Err(SimulationError::Replay { .. })));
    assert!(matches!(of(0, 1_000_000), Err(SimulationError::NobodyToDrive { .. })));
}
