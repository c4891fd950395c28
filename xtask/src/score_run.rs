//! `eval`: a finished run on other recordings, all of whose windows are test windows.

use std::fs;

use anyhow::{Context as _, Result};
use gnp_data::{Split, WindowSet};
use serde::Serialize;

use crate::cli::EvalArgs;
use crate::config::RunConfig;
use crate::evaluate::{Scoring, score};
use crate::ingest;
use crate::run_folder::{DataState, Draft, RunFolder, Stage, write_json};
use crate::session::{Machine, Session};
use crate::source;

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

/// Ingests other recordings with the run's configuration and scores the run's model on them.
///
/// # Errors
/// When the run is not finished, the recordings are not of its kind and rate, or `--out` is in use.
pub(crate) fn run(args: &EvalArgs) -> Result<()> {
    let folder = RunFolder::open(&args.run)?;
    folder.require(Stage::Evaluate)?;
    let config = RunConfig::read(&folder.path("config.toml"), &[])?;
    let draft = Draft::start(&args.out, "take another --out")?;
    let session = Session::new(folder, config, Machine::start(&args.machine)?);
    let found = source::find(&session.config, Some(&args.data_dir))?;
    session.terminal().result(&format!("Data: {}", found.data.words));
    let report = ingest::run(found, &session.config, draft.path(), session.terminal())?;
    let recordings = report.load(draft.path(), session.terminal())?;
    let (set, _) = WindowSet::cut(&recordings, &session.config.windows)?;
    let split = Split::all_test(&set);
    let scoring = Scoring {
        model: session.folder.root(),
        out: draft.path(),
        set: &set,
        ids: split.test(),
        split: "other recordings, all test".to_owned(),
        data: &report.data,
        config: &session.config,
    };
    score(&scoring, &session)?;
    let state = EvalState {
        run: session.folder.root().display().to_string(),
        run_split_hash: &session.folder.state.split_hash,
        trained_on: &session.folder.state.data,
        scored_on: &report.data,
        windows: split.test().len(),
        windows_hash: split.hash(),
        version: env!("CARGO_PKG_VERSION"),
    };
    write_json(&draft.path().join("eval.json"), &state)?;
    let recordings = draft.path().join(ingest::RECORDINGS);
    fs::remove_dir_all(&recordings).with_context(|| format!("cannot remove {}", recordings.display()))?;
    let out = draft.publish()?;
    session.terminal().note(&format!("scores: {}", out.join("metrics.md").display()));
    Ok(())
}
