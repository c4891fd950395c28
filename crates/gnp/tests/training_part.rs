//! Nothing is fitted outside the training part: whatever the other recordings show, rules, modes, statistics of the
//! features and weights after an epoch have the same bits.

#![allow(clippy::unwrap_used)] // also outside the test functions

#[allow(dead_code)] // trains further than is needed here
mod smoke;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use candle_core::Tensor;
use gnp::{Machine, Plan, Stage};
use gnp_data::{Dataset, Expectation, Recording, discover, read};
use gnp_model::Checkpoint;
use tempfile::TempDir;

/// Metres in a foot.
const FOOT: f64 = 0.3048;
/// Scenes of US-101 none of which stays together with another.
const SCENES: [&str; 6] = ["us101-4_1", "us101-10_1", "us101-12_1", "us101-16_1", "us101-21_1", "us101-26_1"];
fn scenes() -> Vec<Recording> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/ngsim");
    let sources = discover(&folder, Dataset::NGSIM).unwrap();
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: Some(10.) };
    let recordings = sources.iter().flat_map(|source| read(source, &expect).unwrap()).map(|(recording, _)| recording);
    recordings.filter(|recording| SCENES.contains(&recording.meta().name.as_str())).collect()
}

/// NGSIM's columns of a recording, with every position along the road times `stretch`: all drive so much faster.
fn csv(recording: &Recording, stretch: f64) -> String {
    let mut text = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,\
                    v_Class,v_Vel,v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location\n"
        .to_owned();
    let columns = recording.columns();
    for track in recording.tracks() {
        for (frame, row) in (track.first_frame..).zip(track.rows.clone()) {
            let front = stretch * f64::from(columns.x[row]) + f64::from(track.length) / 2.;
            let (right, speed) = (50. - f64::from(columns.y[row]), stretch * f64::from(columns.vx[row]));
            let [right, front, speed] = [right, front, speed].map(|value| value / FOOT);
            let [length, width] = [track.length, track.width].map(|value| f64::from(value) / FOOT);
            let (vehicle, frames, time) = (track.vehicle, track.rows.len(), 1_118_846_980_000 + 100 * u64::from(frame));
            let lane = columns.lane[row];
            writeln!(
                text,
                "{vehicle},{frame},{frames},{time},{right:.3},{front:.3},0,0,{length:.2},{width:.2},2,{speed:.2},0,{lane},\
                 0,0,0,0,us-101"
            )
            .unwrap();
        }
    }
    text
}

/// The fitted files of a run on `scenes`, those of `stretched` driven faster, the split's hash and its training recordings.
fn fitted(
    scenes: &[Recording],
    stretched: &BTreeSet<String>,
) -> (BTreeMap<&'static str, Vec<u8>>, String, BTreeSet<String>) {
    let folder = TempDir::new().unwrap();
    let data: PathBuf = folder.path().join("data");
    std::fs::create_dir(&data).unwrap();
    for scene in scenes {
        let name = &scene.meta().name;
        let stretch = if stretched.contains(name) { 1.15 } else { 1. };
        std::fs::write(data.join(format!("{name}.csv")), csv(scene, stretch)).unwrap();
    }
    let config = smoke::config(&["data.max_recordings=0", "split.kind=recording"]);
    let mut run = Plan::new(config, Some(data), folder.path().join("run")).begin(&Machine::default()).unwrap();
    for stage in [Stage::Ingest, Stage::Modes, Stage::Goal] {
        run.perform(stage).unwrap();
    }
    let set = run.windows().unwrap();
    let split = run.split(&set).unwrap();
    let training = split.train().iter().map(|id| set.recording(*id).unwrap().meta().name.clone()).collect();
    let mut files: BTreeMap<_, _> =
        ["rules.json", "modes.safetensors"].map(|file| (file, std::fs::read(run.path().join(file)).unwrap())).into();
    // Its header has the validation score, which is to differ.
    let goal = Checkpoint::load(&run.path().join("goal.safetensors")).unwrap();
    files.insert("statistics of the features", serde_json::to_vec(&goal.header.features).unwrap());
    let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let bits = goal.tensors.values().flat_map(values).flat_map(f32::to_le_bytes).collect();
    files.insert("weights after an epoch", bits);
    (files, split.hash().to_owned(), training)
}

#[test]
fn only_training_recordings_have_a_say_in_what_is_fitted() {
    let scenes = scenes();
    assert_eq!(scenes.len(), SCENES.len());
    let (files, hash, training) = fitted(&scenes, &BTreeSet::new());
    let others: BTreeSet<String> = SCENES.iter().map(ToString::to_string).filter(|it| !training.contains(it)).collect();
    assert!(!training.is_empty() && others.len() >= 2, "{training:?}");

    let (without, same_hash, _) = fitted(&scenes, &others);
    assert_eq!(hash, same_hash, "the windows are parted alike");
    for (file, bytes) in &files {
        assert!(*bytes == without[file], "{file} knows recordings beyond the training part");
    }
    // And each of them depends on the training part.
    let one: BTreeSet<String> = training.iter().take(1).cloned().collect();
    let (changed, same_hash, _) = fitted(&scenes, &one);
    assert_eq!(hash, same_hash);
    for (file, bytes) in &files {
        assert!(*bytes != changed[file], "{file} does not change with {one:?}");
    }
}
