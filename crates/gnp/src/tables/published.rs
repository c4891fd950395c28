//! The row of GNP as published: its own sizes, features, goals and recipe, on the windows of the table.

use std::path::Path;

use gnp_data::Dataset;

use crate::config::{PredictConfig, RunConfig};
use crate::error::{Result, bail};
use crate::run::Run;
use crate::tables::derived::{TRAINED, beside};

/// Its row.
pub(crate) const NAME: &str = "GNP as published";

/// Refuses a configuration of the published model for other data than `dataset`.
///
/// # Errors
/// Names both.
pub(crate) fn check(published: &RunConfig, dataset: Dataset) -> Result<()> {
    if published.dataset != dataset {
        bail!(Config, "{NAME}: its configuration is for {}, not for {dataset}", published.dataset);
    }
    Ok(())
}

/// The run of the model that `published` describes, in `place`, on the windows of the run `full`; trained unless it
/// was before.
///
/// # Errors
/// When the configuration is for other data or its training fails.
pub(crate) fn trained(published: &RunConfig, full: &Run, place: &Path) -> Result<Run> {
    let written = RunConfig::read(&full.folder.path("config.toml"), &[])?;
    check(published, written.dataset)?;
    let config = on_the_same_windows(published, &written);
    let mut run = beside(&full.folder, &config, &TRAINED, place, &full.machine)?;
    run.train()?;
    Ok(run)
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
