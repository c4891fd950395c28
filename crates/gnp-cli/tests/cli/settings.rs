//! Configurations and settings from the command line.

use std::fs;

use tempfile::TempDir;

use crate::program::{Finished, names, program, run, smoke};

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
fn a_configuration_that_comes_with_the_program_has_a_name_everywhere() {
    let elsewhere = TempDir::new().unwrap();
    let from = |config: &str| {
        let data = elsewhere.path().join("gone");
        let arguments = ["pipeline", "--config", config, "--data-dir", data.to_str().unwrap()];
        Finished::from(program(&arguments).current_dir(elsewhere.path()).output().unwrap())
    };
    // It is found: what is missing is the data.
    from("paper/highd").badly(&["gone"]);
    from("smoke").badly(&["gone"]);
    from("configs/ngsim.toml")
        .badly(&["there is no file configs/ngsim.toml", "ngsim, highd, smoke, pretrained/ngsim, paper/ngsim"]);
}

/// In milliseconds, before anything is read: the folder of data does not even exist.
#[test]
fn what_no_memory_holds_is_refused_before_anything_is_read() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let refused = |settings: &[&str]| {
        let mut arguments = vec!["pipeline", "--config", "smoke", "--data-dir", "gone", "--out"];
        arguments.push(place.to_str().unwrap());
        settings.iter().for_each(|setting| arguments.extend(["--set", setting]));
        let finished = run(&arguments);
        assert_eq!(names(out.path()), [""; 0], "something was written");
        finished
    };
    for (setting, range) in [
        ("evaluate.bootstrap.resamples=1000000000000", "evaluate.bootstrap.resamples = 1000000000000: give a number"),
        ("goal.width=4096000", "goal.width = 4096000: give a number from 1 to 8192 units"),
        ("traj.hidden=1000000", "traj.hidden = 1000000: give a number from 1 to 8192 units"),
        ("traj.encoder=[100000000000]", "traj.encoder = 100000000000: give a number from 1 to 8192 units a layer"),
        ("goal.layers=100000000", "goal.layers = 100000000: give a number from 0 to 128 layers"),
        ("windows.predicted_s=1e9", "windows.predicted_s = 1000000000: give a number from 0.001 to 600 s"),
    ] {
        refused(&[setting]).badly(&[range]);
    }
    // In its range, and terabytes.
    #[cfg(target_os = "linux")]
    refused(&["goal.width=8192", "goal.layers=128"]).badly(&[
        "the training of the goal network would need about ",
        "GB of memory, and there are ",
        "weights of the goal network, with gradients and moments (goal.width, goal.layers",
    ]);
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

#[test]
fn a_device_that_cannot_be_used_is_refused() {
    if candle_core::Device::new_cuda(0).is_ok() {
        return;
    }
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let arguments = ["pipeline", "--dataset", "ngsim", "--device", "cuda", "--out", place.to_str().unwrap()];
    let remedy = if cfg!(feature = "cuda") { "nvidia-smi" } else { "--features cuda" };
    run(&arguments).badly(&["--device cuda", remedy, "--device cpu"]);
    assert_eq!(names(out.path()), [""; 0], "something was written");
}
