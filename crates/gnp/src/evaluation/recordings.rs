//! A finished run on other recordings, all of whose windows are test windows.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use gnp_data::{Fingerprint, Split, Subset, WindowId, WindowKey, WindowSet};
use gnp_eval::Protocol;
use serde::Serialize;

use super::{Material, Scores, fitting, of_run};
use crate::data::{ingest, source};
use crate::error::{Context as _, Error, Result};
use crate::needs;
use crate::run::Run;
use crate::run::draft::Draft;
use crate::run::folder::{DataState, Stage, write_json};

/// `eval.json`: what was scored on what.
#[derive(Debug, Serialize)]
struct EvalState<'a> {
    run: String,
    run_split_hash: &'a str,
    trained_on: &'a DataState,
    scored_on: &'a DataState,
    windows: usize,
    /// Those of what the run was trained or tuned on; not known where its own recordings cannot be used.
    windows_of_training: Option<usize>,
    windows_hash: &'a str,
    version: &'static str,
}

/// The run's own windows and their split; `None`, and a note, where they cannot be loaded.
fn own_windows(run: &Run) -> Result<Option<(WindowSet<'_>, Split)>> {
    match run.windows().and_then(|own| Ok((run.split(&own)?, own))) {
        Ok((split, own)) => Ok(Some((own, split))),
        Err(stopped @ Error::Stopped { .. }) => Err(stopped),
        Err(error) => {
            let error = error.chain();
            run.note(&format!(
                "no densities, nor is it known whether the run was trained on these recordings: its own cannot be used: {error}"
            ));
            Ok(None)
        }
    }
}

/// The windows to which densities are fitted, whatever the run is scored on: its validation part less what is scored.
fn for_densities<'s, 'a>(
    (own, split): &'s (WindowSet<'a>, Split),
    scored: &WindowSet<'_>,
) -> Option<(&'s WindowSet<'a>, Vec<WindowId>)> {
    let ids = fitting(own, split, Subset::Test).map_or_else(Vec::new, |(own, ids)| beside(own, ids, scored));
    (!ids.is_empty()).then_some((own, ids))
}

/// How many of the scored windows are stretches of those that a run was trained or tuned on.
fn seen_in_training((own, split): &(WindowSet<'_>, Split), scored: &WindowSet<'_>) -> usize {
    let ids = split.train().iter().chain(split.validation());
    let trained = Fingerprint::of_windows("trained on", ids.filter_map(|id| own.get(*id)));
    scored.iter().filter(|window| trained.shows(window)).count()
}

/// Those of the windows `ids` of `set` that are not among the scored ones.
fn beside(set: &WindowSet<'_>, ids: &[WindowId], scored: &WindowSet<'_>) -> Vec<WindowId> {
    let scored: BTreeSet<WindowKey> = scored.iter().map(|window| window.key()).collect();
    let is_beside = |id: &&WindowId| set.get(**id).is_some_and(|window| !scored.contains(&window.key()));
    ids.iter().filter(is_beside).copied().collect()
}

/// Ingests other recordings with the run's configuration, scores the run's model on all their windows, and writes
/// scores and predictions to the new folder `out`; returns its place.
///
/// # Errors
/// When the run is not trained, the recordings are not of its kind and rate, or `out` is in use.
pub fn score_recordings(run: &Run, data: &Path, out: &Path) -> Result<(Scores, PathBuf)> {
    run.folder.require(Stage::Evaluate)?;
    let draft = Draft::start(out, "take another --out", &run.machine)?;
    let found = source::find(&run.config, Some(data))?;
    run.result(&format!("Data: {}", found.data.description));
    let report = ingest::run(found, &run.config, draft.path(), &run.machine)?;
    needs::check_with(Stage::Evaluate, &run.config, &report, &run.machine)?;
    let recordings = report.load(draft.path(), &run.machine)?;
    let (set, _) = WindowSet::cut(&recordings, &run.config.windows)?;
    let split = Split::all_test(&set);
    let words = "other recordings, all test".to_owned();
    let own = own_windows(run)?;
    let windows_of_training = own.as_ref().map(|own| seen_in_training(own, &set));
    if let Some(seen @ 1..) = windows_of_training {
        run.result(&format!(
            "{seen} of {} windows are of what the run was trained or tuned on: their scores are not those of held-out data",
            split.test().len()
        ));
    }
    let clean = run.config.evaluate.protocols.contains(&Protocol::Clean);
    let fitted_to = own.as_ref().filter(|_| clean).and_then(|own| for_densities(own, &set));
    let fitting = fitted_to.as_ref().map(|(own, ids)| (*own, &ids[..]));
    let material = Material { set: &set, ids: split.test(), fitting, split: words, data: &report.data };
    let scores = of_run(run, &material, draft.path())?;
    let state = EvalState {
        run: run.path().display().to_string(),
        run_split_hash: &run.folder.state.split_hash,
        trained_on: &run.folder.state.data,
        scored_on: &report.data,
        windows: split.test().len(),
        windows_of_training,
        windows_hash: split.hash(),
        version: env!("CARGO_PKG_VERSION"),
    };
    write_json(&draft.path().join("eval.json"), &state)?;
    let kept = draft.path().join(ingest::RECORDINGS);
    fs::remove_dir_all(&kept).with_context(|| format!("cannot remove {}", kept.display()))?;
    Ok((scores, draft.publish()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::tests::{recording, windows};

    #[test]
    fn windows_that_are_scored_are_left_out_of_the_fit() {
        let own = [recording("a"), recording("b")];
        let scored = [recording("b"), recording("c")];
        let [own, scored] = [&own, &scored].map(|it| WindowSet::cut(it, &windows()).unwrap().0);
        let left = beside(&own, own.ids(), &scored);
        assert!(!left.is_empty() && left.len() < own.ids().len());
        assert!(left.iter().all(|id| own.get(*id).unwrap().key().recording == "a"));
    }
}
