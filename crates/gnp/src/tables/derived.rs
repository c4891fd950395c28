//! Runs that learn something else than another run on the same windows: ablations, and further seeds.
//!
//! Such a run has a folder of its own, which starts as a copy of the other's with only the stages left
//! to do that the change reaches: recordings and split, and with them the windows, stay the same.

use std::fs;
use std::path::{Path, PathBuf};

use crate::config::RunConfig;
use crate::data::ingest::RECORDINGS;
use crate::error::{Context as _, Result};
use crate::evaluation::rules;
use crate::machine::Machine;
use crate::run::Run;
use crate::run::folder::{Draft, RunFolder, RunState, Stage, occupied, write, write_state};

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
        let draft = Draft::start(place, "remove it")?;
        copy(full, redo, draft.path())?;
        write(&draft.path().join("config.toml"), config.to_toml()?.as_bytes())?;
        let kept = |stage: &Stage| !redo.contains(stage) && *stage < Stage::Evaluate;
        let finished = full.state.finished.clone().into_iter().filter(|(stage, _)| kept(stage)).collect();
        write_state(draft.path(), &RunState { finished, seed: config.seed, ..full.state.clone() })?;
        draft.publish()?;
    }
    let folder = RunFolder::open(place)?;
    let earlier = RunConfig::read(&folder.path("config.toml"), &[])?;
    config.expect_same(&earlier, place)?;
    Ok(Run::new(folder, config, machine))
}

/// What a new run takes over: recordings, split, fitted rules, and the files of stages that are not done anew.
fn copy(full: &RunFolder, redo: &[Stage], to: &Path) -> Result<()> {
    let mut files: Vec<PathBuf> = ["ingest.json", "ingest.txt", "split.json"].map(PathBuf::from).into();
    // The rules are fitted to the training windows, which are the same; without the file they are fitted again.
    files.extend(Some(PathBuf::from(rules::FILE)).filter(|file| full.path(file).exists()));
    let kept = TRAINED.into_iter().filter(|stage| !redo.contains(stage));
    files.extend(kept.map(|stage| PathBuf::from(format!("{}.safetensors", stage.name()))));
    let recordings = Path::new(RECORDINGS);
    let from = full.path(recordings);
    let cannot = |path: &Path| format!("cannot copy {}", path.display());
    fs::create_dir(to.join(recordings)).with_context(|| cannot(&from))?;
    for entry in fs::read_dir(&from).with_context(|| cannot(&from))? {
        files.push(recordings.join(entry.with_context(|| cannot(&from))?.file_name()));
    }
    for file in files {
        let (from, to) = (full.path(&file), to.join(&file));
        // Nobody writes into a finished file, so one on the disk is enough where links are possible.
        if fs::hard_link(&from, &to).is_err() {
            fs::copy(&from, &to).with_context(|| cannot(&from))?;
        }
    }
    Ok(())
}
