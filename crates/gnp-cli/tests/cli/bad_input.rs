//! Bad recordings: one error with file, place and remedy, exit code 1, and nothing on the disk.

use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use tempfile::TempDir;

use crate::program::{Finished, data, fixture, names, run, smoke};

/// An embedded file, unpacked if it is packed.
fn text(file: &str) -> String {
    let bytes = fs::read(fixture(file)).unwrap();
    let mut text = String::new();
    if file.ends_with(".gz") {
        GzDecoder::new(&bytes[..]).read_to_string(&mut text).unwrap();
    } else {
        text = String::from_utf8(bytes).unwrap();
    }
    text
}

/// Ingests a folder that holds these files; checks that nothing was written.
fn ingest(dataset: &str, files: &[(&str, Vec<u8>)], more: &[&str]) -> Finished {
    let folder = TempDir::new().unwrap();
    for (name, content) in files {
        fs::write(folder.path().join(name), content).unwrap();
    }
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let mut arguments = vec!["pipeline", "--dataset", dataset, "--data-dir", folder.path().to_str().unwrap()];
    arguments.extend(["--out", place.to_str().unwrap()]);
    arguments.extend(more);
    let finished = run(&arguments);
    assert_eq!(names(out.path()), [""; 0], "something was written:\n{}", finished.err);
    finished
}

fn ngsim(content: String) -> Finished {
    ingest("ngsim", &[("scene.csv", content.into_bytes())], &[])
}

/// The embedded scene with one line changed.
fn scene_with(line: usize, change: impl Fn(Vec<&str>) -> Vec<String>) -> String {
    let text = text("ngsim/us101-4_1.csv.gz");
    let lines = text.lines().enumerate().map(|(number, content)| {
        if number + 1 == line { change(content.split(',').collect()).join(",") } else { content.to_owned() }
    });
    lines.collect::<Vec<_>>().join("\n") + "\n"
}

/// Replaces field `column` of a line.
fn field(column: usize, value: &'static str) -> impl Fn(Vec<&str>) -> Vec<String> {
    move |fields| fields.iter().enumerate().map(|(i, old)| if i == column { value } else { *old }.to_owned()).collect()
}

/// Recording 01 of the embedded highD layout, its meta file and its tracks' meta file changed.
fn highd(meta: impl Fn(String) -> String, tracks: impl Fn(String) -> String) -> Finished {
    let packed = fs::read(fixture("highd/01_tracks.csv.gz")).unwrap();
    let files = [
        ("01_recordingMeta.csv", meta(text("highd/01_recordingMeta.csv")).into_bytes()),
        ("01_tracksMeta.csv", tracks(text("highd/01_tracksMeta.csv")).into_bytes()),
        ("01_tracks.csv.gz", packed),
    ];
    ingest("highd", &files, &[])
}

fn same(text: String) -> String {
    text
}

#[test]
fn a_missing_column() {
    let without = text("ngsim/us101-4_1.csv.gz").replacen("Lane_ID", "Lane", 1);
    ngsim(without).badly(&["scene.csv", "Lane_ID"]);
}

#[test]
fn a_wrong_delimiter() {
    ngsim(text("ngsim/us101-4_1.csv.gz").replace(',', ";")).badly(&["scene.csv", "line 1"]);
}

#[test]
fn a_truncated_archive() {
    let mut packed = fs::read(fixture("ngsim/us101-4_1.csv.gz")).unwrap();
    packed.truncate(packed.len() / 2);
    ingest("ngsim", &[("scene.csv.gz", packed)], &[]).badly(&["scene.csv.gz", "gzip"]);
}

#[test]
fn a_value_that_is_no_number() {
    ngsim(scene_with(7, field(4, "NaN"))).badly(&["scene.csv", "line 7", "Local_X"]);
}

#[test]
fn a_negative_size() {
    ngsim(scene_with(3, field(8, "-15.0"))).badly(&["scene.csv", "line 3", "v_Length"]);
}

#[test]
fn feet_where_metres_are_due_and_the_other_way_round() {
    ngsim(scene_with(2, field(11, "400.0"))).badly(&["scene.csv", "v_Vel"]);
    highd(|text| text.replace("3.00;6.80;10.60", "9.84;22.31;34.78"), same)
        .badly(&["01_recordingMeta.csv", "upperLaneMarkings"]);
}

#[test]
fn recordings_that_cannot_be_split() {
    highd(same, same).badly(&["split by recording", "split by vehicle"]);
}

#[test]
fn markings_that_do_not_parse() {
    highd(|text| text.replace("3.00;6.80;10.60", "3.00;six;10.60"), same).badly(&[
        "01_recordingMeta.csv",
        "line 2",
        "upperLaneMarkings",
    ]);
}

#[test]
fn a_rate_that_the_configuration_does_not_expect() {
    highd(|text| text.replace("1,25,2", "1,30,2"), same).badly(&["01_recordingMeta.csv", "30", "25"]);
}

#[test]
fn a_folder_without_recordings() {
    ingest("ngsim", &[("notes.md", b"nothing here".to_vec())], &[]).badly(&["no recordings", "NGSIM"]);
    ingest("highd", &[], &[]).badly(&["no recordings", "highD"]);
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let gone = out.path().join("gone");
    run(&["pipeline", "--dataset", "ngsim", "--data-dir", gone.to_str().unwrap(), "--out", place.to_str().unwrap()])
        .badly(&["gone"]);
}

#[test]
fn no_window_long_enough() {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(text("ngsim/us101-4_1.csv.gz").as_bytes()).unwrap();
    let files = [("scene.csv.gz", packed.finish().unwrap())];
    ingest("ngsim", &files, &["--set", "windows.predicted_s=60.0"]).badly(&["no track is long enough", "63"]);
}

#[test]
fn a_run_folder_in_use_is_left_alone() {
    let out = TempDir::new().unwrap();
    fs::write(out.path().join("mine.txt"), "mine").unwrap();
    let place = out.path().to_str().unwrap();
    run(&["pipeline", "--dataset", "ngsim", "--out", place]).badly(&["not empty", "--resume"]);
    run(&["pipeline", "--dataset", "ngsim", "--out", place, "--resume"]).badly(&["not a run folder"]);
    assert_eq!(names(out.path()), ["mine.txt"]);
}

#[test]
fn a_stage_needs_a_run_folder() {
    let out = TempDir::new().unwrap();
    run(&["goal", "--run", out.path().to_str().unwrap()]).badly(&["not a run folder", "gnp ingest"]);
    assert!(names(Path::new(out.path())).is_empty());
}

#[test]
fn what_is_resumed_and_is_not_there_or_no_run_is_said_to_be_that() {
    run(&["pipeline", "--resume"]).badly(&["which run is to be resumed", "--out DIR"]);
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let place = place.to_str().unwrap();
    for settings in [&[][..], &["--set", "seed=1"]] {
        run(&[&["pipeline", "--resume", "--out", place][..], settings].concat()).badly(&[
            "there is no run in",
            "to resume",
            "--dataset NAME",
        ]);
    }
    run(&["goal", "--run", place]).badly(&["is not there"]);
    fs::write(out.path().join("table.toml"), "").unwrap();
    let table = out.path().to_str().unwrap();
    run(&["pipeline", "--resume", "--out", table]).badly(&["not a run folder but that of a table", "gnp compare"]);
    assert_eq!(names(out.path()), ["table.toml"]);
}

#[test]
fn a_run_that_another_process_writes_is_refused_by_its_name() {
    let (data, out) = (data(&["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz"]), TempDir::new().unwrap());
    let place = out.path().join("run");
    let [config, from, place] = [&smoke(), data.path(), &place].map(|path| path.to_str().unwrap().to_owned());
    run(&["ingest", "--config", &config, "--data-dir", &from, "--out", &place]).well();
    let held = gnp::Run::open(Path::new(&place), &gnp::Machine::default()).unwrap().lock().unwrap();
    let owner = format!("process {} on ", std::process::id());
    run(&["modes", "--run", &place]).badly(&["is being written by", &owner, "since", "UTC", "wait for its end"]);
    drop(held);
    run(&["modes", "--run", &place]).well();
}
