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

use crate::config::RunConfig;
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
    /// Those that come with the project. Augmentations and sampling by site, where the recipes do not say them, are those of
    /// the goal network in `config`.
    ///
    /// # Errors
    /// As [`Recipes::read`].
    pub fn embedded(config: &RunConfig) -> Result<Self> {
        Self::parse(EMBEDDED, &as_goals(config)).context("configs/neural-baselines.toml")
    }

    /// Reads a file of recipes; as [`Recipes::embedded`].
    ///
    /// # Errors
    /// When it is not there, no TOML, or has a baseline or key that does not exist or cannot be used.
    pub fn read(path: &Path, config: &RunConfig) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        Self::parse(&text, &as_goals(config)).with_context(|| path.display().to_string())
    }

    /// Reads recipes of which none leaves anything to a configuration.
    pub(super) fn parse_whole(text: &str) -> Result<Self> {
        Self::parse(text, &toml::Table::new())
    }

    fn parse(text: &str, defaults: &toml::Table) -> Result<Self> {
        let config = |error: toml::de::Error| Error::Config(error.to_string().trim_end().to_owned());
        let mut tables: BTreeMap<String, toml::Table> = toml::from_str(text).map_err(config)?;
        let mut shared = defaults.clone();
        shared.extend(tables.remove(SHARED).unwrap_or_default());
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
            if stem == NeuralBaseline::PipInformed.stem() && forms.contains(&OutputForm::Deviation) {
                // How much is believed would be fitted with recorded plans, and used with plans of constant velocity.
                bail!(Config, "[{stem}]: {FORMS} can only be published; [pip_no_plan] has both");
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
        let told = |name: &str, stem: &str| format!("{name}: has no recipe ([{stem}])");
        let mut missing = Vec::new();
        if self.column.is_none() {
            missing.push(told(ColumnNetwork::NAME, ColumnNetwork::STEM));
        }
        for kind in NeuralBaseline::ALL {
            let Some(Trained { forms, .. }) = self.networks.get(kind.stem()) else {
                missing.push(told(kind.name(), kind.stem()));
                continue;
            };
            let without =
                [OutputForm::Published, OutputForm::Deviation].into_iter().filter(|form| !forms.contains(form));
            let reason = |form| format!("{}: its recipe leaves it out ([{}] {FORMS})", kind.name_in(form), kind.stem());
            missing.extend(without.map(reason));
        }
        missing
    }

    /// Stems of what is trained by these recipes and not, or otherwise, by `others`.
    pub(super) fn differing(&self, others: &Self) -> Vec<&'static str> {
        let (own, theirs) = (self.rows(), others.rows());
        let mut stems: Vec<&str> = own.iter().filter(|row| !theirs.contains(row)).map(Row::stem).collect();
        if self.column.is_some() && self.column != others.column {
            stems.push(ColumnNetwork::STEM);
        }
        stems
    }

    /// The recipe of the column network.
    #[must_use]
    pub fn column(&self) -> Option<&ColumnRecipe> {
        self.column.as_ref()
    }
}

/// The keys of a recipe that are GNP's unless the recipe says otherwise: everybody sees windows as its goal network does.
fn as_goals(config: &RunConfig) -> toml::Table {
    let goal = &config.goal;
    let keys = [
        ("mirror", goal.loss.mirror),
        ("longitudinal_scale", goal.loss.longitudinal_scale),
        ("site_sampling_exponent", goal.train.site_sampling_exponent),
    ];
    keys.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect()
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
        let config = RunConfig::embedded("ngsim", &[]).unwrap();
        let recipes = Recipes::embedded(&config).unwrap();
        // Augmentations are those of the goal network.
        let recipe = &recipes.networks["cs_lstm"].recipe;
        assert_eq!(
            (recipe.mirror, recipe.longitudinal_scale),
            (config.goal.loss.mirror, config.goal.loss.longitudinal_scale)
        );
        assert_eq!(recipe.site_sampling_exponent, config.goal.train.site_sampling_exponent);
        assert!(!recipes.rows().is_empty() && recipes.column().is_some());
        assert_eq!(Recipes::parse_whole(&toml::to_string(&recipes).unwrap()).unwrap(), recipes);
        assert!(recipes.differing(&recipes).is_empty());
        let mut other = recipes.clone();
        other.networks.get_mut("cs_lstm").unwrap().recipe.steps += 1;
        other.networks.remove("stdan");
        let stems = ["cs_lstm", "cs_lstm_deviation", "stdan", "stdan_deviation"];
        assert_eq!(recipes.differing(&other), stems);
        assert_eq!(other.differing(&recipes), stems[..2]);
        assert!(other.missing().contains(&"STDAN: has no recipe ([stdan])".to_owned()));
        for line in EMBEDDED.lines().filter(|line| line.contains(" = ")) {
            assert!(line.starts_with('#') || line.contains(" # "), "no comment: {line}");
        }
    }

    #[test]
    fn a_baseline_or_key_that_does_not_exist_is_named() {
        let defaults = as_goals(&RunConfig::embedded("ngsim", &[]).unwrap());
        let message = |text: &str| Recipes::parse(text, &defaults).unwrap_err().chain();
        let text = EMBEDDED;
        assert!(message(&text.replacen("[cs_lstm]", "[cslstm]", 1)).contains("[cslstm]"));
        assert!(message(&text.replacen("\nsteps =", "\nstaps =", 1)).contains("steps"));
        assert!(message(&text.replacen("hidden =", "hide =", 1)).contains("hide"));
        assert!(message(&text.replacen("networks = 5", "networks = 0", 1)).contains("[column_network]"));
        assert!(Recipes::parse_whole(text).unwrap_err().chain().contains("site_sampling_exponent"));
        let with_plan = text.replacen("\n[pip_no_plan]", "\n[pip]", 1);
        assert!(message(&with_plan).contains("[pip_no_plan] has both"));
        assert!(message(&text.replacen("unit_m = 5.0", "unit_m = 0.0", 1)).contains("unit_m"));
    }
}
