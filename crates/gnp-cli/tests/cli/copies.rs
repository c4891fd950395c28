//! Folders in which recordings lie twice, or whose files are not all recordings.

use std::collections::BTreeSet;
use std::fs;
use std::io::Read as _;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{fixture, names, run, smoke};

/// Text of an embedded file.
fn text(name: &str) -> String {
    let mut text = String::new();
    flate2::read::GzDecoder::new(&fs::read(fixture(name)).unwrap()[..]).read_to_string(&mut text).unwrap();
    text
}

/// A scene twice, a cut of another before it, and a file of another kind.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let (scene, whole) = ("ngsim/us101-13_1.csv.gz", text("ngsim/us101-24_1.csv.gz"));
    fs::copy(fixture(scene), folder.path().join("a.csv.gz")).unwrap();
    fs::write(folder.path().join("b.csv"), text(scene)).unwrap();
    let (header, rows) = whole.split_once('\n').unwrap();
    let frame = |row: &str| row.split(',').nth(1).unwrap().parse::<u32>().unwrap();
    let cut: Vec<&str> = rows.lines().filter(|row| (20..110).contains(&frame(row))).collect();
    fs::write(folder.path().join("cut.csv"), format!("{header}\n{}\n", cut.join("\n"))).unwrap();
    fs::write(folder.path().join("whole.csv"), &whole).unwrap();
    fs::write(folder.path().join("more.zip"), b"PK\x03\x04\x14").unwrap();
    folder
}

fn ingested(folder: &Path, threads: &str) -> (String, Value, Vec<String>) {
    let (out, config) = (TempDir::new().unwrap(), smoke());
    let place = out.path().join("run");
    let arguments = ["ingest", "--config", config.to_str().unwrap(), "--data-dir", folder.to_str().unwrap()];
    let more = [
        "--out",
        place.to_str().unwrap(),
        "--set",
        "split.kind=vehicle",
        "--set",
        "data.max_recordings=0",
        "--threads",
        threads,
    ];
    let finished = run(&[&arguments[..], &more].concat()).well();
    assert!(fs::read_to_string(place.join("ingest.txt")).unwrap().contains("b is left out"));
    let report = serde_json::from_str(&fs::read_to_string(place.join("ingest.json")).unwrap()).unwrap();
    (finished.out, report, names(&place.join("recordings")))
}

/// The same scene as `a.csv` and `b.csv` once gave a split of which half of the test windows were in training.
#[test]
fn a_recording_that_lies_there_twice_is_taken_once() {
    let folder = folder();
    // One after another, so that the cut is saved before the whole comes; both at once.
    for threads in ["1", "2"] {
        let (said, report, files) = ingested(folder.path(), threads);
        let list = |key: &str| report[key].as_array().unwrap().clone();
        let kept: Vec<Value> = list("recordings").iter().map(|it| it["quality"]["recording"].clone()).collect();
        assert_eq!(kept, ["a", "whole"]);
        let left_out: BTreeSet<(String, String)> = list("left_out")
            .iter()
            .map(|it| (it["recording"].as_str().unwrap().to_owned(), it["copy_of"].as_str().unwrap().to_owned()))
            .collect();
        let expected = [("b", "a"), ("cut", "whole")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        assert_eq!(left_out, BTreeSet::from(expected));
        // What lies in the folder is what the report has.
        let reported: Vec<String> = list("recordings")
            .iter()
            .map(|it| it["file"].as_str().unwrap().trim_start_matches("recordings/").to_owned())
            .collect();
        assert_eq!(files, reported);
        for part in ["b is left out: 100 % of its rows are those of a", "more.zip is not read: a zip archive"] {
            let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(said.contains(part), "no `{part}` in:\n{said}");
        }
        assert!(list("not_read")[0].as_str().unwrap().contains("more.zip"));
    }
    // `--describe` says the same of what it does not read.
    let described = run(&["ingest", "--dataset", "ngsim", "--describe", "--data-dir", folder.path().to_str().unwrap()]);
    assert!(described.well().out.contains("a zip archive; unpack it"));
}
