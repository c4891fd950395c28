//! Tracks in other formats.

use std::fs;

use tempfile::TempDir;

use crate::program::{data, run};

#[test]
fn a_scene_becomes_plain_tracks_floating_car_data_and_ngsim_again() {
    let (scenes, out) = (data(&["ngsim/us101-13_1.csv.gz", "ngsim/us101-24_1.csv.gz"]), TempDir::new().unwrap());
    let place = |name: &str| out.path().join(name).to_str().unwrap().to_owned();
    let scene = scenes.path().join("us101-13_1.csv.gz");
    let convert = |input: &str, to: &str, output: &str, more: &[&str]| {
        run(&[&["convert", "--input", input, "--to", to, "--output", output][..], more].concat())
    };
    let there = convert(scene.to_str().unwrap(), "tracks", &place("a.parquet"), &[]).well();
    assert!(there.out.starts_with("ngsim -> tracks: 1 recording with "), "{}", there.out);
    assert!(there.out.contains("nothing is lost") && there.err.contains("a.parquet"), "{}{}", there.out, there.err);
    let fcd = convert(&place("a.parquet"), "sumo", &place("fcd.xml.gz"), &[]).well();
    assert!(fcd.out.contains("lost: rows without a speed"), "{}", fcd.out);
    assert!(out.path().join("fcd.add.xml").is_file());
    let back = convert(&place("fcd.xml.gz"), "ngsim", &place("back"), &["--from", "sumo"]).well();
    assert!(back.out.starts_with("sumo -> ngsim: 1 recording with "), "{}", back.out);
    assert!(out.path().join("back/fcd.csv").is_file() && !out.path().join("back/SIMULATED").exists());

    // A folder becomes a folder; several recordings are no file.
    convert(scenes.path().to_str().unwrap(), "tracks", &place("all"), &[]).well();
    let mut names: Vec<_> = fs::read_dir(place("all")).unwrap().map(|it| it.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["us101-13_1.csv", "us101-24_1.csv"]);
    convert(scenes.path().to_str().unwrap(), "tracks", &place("one.csv"), &[])
        .badly(&["2 recordings do not go into one file"]);
    assert!(!out.path().join("one.csv").exists());
    convert(&place("a.parquet"), "tracks", &place("a.parquet"), &[]).badly(&["this is the input"]);
    let rate = convert(&place("a.parquet"), "highd", &place("as-highd"), &[]).well();
    assert!(rate.out.contains("carriageways are added"), "{}", rate.out);
    let read = convert(&place("as-highd"), "tracks", &place("of-highd.csv"), &[]).well();
    assert!(read.out.starts_with("highd -> tracks: 1 recording"), "{}", read.out);
}
