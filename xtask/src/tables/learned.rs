//! The learned baselines of a table: trained where they are not yet, by recipes from a file.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use gnp_neural_baselines::{NeuralBaseline, NeuralBaselineError, Recipe, TrainedBaseline, Training, WithFuture};

use crate::stop::{Interrupted, STOP};
use crate::tables::Fold;
use crate::tables::systems::System;
use crate::training::Watch;

/// Recipes by file stem of the baseline.
pub(crate) type Recipes = BTreeMap<String, Recipe>;

/// Reads a file of recipes.
///
/// # Errors
/// When it is not there, no TOML, or has a baseline or key that does not exist or cannot be used.
pub(crate) fn read(path: &Path) -> Result<Recipes> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    parse(&text).with_context(|| path.display().to_string())
}

fn parse(text: &str) -> Result<Recipes> {
    let recipes: Recipes = toml::from_str(text).map_err(|error| anyhow::anyhow!("{}", error.to_string().trim_end()))?;
    for (stem, recipe) in &recipes {
        if !NeuralBaseline::ALL.iter().any(|kind| kind.stem() == stem) {
            let known: Vec<&str> = NeuralBaseline::ALL.iter().map(|kind| kind.stem()).collect();
            bail!("[{stem}]: no such baseline; there are {}", known.join(", "));
        }
        recipe.check().with_context(|| format!("[{stem}]"))?;
    }
    Ok(recipes)
}

/// A baseline, trained in `folder` unless it was before.
///
/// # Errors
/// When the training fails; [`Interrupted`].
pub(crate) fn system(kind: NeuralBaseline, recipe: &Recipe, fold: &Fold<'_>, folder: &Path) -> Result<System> {
    let Fold { session, set, split, .. } = fold;
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let recipe = Recipe { seed: recipe.seed.wrapping_add(session.config.seed), ..recipe.clone() };
    let data = Training { set, train: split.train(), validation: split.validation(), split_hash: split.hash() };
    let watch = Watch::new(session.terminal(), kind.name(), recipe.epochs());
    match TrainedBaseline::train(kind, &recipe, &data, folder, &session.machine.device, watch, &STOP) {
        Err(NeuralBaselineError::Interrupted { .. }) => Err(Interrupted.into()),
        Err(error) => Err(anyhow::Error::new(error).context(format!("{} failed", kind.name()))),
        Ok(learned) if kind.uses_future() => Ok(System::oracle(kind.name(), OracleBaseline(learned))),
        Ok(learned) => Ok(System::predictor(kind.name(), learned)),
    }
}

/// A baseline that goes by recorded futures, whole.
struct OracleBaseline(TrainedBaseline);

impl gnp_data::OraclePredictor for OracleBaseline {
    fn name(&self) -> &str {
        self.0.kind().name()
    }

    fn predict_with_future(
        &self,
        windows: &[gnp_data::Window<'_>],
        k: usize,
    ) -> Result<Vec<gnp_data::Forecast>, gnp_data::PredictError> {
        let informed: WithFuture<'_> = self.0.with_future().ok_or_else(|| gnp_data::PredictError::Model {
            model: self.0.kind().name().to_owned(),
            source: "takes no recorded future".into(),
        })?;
        informed.predict_with_future(windows, k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project;

    fn embedded() -> String {
        fs::read_to_string(project::root().join("configs/neural-baselines.toml")).unwrap()
    }

    #[test]
    fn the_recipes_that_come_with_the_project_can_be_used() {
        assert!(!parse(&embedded()).unwrap().is_empty());
        for line in embedded().lines().filter(|line| line.contains(" = ")) {
            assert!(line.starts_with('#') || line.contains(" # "), "no comment: {line}");
        }
    }

    #[test]
    fn a_baseline_or_key_that_does_not_exist_is_named() {
        let message = |text: &str| format!("{:#}", parse(text).unwrap_err());
        let text = embedded();
        assert!(message(&text.replacen("[cs_lstm]", "[cslstm]", 1)).contains("[cslstm]"));
        assert!(message(&text.replacen("decay =", "decoy =", 1)).contains("decoy"));
        assert!(message(&text.replacen("unit_m = 5.0", "unit_m = 0.0", 1)).contains("unit_m"));
    }
}
