//! The ablations of GNP as data, and how each comes by its model.
//!
//! A variant that learns nothing else than the full model is read from the full model's folder. One
//! that does has a folder of its own, which starts as a copy of the full model's with only the stages
//! that the change reaches left to do: the split, and with it the windows, stays the same.

use std::path::Path;

use crate::error::Result;
use crate::evaluation::systems::System;
use crate::machine::Machine;
use crate::run::Run;
use candle_core::Device;
use gnp_model::{Checkpoint, Gnp, NeighbourFuture, NeighbourInput, ReferencePath};
use gnp_modes::Modes;

use crate::config::{RunConfig, Setting};
use crate::run::folder::{RunFolder, Stage};
use crate::tables::derived::{TRAINED, beside};

/// One row of the ablation table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variant {
    /// Its row.
    pub(crate) name: &'static str,
    /// What it learns or predicts differently.
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
    /// Keys and their values; the first one names the folder.
    Keys(&'static [(&'static str, &'static str)]),
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

#[derive(Clone, Copy, Debug, PartialEq)]
enum Input {
    /// The past, neighbours as configured.
    Past,
    /// The past, neighbours as forecast by the same force.
    Joint,
    /// The recorded paths of the neighbours.
    Neighbours,
    /// The recorded last position.
    Goal,
}

/// The full model's row.
pub(crate) const FULL: &str = "gnp";

const GOALS: &[Stage] = &[Stage::Modes, Stage::Goal];
const GOAL_NETWORK: &[Stage] = &[Stage::Goal];
const FORCES: &[Stage] = &[Stage::Attraction, Stage::Repulsion];
const REPULSION: &[Stage] = &[Stage::Repulsion];
const ALL: &[Stage] = &TRAINED;

const ONE_MODE: Change = Change::Keys(&[("modes.modes", "1")]);
/// Neighbours behind their leaders need the platoon as reference: they fall back with it.
const STRAIGHT_REFERENCE: Change =
    Change::Keys(&[("features.reference", "constant_velocity"), ("predict.neighbours", "constant_velocity")]);

const fn variant(name: &'static str, change: Change, redo: &'static [Stage], force: Force, input: Input) -> Variant {
    Variant { name, change, redo, force, input }
}

/// A row that changes the configuration and nothing else.
const fn key(name: &'static str, keys: &'static [(&'static str, &'static str)], redo: &'static [Stage]) -> Variant {
    variant(name, Change::Keys(keys), redo, Force::Full, Input::Past)
}

/// All rows. "No modes" is a single mode, the mean future of the training part: one token that carries
/// nothing but its place in the network, hence one goal made of the observation alone.
pub(crate) const VARIANTS: [Variant; 20] = [
    variant(FULL, Change::Nothing, &[], Force::Full, Input::Past),
    variant("reference: constant velocity", STRAIGHT_REFERENCE, ALL, Force::Full, Input::Past),
    key("no platoon hint", &[("features.car_following_features", "false")], GOAL_NETWORK),
    key("one vehicle ahead", &[("features.vehicles_ahead", "1")], GOAL_NETWORK),
    key("sees who is behind and beside", &[("features.neighbours", "all")], GOAL_NETWORK),
    key("no mean in the loss", &[("goal.mean_weight", "0.0")], GOAL_NETWORK),
    key("selection: medoids", &[("predict.selection", "medoids")], &[]),
    key("full trust in the network", &[("predict.trust", "1.0")], &[]),
    variant("no repulsion", Change::Nothing, &[], Force::Attraction, Input::Past),
    variant("no modes", ONE_MODE, GOALS, Force::Full, Input::Past),
    variant("no modes, no repulsion", ONE_MODE, GOALS, Force::Attraction, Input::Past),
    key("neighbours at constant velocity", &[("predict.neighbours", "constant_velocity")], REPULSION),
    variant("joint neighbours", Change::Nothing, &[], Force::Full, Input::Joint),
    variant(
        "oracle neighbours",
        Change::Keys(&[("predict.neighbours", "oracle")]),
        REPULSION,
        Force::Full,
        Input::Neighbours,
    ),
    variant("true goal", Change::Nothing, &[], Force::Full, Input::Goal),
    key("explicit Euler", &[("traj.integrator", "explicit")], FORCES),
    key("no lines", &[("traj.lines", "false")], FORCES),
    variant("a quarter of the modes", Change::ModesTimes(0.25), GOALS, Force::Full, Input::Past),
    variant("half of the modes", Change::ModesTimes(0.5), GOALS, Force::Full, Input::Past),
    variant("twice the modes", Change::ModesTimes(2.), GOALS, Force::Full, Input::Past),
];

impl Variant {
    /// The folder below `variants` of those that have one; rows that learn the same share it.
    pub(crate) fn folder(&self, config: &RunConfig) -> Option<String> {
        let settings = self.settings(config);
        let Setting { key, text } = settings.first().filter(|_| !self.redo.is_empty())?;
        Some(format!("{}-{text}", key.replace('.', "-")))
    }

    fn settings(&self, config: &RunConfig) -> Vec<Setting> {
        let set = |key: &str, text: String| Setting { key: key.to_owned(), text };
        match self.change {
            Change::Nothing => Vec::new(),
            Change::Keys(keys) => keys.iter().map(|(key, value)| set(key, (*value).to_owned())).collect(),
            Change::ModesTimes(factor) => {
                let modes = ((config.modes.modes as f64 * factor).round() as usize).max(1);
                vec![set("modes.modes", modes.to_string())]
            }
        }
    }

    /// The configuration of the full model in the folder `full`, changed.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn changed(&self, full: &Path) -> Result<RunConfig> {
        let path = full.join("config.toml");
        let config = RunConfig::read(&path, &[])?;
        RunConfig::read(&path, &self.settings(&config))
    }

    /// Why the row is not in the table of this full model, if it is not: it would repeat the full model's, or cannot be.
    pub(crate) fn left_out(&self, full: &Path, config: &RunConfig) -> Result<Option<&'static str>> {
        let platoon = config.features.reference == ReferencePath::Platoon;
        let joint = config.predict.neighbours == NeighbourInput::Joint;
        if self.input == Input::Joint && (platoon || joint) {
            let why = if platoon { "vehicles of a platoon follow each other already" } else { SAME };
            return Ok(Some(why));
        }
        // The first key is what the row is about; others only go with it.
        let settings = self.settings(config);
        let Some(first) = settings.get(..1) else { return Ok(None) };
        Ok((RunConfig::read(&full.join("config.toml"), first)? == *config).then_some(SAME))
    }

    /// The variant's run in `place`, started from the full model's folder unless it is there.
    ///
    /// # Errors
    /// When it cannot be made, or was made of another model.
    pub(crate) fn start(&self, full: &RunFolder, place: &Path, machine: &Machine) -> Result<Run> {
        beside(full, &self.changed(full.root())?, self.redo, place, machine)
    }

    /// The row, from the folder of its model and its configuration.
    ///
    /// # Errors
    /// When the model cannot be read.
    pub(crate) fn system(&self, folder: &Path, changed: &RunConfig, device: &Device) -> Result<System> {
        let neighbours = match self.input {
            Input::Joint => NeighbourFuture::Joint,
            Input::Past | Input::Neighbours | Input::Goal => changed.predict.neighbours.without_future(),
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
        let predict = &changed.predict;
        let gnp = gnp.selecting(predict.selection).trusting(predict.trust)?.with_precision(predict.precision)?;
        Ok(match self.input {
            Input::Past | Input::Joint => System::predictor(self.name, gnp),
            Input::Neighbours => System::oracle(self.name, gnp.oracle()),
            Input::Goal => System::oracle(self.name, gnp.true_goal()),
        })
    }
}

const SAME: &str = "the configuration is like that";

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    fn ngsim() -> RunConfig {
        RunConfig::embedded("ngsim", &[]).unwrap()
    }

    #[test]
    fn rows_have_names_and_folders_of_their_own_and_settings_that_exist() {
        let config = ngsim();
        let names: BTreeSet<&str> = VARIANTS.iter().map(|variant| variant.name).collect();
        assert_eq!(names.len(), VARIANTS.len());
        let mut places = BTreeMap::new();
        for variant in &VARIANTS {
            let settings = variant.settings(&config);
            RunConfig::embedded("ngsim", &settings).unwrap();
            assert_eq!(variant.folder(&config).is_some(), !variant.redo.is_empty(), "{}", variant.name);
            if let Some(place) = variant.folder(&config) {
                let (same, redo) = places.entry(place.clone()).or_insert((settings.clone(), variant.redo));
                assert!(*same == settings && *redo == variant.redo, "{place}");
            }
        }
    }

    /// What is done anew must be everything that reads the key, and nothing is done twice.
    #[test]
    fn a_change_reaches_the_stages_that_read_its_key() {
        let config = ngsim();
        for variant in &VARIANTS {
            let reads = |key: &str| -> &'static [Stage] {
                match key {
                    // Who is shown to the goal network, and whether the platoon is: no other network sees either.
                    "goal.mean_weight" | "features.vehicles_ahead" | "features.neighbours" => GOAL_NETWORK,
                    "features.car_following_features" => GOAL_NETWORK,
                    // What futures are counted from, and the frame that the force drives in.
                    "features.reference" => ALL,
                    "predict.neighbours" => REPULSION,
                    // Read when there is a model.
                    "predict.selection" | "predict.trust" => &[],
                    key if key.starts_with("modes.") => GOALS,
                    key if key.starts_with("traj.") => FORCES,
                    key => panic!("{key}"),
                }
            };
            let keys = variant.settings(&config);
            let reached: BTreeSet<Stage> = keys.iter().flat_map(|setting| reads(&setting.key)).copied().collect();
            assert_eq!(variant.redo, reached.into_iter().collect::<Vec<_>>(), "{}", variant.name);
        }
    }

    #[test]
    fn rows_that_learn_the_same_share_a_folder() {
        let config = ngsim();
        let folder = |name: &str| VARIANTS.iter().find(|v| v.name == name).unwrap().folder(&config);
        assert_eq!(folder("no modes"), folder("no modes, no repulsion"));
        assert_eq!(folder("no modes").as_deref(), Some("modes-modes-1"));
        assert_eq!(folder("true goal"), None);
        assert_eq!(folder("selection: medoids"), None);
        assert_ne!(folder("explicit Euler"), folder("no lines"));
    }

    #[test]
    fn a_row_that_cannot_be_or_would_repeat_the_full_model_is_left_out() {
        let out = tempfile::TempDir::new().unwrap();
        let left_out = |settings: &[&str]| -> BTreeMap<&str, &str> {
            let settings: Vec<Setting> = settings.iter().map(|text| text.parse().unwrap()).collect();
            let config = RunConfig::embedded("ngsim", &settings).unwrap();
            std::fs::write(out.path().join("config.toml"), config.to_toml().unwrap()).unwrap();
            let why = |variant: &Variant| Some((variant.name, variant.left_out(out.path(), &config).unwrap()?));
            VARIANTS.iter().filter_map(why).collect()
        };
        let names = |settings: &[&str]| left_out(settings).into_keys().collect::<Vec<_>>();
        // What is asked about is fixed; the rest of the embedded configuration may change.
        let names =
            |settings: &[&str]| names(&[settings, &["features.neighbours=ahead", "predict.trust=0.5"]].concat());
        assert_eq!(names(&["features.reference=platoon", "predict.neighbours=platoon"]), ["joint neighbours"]);
        let straight = ["features.reference=constant_velocity", "predict.neighbours=constant_velocity"];
        assert_eq!(names(&straight), ["neighbours at constant velocity", "reference: constant velocity"]);
        let joint = ["features.reference=constant_velocity", "predict.neighbours=joint", "traj.lines=false"];
        assert_eq!(names(&joint), ["joint neighbours", "no lines", "reference: constant velocity"]);
    }
}
