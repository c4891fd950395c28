//! Runs that train in a second.

use std::path::Path;

use gnp::{Machine, Plan, Run, RunConfig};

/// The smoke configuration with one epoch of each training, and more settings.
pub(crate) fn config(more: &[&str]) -> RunConfig {
    let settings = ["data.max_recordings=3", "goal.epochs=1", "attraction.epochs=1", "repulsion.epochs=1"];
    let set: Vec<_> = settings.iter().chain(more).map(|text| text.parse().unwrap()).collect();
    RunConfig::embedded("smoke", &set).unwrap()
}

/// A run of it, trained.
#[allow(dead_code)] // not every test that has this module trains one so
pub(crate) fn trained(config: RunConfig, out: &Path) -> Run {
    let mut run = Plan::new(config, None, out).begin(&Machine::default()).unwrap();
    run.train().unwrap();
    run
}
