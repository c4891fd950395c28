//! The ablations of GNP as data, and how each comes by its model.
//!
//! A variant that learns nothing else than the full model is read from the full model's folder. One
//! that does has a folder of its own, which starts as a copy of the full model's with only the stages
//! that the change reaches left to do: the split, and with it the windows, stays the same.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Context as _, Result};
use crate::evaluation::systems::System;
use crate::machine::Machine;
use crate::run::Run;
use candle_core::Device;
use gnp_model::{Checkpoint, Gnp, NeighbourFuture};
use gnp_modes::Modes;

use crate::config::{RunConfig, Setting};
use crate::data::ingest::RECORDINGS;
use crate::run::folder::{Draft, RunFolder, RunState, Stage, occupied, write, write_state};

/// One row of the ablation table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variant {
    /// Its row.
    pub(crate) name: &'static str,
    /// What it learns differently.
    pub(crate) change: Change,
    /// Stages that the change reaches.
    pub(crate) redo: &'static [Stage],
    /// The part of the force that drives.
    force: Force,
    /// Which recorded future it is given, if any, and where its neighbours go.
    input: Input,
}

/// What a variant changes in the configuration.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Change {
    /// Nothing.
    Nothing,
    /// A key and its value.
    Key(&'static str, &'static str),
    /// The number of modes, by a factor.
    ModesTimes(f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Force {
    /// Attraction of the goal and repulsion of vehicles and lines.
    Full,
    /// Attraction alone.
    Attraction,
}

#[derive(Clone, Copy, Debug)]
enum Input {
    /// The past; neighbours as said.
    Past(NeighbourFuture),
    /// The recorded paths of the neighbours.
    Neighbours,
    /// The recorded last position.
    Goal,
}

/// The full model's row.
pub(crate) const FULL: &str = "gnp";

const GOALS: &[Stage] = &[Stage::Modes, Stage::Goal];
const FORCES: &[Stage] = &[Stage::Attraction, Stage::Repulsion];
const STRAIGHT: Input = Input::Past(NeighbourFuture::ConstantVelocity);

const fn variant(name: &'static str, change: Change, redo: &'static [Stage], force: Force, input: Input) -> Variant {
    Variant { name, change, redo, force, input }
}

/// All rows. "No modes" is a single mode, the mean future of the training part: one token that carries
/// nothing but its place in the network, hence one goal made of the observation alone.
pub(crate) const VARIANTS: [Variant; 12] = [
    variant(FULL, Change::Nothing, &[], Force::Full, STRAIGHT),
    variant("no repulsion", Change::Nothing, &[], Force::Attraction, STRAIGHT),
    variant("no modes", Change::Key("modes.modes", "1"), GOALS, Force::Full, STRAIGHT),
    variant("no modes, no repulsion", Change::Key("modes.modes", "1"), GOALS, Force::Attraction, STRAIGHT),
    variant("joint neighbours", Change::Nothing, &[], Force::Full, Input::Past(NeighbourFuture::Joint)),
    variant(
        "oracle neighbours",
        Change::Key("predict.neighbours", "oracle"),
        &[Stage::Repulsion],
        Force::Full,
        Input::Neighbours,
    ),
    variant("true goal", Change::Nothing, &[], Force::Full, Input::Goal),
    variant("explicit Euler", Change::Key("traj.integrator", "explicit"), FORCES, Force::Full, STRAIGHT),
    variant("no lines", Change::Key("traj.lines", "false"), FORCES, Force::Full, STRAIGHT),
    variant("a quarter of the modes", Change::ModesTimes(0.25), GOALS, Force::Full, STRAIGHT),
    variant("half of the modes", Change::ModesTimes(0.5), GOALS, Force::Full, STRAIGHT),
    variant("twice the modes", Change::ModesTimes(2.), GOALS, Force::Full, STRAIGHT),
];

impl Variant {
    /// The folder below `variants` of those that have one; rows that learn the same share it.
    pub(crate) fn folder(&self, config: &RunConfig) -> Option<String> {
        let Setting { key, text } = self.setting(config)?;
        Some(format!("{}-{text}", key.replace('.', "-")))
    }

    fn setting(&self, config: &RunConfig) -> Option<Setting> {
        let (key, text) = match self.change {
            Change::Nothing => return None,
            Change::Key(key, value) => (key, value.to_owned()),
            Change::ModesTimes(factor) => {
                ("modes.modes", ((config.modes.modes as f64 * factor).round() as usize).max(1).to_string())
            }
        };
        Some(Setting { key: key.to_owned(), text })
    }

    /// Whether the configuration is like that already: the row would repeat the full model's.
    pub(crate) fn is_the_full_model(&self, full: &Path, config: &RunConfig) -> Result<bool> {
        let Some(setting) = self.setting(config) else { return Ok(false) };
        Ok(RunConfig::read(&full.join("config.toml"), &[setting])? == *config)
    }

    /// The variant's run in `place`, started from the full model's folder unless it is there.
    ///
    /// # Errors
    /// When it cannot be made, or was made of another model.
    pub(crate) fn start(&self, full: &RunFolder, config: &RunConfig, place: &Path, machine: &Machine) -> Result<Run> {
        let settings: Vec<Setting> = self.setting(config).into_iter().collect();
        let changed = RunConfig::read(&full.path("config.toml"), &settings)?;
        if !occupied(place)? {
            let draft = Draft::start(place, "remove it")?;
            copy(full, self.redo, draft.path())?;
            write(&draft.path().join("config.toml"), changed.to_toml()?.as_bytes())?;
            let kept = |stage: &Stage| !self.redo.contains(stage) && *stage < Stage::Evaluate;
            let finished = full.state.finished.clone().into_iter().filter(|(stage, _)| kept(stage)).collect();
            write_state(draft.path(), &RunState { finished, ..full.state.clone() })?;
            draft.publish()?;
        }
        let folder = RunFolder::open(place)?;
        let earlier = RunConfig::read(&folder.path("config.toml"), &[])?;
        changed.expect_same(&earlier, place)?;
        Ok(Run::new(folder, &changed, machine))
    }

    /// The row, from the folder of its model.
    ///
    /// # Errors
    /// When the model cannot be read.
    pub(crate) fn system(&self, folder: &Path, config: &RunConfig, device: &Device) -> Result<System> {
        let neighbours = match self.input {
            Input::Past(neighbours) => neighbours,
            Input::Neighbours | Input::Goal => NeighbourFuture::ConstantVelocity,
        };
        let gnp = match self.force {
            Force::Full => Gnp::load(folder, neighbours, device)?,
            Force::Attraction => {
                let modes = Modes::load(&folder.join("modes.safetensors"))?;
                let goal = Checkpoint::load(&folder.join("goal.safetensors"))?;
                let force = Checkpoint::load(&folder.join("attraction.safetensors"))?;
                Gnp::new(modes, &goal, Some(&force), neighbours, device)?
            }
        };
        let gnp = gnp.selecting(config.predict.selection).trusting(config.predict.trust)?;
        Ok(match self.input {
            Input::Past(_) => System::predictor(self.name, gnp),
            Input::Neighbours => System::oracle(self.name, gnp.oracle()),
            Input::Goal => System::oracle(self.name, gnp.true_goal()),
        })
    }
}

/// What a new variant takes over: recordings, split, and the files of stages that are not done anew.
fn copy(full: &RunFolder, redo: &[Stage], to: &Path) -> Result<()> {
    let mut files: Vec<PathBuf> = ["ingest.json", "ingest.txt", "split.json"].map(PathBuf::from).into();
    let trained = [Stage::Modes, Stage::Goal, Stage::Attraction, Stage::Repulsion];
    let kept = trained.into_iter().filter(|stage| !redo.contains(stage));
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn ngsim() -> RunConfig {
        RunConfig::embedded("ngsim", &[]).unwrap()
    }

    #[test]
    fn rows_have_names_of_their_own_and_settings_that_exist() {
        let config = ngsim();
        let names: BTreeSet<&str> = VARIANTS.iter().map(|variant| variant.name).collect();
        assert_eq!(names.len(), VARIANTS.len());
        for variant in &VARIANTS {
            let settings: Vec<Setting> = variant.setting(&config).into_iter().collect();
            assert_eq!(settings.is_empty(), variant.redo.is_empty(), "{}", variant.name);
            RunConfig::embedded("ngsim", &settings).unwrap();
        }
    }

    /// What is done anew must be everything that reads the key, and nothing is done twice.
    #[test]
    fn a_change_reaches_the_stages_that_read_its_key() {
        let config = ngsim();
        for variant in &VARIANTS {
            let reads = match variant.setting(&config).map(|setting| setting.key) {
                None => &[][..],
                Some(key) if key.starts_with("modes.") => GOALS,
                Some(key) if key.starts_with("traj.") => FORCES,
                Some(key) if key == "predict.neighbours" => &[Stage::Repulsion],
                Some(key) => panic!("{key}"),
            };
            assert_eq!(variant.redo, reads, "{}", variant.name);
        }
    }

    #[test]
    fn rows_that_learn_the_same_share_a_folder() {
        let config = ngsim();
        let folder = |name: &str| VARIANTS.iter().find(|v| v.name == name).unwrap().folder(&config);
        assert_eq!(folder("no modes"), folder("no modes, no repulsion"));
        assert_eq!(folder("no modes").as_deref(), Some("modes-modes-1"));
        assert_eq!(folder("true goal"), None);
        assert_ne!(folder("explicit Euler"), folder("no lines"));
    }
}
