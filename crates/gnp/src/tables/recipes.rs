//! The neural baselines of a table: trained where they are not yet, by recipes from a file.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::error::{Context as _, Error, Result, bail};
use gnp_baselines::PlatoonRule;
use gnp_neural_baselines::{
    ColumnNetwork, ColumnRecipe, NeuralBaseline, NeuralBaselineError, OutputForm, Recipe, TrainedBaseline, Training,
    WithFuture,
};
use gnp_train::{BatchReport, Observer, TrainError};

use crate::evaluation::rules;
use crate::evaluation::systems::System;
use crate::progress::Work;
use crate::stages::Watch;
use crate::tables::Fold;

/// The recipes that come with the project.
const EMBEDDED: &str = include_str!("../../configs/neural-baselines.toml");

/// How neural baselines are trained, by baseline. Its TOML form is that of a file of recipes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Recipes {
    #[serde(rename = "column_network", skip_serializing_if = "Option::is_none")]
    column: Option<ColumnRecipe>,
    #[serde(flatten)]
    networks: BTreeMap<String, Trained>,
}

/// How one network is trained: one row for each form of output.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
struct Trained {
    forms: Vec<OutputForm>,
    #[serde(flatten)]
    recipe: Recipe,
}

/// The key of a network's table that is not of its recipe.
const FORMS: &str = "forms";

/// A published network in one form of output. Rows of one stem share their training.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    kind: NeuralBaseline,
    form: OutputForm,
    recipe: Recipe,
}

impl Row {
    /// Its name in tables.
    pub(crate) fn name(&self) -> &'static str {
        self.kind.name_in(self.form)
    }

    /// Of its files, and in the names of jobs.
    pub(crate) fn stem(&self) -> &'static str {
        self.kind.stem_in(self.form)
    }
}

impl Recipes {
    /// Those that come with the project.
    ///
    /// # Errors
    /// As [`Recipes::read`].
    pub fn embedded() -> Result<Self> {
        Self::parse(EMBEDDED).context("configs/neural-baselines.toml")
    }

    /// Reads a file of recipes.
    ///
    /// # Errors
    /// When it is not there, no TOML, or has a baseline or key that does not exist or cannot be used.
    pub fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        Self::parse(&text).with_context(|| path.display().to_string())
    }

    pub(super) fn parse(text: &str) -> Result<Self> {
        let config = |error: toml::de::Error| Error::Config(error.to_string().trim_end().to_owned());
        let mut tables: BTreeMap<String, toml::Table> = toml::from_str(text).map_err(config)?;
        let shared = tables.remove(SHARED).unwrap_or_default();
        let column = tables.remove(ColumnNetwork::STEM).map(toml::Table::try_into::<ColumnRecipe>).transpose();
        let column = column.map_err(config).with_context(|| format!("[{}]", ColumnNetwork::STEM))?;
        if let Some(recipe) = &column {
            recipe.check().with_context(|| format!("[{}]", ColumnNetwork::STEM))?;
        }
        let mut networks = BTreeMap::new();
        for (stem, own) in tables {
            if !NeuralBaseline::ALL.iter().any(|kind| kind.stem() == stem) {
                let stems = NeuralBaseline::ALL.iter().map(|kind| kind.stem());
                let known: Vec<&str> = [SHARED, ColumnNetwork::STEM].into_iter().chain(stems).collect();
                bail!(Config, "[{stem}]: no such baseline; there are {}", known.join(", "));
            }
            let mut keys = shared.clone();
            keys.extend(own);
            let forms = keys.remove(FORMS).map(toml::Value::try_into::<Vec<OutputForm>>).transpose();
            let mut forms = forms.map_err(config).with_context(|| format!("[{stem}] {FORMS}"))?.unwrap_or_default();
            forms.sort_unstable();
            forms.dedup();
            if forms.is_empty() {
                bail!(
                    Config,
                    "[{stem}]: {FORMS} names none; give published, deviation or both, or leave the table out"
                );
            }
            let recipe: Recipe = keys.try_into().map_err(config).with_context(|| format!("[{stem}]"))?;
            recipe.check().with_context(|| format!("[{stem}]"))?;
            networks.insert(stem, Trained { forms, recipe });
        }
        Ok(Self { column, networks })
    }

    /// The rows, in the order of a table.
    pub(crate) fn rows(&self) -> Vec<Row> {
        let networks = NeuralBaseline::ALL.into_iter().filter_map(|kind| Some((kind, self.networks.get(kind.stem())?)));
        let rows = networks.flat_map(|(kind, Trained { forms, recipe })| {
            forms.iter().map(move |form| Row { kind, form: *form, recipe: recipe.clone() })
        });
        rows.collect()
    }

    /// What a table without some of the baselines says of them.
    pub(crate) fn missing(&self) -> Vec<String> {
        let without = NeuralBaseline::ALL.into_iter().filter(|kind| !self.networks.contains_key(kind.stem()));
        let told = |name: &str, stem: &str| format!("{name}: has no recipe ([{stem}])");
        let column = self.column.is_none().then(|| told(ColumnNetwork::NAME, ColumnNetwork::STEM));
        column.into_iter().chain(without.map(|kind| told(kind.name(), kind.stem()))).collect()
    }

    /// The recipe of the column network.
    #[must_use]
    pub fn column(&self) -> Option<&ColumnRecipe> {
        self.column.as_ref()
    }
}

/// The table of keys that every published network has, unless its own says otherwise.
const SHARED: &str = "shared";

/// A published network, trained with `seed` added to that of its recipe in `folder` unless it was before.
///
/// # Errors
/// When the training fails; [`Error::Stopped`].
pub(crate) fn system(row: &Row, seed: u64, fold: &Fold<'_>, folder: &Path) -> Result<System> {
    let Fold { run, split, .. } = fold;
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let recipe = Recipe { seed: row.recipe.seed.wrapping_add(seed), ..row.recipe.clone() };
    let platoon = match row.form {
        OutputForm::Published => None,
        OutputForm::Deviation => Some(rules::platoon(run)?),
    };
    let data = training(fold, platoon.as_ref());
    let (kind, machine, name) = (row.kind, &run.machine, row.name());
    let watch = Watch::new(machine, name, recipe.epochs(split.train().len()));
    match TrainedBaseline::train(kind, &recipe, &data, folder, &machine.device, watch, machine.stop.flag()) {
        Err(NeuralBaselineError::Interrupted { .. }) => Err(Error::Stopped { kept: None }),
        Err(error) => Err(error).with_context(|| format!("{name} failed")),
        Ok(learned) if kind.uses_future() => Ok(System::oracle(name, OracleBaseline(learned))),
        Ok(learned) => Ok(System::predictor(name, learned)),
    }
}

fn training<'a>(fold: &Fold<'a>, reference: Option<&'a PlatoonRule>) -> Training<'a> {
    let Fold { set, split, .. } = fold;
    Training { set, train: split.train(), validation: split.validation(), split_hash: split.hash(), reference }
}

/// The column network, trained with `seed` added to that of its recipe in `folder` unless it was before.
///
/// # Errors
/// As [`system`].
pub(crate) fn column(recipe: &ColumnRecipe, seed: u64, fold: &Fold<'_>, folder: &Path) -> Result<System> {
    let Fold { run, split, .. } = fold;
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let recipe = ColumnRecipe { seed: recipe.seed.wrapping_add(seed), ..recipe.clone() };
    let platoon = rules::platoon(run)?;
    let data = training(fold, Some(&platoon));
    let machine = &run.machine;
    let batches = split.train().len().div_ceil(recipe.batch.max(1));
    let total = (2 * recipe.networks * recipe.epochs * batches) as u64;
    let steps = Steps { work: machine.progress.start(ColumnNetwork::NAME, 0, total, "batches"), done: 0 };
    match ColumnNetwork::train(&recipe, &data, folder, &machine.device, steps, machine.stop.flag()) {
        Err(NeuralBaselineError::Interrupted { .. }) => Err(Error::Stopped { kept: None }),
        Err(error) => Err(error).with_context(|| format!("{} failed", ColumnNetwork::NAME)),
        Ok(network) => Ok(System::predictor(ColumnNetwork::NAME, network)),
    }
}

/// Shows how many steps are done of several short trainings.
struct Steps {
    work: Box<dyn Work>,
    done: u64,
}

impl Observer for Steps {
    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        self.done += 1;
        self.work.at(self.done, &format!("loss {:.4}", report.loss));
        Ok(())
    }
}

/// A baseline that uses recorded futures, whole.
struct OracleBaseline(TrainedBaseline);

impl gnp_data::OraclePredictor for OracleBaseline {
    fn name(&self) -> &str {
        gnp_data::Predictor::name(&self.0)
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

    #[test]
    fn the_recipes_that_come_with_the_project_can_be_used() {
        let recipes = Recipes::embedded().unwrap();
        assert!(!recipes.rows().is_empty() && recipes.column().is_some());
        assert_eq!(Recipes::parse(&toml::to_string(&recipes).unwrap()).unwrap(), recipes);
        for line in EMBEDDED.lines().filter(|line| line.contains(" = ")) {
            assert!(line.starts_with('#') || line.contains(" # "), "no comment: {line}");
        }
    }

    #[test]
    fn a_baseline_or_key_that_does_not_exist_is_named() {
        let message = |text: &str| Recipes::parse(text).unwrap_err().chain();
        let text = EMBEDDED;
        assert!(message(&text.replacen("[cs_lstm]", "[cslstm]", 1)).contains("[cslstm]"));
        assert!(message(&text.replacen("\nsteps =", "\nstaps =", 1)).contains("steps"));
        assert!(message(&text.replacen("hidden =", "hide =", 1)).contains("hide"));
        assert!(message(&text.replacen("networks = 5", "networks = 0", 1)).contains("[column_network]"));
        assert!(message(&text.replacen("unit_m = 5.0", "unit_m = 0.0", 1)).contains("unit_m"));
    }
}
