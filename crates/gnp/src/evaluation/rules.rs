//! The predictors without a network, fitted to a run's training windows and kept with the run.

use std::collections::BTreeMap;

use gnp_baselines::{Parameters, PlatoonParameters, PlatoonRule, RULES, Rule};
use gnp_data::Window;
use serde::{Deserialize, Serialize};

use super::systems::System;
use crate::error::{Context as _, Error, Result};
use crate::run::Run;
use crate::run::folder::{Stage, write_json};

/// File of the fitted parameters in a run folder.
pub(crate) const FILE: &str = "rules.json";

/// Name of the rule that others are set beside.
pub(crate) const CONSTANT_VELOCITY: &str = "constant velocity";

/// Most training windows of a site that rules are fitted to; of more, every n-th is taken.
const MOST: usize = 2000;

/// `rules.json`: parameters by the name of the rule, and the split whose training windows they were fitted to.
#[derive(Debug, Serialize, Deserialize)]
struct Fitted {
    split_hash: String,
    rules: BTreeMap<String, Parameters>,
}

/// Fits the rules to the run's training windows and keeps them in `rules.json`, from which they are taken from then on;
/// unless they are there.
///
/// # Errors
/// When a rule cannot be fitted or the file cannot be written.
pub(crate) fn keep(run: &mut Run) -> Result<()> {
    if kept(run)?.is_some() {
        return Ok(());
    }
    run.writing(|run| {
        write_json(&run.folder.path(FILE), &fit(run)?)?;
        run.folder.record(Stage::Ingest, [FILE.to_owned()])?;
        run.folder.write()
    })
}

/// Every rule as fitted to the run's training windows: from `rules.json`, or now where they were not kept.
///
/// # Errors
/// When a rule cannot be fitted or the file cannot be used.
pub(crate) fn systems(run: &Run) -> Result<Vec<System>> {
    let fitted = fitted(run)?;
    let system = |rule: &Rule| -> Result<System> {
        let parameters = fitted.rules.get(rule.name()).unwrap_or(&Parameters::Null);
        let predictor = rule.load(parameters).with_context(|| unusable(run))?;
        Ok(System::boxed(rule.name(), predictor))
    };
    RULES.iter().map(system).collect()
}

/// Constant velocity as fitted to the run's training windows.
///
/// # Errors
/// As [`systems`].
pub(crate) fn constant_velocity(run: &Run) -> Result<System> {
    let found = systems(run)?.into_iter().find(|system| system.name() == CONSTANT_VELOCITY);
    found.ok_or_else(|| Error::Folder(unusable(run)))
}

/// The car-following rule as fitted to the run's training windows.
///
/// # Errors
/// As [`systems`].
pub(crate) fn platoon(run: &Run) -> Result<PlatoonRule> {
    let fitted = fitted(run)?;
    let parameters = fitted.rules.get(PlatoonRule::NAME).cloned().unwrap_or_default();
    let parameters = PlatoonParameters::deserialize(parameters);
    let cannot = || unusable(run);
    PlatoonRule::new(parameters.with_context(cannot)?).with_context(cannot)
}

/// Said of a file that some other version wrote, or a person changed.
fn unusable(run: &Run) -> String {
    format!("{} cannot be used; remove it, and the rules are fitted again", run.folder.path(FILE).display())
}

fn fitted(run: &Run) -> Result<Fitted> {
    match kept(run)? {
        Some(kept) => Ok(kept),
        None => fit(run).with_context(|| format!("no rules in {} and they cannot be fitted", run.path().display())),
    }
}

/// What is in `rules.json`, where it is a file of the run and has every rule of this version.
fn kept(run: &Run) -> Result<Option<Fitted>> {
    if !run.folder.state.files.contains_key(FILE) {
        return Ok(None);
    }
    let kept: Fitted = run.folder.read_json(FILE)?;
    let complete = RULES.iter().all(|rule| kept.rules.contains_key(rule.name()));
    Ok(Some(kept).filter(|kept| complete && kept.split_hash == run.folder.state.split_hash))
}

fn fit(run: &Run) -> Result<Fitted> {
    let set = run.windows()?;
    let split = run.split(&set)?;
    let mut by_site: BTreeMap<&str, Vec<Window<'_>>> = BTreeMap::new();
    for window in split.train().iter().filter_map(|id| set.get(*id)) {
        by_site.entry(window.observation().site()).or_default().push(window);
    }
    let thinned = |windows: &Vec<Window<'_>>| windows.len().div_ceil(MOST).max(1);
    let training: Vec<Window<'_>> =
        by_site.values().flat_map(|windows| windows.iter().copied().step_by(thinned(windows))).collect();
    let mut rules = BTreeMap::new();
    for rule in RULES {
        rules.insert(rule.name().to_owned(), rule.fit(&training).with_context(|| rule.name())?);
    }
    Ok(Fitted { split_hash: split.hash().to_owned(), rules })
}
