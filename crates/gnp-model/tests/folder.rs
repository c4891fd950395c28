//! Model folders: read as they were written, and refused when they are not.

#![allow(clippy::unwrap_used)] // also outside the test functions

use std::fs;
use std::path::{Path, PathBuf};

use gnp_model::{Device, Gnp, ModelError, ModelFolder};
use serde_json::json;
use tempfile::TempDir;

/// The weights that come with the project.
fn committed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/ngsim")
}

/// A copy of them.
fn copy() -> TempDir {
    let place = TempDir::new().unwrap();
    for name in ModelFolder::FILES.into_iter().chain(["card.json", "README.md"]) {
        fs::copy(committed().join(name), place.path().join(name)).unwrap();
    }
    place
}

#[test]
fn a_folder_gives_the_model_and_its_settings() {
    let place = copy();
    let folder = ModelFolder::open(place.path()).unwrap();
    let gnp = Gnp::open(place.path(), &Device::Cpu).unwrap();
    let card = folder.card();
    assert_eq!(gnp.trust(), card.predict.trust);
    assert_eq!((gnp.shape().rate_hz, gnp.shape().t_pred), (card.windows.rate_hz, 50));
    // The text says what the card says.
    for part in [&card.licence, &card.limits[0], &card.scores.of, &card.files["goal.safetensors"].sha256] {
        assert!(card.text().contains(part.as_str()), "{part}");
    }
    // Written again it is the same, byte for byte.
    ModelFolder::write_card(place.path(), card.clone()).unwrap();
    for name in ["card.json", "README.md"] {
        assert_eq!(fs::read(place.path().join(name)).unwrap(), fs::read(committed().join(name)).unwrap(), "{name}");
    }
}

#[test]
fn any_changed_byte_is_refused_by_the_name_of_its_file() {
    let place = copy();
    for name in ModelFolder::FILES.into_iter().chain(["card.json"]) {
        let path = place.path().join(name);
        let bytes = fs::read(&path).unwrap();
        for at in [0, bytes.len() / 2, bytes.len() - 1] {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            fs::write(&path, changed).unwrap();
            let error = ModelFolder::open(place.path()).unwrap_err();
            assert!(
                matches!(&error, ModelError::Changed { path: found, .. } if *found == path),
                "{name} {at}: {error}"
            );
        }
        fs::remove_file(&path).unwrap();
        let error = ModelFolder::open(place.path()).unwrap_err();
        let expected = if name == "card.json" { "there is no model at" } else { name };
        assert!(error.to_string().contains(expected), "{error}");
        fs::write(&path, bytes).unwrap();
    }
    ModelFolder::open(place.path()).unwrap();
}

#[test]
fn what_is_no_model_and_what_is_of_a_later_program_is_said() {
    let place = TempDir::new().unwrap();
    let told = |path: &Path| match ModelFolder::open(path).unwrap_err() {
        error @ ModelError::NoModel { .. } => error.to_string(),
        other => panic!("{other}"),
    };
    assert!(told(&place.path().join("none")).contains("nothing of that name"));
    assert!(told(place.path()).contains("it has no card.json") && told(place.path()).contains("gnp export"));
    assert!(told(&committed().join("card.json")).contains("it is a file"));
    let place = copy();
    gnp_file::save_json(&place.path().join("card.json"), &json!({"format": 2, "anything": "else"})).unwrap();
    let error = ModelFolder::open(place.path()).unwrap_err();
    assert!(matches!(error, ModelError::CardFormat { found: 2, reads: 1, .. }), "{error}");
}
