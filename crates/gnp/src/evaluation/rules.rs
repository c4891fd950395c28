//! The predictors without a network, fitted to a run's training windows and kept with the run.

use std::collections::BTreeMap;
use std::fs;

use gnp_baselines::{Parameters, PlatoonParameters, PlatoonRule, RULES, Rule};
use gnp_data::Window;
use serde::{Deserialize, Serialize};

use super::systems::System;
use crate::error::{Context as _, Error, Result};
use crate::run::Run;
use crate::run::folder::write_json;

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

/// Every rule as fitted to the run's training windows: now, and from `rules.json` from then on.
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
    let path = run.folder.path(FILE);
    if path.exists() {
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let kept: Fitted =
            serde_json::from_str(&text).with_context(|| format!("{} is damaged; remove it", path.display()))?;
        let complete = RULES.iter().all(|rule| kept.rules.contains_key(rule.name()));
        if complete && kept.split_hash == run.folder.state.split_hash {
            return Ok(kept);
        }
    }
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
    let fitted = Fitted { split_hash: split.hash().to_owned(), rules };
    write_json(&path, &fitted)?;
    Ok(fitted)
}
