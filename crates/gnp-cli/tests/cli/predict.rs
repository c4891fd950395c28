//! `predict`, `explain --input`, `export` and `info` as users run them.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{data, names, program, run};

const SCENES: [&str; 3] = ["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz", "ngsim/us101-26_1.csv.gz"];

/// Plain tracks of two vehicles in one lane, ten rows each, a second long; the follower is faster.
fn plain(place: &Path) {
    let mut text = "id,time,x,y,length,width\n".to_owned();
    for row in 0..10 {
        let time = f64::from(row) / 10.;
        for (name, start, speed) in [("ego", 0., 25.), ("truck", 40., 20.)] {
            text += &format!("{name},{time:.1},{:.3},1.8,4.5,1.8\n", start + speed * time);
        }
    }
    fs::write(place, text).unwrap();
}

#[test]
fn a_killed_prediction_goes_on_to_the_same_bytes() {
    let (tracks, place) = (data(&SCENES), TempDir::new().unwrap());
    let input = tracks.path().to_str().unwrap();
    let outs = ["whole.parquet", "killed.parquet"].map(|name| place.path().join(name));
    let words = |out: &Path| {
        let out = out.to_str().unwrap().to_owned();
        ["predict", "--input", input, "--every", "0.3", "--jobs", "1", "--output"]
            .map(str::to_owned)
            .into_iter()
            .chain([out])
            .collect::<Vec<_>>()
    };
    let told = run(&words(&outs[0])).well();
    assert!(
        told.err.contains("model: ngsim") && told.out.contains("forecasts of 3 recordings"),
        "{}{}",
        told.err,
        told.out
    );

    let parts = place.path().join(".killed.parquet.parts");
    let mut child = program(&words(&outs[1])).stderr(std::process::Stdio::null()).spawn().unwrap();
    let part = |entry: &fs::DirEntry| entry.path().extension().is_some_and(|end| end == "parquet");
    let made = || fs::read_dir(&parts).into_iter().flatten().flatten().filter(part).count();
    let until = Instant::now() + Duration::from_secs(60);
    while made() == 0 && !outs[1].exists() && Instant::now() < until {
        thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(parts.exists() || outs[1].exists(), "something is done, or on a machine that is fast enough all");
    run(&words(&outs[1])).well();
    assert!(fs::read(&outs[0]).unwrap() == fs::read(&outs[1]).unwrap(), "other bytes");
    assert_eq!(names(place.path()), ["killed.parquet", "whole.parquet"]);
}

#[test]
fn plain_tracks_of_ten_rows_are_predicted_and_explained() {
    let place = TempDir::new().unwrap();
    let (tracks, out, figures) =
        (place.path().join("tracks.csv"), place.path().join("out.parquet"), place.path().join("explained"));
    plain(&tracks);
    let tracks = tracks.to_str().unwrap();
    let told = run(&["predict", "--input", tracks, "--output", out.to_str().unwrap()]).well();
    assert!(told.out.starts_with("2 forecasts of 1 recording, 2 of them from a past that was filled"), "{}", told.out);
    let arguments = ["explain", "--input", tracks, "--vehicle", "ego", "--out", figures.to_str().unwrap()];
    let told = run(&arguments).well();
    assert!(told.out.contains("vehicle ego") && told.out.contains("leader truck"), "{}", told.out);
    assert!(figures.join("contributions.svg").exists());
    let told = run(&[&arguments[..], &["--json"]].concat()).well();
    let value: Value = serde_json::from_str(&told.out).unwrap();
    assert_eq!(value["vehicle_name"], "ego");
    let told = run(&[&arguments[..], &["--add", "9,0,3", "--without-term", "neighbours", "--json"]].concat()).well();
    let value: Value = serde_json::from_str(&told.out).unwrap();
    assert_eq!(value["changes"], "without the force of neighbours and with a vehicle new 1 added at 3 m/s");
    let parts = value["changed"]["parts"].as_array().unwrap();
    assert!(parts.iter().any(|part| part["cause"] == "leader new 1"), "{parts:?}");
    assert!(figures.join("what-if.svg").exists());
    // Vehicles are called as in the file.
    for (change, words) in [
        (["--without", "truck"], "without vehicle truck"),
        (["--speed", "truck=3"], "with vehicle truck at 3 m/s"),
        (["--move", "truck=-4,0"], "with vehicle truck moved 4 m back"),
    ] {
        let told = run(&[&arguments[..], &change, &["--json"]].concat()).well();
        let value: Value = serde_json::from_str(&told.out).unwrap();
        assert_eq!(value["changes"], words);
        let shorter = value["change"]["path"].as_array().unwrap().last().unwrap()[0].as_f64().unwrap();
        assert_eq!(shorter > 0., change[0] == "--without", "{words}: {shorter}");
    }
    run(&[&arguments[..], &["--without", "trucks"]].concat())
        .badly(&["no vehicle trucks", "truck (most like it, of 2)"]);
    // The number that a name has inside is none.
    run(&[&arguments[..], &["--without", "2"]].concat()).badly(&["no vehicle 2", "there are ego, truck"]);
    run(&[&arguments[..], &["--without-term", "magic"]].concat()).badly(&["magic", "neighbours"]);
    run(&["explain", "--input", tracks, "--vehicle", "bus"]).badly(&["no recording with a vehicle bus"]);
}

#[test]
fn the_card_of_the_model_is_printed() {
    let told = run(&["info"]).well();
    for part in ["# ngsim", "## Limits", "## Scores", "Licence"] {
        assert!(told.out.contains(part), "{}", told.out);
    }
    let told = run(&["info", "ngsim", "--json"]).well();
    let card: Value = serde_json::from_str(&told.out).unwrap();
    assert_eq!((card["name"].as_str(), card["windows"]["rate_hz"].as_f64()), (Some("ngsim"), Some(10.)));
    run(&["info", "nowhere"]).badly(&["there is no model at nowhere", "ngsim"]);
}
