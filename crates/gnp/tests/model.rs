//! Models by themselves: exported from a run, opened from a folder, a run, or the program.

#![allow(clippy::unwrap_used, clippy::result_large_err)] // also outside the test functions

mod smoke;

use std::fs;
use std::path::Path;

use gnp::{Error, ExportRequest, Machine, Model};
use gnp_data::Predictor as _;
use gnp_model::ModelError;
use tempfile::TempDir;

use smoke::{config, trained};

#[test]
fn an_exported_model_is_that_of_its_run_and_needs_no_recordings() {
    let place = TempDir::new().unwrap();
    let (run, machine) = (trained(config(&[]), &place.path().join("run")), Machine::default());
    let export = |name: &str| {
        let out = place.path().join(name);
        let request =
            ExportRequest { run: run.path().to_owned(), out: out.clone(), name: Some("mine".to_owned()), card: None };
        gnp::export(&request, &machine).map(|card| (out, card))
    };
    let (folder, card) = export("a").unwrap();
    assert_eq!((card.name.as_str(), card.predict.k), ("mine", run.config().predict.k));
    // The same bytes again, and not over what is there.
    let (again, _) = export("b").unwrap();
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name();
        assert_eq!(fs::read(folder.join(&name)).unwrap(), fs::read(again.join(&name)).unwrap(), "{name:?}");
    }
    assert!(export("a").unwrap_err().to_string().contains("take another --out"));

    let set = run.windows().unwrap();
    let seen: Vec<_> = set.iter().step_by(40).map(|window| window.observation()).collect();
    let expected = run.model().unwrap().predict(&seen, 3).unwrap();
    let folders = [folder.as_path(), run.path()];
    for from in folders {
        let model = Model::open(Some(from), &machine).unwrap();
        assert_eq!(model.gnp().predict(&seen, 3).unwrap(), expected, "{}", from.display());
    }
    let cards = folders.map(|from| gnp::model_card(Some(from), &machine).unwrap());
    assert_eq!((&cards[0].predict, &cards[0].training), (&cards[1].predict, &cards[1].training));
}

#[test]
fn words_of_a_card_are_checked() {
    let place = TempDir::new().unwrap();
    let run = trained(config(&[]), &place.path().join("run"));
    let words = place.path().join("words.toml");
    let export = |text: &str| {
        fs::write(&words, text).unwrap();
        let (run, out) = (run.path().to_owned(), place.path().join("model"));
        let request = ExportRequest { run, out, name: None, card: Some(words.clone()) };
        gnp::export(&request, &Machine::default())
    };
    for (bad, part) in [
        ("title = 3", "words.toml"),
        ("title = \"a\"\nlicence = \"b\"\nlimits = []\nlicense = \"c\"", "license"),
        ("title = \"a\"", "licence"),
    ] {
        let message = export(bad).unwrap_err().chain();
        assert!(message.contains(part), "{message}");
        assert!(!place.path().join("model").exists());
    }
    let card = export("title = \"a\"\nlicence = \"b\"\nlimits = [\"c\"]").unwrap();
    assert_eq!((card.title.as_str(), card.licence.as_str(), card.name.as_str()), ("a", "b", "run"));
}

#[test]
fn without_a_word_it_is_the_one_that_comes_with_the_program() {
    let machine = Machine::default();
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/ngsim");
    let expected = gnp::model_card(Some(&committed), &machine).unwrap();
    for from in [None, Some(Path::new("ngsim"))] {
        assert_eq!(Model::open(from, &machine).unwrap().card(), &expected);
    }
    let error = Model::open(Some(Path::new("nowhere")), &machine).unwrap_err();
    assert!(matches!(&error, Error::Model(ModelError::NoModel { .. })), "{error}");
    let message = error.to_string();
    assert!(message.contains("nothing of that name") && message.contains("ngsim"), "{message}");
}
