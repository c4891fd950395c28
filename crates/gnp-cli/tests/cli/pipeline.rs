//! The main job from end to end on two real scenes, with tiny networks.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{data, names, program, run, smoke};

const SCENES: [&str; 2] = ["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz"];

/// Arguments of a pipeline on `data` into `out`.
fn pipeline<'a>(data: &'a Path, out: &'a Path, config: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["pipeline", "--config", config.to_str().unwrap(), "--data-dir", data.to_str().unwrap()];
    arguments.extend(["--out", out.to_str().unwrap()]);
    arguments.extend(more);
    arguments
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn recordings_become_a_model_and_scores_the_same_ones_every_time() {
    let (data, out, config) = (data(&SCENES), TempDir::new().unwrap(), smoke());
    let first = out.path().join("first");
    let finished = run(&pipeline(data.path(), &first, &config, &["--threads", "1"])).well();
    assert!(finished.out.starts_with("Data: NGSIM recordings in "), "{}", finished.out);
    assert!(finished.err.contains("rows/s; peak memory"), "{}", finished.err);

    for file in [
        "attraction.safetensors",
        "config.toml",
        "differences.json",
        "events",
        "goal.last.safetensors",
        "goal.safetensors",
        "history-goal.json",
        "ingest.json",
        "ingest.txt",
        "figures/error-by-horizon.png",
        "metrics.csv",
        "metrics.json",
        "metrics.md",
        "modes.safetensors",
        "predictions.parquet",
        "recordings",
        "report.html",
        "repulsion.safetensors",
        "rules.json",
        "run.json",
        "split.json",
    ] {
        assert!(first.join(file).exists(), "no {file} in {:?}", names(&first));
    }
    assert!(!names(&first).iter().any(|name| name.starts_with('.')), "{:?}", names(&first));
    assert_eq!(names(out.path()), ["first"]);

    // It ends with one short table, of which no line is wide, and says where the rest is.
    let end = &finished.out[finished.out.find("\nOn us-101,").unwrap_or_else(|| panic!("{}", finished.out))..];
    for part in ["RMSE at 5 s", "minFDE_6 at 5 s", "constant velocity", "best rule", "metrics.md", "report.html"] {
        assert!(end.contains(part), "no `{part}` in:\n{end}");
    }
    let tables = end.lines().filter(|line| !line.contains(out.path().to_str().unwrap()));
    assert!(tables.clone().count() < 16 && tables.clone().all(|line| line.chars().count() <= 80), "{end}");

    let scores = json(&first.join("metrics.json"));
    for model in ["gnp", "goal head", "constant velocity", "constant acceleration", "Kalman filter", "IDM", "platoon"] {
        let rmse = scores.as_array().unwrap().iter().find(|score| {
            score["model"] == model
                && score["metric"] == "rmse_at"
                && score["protocol"] == "clean"
                && score["horizon_s"] == 5.
        });
        let rmse = rmse.unwrap_or_else(|| panic!("no score of {model}"));
        assert_eq!(rmse["site"], "us-101");
        assert!(rmse["value"].as_f64().unwrap() > 0.);
    }
    let markdown = fs::read_to_string(first.join("metrics.md")).unwrap();
    for part in ["protocol clean", "split by vehicle", "10 Hz", "windows", "drivers"] {
        assert!(markdown.contains(part), "no `{part}` in:\n{markdown}");
    }

    // In steps and on another number of threads: the same scores, to the last digit.
    let second = out.path().join("second");
    let mut ingest = pipeline(data.path(), &second, &config, &[]);
    ingest[0] = "ingest";
    run(&ingest).well();
    run(&["goal", "--run", second.to_str().unwrap()]).badly(&["gnp train --stage modes --run"]);
    run(&["modes", "--run", second.to_str().unwrap()]).well();
    run(&["train", "--stage", "goal", "--run", second.to_str().unwrap(), "--threads", "2"]).well();
    let resumed =
        run(&["pipeline", "--resume", "--out", second.to_str().unwrap(), "--config", config.to_str().unwrap()]);
    assert!(resumed.well().err.contains("goal: finished before"));
    for file in ["split.json", "metrics.json", "history-goal.json", "history-repulsion.json"] {
        assert!(fs::read(first.join(file)).unwrap() == fs::read(second.join(file)).unwrap(), "{file} differs");
    }

    // Another configuration is no resume, and a finished run is not overwritten.
    run(&pipeline(data.path(), &first, &config, &["--resume", "--set", "traj.hidden=9"]))
        .badly(&["cannot resume", "`traj.hidden` is 9 and was 8"]);
    run(&pipeline(data.path(), &first, &config, &[])).badly(&["not empty", "--resume"]);
    let again = run(&["evaluate", "--run", first.to_str().unwrap(), "--tables", "--quiet"]).well();
    assert!(again.err.is_empty() && again.out.contains("protocol paper"), "{}", again.out);

    // A forecast is explained as text and as JSON, beside a changed scene.
    let place = first.to_str().unwrap();
    // Who writes into the run keeps nobody from it.
    let held = gnp::Run::open(&first, &gnp::Machine::default()).unwrap().lock().unwrap();
    let said = run(&["explain", "--run", place]).well();
    drop(held);
    for part in ["constant velocity", "\npath ", " 5 s", "In 5 s vehicle ", "sum of the causes"] {
        assert!(said.out.contains(part), "no `{part}` in:\n{}", said.out);
    }
    let asked: Value = serde_json::from_str(&run(&["explain", "--run", place, "--json"]).well().out).unwrap();
    let (vehicle, frame) = (asked["vehicle"].to_string(), asked["frame"].to_string());
    let ahead = asked["as_it_is"]["parts"].as_array().unwrap().iter().find(|part| part["place"] == 1).unwrap();
    let pictures = out.path().join("pictures");
    let ahead = ahead["vehicle"].to_string();
    let arguments =
        ["explain", "--run", place, "--vehicle", &vehicle, "--at", &frame, "--without", &ahead, "--json", "--out"];
    let changed = run(&[&arguments[..], &[pictures.to_str().unwrap()]].concat()).well();
    let changed: Value = serde_json::from_str(&changed.out).unwrap();
    assert_eq!(changed["as_it_is"], asked["as_it_is"]);
    assert_eq!(changed["changes"], format!("without vehicle {ahead}"));
    assert_eq!(names(&pictures), ["contributions.png", "contributions.svg", "what-if.png", "what-if.svg"]);
    run(&["explain", "--run", place, "--vehicle", "99999"]).badly(&["99999", "vehicles with one: "]);

    // On other recordings every window is a test window.
    let other = crate::program::data(&["ngsim/us101-23_1.csv.gz"]);
    let scored = out.path().join("scored");
    let arguments = ["eval", "--run", first.to_str().unwrap(), "--data-dir", other.path().to_str().unwrap(), "--out"];
    run(&[&arguments[..], &[scored.to_str().unwrap()]].concat()).well();
    assert_eq!(
        names(&scored),
        [
            "differences.json",
            "eval.json",
            "faithfulness.json",
            "ingest.json",
            "ingest.txt",
            "metrics.csv",
            "metrics.json",
            "metrics.md",
            "predictions.parquet",
        ]
    );
    let windows = json(&scored.join("eval.json"))["windows"].as_u64().unwrap();
    let ingested = json(&scored.join("ingest.json"))["recordings"][0]["windows"]["windows"].as_u64().unwrap();
    assert_eq!(windows, ingested);
    assert_eq!(json(&scored.join("eval.json"))["windows_of_training"], 0);

    // On a copy of what it was trained on, that is said.
    let (again, copy) = (out.path().join("again"), TempDir::new().unwrap());
    fs::copy(data.path().join("us101-13_1.csv.gz"), copy.path().join("renamed.txt.gz")).unwrap();
    let arguments = ["eval", "--run", first.to_str().unwrap(), "--data-dir", copy.path().to_str().unwrap(), "--out"];
    let said = run(&[&arguments[..], &[again.to_str().unwrap()]].concat()).well().out;
    let state = json(&again.join("eval.json"));
    let [seen, all] = ["windows_of_training", "windows"].map(|key| state[key].as_u64().unwrap());
    let split = json(&first.join("split.json"));
    let starts = |part: &str| -> usize {
        split[part]["us101-13_1"].as_array().unwrap().iter().map(|it| it["t0"].as_array().unwrap().len()).sum()
    };
    assert_eq!(seen as usize, starts("train") + starts("validation"));
    assert_eq!(all as usize, starts("train") + starts("validation") + starts("test"));
    assert!(said.contains(&format!("{seen} of {all} windows are of what the run was trained or tuned on")), "{said}");
}

#[test]
fn simulated_recordings_are_called_so() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let arguments =
        ["ingest", "--dataset", "highd", "--out", place.to_str().unwrap(), "--set", "data.max_recordings=1"];
    let finished = run(&arguments).well();
    assert!(finished.out.starts_with("Data: *simulated*"), "{}", finished.out);
    assert!(fs::read_to_string(place.join("ingest.txt")).unwrap().contains("*simulated*"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_a_checkpoint_that_a_resume_goes_on_from() {
    use std::process::{Command, Stdio};
    use std::time::Duration;

    let (data, out, config) = (data(&SCENES[..1]), TempDir::new().unwrap(), smoke());
    let place = out.path().join("run");
    let arguments = pipeline(data.path(), &place, &config, &["--set", "goal.epochs=60"]);
    let mut running = program(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    while !place.join("goal.last.safetensors").exists() {
        assert!(running.try_wait().unwrap().is_none(), "ended before the first epoch");
        std::thread::sleep(Duration::from_millis(5));
    }
    // Still the process that was started, though it started itself anew with what the libraries below are to find.
    if let Ok(environment) = fs::read(format!("/proc/{}/environ", running.id())) {
        let environment = String::from_utf8_lossy(&environment);
        assert!(environment.contains("CANDLE_NUM_THREADS=1\0") && environment.contains("RAYON_NUM_THREADS="));
    }
    let sent = Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let ended = running.wait_with_output().unwrap();
    let message = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(130), "{message}");
    assert!(message.contains("go on with `gnp pipeline --resume --out"), "{message}");
    run(&["pipeline", "--resume", "--out", place.to_str().unwrap()]).well();
    let history = json(&place.join("history-goal.json"));
    assert_eq!(history["epochs"].as_array().unwrap().len(), 60);
}
