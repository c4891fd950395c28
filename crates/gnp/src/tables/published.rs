//! The row of GNP as published: its own sizes, features, goals and recipe, on the windows of the table.

use std::path::Path;

use crate::config::{PredictConfig, RunConfig};
use crate::error::{Result, bail};
use crate::evaluation::systems::System;
use crate::run::folder::Stage;
use crate::tables::Fold;
use crate::tables::derived::beside;

/// Its row.
pub(crate) const NAME: &str = "GNP as published";

/// The model that `published` describes, trained in `place` on the windows of `fold` unless it was before.
///
/// # Errors
/// When the configuration is for other data or its training fails.
pub(crate) fn system(published: &RunConfig, fold: &Fold<'_>, place: &Path) -> Result<System> {
    let full = fold.run;
    let written = RunConfig::read(&full.folder.path("config.toml"), &[])?;
    if published.dataset != written.dataset {
        bail!(Config, "{NAME}: its configuration is for {}, not for {}", published.dataset, written.dataset);
    }
    let config = on_the_same_windows(published, &written);
    let trained = [Stage::Modes, Stage::Goal, Stage::Attraction, Stage::Repulsion];
    let mut run = beside(&full.folder, &config, &trained, place, &full.machine)?;
    trained.into_iter().try_for_each(|stage| run.perform(stage))?;
    Ok(System::predictor(NAME, run.model()?))
}

/// `published` with the recordings, windows, split, seed and evaluation of the table's run.
fn on_the_same_windows(published: &RunConfig, written: &RunConfig) -> RunConfig {
    let RunConfig { seed, data, windows, split, evaluate, .. } = written.clone();
    let predict = PredictConfig { k: written.predict.k, ..published.predict.clone() };
    RunConfig { seed, data, windows, split, evaluate, predict, ..published.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_windows_are_the_tables_and_the_model_is_the_published_one() {
        let [published, written] = ["paper/ngsim", "ngsim"].map(|name| RunConfig::embedded(name, &[]).unwrap());
        let config = on_the_same_windows(&published, &written);
        assert_eq!((&config.windows, &config.split), (&written.windows, &written.split));
        assert_eq!(
            (&config.goal, &config.traj, &config.features),
            (&published.goal, &published.traj, &published.features)
        );
        assert_eq!(config.predict.selection, published.predict.selection);
        assert!(!config.traj.lines, "the published code has no lines");
        // What is written reads again: the futures asked for are among those of the protocols.
        assert_eq!(config.with(&[]).unwrap(), config);
    }
}
