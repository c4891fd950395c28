//! A finished run on other recordings, all of whose windows are test windows.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use gnp_data::{Split, Subset, WindowId, WindowKey, WindowSet};
use gnp_eval::Protocol;
use serde::Serialize;

use super::{Material, Scores, fitting, of_run};
use crate::data::{ingest, source};
use crate::error::{Context as _, Error, Result};
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
    windows_hash: &'a str,
    version: &'static str,
}

/// The run's own windows, whatever it is scored on, and those of them to which densities are fitted: the validation
/// part less what is scored. `None`, and a note, where they cannot be loaded.
fn for_densities<'a>(run: &'a Run, scored: &WindowSet<'_>) -> Result<Option<(WindowSet<'a>, Vec<WindowId>)>> {
    let loaded = run.windows().and_then(|own| Ok((run.split(&own)?, own)));
    let (split, own) = match loaded {
        Ok(loaded) => loaded,
        Err(stopped @ Error::Stopped { .. }) => return Err(stopped),
        Err(error) => {
            run.note(&format!("no densities: the recordings of the run cannot be used: {}", error.chain()));
            return Ok(None);
        }
    };
    let ids = fitting(&own, &split, Subset::Test).map_or_else(Vec::new, |(own, ids)| beside(own, ids, scored));
    Ok((!ids.is_empty()).then_some((own, ids)))
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
    let recordings = report.load(draft.path(), &run.machine)?;
    let (set, _) = WindowSet::cut(&recordings, &run.config.windows)?;
    let split = Split::all_test(&set);
    let words = "other recordings, all test".to_owned();
    let own = if run.config.evaluate.protocols.contains(&Protocol::Clean) { for_densities(run, &set)? } else { None };
    let fitting = own.as_ref().map(|(own, ids)| (own, &ids[..]));
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
