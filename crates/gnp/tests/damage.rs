//! Run folders that were damaged, and ones that two processes work in.

#![allow(clippy::unwrap_used, clippy::expect_used)] // also outside the test functions

mod smoke;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::{Arc, LazyLock, Mutex};

use candle_core::Device;
use gnp::{
    CompareRequest, DriveOn, JobState, Machine, Plan, PreparedTable, Progress, Recipes, ReplayDrivers, Run, Silent,
    Stage, Stop, Work,
};
use gnp_data::{Dataset, TrackOptions};
use tempfile::TempDir;

use smoke::config;

/// Files of a run by their names from its folder.
type Files = BTreeMap<String, Vec<u8>>;

/// A finished run, made once.
static FINISHED: LazyLock<Files> = LazyLock::new(|| {
    let out = TempDir::new().unwrap();
    let mut run = Plan::new(config(&[]), None, out.path().join("run")).begin(&Machine::default()).unwrap();
    run.complete().unwrap();
    files(run.path())
});

fn files(root: &Path) -> Files {
    let mut found = Files::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// A copy of the finished run in `place`.
fn copied(place: &Path) {
    for (name, bytes) in FINISHED.iter() {
        let path = place.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

/// What was said.
#[derive(Debug, Default)]
struct Notes(Mutex<Vec<String>>);

impl Progress for Notes {
    fn note(&self, text: &str) {
        self.0.lock().unwrap().push(text.to_owned());
    }

    fn result(&self, _: &str) {}

    fn start(&self, what: &str, done: u64, total: u64, unit: &'static str) -> Box<dyn Work> {
        Silent.start(what, done, total, unit)
    }
}

/// What some work says.
fn said(work: impl FnOnce(&Machine)) -> String {
    let notes = Arc::new(Notes::default());
    work(&Machine::new(Device::Cpu, notes.clone(), Stop::new()));
    let said = notes.0.lock().unwrap();
    said.join("\n")
}

/// Does all of a run that is not done; what was said of it.
fn completed(place: &Path) -> String {
    said(|machine| Plan::resume(place).begin(machine).unwrap().complete().unwrap())
}

fn refused(place: &Path) -> String {
    Plan::resume(place).begin(&Machine::default()).unwrap_err().chain()
}

/// What is wrong with a run and its recordings, if anything is, and whether it is refused for it.
fn problem(place: &Path) -> Option<(bool, String)> {
    let mut refused = None;
    let said = said(|machine| {
        refused = match Run::open(place, machine) {
            Ok(run) => run.recordings().err().map(|error| error.chain()),
            Err(error) => Some(error.chain()),
        };
    });
    let told = Some((false, said)).filter(|(_, said)| !said.is_empty());
    refused.map(|message| (true, message)).or(told)
}

fn flip(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

/// Results that say nothing of time: of a whole run, and of one made again, the same bytes.
fn same_results(place: &Path) {
    let found = files(place);
    let timed = |name: &str| ["run.json", "report.html"].contains(&name) || name.starts_with("events/");
    for (name, bytes) in FINISHED.iter().filter(|(name, _)| !timed(name)) {
        assert!(found.get(name).is_some_and(|again| again == bytes), "{name} is not made again as it was");
    }
}

#[test]
fn every_file_of_a_run_that_is_missing_or_differs_is_found() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    let opened = || problem(&place);
    assert_eq!(opened(), None);
    let mut tried = 0;
    for (name, bytes) in FINISHED.iter().filter(|(name, _)| *name != "run.lock") {
        let path = place.join(name);
        let mut flipped = bytes.clone();
        flipped[bytes.len() / 2] ^= 1;
        let damages = [None, Some(&bytes[..0]), Some(&bytes[..bytes.len() - 1]), Some(&flipped)];
        for damage in damages {
            match damage {
                None => fs::remove_file(&path).unwrap(),
                Some(bytes) => fs::write(&path, bytes).unwrap(),
            }
            let (refused, message) = opened().expect(name);
            assert!(message.contains(name.as_str()), "{name}: {message}");
            // Told, where nobody needs it or another file says the same.
            let spared = ["events/", "history-", "ingest.txt", "metrics.csv", "metrics.md", "rules.json"];
            let spared = spared.iter().any(|start| name.starts_with(start)) || name.ends_with(".last.safetensors");
            assert_eq!(refused, !spared, "{name}: {message}");
            tried += 1;
        }
        fs::write(&path, bytes).unwrap();
    }
    assert!(tried > 100, "{tried}");
    assert_eq!(opened(), None);
    // A recording in the place of another one is whole, and another one.
    let names: Vec<&String> = FINISHED.keys().filter(|name| name.ends_with(".rec")).collect();
    fs::write(place.join(names[0]), &FINISHED[names[1]]).unwrap();
    assert!(opened().unwrap().1.contains(names[0]));
}

#[test]
fn what_is_damaged_is_made_again_with_what_was_made_from_it() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    fs::write(place.join("mine.txt"), "mine").unwrap();
    flip(&place.join("goal.safetensors"));
    let read = Run::open(&place, &Machine::default()).unwrap_err().chain();
    assert!(read.contains("goal.safetensors differs from what was written") && read.contains("--resume"), "{read}");
    let said = completed(&place);
    for part in [
        "goal.safetensors differs from what was written: goal and what was made from it are made again",
        "attraction: finished before",
        "goal: 1 epochs",
    ] {
        assert!(said.contains(part), "no `{part}` in:\n{said}");
    }
    same_results(&place);
    assert_eq!(fs::read(place.join("mine.txt")).unwrap(), b"mine");
    assert!(!completed(&place).contains("again"), "it is whole");
}

#[test]
fn what_another_file_says_is_written_from_it_and_what_is_not_needed_is_done_without() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    fs::remove_file(place.join("history-goal.json")).unwrap();
    for name in ["ingest.txt", "metrics.csv", "metrics.md"] {
        fs::write(place.join(name), "").unwrap();
    }
    flip(&place.join("attraction.last.safetensors"));
    let said = completed(&place);
    assert!(said.contains("history-goal.json is missing: written again"), "{said}");
    assert!(
        said.contains("attraction.last.safetensors differs from what was written: its training is finished"),
        "{said}"
    );
    assert!(!said.contains("are made again"), "{said}");
    assert!(said.contains("metrics.csv and 1 more differ from what was written: written again"), "{said}");
    let kept = ["history-goal.json", "ingest.txt", "metrics.csv", "metrics.md", "goal.safetensors", "report.html"];
    assert!(kept.iter().all(|name| fs::read(place.join(name)).unwrap() == FINISHED[*name]));
    assert!(!completed(&place).contains("differs"), "it is told once");

    // Scores and pages are made again without a training, and rules are fitted again when they are needed.
    for name in ["rules.json", "predictions.parquet"] {
        fs::remove_file(place.join(name)).unwrap();
    }
    fs::write(place.join("report.html"), "").unwrap();
    let said = completed(&place);
    let again = "predictions.parquet is missing: evaluate and what was made";
    assert!(said.contains(again) && !said.contains(" epochs in"), "{said}");
    for name in ["rules.json", "metrics.json", "predictions.parquet"] {
        assert!(fs::read(place.join(name)).unwrap() == FINISHED[name], "{name}");
    }
}

#[test]
fn what_cannot_be_made_again_is_refused() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    let recording = FINISHED.keys().find(|name| name.ends_with(".rec")).unwrap();
    for name in ["config.toml", "split.json", "ingest.json", recording] {
        fs::write(place.join(name), "").unwrap();
        let message = refused(&place);
        assert!(message.contains(name) && message.contains("cannot be made again"), "{message}");
        fs::write(place.join(name), &FINISHED[name]).unwrap();
    }
    fs::write(place.join("run.json"), &FINISHED["run.json"][..100]).unwrap();
    assert!(refused(&place).contains("run.json"));
    fs::remove_file(place.join("run.json")).unwrap();
    assert!(refused(&place).contains("run.json is missing; copy it back"), "{}", refused(&place));
}

#[test]
fn a_model_is_used_without_its_recordings_and_not_with_other_ones() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    for name in ["split.json", "ingest.json", "ingest.txt", "metrics.json", "history-goal.json"] {
        fs::remove_file(place.join(name)).unwrap();
    }
    for folder in ["recordings", "events", "figures"] {
        fs::remove_dir_all(place.join(folder)).unwrap();
    }
    assert!(Run::open(&place, &Machine::default()).is_err());
    let other = gnp::embedded_folder(Dataset::NGSIM).unwrap().join("us101-24_1.csv.gz");
    let said = said(|machine| {
        let run = Run::open_model(&place, machine).unwrap();
        let (scores, _) = gnp::score_recordings(&run, &other, &out.path().join("scores")).unwrap();
        assert!(!scores.scores.is_empty());
        let drive = DriveOn {
            tracks: TrackOptions::default(),
            dataset: Dataset::NGSIM,
            data: Some(other.clone()),
            recording: None,
            at_s: 0.,
            seconds: 1.,
            drivers: ReplayDrivers::Run(place.clone()),
            seeds: vec![0],
            out: out.path().join("driven"),
            fcd: false,
        };
        gnp::simulate_from(&drive, machine).unwrap();
        let mut tuned = Plan::new(config(&[]), None, out.path().join("tuned")).begin(machine).unwrap();
        tuned.start_from(&place).unwrap();
    });
    assert!(said.contains("no densities") && said.contains("ingest.json is missing"), "{said}");
    // Weights are not done without.
    fs::remove_file(place.join("goal.safetensors")).unwrap();
    assert!(Run::open_model(&place, &Machine::default()).unwrap_err().chain().contains("goal.safetensors"));

    let place = out.path().join("exchanged");
    copied(&place);
    let names: Vec<&String> = FINISHED.keys().filter(|name| name.ends_with(".rec")).collect();
    fs::write(place.join(names[0]), &FINISHED[names[1]]).unwrap();
    let message = Run::open_model(&place, &Machine::default()).unwrap_err().chain();
    assert!(message.contains(names[0]) && message.contains("differs"), "{message}");
}

#[test]
fn report_and_figures_make_their_own_files_again() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    fs::remove_file(place.join("report.html")).unwrap();
    fs::write(place.join("metrics.md"), "edited").unwrap();
    fs::remove_dir_all(place.join("events")).unwrap();
    let told = said(|machine| drop(gnp::write_report(&mut Run::resume(&place, machine).unwrap()).unwrap()));
    assert!(told.contains("metrics.md differs") && !told.contains("evaluate and what"), "{told}");
    fs::remove_dir_all(place.join("figures")).unwrap();
    let said = said(|machine| {
        let mut run = Run::resume(&place, machine).unwrap();
        gnp::draw_figures(&mut run, None, &place.join("figures")).unwrap();
    });
    let figures = FINISHED.keys().filter(|name| name.starts_with("figures/")).count();
    assert!(said.contains(&format!("and {} more are missing: report", figures - 1)), "{said}");
    same_results(&place);
    assert!(place.join("report.html").exists());
    assert!(!completed(&place).contains("again"), "nothing is left to do");
}

#[test]
fn a_folder_that_cannot_be_written_to_is_said_to_be_so() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    fs::remove_file(place.join("run.lock")).unwrap();
    fs::create_dir(place.join("run.lock")).unwrap();
    fs::remove_file(place.join("report.html")).unwrap();
    let message = refused(&place);
    assert!(message.contains("run cannot be written to (") && message.ends_with("report.html is missing"), "{message}");
}

#[test]
fn two_do_not_write_one_run_and_reading_needs_nobody_s_leave() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    let machine = Machine::default();
    let mut run = Run::resume(&place, &machine).unwrap();
    let held = Run::open(&place, &machine).unwrap().lock().unwrap();
    for message in [
        run.forget(Stage::Report).unwrap_err().chain(),
        gnp::write_report(&mut run).unwrap_err().chain(),
        run.start_from(&place).unwrap_err().chain(),
    ] {
        let owner = format!("process {} on ", std::process::id());
        assert!(message.contains("is being written by") && message.contains(&owner), "{message}");
        assert!(message.contains("UTC; wait for its end"), "{message}");
    }
    // Read all the same, and the folder stays as it is.
    let before = files(&place);
    let read = Run::finished(&place, &machine).unwrap();
    assert!(read.model().is_ok() && read.scores().is_ok());
    run.complete().unwrap();
    assert!(files(&place) == before);
    drop(held);
    run.forget(Stage::Report).unwrap();
    // What the other one did meanwhile is seen.
    Run::resume(&place, &machine).unwrap().complete().unwrap();
    run.forget(Stage::Evaluate).unwrap();
    assert!(!run.state().finished.contains_key(&Stage::Report));
    assert_eq!(fs::read(place.join("run.lock")).unwrap(), b"", "nobody holds it");
}

#[test]
fn what_killed_programs_left_goes_and_nothing_else() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    copied(&place);
    let left = ["a", "figures/a"].map(|name| gnp_file::beside(&place.join(name)).unwrap().path().to_owned());
    left.iter().for_each(|path| fs::write(path, "half").unwrap());
    let draft = gnp_file::Draft::start(&place).unwrap().path().to_owned();
    fs::create_dir(&draft).unwrap();
    fs::write(draft.join("run.lock"), "").unwrap();
    fs::write(draft.join("ingest.json"), "half").unwrap();
    let others = [out.path().join(".other.unfinished-a1B2c3"), place.join(".tmpA1B2c3")];
    others.iter().for_each(|path| fs::write(path, "theirs").unwrap());
    let said = completed(&place);
    assert!(left.iter().chain([&draft]).all(|path| !path.exists()), "{said}");
    assert!(others.iter().all(|path| path.exists()));
    assert!(said.contains("that killed programs left: 1 removed"), "{said}");
}

#[test]
fn a_damaged_last_checkpoint_is_no_place_to_go_on_from() {
    let out = TempDir::new().unwrap();
    let place = out.path().join("run");
    let mut run = Plan::new(config(&[]), None, &place).begin(&Machine::default()).unwrap();
    run.perform(Stage::Modes).unwrap();
    fs::write(place.join("goal.last.safetensors"), "half").unwrap();
    run.perform(Stage::Goal).unwrap();
    assert!(fs::read(place.join("goal.safetensors")).unwrap() == FINISHED["goal.safetensors"]);
}

#[test]
fn a_job_of_a_table_whose_files_are_damaged_is_done_again() {
    let out = TempDir::new().unwrap();
    let (place, none) = (out.path().join("table"), out.path().join("none.toml"));
    fs::write(&none, "").unwrap();
    let recipes = Recipes::read(&none, &config(&[])).unwrap();
    let asked = CompareRequest::new(Plan::new(config(&[]), None, &place), recipes);
    let machine = Machine::default();
    let table = PreparedTable::prepare(&asked, &machine).unwrap();
    let job = "fold-1/gnp/seed-0";
    table.perform(job, &machine).unwrap();
    let state = || table.jobs().unwrap()[0].state;
    assert_eq!(state(), JobState::Done);
    let weights = place.join("gnp/repulsion.safetensors");
    let before = fs::read(&weights).unwrap();
    flip(&weights);
    assert_eq!(state(), JobState::Begun);
    let message = table.gather(false, &machine).unwrap_err().chain();
    assert!(message.contains(job) && message.contains("repulsion.safetensors differs"), "{message}");
    table.perform(job, &machine).unwrap();
    assert_eq!(state(), JobState::Done);
    assert!(fs::read(&weights).unwrap() == before);

    let asked = place.join("table.toml");
    let text = fs::read_to_string(&asked).unwrap();
    fs::write(&asked, text.replace("seeds = 1", "seeds = 2")).unwrap();
    let message = PreparedTable::open(&place).unwrap_err().chain();
    assert!(message.contains("table.toml is damaged"), "{message}");
}

#[test]
fn jobs_of_a_damaged_fold_do_not_keep_each_other_from_their_work() {
    let out = TempDir::new().unwrap();
    let (place, file) = (out.path().join("table"), out.path().join("recipes.toml"));
    let embedded = include_str!("../configs/neural-baselines.toml");
    let mut asked: toml::Table = embedded.parse().unwrap();
    asked.retain(|stem, _| stem == "column_network");
    for key in ["networks", "epochs"] {
        asked["column_network"].as_table_mut().unwrap().insert(key.to_owned(), 1.into());
    }
    fs::write(&file, asked.to_string()).unwrap();
    let recipes = Recipes::read(&file, &config(&[])).unwrap();
    let asked = CompareRequest::new(Plan::new(config(&[]), None, &place), recipes);
    let table = PreparedTable::prepare(&asked, &Machine::default()).unwrap();
    let jobs: Vec<String> = table.jobs().unwrap().into_iter().map(|job| job.id).collect();
    assert_eq!(jobs.len(), 2);
    jobs.iter().for_each(|job| table.perform(job, &Machine::default()).unwrap());
    let models: Vec<_> = files(&place).into_keys().filter(|name| name.ends_with(".safetensors")).collect();
    let learned: Vec<_> = models.iter().filter(|name| name.starts_with("learned/")).collect();
    assert!(!learned.is_empty());
    let weights = place.join("gnp/repulsion.safetensors");
    let before = fs::read(&weights).unwrap();
    fs::remove_file(&weights).unwrap();
    learned.iter().for_each(|name| fs::remove_file(place.join(name)).unwrap());
    // One that writes into the run is waited for by the job of the run alone.
    let held = gnp_file::Lock::take(&place.join("gnp/run.lock")).unwrap();
    let waits = said(|machine| {
        std::thread::scope(|scope| {
            let gnp = scope.spawn(|| table.perform(&jobs[0], machine).unwrap());
            table.perform(&jobs[1], machine).unwrap();
            assert!(!gnp.is_finished() && !weights.exists());
            drop(held);
            gnp.join().unwrap();
        });
    });
    assert!(table.jobs().unwrap().iter().all(|job| job.state == JobState::Done), "{waits}");
    assert!(fs::read(&weights).unwrap() == before);
}
