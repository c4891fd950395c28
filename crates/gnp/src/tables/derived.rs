//! Runs that learn something else than another run on the same windows: ablations, and further seeds.
//!
//! Such a run has a folder of its own, which starts as a copy of the other's with only the stages left
//! to do that the change reaches: recordings and split, and with them the windows, stay the same.

use std::fs;
use std::path::Path;

use crate::config::RunConfig;
use crate::error::{Context as _, Result};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::draft::{Draft, occupied};
use crate::run::folder::{RunFolder, RunState, Stage, write, write_state};
use crate::run::manifest::RunFile;

/// The stages that learn.
pub(super) const TRAINED: [Stage; 4] = [Stage::Modes, Stage::Goal, Stage::Attraction, Stage::Repulsion];

/// The run of `config` on the windows of the run `full`, in `place`: started there with the stages `redo`, which its
/// differences reach, left to do unless it is there. Of `full` only what they need must be finished: for [`TRAINED`] its
/// recordings and split.
///
/// # Errors
/// When it cannot be made, or was made of another configuration.
pub(super) fn beside(
    full: &RunFolder,
    config: &RunConfig,
    redo: &[Stage],
    place: &Path,
    machine: &Machine,
) -> Result<Run> {
    if !occupied(place)? {
        let draft = Draft::start(place, "remove it", machine)?;
        let mut files = full.state.files.clone();
        let copied = copy(full, redo, draft.path())?;
        files.retain(|name, _| copied.contains(name));
        let own = "config.toml";
        write(&draft.path().join(own), config.to_toml()?.as_bytes())?;
        let kept = |stage: &Stage| !redo.contains(stage) && *stage < Stage::Evaluate;
        let finished = full.state.finished.clone().into_iter().filter(|(stage, _)| kept(stage)).collect();
        let mut state = RunState { finished, files, seed: config.seed, ..full.state.clone() };
        state.record(draft.path(), Stage::Ingest, [own.to_owned()])?;
        write_state(draft.path(), &state)?;
        draft.publish_run()?;
    }
    let run = Run::resume(place, machine)?;
    let earlier = RunConfig::read(&run.folder.path("config.toml"), &[])?;
    config.expect_same(&earlier, place)?;
    Ok(run)
}

/// Copies what a new run takes over, and returns its names: recordings, split, fitted rules, and the weights of stages
/// that are not done anew.
fn copy(full: &RunFolder, redo: &[Stage], to: &Path) -> Result<Vec<String>> {
    let weights: Vec<String> = TRAINED
        .into_iter()
        .filter(|stage| !redo.contains(stage))
        .map(|stage| format!("{}.safetensors", stage.name()))
        .collect();
    let of_ingest = |(name, file): (&String, &RunFile)| file.stage == Stage::Ingest && name != "config.toml";
    let files = full.state.files.iter().filter(|it| of_ingest(*it) || weights.contains(it.0));
    let names: Vec<String> = files.map(|(name, _)| name.clone()).collect();
    for name in &names {
        let (from, to) = (full.path(name), to.join(name));
        let cannot = || format!("cannot copy {}", from.display());
        fs::create_dir_all(to.parent().unwrap_or(&to)).with_context(cannot)?;
        // Nobody writes into a finished file, so one on the disk is enough where links are possible.
        if fs::hard_link(&from, &to).is_err() {
            gnp_file::copy(&from, &to).with_context(cannot)?;
        }
    }
    Ok(names)
}
