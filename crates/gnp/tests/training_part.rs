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
use gnp_data::{Dataset, Expectation, Recording, WindowId, discover, read};
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

/// What a run makes of some scenes.
struct Fitted {
    /// Of the training part.
    files: BTreeMap<&'static str, Vec<u8>>,
    /// The chosen epoch, its validation scores and how much is believed: of the validation part, too.
    chosen: (usize, BTreeMap<String, f64>, Option<f64>),
    split_hash: String,
    /// Names of recordings.
    training: BTreeSet<String>,
    test: BTreeSet<String>,
}

/// A run on `scenes`, those of `stretched` driven faster.
fn fitted(scenes: &[Recording], stretched: &BTreeSet<String>) -> Fitted {
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
    let names = |ids: &[WindowId]| ids.iter().map(|id| set.recording(*id).unwrap().meta().name.clone()).collect();
    let (training, test) = (names(split.train()), names(split.test()));
    let mut files: BTreeMap<_, _> =
        ["rules.json", "modes.safetensors"].map(|file| (file, std::fs::read(run.path().join(file)).unwrap())).into();
    // Its header has the validation score, which is to differ.
    let goal = Checkpoint::load(&run.path().join("goal.safetensors")).unwrap();
    files.insert("statistics of the features", serde_json::to_vec(&goal.header.features).unwrap());
    let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let bits = goal.tensors.values().flat_map(values).flat_map(f32::to_le_bytes).collect();
    files.insert("weights after an epoch", bits);
    let chosen = (goal.header.epoch, goal.header.scores, goal.header.trust);
    Fitted { files, chosen, split_hash: split.hash().to_owned(), training, test }
}

#[test]
fn only_training_recordings_have_a_say_in_what_is_fitted() {
    let scenes = scenes();
    assert_eq!(scenes.len(), SCENES.len());
    let plain = fitted(&scenes, &BTreeSet::new());
    let others: BTreeSet<String> =
        SCENES.iter().map(ToString::to_string).filter(|name| !plain.training.contains(name)).collect();
    assert!(!plain.training.is_empty() && others.len() > plain.test.len(), "{others:?}");

    let without = fitted(&scenes, &others);
    assert_eq!(plain.split_hash, without.split_hash, "the windows are parted alike");
    for (file, bytes) in &plain.files {
        assert!(*bytes == without.files[file], "{file} knows recordings beyond the training part");
    }
    // What is chosen by the validation part knows nothing of the test part.
    let without_test = fitted(&scenes, &plain.test);
    assert!(plain.chosen.2.is_some() && plain.chosen == without_test.chosen, "{:?}", without_test.chosen);
    assert!(plain.chosen != without.chosen, "{:?}", without.chosen);
    // And all that is fitted depends on the training part.
    let one: BTreeSet<String> = plain.training.iter().take(1).cloned().collect();
    let changed = fitted(&scenes, &one);
    assert_eq!(plain.split_hash, changed.split_hash);
    for (file, bytes) in &plain.files {
        assert!(*bytes != changed.files[file], "{file} does not change with {one:?}");
    }
}
