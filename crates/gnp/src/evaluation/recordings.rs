//! A finished run on other recordings, all of whose windows are test windows.

use std::fs;
use std::path::{Path, PathBuf};

use gnp_data::{Split, Subset, WindowSet};
use serde::Serialize;

use super::{Material, Scores, fitting, of_run};
use crate::data::{ingest, source};
use crate::error::{Context as _, Result};
use crate::run::Run;
use crate::run::folder::{DataState, Draft, Stage, write_json};

/// `eval.json`: what was scored on what.
#[derive(Debug, Serialize)]
struct EvalState<'a> {
    run: String,
    run_split_hash: &'a str,
    trained_on: &'a DataState,
    scored_on: &'a DataState,
    windows: usize,
    windows_hash: &'a str,
    version: &'static str,
}

/// Ingests other recordings with the run's configuration, scores the run's model on all their windows, and writes
/// scores and predictions to the new folder `out`; returns its place.
///
/// # Errors
/// When the run is not trained, the recordings are not of its kind and rate, or `out` is in use.
pub fn score_recordings(run: &Run, data: &Path, out: &Path) -> Result<(Scores, PathBuf)> {
    run.folder.require(Stage::Evaluate)?;
    let draft = Draft::start(out, "take another --out")?;
    let found = source::find(&run.config, Some(data))?;
    run.result(&format!("Data: {}", found.data.description));
    let report = ingest::run(found, &run.config, draft.path(), &run.machine)?;
    let recordings = report.load(draft.path(), &run.machine)?;
    let (set, _) = WindowSet::cut(&recordings, &run.config.windows)?;
    let split = Split::all_test(&set);
    let words = "other recordings, all test".to_owned();
    // Densities are of the run, whatever it is scored on.
    let own = run.windows()?;
    let trained = run.split(&own)?;
    let fitting = fitting(&own, &trained, Subset::Test);
    let material = Material { set: &set, ids: split.test(), fitting, split: words, data: &report.data };
    let scores = of_run(run, &material, draft.path())?;
    let state = EvalState {
        run: run.path().display().to_string(),
        run_split_hash: &run.folder.state.split_hash,
        trained_on: &run.folder.state.data,
        scored_on: &report.data,
        windows: split.test().len(),
        windows_hash: split.hash(),
        version: env!("CARGO_PKG_VERSION"),
    };
    write_json(&draft.path().join("eval.json"), &state)?;
    let kept = draft.path().join(ingest::RECORDINGS);
    fs::remove_dir_all(&kept).with_context(|| format!("cannot remove {}", kept.display()))?;
    Ok((scores, draft.publish()?))
}
