//! A run that starts from another one: what is taken over, and what both must have in common.

use std::fs;
use std::path::{Path, PathBuf};

use gnp_goal::GoalConfig;
use gnp_model::{Checkpoint, Component, FeatureConfig, Features, Origin};
use gnp_traj::TrajConfig;
use serde::Serialize;
use toml::Table;

use crate::config::{RunConfig, first_difference};
use crate::error::{Context as _, Result, bail};
use crate::run::folder::{RunFolder, Stage};
use crate::run::manifest::Need;

/// Folder of the copied files in a run that starts from another one.
pub(super) const FOLDER: &str = "origin";

/// Stages whose files are copied.
const COPIED: [Stage; 4] = [Stage::Modes, Stage::Goal, Stage::Attraction, Stage::Repulsion];

/// Names of the copied files, from the run folder.
pub(crate) fn files() -> Vec<String> {
    COPIED.iter().map(|stage| format!("{FOLDER}/{}.safetensors", stage.name())).collect()
}

/// A file that was copied from the run that the one in `folder` starts from; `None` where it starts from none.
pub(crate) fn file(folder: &RunFolder, stage: Stage) -> Option<PathBuf> {
    folder.state.origin.as_ref().map(|_| folder.path(FOLDER).join(format!("{}.safetensors", stage.name())))
}

/// The features that the networks were trained with from which the run in `folder` starts.
///
/// # Errors
/// When the copied file cannot be read.
pub(crate) fn features(folder: &RunFolder) -> Result<Option<Features>> {
    let Some(path) = file(folder, Stage::Goal) else { return Ok(None) };
    let checkpoint = Checkpoint::load(&path).with_context(|| path.display().to_string())?;
    checkpoint.header.expect(&path, Component::Goal, None)?;
    Ok(Some(checkpoint.header.features))
}

/// A trained run that another one can start from.
pub(crate) struct Finished {
    folder: RunFolder,
    config: RunConfig,
    place: PathBuf,
}

/// What two runs must have in common.
#[derive(Serialize)]
struct Form<'a> {
    windows: Windows,
    modes: Modes,
    features: &'a FeatureConfig,
    goal: &'a GoalConfig,
    traj: &'a TrajConfig,
}

#[derive(Serialize)]
struct Windows {
    observed_s: f64,
    predicted_s: f64,
    rate_hz: f64,
}

#[derive(Serialize)]
struct Modes {
    modes: usize,
}

fn form(config: &RunConfig) -> Result<Table> {
    let windows = &config.windows;
    let form = Form {
        windows: Windows { observed_s: windows.observed_s, predicted_s: windows.predicted_s, rate_hz: windows.rate_hz },
        modes: Modes { modes: config.modes.modes },
        features: &config.features,
        goal: &config.goal.net,
        traj: &config.traj,
    };
    Table::try_from(form).context("the configuration has no TOML form")
}

impl Finished {
    /// The run in `root`.
    ///
    /// # Errors
    /// When it is none, or one whose trainings are not all finished.
    pub(crate) fn open(root: &Path) -> Result<Self> {
        let cannot = || format!("cannot start from {}", root.display());
        let folder = RunFolder::whole(root, Need::Model).with_context(cannot)?;
        if let Some(stage) = COPIED.into_iter().find(|stage| !folder.has(*stage)) {
            bail!(
                Folder,
                "cannot start from {0}: its {1} is not finished; run `gnp train --run {0}` first",
                root.display(),
                stage.name()
            );
        }
        let config = RunConfig::read(&folder.path("config.toml"), &[]).with_context(cannot)?;
        let place = fs::canonicalize(root).with_context(cannot)?;
        Ok(Self { folder, config, place })
    }

    /// Copies what is taken over to the run folder `to`, whose configuration is `config`.
    ///
    /// # Errors
    /// When the two runs have another form, or a file cannot be copied.
    pub(crate) fn copy(&self, config: &RunConfig, to: &Path) -> Result<Origin> {
        if let Some((key, there, here)) = first_difference(&form(&self.config)?, &form(config)?) {
            bail!(
                Config,
                "cannot start from {}: `{key}` is {there} there and {here} here; its weights fit the same windows, features \
                 and networks alone, so give the same value",
                self.place.display()
            );
        }
        let place = to.join(FOLDER);
        fs::create_dir_all(&place).with_context(|| format!("cannot make the folder {}", place.display()))?;
        for stage in COPIED {
            let name = format!("{}.safetensors", stage.name());
            let from = self.folder.path(&name);
            gnp_file::copy(&from, &place.join(&name)).with_context(|| format!("cannot copy {}", from.display()))?;
        }
        Ok(Origin { folder: self.place.clone(), split_hash: self.folder.state.split_hash.clone() })
    }

    /// Whether the run in `run` starts from this one already.
    ///
    /// # Errors
    /// When it started from another one.
    pub(crate) fn expect(&self, before: &Origin, run: &Path) -> Result<()> {
        if before.folder != self.place {
            let (run, then) = (run.display(), before.folder.display());
            bail!(Folder, "{run} started from {then}, not from {}; take another --out", self.place.display());
        }
        Ok(())
    }
}
