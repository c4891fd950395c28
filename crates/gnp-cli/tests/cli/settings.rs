//! Configurations and settings from the command line.

use std::fs;

use tempfile::TempDir;

use crate::program::{names, run, smoke};

#[test]
fn an_unknown_key_is_refused_with_those_near_it() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let place = place.to_str().unwrap();
    run(&["pipeline", "--dataset", "ngsim", "--out", place, "--set", "goal.epoch=3"])
        .badly(&["unknown key `goal.epoch`", "goal.epochs"]);
    run(&["pipeline", "--dataset", "ngsim", "--out", place, "--set", "goal.epochs=many"])
        .badly(&["goal.epochs", "integer"]);
    assert_eq!(names(out.path()), [""; 0], "something was written");
}

#[test]
fn a_key_too_many_in_the_file_is_refused_with_its_path() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("mine.toml");
    let text = fs::read_to_string(smoke()).unwrap().replace("[windows]", "[windows]\nobserved = 3.0");
    fs::write(&file, text).unwrap();
    run(&["pipeline", "--config", file.to_str().unwrap()]).badly(&[
        "mine.toml",
        "`windows.observed`",
        "windows.observed_s",
    ]);
}

#[test]
fn the_data_set_must_be_that_of_the_configuration() {
    run(&["pipeline", "--dataset", "highd", "--config", smoke().to_str().unwrap()]).badly(&["--dataset highd"]);
    run(&["pipeline"]).badly(&["--dataset ngsim", "--config"]);
}

#[test]
fn wrong_use_has_its_own_exit_code() {
    assert_eq!(run(&["pipeline", "--dataset", "waymo"]).code, Some(2));
    assert_eq!(run(&["train"]).code, Some(2));
}

#[test]
fn every_command_has_help() {
    for command in [
        "pipeline", "ingest", "train", "evaluate", "compare", "ablate", "figures", "report", "replay", "goal", "eval",
        "score", "table1",
    ] {
        let help = run(&[command, "--help"]).well();
        assert!(help.out.contains("Usage: gnp "), "{}", help.out);
    }
}

#[test]
fn describe_lists_columns_units_and_what_is_there() {
    let described = run(&["ingest", "--dataset", "ngsim", "--describe"]).well();
    for part in ["Local_X", "ft", "vx", "m/s"] {
        assert!(described.out.contains(part), "{}", described.out);
    }
    let dir = crate::program::fixture("highd");
    let described = run(&["ingest", "--dataset", "highd", "--describe", "--data-dir", dir.to_str().unwrap()]).well();
    for part in ["upperLaneMarkings", "3 recordings", "*simulated*", "02_tracks.csv.gz"] {
        assert!(described.out.contains(part), "{}", described.out);
    }
}

#[cfg(not(feature = "cuda"))]
#[test]
fn a_device_that_is_not_in_the_build_is_refused() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let arguments = ["pipeline", "--dataset", "ngsim", "--device", "cuda", "--out", place.to_str().unwrap()];
    run(&arguments).badly(&["--device cuda", "--features cuda"]);
    assert_eq!(names(out.path()), [""; 0], "something was written");
}
