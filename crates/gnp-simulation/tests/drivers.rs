//! Drivers are found again in recordings of simulated traffic, and what is no recording of followers is refused.

#![allow(clippy::unwrap_used)] // also outside the test functions

use gnp_data::{Recording, Slot, VehicleClass};
use gnp_force::{Drive, Driver, Idm, Mobil, Noise, Profile, Road, Rule, Simulator, SimulatorParams, State, Vehicle};
use gnp_simulation::{
    Recorder,
    drivers::{DriverDistribution, DriverError, FitConfig, fit_drivers, fit_lane_changes},
};

/// Steps between two frames, and steps a second.
const EVERY: usize = 2;
const RATE: usize = 20;

fn scene(lanes: usize) -> Simulator<f64> {
    let params = SimulatorParams::motorway(1. / RATE as f64);
    Simulator::new(params, Road::motorway(lanes, 3.75).unwrap()).unwrap()
}

/// Drives on for some seconds and records 10 frames of each.
fn recorded(mut scene: Simulator<f64>, seconds: usize) -> Recording {
    let mut recorder = Recorder::new(scene.road(), "made", "made", (RATE / EVERY) as f64);
    for _ in 0..seconds * RATE / EVERY {
        recorder.take(&scene).unwrap();
        for _ in 0..EVERY {
            scene.step();
        }
    }
    recorder.finish().unwrap()
}

/// Twelve drivers, no two alike.
fn drivers() -> Vec<Driver<f64>> {
    let vary = |i: usize, by: usize| ((i * by) % 12) as f64 / 11. * 2. - 1.;
    let driver = |i: usize| Driver {
        desired_speed: 32. * (0.1 * vary(i, 5)).exp(),
        time_gap: 1.2 * (0.35 * vary(i, 7)).exp(),
        standstill_gap: 2.5 * (0.25 * vary(i, 11)).exp(),
        acceleration: 1.2 * (0.35 * vary(i, 1)).exp(),
        braking: 1.8 * (0.3 * vary(i, 13)).exp(),
    };
    (0..12).map(driver).collect()
}

fn following(driver: &Driver<f64>, state: State<f64>) -> Vehicle<f64> {
    let y = state.position.y;
    Vehicle {
        rule: Rule::Idm(Idm::of(driver)),
        ..Vehicle::car(state, Drive::Cruise { speed: driver.desired_speed, y })
    }
}

/// Each driver behind a leader of his own, who stops, crawls and draws away.
fn pairs(noise: Option<Noise<f64>>, seconds: usize) -> Recording {
    let of = drivers();
    let mut scene = scene(of.len());
    for (lane, driver) in of.iter().enumerate() {
        let y = scene.road().lane_centre(lane).unwrap();
        let part =
            [(0., 20.), (8., 24.), (14., 9.), (20., 9.), (26., 0.), (32., 0.), (46., 22.), (54., 14.), (75., 40.)];
        let knots: Vec<_> = (0..seconds.div_ceil(90))
            .flat_map(|lap| part.map(|(time, speed)| (time + 90. * lap as f64, speed)))
            .collect();
        let lead = Drive::Follow(Profile::speeds(&knots).unwrap().into());
        scene.add(Vehicle::car(State::new(40., y, 20., 0.), lead)).unwrap();
        scene.add(Vehicle { noise, ..following(driver, State::new(0., y, 20., 0.)) }).unwrap();
    }
    recorded(scene, seconds)
}

#[test]
fn drivers_are_found_again() {
    let recording = pairs(None, 90);
    let traffic = fit_drivers(&[recording], &FitConfig::default()).unwrap();
    let truth = drivers();
    assert_eq!(traffic.drivers().len(), truth.len());
    assert_eq!(traffic.left_out().without_leader, truth.len(), "the leaders");
    for ((key, found), truth) in traffic.drivers().iter().zip(&truth) {
        let found_of = found.driver;
        for (name, found, truth, tolerance) in [
            ("desired speed", found_of.desired_speed, truth.desired_speed, 0.03),
            ("time gap", found_of.time_gap, truth.time_gap, 0.05),
            ("standstill gap", found_of.standstill_gap, truth.standstill_gap, 0.1),
            ("acceleration", found_of.acceleration, truth.acceleration, 0.1),
            ("braking", found_of.braking, truth.braking, 0.15),
        ] {
            assert!((found / truth).ln().abs() < tolerance, "{key:?}: {name} {found}, was {truth}");
        }
        assert!(found.error_m < 0.3 && found.seconds > 89., "{found:?}");
    }
    let errors = traffic.errors();
    assert!(10. * errors.own_m < errors.typical_m.min(errors.standard_m), "{errors:?}");
    // Nobody is unsteady.
    assert!(traffic.noise().unwrap().sigma < 0.05, "{:?}", traffic.noise());
}

#[test]
fn unsteadiness_is_found_again() {
    let noise = Noise { sigma: 0.3, correlation: 2. };
    let traffic = fit_drivers(&[pairs(Some(noise), 180)], &FitConfig::default()).unwrap();
    let found = traffic.noise().unwrap();
    assert!((found.sigma / noise.sigma).ln().abs() < 0.2, "{found:?}");
    assert!((found.correlation / noise.correlation).ln().abs() < 0.4, "{found:?}");
}

/// Three lanes of drivers who change them.
fn changing(mobil: Mobil<f64>) -> Recording {
    let (of, mut scene) = (drivers(), scene(3));
    for i in 0..120 {
        let (lane, place) = (i % 3, i / 3);
        let y = scene.road().lane_centre(lane).unwrap();
        let driver = Driver { desired_speed: 20. + 14. * ((i * 37) % 120) as f64 / 119., ..of[(i * 5) % 12] };
        let state = State::new(55. * place as f64 + 15. * lane as f64, y, 22., 0.);
        let noise = Some(Noise { sigma: 0.2, correlation: 3. });
        scene.add(Vehicle { lane_change: Some(mobil), noise, ..following(&driver, state) }).unwrap();
    }
    recorded(scene, 120)
}

#[test]
fn the_threshold_of_lane_changes_is_found_again() {
    let mut thresholds = Vec::new();
    for threshold in [0.15, 0.6] {
        let mobil = Mobil { threshold, keep_right: 0.1, ..Mobil::standard() };
        let recordings = [changing(mobil)];
        let traffic = fit_drivers(&recordings, &FitConfig::default()).unwrap();
        let fit = fit_lane_changes(&recordings, &traffic).unwrap();
        let likelihood = fit.likelihood.unwrap();
        assert!(likelihood.changes >= 20 && likelihood.gain > 0.5 * likelihood.changes as f64, "{fit:?}");
        assert!(likelihood.wishes <= likelihood.changes && 2 * likelihood.wishes >= likelihood.changes, "{fit:?}");
        assert!((fit.mobil.threshold - threshold).abs() < 0.2, "{threshold}: {fit:?}");
        assert!((fit.mobil.keep_right - 0.1).abs() < 0.2, "{threshold}: {fit:?}");
        thresholds.push(fit.mobil.threshold);
    }
    assert!(thresholds[1] > thresholds[0] + 0.2, "{thresholds:?}");
}

#[test]
fn simulated_drivers_change_lanes_as_often_as_recorded() {
    let mobil = Mobil { threshold: 0.3, keep_right: 0., ..Mobil::standard() };
    let drivers = DriverDistribution::fit("made", &[changing(mobil)], &FitConfig::default()).unwrap();
    let fit = drivers.lane_changes();
    let (recorded, simulated) = (fit.per_vehicle_km(), fit.simulated_per_vehicle_km.unwrap());
    assert!(recorded > 0.1 && (simulated / recorded).ln().abs() < 0.25, "{recorded}, {simulated}: {fit:?}");
}

#[test]
fn few_changes_leave_the_standard_rule() {
    let recordings = [pairs(None, 20)];
    let traffic = fit_drivers(&recordings, &FitConfig::default()).unwrap();
    let fit = fit_lane_changes(&recordings, &traffic).unwrap();
    assert_eq!((fit.mobil, fit.likelihood, fit.to_left + fit.to_right), (Mobil::standard(), None, 0));
    // Twelve pairs side by side: nobody has room.
    assert!(fit.vehicle_km > 1. && fit.situations == 0, "{fit:?}");
}

#[test]
fn who_follows_nobody_is_not_fitted() {
    let alone = |seconds| {
        let mut scene = scene(1);
        scene.add(following(&Driver::motorway(), State::new(0., 1.875, 20., 0.))).unwrap();
        recorded(scene, seconds)
    };
    let config = FitConfig::default();
    for recordings in [vec![alone(20)], vec![one_frame()], vec![]] {
        let vehicles = recordings.iter().map(|recording: &Recording| recording.tracks().len()).sum::<usize>();
        let error = fit_drivers(&recordings, &config).unwrap_err();
        assert!(matches!(error, DriverError::NoFollowers { vehicles: n, .. } if n == vehicles), "{error}");
    }
    for least_s in [0., -1., f64::NAN] {
        let error = fit_drivers(&[alone(1)], &FitConfig { least_s, ..config }).unwrap_err();
        assert!(matches!(error, DriverError::Value { what: "least_s", .. }), "{error}");
    }
    // Behind somebody, but for 4 s only.
    let error = fit_drivers(&[pairs(None, 4)], &config).unwrap_err();
    assert!(matches!(error, DriverError::NoFollowers { vehicles: 24, .. }), "{error}");
}

fn one_frame() -> Recording {
    let mut scene = scene(1);
    for x in [0., 30.] {
        scene.add(following(&Driver::motorway(), State::new(x, 1.875, 20., 0.))).unwrap();
    }
    let mut recorder = Recorder::new(scene.road(), "made", "made", 10.);
    recorder.take(&scene).unwrap();
    recorder.finish().unwrap()
}

#[test]
fn vehicles_shared_by_recordings_are_fitted_once() {
    let recordings = [pairs(None, 15), pairs(None, 25)];
    let shared = FitConfig { shared_vehicles: true, ..FitConfig::default() };
    let traffic = fit_drivers(&recordings, &shared).unwrap();
    assert!(traffic.drivers().iter().all(|(key, it)| key.recording == 1 && it.seconds > 24.));
    assert_eq!((traffic.drivers().len(), traffic.left_out().repeated), (12, 24));
    assert_eq!(fit_drivers(&recordings, &FitConfig::default()).unwrap().drivers().len(), 24);
}

#[test]
fn who_drives_freely_tells_the_desired_speed() {
    let mut scene = scene(1);
    for (place, speed) in [(0., 31.), (1500., 27.)] {
        let driver = Driver { desired_speed: speed, ..Driver::motorway() };
        scene.add(following(&driver, State::new(place, 1.875, speed, 0.))).unwrap();
    }
    let recording = recorded(scene, 20);
    assert!(recording.neighbour(0, Slot::Preceding).is_some());
    let traffic = fit_drivers(&[recording], &FitConfig::default()).unwrap();
    let [behind, ahead] = *traffic.free() else { panic!("{:?}", traffic.free()) };
    assert!((behind.speed - 31.).abs() < 0.3 && (ahead.speed - 27.).abs() < 0.3, "{behind:?} {ahead:?}");
    assert_eq!([behind.class, ahead.class], [VehicleClass::Car; 2]);
}

#[test]
fn distributions_are_drawn_from_and_written() {
    let recordings = [pairs(None, 30)];
    let drivers = DriverDistribution::fit("made", &recordings, &FitConfig::default()).unwrap();
    assert!(drivers.simulated() && drivers.site() == "made" && drivers.recordings() == 1);
    let mut seen = [0_usize; 12];
    for n in 0..1200 {
        let drawn = drivers.draw(3, n);
        assert_eq!(drawn, drivers.draw(3, n));
        seen[drivers.drivers().iter().position(|driver| driver == drawn).unwrap()] += 1;
    }
    assert!(seen.iter().all(|count| (60..150).contains(count)), "{seen:?}");
    assert!((0..20).any(|n| drivers.draw(3, n) != drivers.draw(4, n)));

    let once = DriverDistribution::from_toml(&drivers.to_toml().unwrap()).unwrap();
    assert_eq!(DriverDistribution::from_toml(&once.to_toml().unwrap()).unwrap(), once);
    for (a, b) in once.drivers().iter().zip(drivers.drivers()) {
        assert!((a.driver.time_gap - b.driver.time_gap).abs() < 1e-4);
    }
    let vehicle = drivers.vehicle(3, 5, State::new(0., 1.875, 20., 0.));
    let mut scene = scene(1);
    scene.add(vehicle).unwrap();
}

#[test]
fn texts_that_are_no_distribution_are_refused() {
    let good = DriverDistribution::embedded("i-80").unwrap().to_toml().unwrap();
    let line = good.lines().find(|line| line.starts_with("time_gap_s")).unwrap();
    for bad in ["time_gap_s = [1.0]", "time_gap_s = []", "time_gap = [1.0]", "time_gap_s = 1.0"] {
        let error = DriverDistribution::from_toml(&good.replace(line, bad)).unwrap_err();
        assert!(matches!(error, DriverError::Toml(_)), "{bad}: {error}");
    }
    let negative = line.replacen("[", "[-", 1);
    let error = DriverDistribution::from_toml(&good.replace(line, &negative)).unwrap_err();
    assert!(error.to_string().contains("driver.time_gap"), "{error}");
    let error = DriverDistribution::embedded("nowhere").unwrap_err();
    assert!(error.to_string().contains("us-101, i-80, highd-simulated"), "{error}");
}

#[test]
fn the_drivers_that_come_along_can_be_read() {
    for (site, simulated) in [("us-101", false), ("i-80", false), ("highd-simulated", true)] {
        let drivers = DriverDistribution::embedded(site).unwrap();
        assert_eq!((drivers.site(), drivers.simulated()), (site, simulated));
        let spreads = drivers.spreads(None).unwrap();
        assert!(spreads.drivers >= 50, "{site}: {spreads:?}");
        assert!((0.4..2.5).contains(&spreads.time_gap.median), "{site}: {spreads:?}");
    }
}
