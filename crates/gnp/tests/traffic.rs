//! Traffic by scene files and from recordings: what is written, and what it says.
#![allow(clippy::unwrap_used, reason = "a test that cannot read what was written has failed")]
use gnp::{DriveOn, Machine, Measurement, ReplayDrivers, Scene, Simulation, measure, scene, simulate, simulate_from};
use gnp_data::{Dataset, TrackOptions};
use gnp_road::ReferenceLine;
use std::path::Path;

const FILES: [&str; 6] =
    ["tracks.parquet", "detectors.csv", "cells.csv", "conflicts.csv", "summary.json", "report.html"];

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn a_scene_is_driven_measured_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("drop");
    let short = Scene { duration_s: 120., ..scene("lane-drop").unwrap() };
    let simulation = Simulation { scene: short, seeds: vec![1, 2], out: out.clone(), fcd: true };
    let all = simulate(&simulation, &Machine::default()).unwrap();
    assert_eq!(all.len(), 2);
    for (seed, measured) in [1, 2].into_iter().zip(&all) {
        assert_eq!(measured.out, out.join(format!("seed-{seed}")));
        for file in FILES.iter().chain(&["happenings.csv", "fcd.xml", "fcd.add.xml", "figures/speed-field.svg"]) {
            assert!(measured.out.join(file).is_file(), "{file}");
        }
        let summary: serde_json::Value = serde_json::from_str(&read(&measured.out.join("summary.json"))).unwrap();
        assert_eq!(summary["simulated"], true);
        let count = |what: &str| summary["counts"][what].as_u64().unwrap();
        assert_eq!(count("started") + count("entered"), count("left") + count("remain"));
        assert!(count("entered") > 20 && measured.text.contains("simulated"), "{}", measured.text);
        // 240 frames at 2 Hz, whoever is there in them.
        assert!((measured.summary.duration_s - 119.5).abs() < 1e-9, "{}", measured.summary.duration_s);
    }
    assert_ne!(read(&all[0].out.join("happenings.csv")), read(&all[1].out.join("happenings.csv")));
    let written: Scene = Scene::parse(&read(&out.join("scene.toml"))).unwrap();
    assert_eq!(written.seeds, [1, 2], "the file says what was driven");

    // Driven again without floating car data, the old file is gone.
    let again = Simulation { seeds: vec![1], out: all[0].out.clone(), fcd: false, ..simulation };
    simulate(&again, &Machine::default()).unwrap();
    assert!(!all[0].out.join("fcd.xml").exists() && !all[0].out.join("fcd.add.xml").exists());
}

fn measurement(data: Option<&Path>, out: &Path) -> Measurement {
    let (data, out) = (data.map(Path::to_owned), out.to_owned());
    Measurement { dataset: Dataset::NGSIM, data, tracks: TrackOptions::default(), out }
}

/// At a rate that no model has, and along a road that curves.
#[test]
fn tracks_of_any_rate_are_measured_along_their_road() {
    const RADIUS: f64 = 300.;
    let place = |s: f64, d: f64| [(RADIUS - d) * (s / RADIUS).sin(), RADIUS - (RADIUS - d) * (s / RADIUS).cos()];
    let folder = tempfile::tempdir().unwrap();
    let mut text = "id,time,x,y,length,width\n".to_owned();
    for row in 0..=70 {
        let time = f64::from(row) / 7.;
        for (name, start, d) in [("a", 0., 1.8), ("b", 30., 1.8), ("bus", 10., 5.4)] {
            let [x, y] = place(start + 20. * time, d);
            text += &format!("{name},{time:.5},{x:.4},{y:.4},4.5,1.8\n");
        }
    }
    let file = folder.path().join("arc.csv");
    std::fs::write(&file, text).unwrap();
    let of = Measurement { dataset: Dataset::TRACKS, ..measurement(Some(&file), &folder.path().join("out")) };
    let error = measure(&of, &Machine::default()).unwrap_err().to_string();
    assert!(error.contains("arc.csv") && error.contains("road"), "{error}");
    let points: Vec<[f64; 2]> = (0..=60).map(|i| place(5. * f64::from(i) - 20., 0.)).collect();
    let tracks = TrackOptions { road: Some(ReferenceLine::from_points(&points).unwrap()), ..TrackOptions::default() };
    let measured = measure(&Measurement { tracks, ..of }, &Machine::default()).unwrap().remove(0);
    let summary = &measured.summary;
    assert_eq!((summary.recording.as_str(), summary.vehicles, summary.rate_hz.round()), ("arc", 3, 7.));
    assert!((summary.vehicle_km / summary.vehicle_h / 3.6 - 20.).abs() < 0.5, "{}", measured.text);
}

#[test]
fn recordings_are_measured_and_say_that_they_are_real() {
    let folder = tempfile::tempdir().unwrap();
    let all = measure(&measurement(None, folder.path()), &Machine::default()).unwrap();
    assert_eq!(all.len(), 18);
    let sample = all.iter().find(|measured| measured.summary.recording == "i80-lanes123").unwrap();
    let page = read(&sample.out.join("report.html"));
    assert!(
        page.contains(", recorded.") && page.contains("a sample of the traffic") && !page.contains("simulated data")
    );
    assert!(!sample.summary.simulated && sample.summary.lane_changes.changes.is_empty());
    assert!(all.iter().all(|measured| FILES[1..].iter().all(|file| measured.out.join(file).is_file())));
}

/// The name of a recording is that of its file, and a stranger's: it does not lead out of the folder that is written.
#[test]
fn what_is_measured_is_written_inside_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = gnp::embedded_folder(Dataset::NGSIM).unwrap().join("us101-4_1.csv.gz");
    let upwards = folder.path().join("...csv.gz");
    std::fs::copy(fixture, &upwards).unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let error = measure(&measurement(Some(&upwards), &out), &Machine::default()).unwrap_err().to_string();
    assert!(error.contains("\"..\" is no name of something in this folder"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is written beside the folder");
}

#[test]
fn traffic_drives_on_from_a_recorded_scene() {
    let folder = tempfile::tempdir().unwrap();
    let of = DriveOn {
        dataset: Dataset::NGSIM,
        data: None,
        tracks: TrackOptions::default(),
        recording: Some("us101-24_1".to_owned()),
        at_s: 0.,
        seconds: 30.,
        drivers: ReplayDrivers::Fitted,
        seeds: vec![3],
        out: folder.path().join("on"),
        fcd: false,
    };
    let machine = Machine::default();
    let measured = simulate_from(&of, &machine).unwrap().remove(0);
    assert!(measured.summary.simulated && measured.summary.vehicles > 30, "{}", measured.text);
    assert!((measured.summary.duration_s - 10.).abs() < 0.5, "no longer than is recorded: {}", measured.text);
    assert!(measured.summary.safety.contacts.is_empty(), "{:?}", measured.summary.safety.contacts);
    for (wrong, said) in [
        (DriveOn { recording: Some("nowhere".to_owned()), ..of.clone() }, "there are"),
        (DriveOn { at_s: 1e9, ..of.clone() }, "us101-24_1 has 9.9 s"),
        (DriveOn { at_s: -1., ..of.clone() }, "cannot start at -1 s"),
        (DriveOn { seconds: f64::NAN, ..of.clone() }, "drive for NaN s"),
        (DriveOn { data: Some(folder.path().join("absent")), ..of.clone() }, "absent"),
    ] {
        let error = simulate_from(&wrong, &machine).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn what_is_no_scene_is_refused_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, "name = \"x\"\nduration = 5\n").unwrap();
    let error = scene(&file.display().to_string()).unwrap_err();
    assert!(error.to_string().contains("is no scene"), "{error}");
    let cause = std::error::Error::source(&error).unwrap().to_string();
    assert!(cause.contains("line 2, column 1") && cause.contains("duration_s"), "{cause}");
    assert!(scene("nothing").unwrap_err().to_string().contains("motorway, lane-drop, ring"));
}
