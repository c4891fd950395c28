//! The command that writes a file for the Rerun viewer.

use tempfile::TempDir;

use crate::program::{names, run};

#[cfg(not(feature = "rerun"))]
#[test]
fn a_build_without_rerun_says_how_to_get_one() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("a.rrd");
    run(&["replay", "--run", "runs/none", "--rrd", file.to_str().unwrap()])
        .badly(&["cargo run --package gnp-cli --features rerun -- replay --run runs/none --rrd ", "a.rrd"]);
    assert_eq!(names(folder.path()), [""; 0]);
}

#[cfg(feature = "rerun")]
#[test]
fn a_finished_run_is_replayed_the_same_every_time() {
    use std::fs;

    use crate::program::{data, smoke};

    let (data, out, config) =
        (data(&["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz"]), TempDir::new().unwrap(), smoke());
    let place = out.path().join("run");
    let (place, file) = (place.to_str().unwrap(), out.path().join("a.rrd"));
    let replay = |more: &[&str]| {
        let arguments = ["replay", "--run", place, "--rrd", file.to_str().unwrap()];
        run(&[&arguments[..], more].concat())
    };
    replay(&[]).badly(&["is not a run folder", "gnp ingest"]);
    let arguments = ["--config", config.to_str().unwrap(), "--data-dir", data.path().to_str().unwrap(), "--out", place];
    run(&[&["ingest"], &arguments[..]].concat()).well();
    replay(&[]).badly(&["is not finished", "--resume"]);
    run(&["pipeline", "--resume", "--out", place, "--config", config.to_str().unwrap()]).well();
    replay(&["--vehicle", "99999"]).badly(&["vehicle 99999 is not in the minute", "take one of "]);
    assert_eq!(names(out.path()), ["run"]);

    let said = replay(&["--threads", "1"]).well().out;
    assert!(said.starts_with("replay: ") && said.contains(" forecasts") && said.contains("of version "), "{said}");
    let first = fs::read(&file).unwrap();
    assert_eq!(&first[..4], b"RRF2");
    replay(&["--threads", "2"]).well();
    assert!(first == fs::read(&file).unwrap());
    assert_eq!(names(out.path()), ["a.rrd", "run"]);

    // A place where no file can be is found before anything is computed.
    run(&["replay", "--run", place, "--rrd", out.path().to_str().unwrap()]).badly(&["is a folder"]);
    let nowhere = out.path().join("missing/a.rrd");
    run(&["replay", "--run", place, "--rrd", nowhere.to_str().unwrap()]).badly(&["cannot write", "missing/a.rrd"]);
}
