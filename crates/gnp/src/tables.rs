//! Tables of systems trained where they are not yet, and scored on the same windows: GNP beside rules and neural
//! baselines ([`compare`]), and GNP beside its ablations ([`ablate`]).
//!
//! A table has a folder: `gnp/` is the run of the full model, `gnp-seed-1/` and so on the same with other
//! seeds, `learned/` has the neural baselines, `published/` is a run of the published model, `variants/` are the runs of
//! ablations. With a split into folds there is one such folder a fold,
//! `fold-1/` and so on, and every window is scored once, by models that were not trained on what is
//! kept together with it. What is trained there stays; a table that is started again with
//! `--resume` trains what is missing and scores everything anew.

mod derived;
mod files;
mod printed;
mod published;
mod recipes;
mod variants;

use std::path::{Path, PathBuf};

use gnp_baselines::RULES;
use gnp_data::{Split, WindowSet};
use gnp_eval::Evaluation;
use gnp_neural_baselines::{ColumnNetwork, NeuralBaseline};

use self::derived::beside;
use self::files::{Report, Scored, write_report};
pub use self::recipes::Recipes;
use self::variants::{FULL, VARIANTS};
use crate::config::{RunConfig, Setting};
use crate::error::{Context as _, Error, Result, bail};
use crate::evaluation::faithfulness::Measured;
use crate::evaluation::systems::System;
use crate::evaluation::{self, Material, remarks, rules};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::folder::{Stage, occupied};
use crate::stages::{Plan, kinds};

/// GNP, the rules and the neural baselines that have a recipe, on the same windows; GNP as published, too, where
/// `published` is the configuration that says how it is trained. GNP is trained with `seeds` seeds, that of the
/// configuration and those after it: its row is the mean over them, and intervals draw them.
///
/// # Errors
/// When there is no seed, or a training or an evaluation fails; [`Error::Stopped`] with the table's folder.
pub fn compare(
    plan: &Plan,
    recipes: &Recipes,
    seeds: usize,
    published: Option<&RunConfig>,
    machine: &Machine,
) -> Result<()> {
    let kinds: Vec<NeuralBaseline> =
        NeuralBaseline::ALL.into_iter().filter(|kind| recipes.get(*kind).is_some()).collect();
    let mut missing = Vec::new();
    if published.is_none() {
        missing.push(format!("{}: is trained where --published asks for it", published::NAME));
    }
    if recipes.column().is_none() {
        missing.push(format!("{}: has no recipe ([{}])", ColumnNetwork::NAME, ColumnNetwork::STEM));
    }
    let without = NeuralBaseline::ALL.into_iter().filter(|kind| !kinds.contains(kind));
    missing.extend(without.map(|kind| format!("{}: has no recipe ([{}])", kind.name(), kind.stem())));
    let total = 2 + RULES.len() + usize::from(published.is_some()) + usize::from(recipes.column().is_some());
    let table = Table::start("table1", plan, machine, (total + recipes.rows().len(), seeds))?;
    let scored = table.scored(|fold| {
        let gnp = fold.run.model()?;
        let goal_head = System::predictor("goal head", gnp.goal_head());
        let mut systems = vec![System::gnp(FULL, gnp), goal_head];
        systems.extend(rules::systems(fold.run)?);
        let learned = fold.folder.join("learned");
        if let Some(recipe) = recipes.column() {
            fold.progress(systems.len() + 1, ColumnNetwork::NAME);
            systems.push(recipes::column(recipe, fold, &learned)?);
        }
        for row in recipes.rows() {
            fold.progress(systems.len() + 1, &row.name());
            let Some(recipe) = recipes.get(row.kind) else { continue };
            systems.push(recipes::system(row, recipe, fold, &learned)?);
        }
        if let Some(config) = published {
            fold.progress(systems.len() + 1, published::NAME);
            systems.push(published::system(config, fold, &fold.folder.join("published"))?);
        }
        Ok(systems)
    })?;
    let report = Report {
        stem: "table1",
        title: "Table 1: all systems on the same windows",
        about: "Every system was trained and scored here. Below stand the figures that the papers print, which rest \
                on other windows, other splits and in part on other quantities.",
        ours: FULL,
        missing: &missing,
        seeds,
        printed: printed::table1(scored.run.config.dataset),
    };
    write_report(&report, &scored, &table.folder)
}

/// The ablations of GNP.
///
/// # Errors
/// As [`compare`].
pub fn ablate(plan: &Plan, machine: &Machine) -> Result<()> {
    let table = Table::start("table2", plan, machine, (VARIANTS.len(), 1))?;
    let scored = table.scored(|fold| {
        let run = fold.run;
        // As written: a run has its seed added to the parts' own.
        let config = RunConfig::read(&run.folder.path("config.toml"), &[])?;
        let mut systems = Vec::new();
        for (done, variant) in VARIANTS.iter().enumerate() {
            if variant.left_out(run.path(), &config)?.is_some() {
                continue;
            }
            let place = match variant.folder(&config) {
                None => run.path().to_owned(),
                Some(name) => {
                    fold.progress(done + 1, variant.name);
                    let place = fold.folder.join("variants").join(name);
                    let mut run = variant.start(&run.folder, &place, machine)?;
                    variant.redo.iter().try_for_each(|stage| run.perform(*stage))?;
                    place
                }
            };
            systems.push(variant.system(&place, &variant.changed(run.path())?, &run.machine.device)?);
        }
        Ok(systems)
    })?;
    let config = RunConfig::read(&scored.run.folder.path("config.toml"), &[])?;
    let mut missing = Vec::new();
    for variant in &VARIANTS {
        if let Some(why) = variant.left_out(scored.run.path(), &config)? {
            missing.push(format!("{}: {why}", variant.name));
        }
    }
    let report = Report {
        stem: "table2",
        title: "Table 2: what the parts of GNP do",
        about: "Each row changes one thing in the full model (first row); parts that the change does not reach are \
                shared. *No modes* is a single mode, the mean future, hence one goal made of the observation alone.",
        ours: FULL,
        missing: &missing,
        seeds: 1,
        printed: printed::table2(scored.run.config.dataset),
    };
    write_report(&report, &scored, &table.folder)
}

/// A table being made.
struct Table<'a> {
    stem: &'static str,
    folder: PathBuf,
    plan: &'a Plan,
    /// As written.
    config: RunConfig,
    machine: &'a Machine,
    /// Systems of a fold, for progress.
    systems: usize,
    /// Seeds that the full model is trained with.
    seeds: usize,
}

/// One fold of a table being made: what its systems are trained on.
pub(crate) struct Fold<'a> {
    /// The run of the full model.
    pub(crate) run: &'a Run,
    /// All windows.
    pub(crate) set: &'a WindowSet<'a>,
    /// Their parts.
    pub(crate) split: &'a Split,
    /// Where the models of this fold are kept.
    folder: PathBuf,
    table: &'a Table<'a>,
    /// From 1.
    number: usize,
}

impl Fold<'_> {
    fn progress(&self, number: usize, name: &str) {
        self.table.note(self.number, number, name);
    }
}

/// Whether everything in a folder is of a table, also of one that was interrupted before there was a model.
fn is_table(stem: &str, folder: &Path) -> Result<bool> {
    let cannot = || format!("cannot list {}", folder.display());
    let ours = [stem, "fold-", "gnp", "learned", "published", "variants", "differences.json", "."];
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let name = entry.with_context(cannot)?.file_name();
        if !ours.iter().any(|start| name.to_string_lossy().starts_with(start)) {
            return Ok(false);
        }
    }
    Ok(true)
}

impl<'a> Table<'a> {
    /// Refuses a folder in use unless it is to be resumed.
    fn start(
        stem: &'static str,
        plan: &'a Plan,
        machine: &'a Machine,
        (systems, seeds): (usize, usize),
    ) -> Result<Self> {
        if seeds == 0 {
            bail!(Config, "a table needs at least one seed");
        }
        let Some(config) = plan.config.clone() else { bail!(Config, "a table needs a configuration") };
        if plan.from.is_some() {
            bail!(Config, "the systems of a table are trained on its windows alone; leave the run to start from out");
        }
        let folder = plan.out.clone();
        let in_use = occupied(&folder)?;
        if in_use && !plan.resume {
            bail!(
                Folder,
                "{} exists and is not empty; go on with it by --resume, or take another --out",
                folder.display()
            );
        }
        if in_use && !is_table(stem, &folder)? {
            bail!(Folder, "{} is not the folder of a table; take another --out", folder.display());
        }
        Ok(Self { stem, folder, plan, config, machine, systems, seeds })
    }

    /// Folds of the split; each has its own models.
    fn folds(&self) -> usize {
        self.config.split.folds
    }

    /// Where the models of a fold are kept.
    fn fold_folder(&self, fold: usize) -> PathBuf {
        if self.folds() == 1 { self.folder.clone() } else { self.folder.join(format!("fold-{fold}")) }
    }

    /// Makes the systems of every fold and scores each on its fold's windows.
    fn scored(&self, systems: impl Fn(&Fold<'_>) -> Result<Vec<System>>) -> Result<Scored> {
        let mut scored: Option<Scored> = None;
        for number in 1..=self.folds() {
            let of_fold = self.fold(number, &systems).map_err(|error| {
                if error.is_stopped() { Error::Stopped { kept: Some(self.folder.clone()) } } else { error }
            })?;
            scored = Some(match scored {
                None => of_fold,
                Some(earlier) => earlier.pooled(of_fold)?,
            });
        }
        match scored {
            Some(scored) => Ok(scored),
            None => bail!(Config, "split.folds is 0; give 1 or more"),
        }
    }

    fn fold(&self, number: usize, systems: &impl Fn(&Fold<'_>) -> Result<Vec<System>>) -> Result<Scored> {
        self.note(number, 1, FULL);
        let folder = self.fold_folder(number);
        let setting = Setting { key: "split.fold".to_owned(), text: number.to_string() };
        let plan = Plan {
            config: Some(self.config.with(&[setting])?),
            out: folder.join("gnp"),
            resume: true,
            ..self.plan.clone()
        };
        let mut run = plan.begin(self.machine)?;
        run.train()?;
        let set = run.windows()?;
        let split = run.split(&set)?;
        let fold = Fold { run: &run, set: &set, split: &split, folder, table: self, number };
        let systems = systems(&fold)?;
        let config = &run.config.evaluate;
        let words = format!("{}{}", kinds(split.kinds()), remarks(&split, config.subset));
        let material = Material {
            set: &set,
            ids: split.subset(config.subset),
            fitting: evaluation::fitting(&set, &split, config.subset),
            split: words,
            data: &run.folder.state.data,
        };
        let mut evaluation = evaluation::evaluate(&material, &systems, config, self.machine)?;
        for further in 1..self.seeds {
            evaluation = evaluation.with_seed(self.of_seed(&fold, further, &material)?)?;
        }
        let faithfulness = Measured::of_systems(&material, &systems, self.machine)?;
        let words = material.split;
        drop(set);
        Ok(Scored::new(&systems, (evaluation, faithfulness), words, &split, run))
    }

    /// What the full model gets that is trained with the `further`-th seed after that of the configuration.
    fn of_seed(&self, fold: &Fold<'_>, further: usize, material: &Material<'_>) -> Result<Evaluation> {
        let seed = self.config.seed.wrapping_add(further as u64);
        self.note(fold.number, self.systems + further, &format!("{FULL}, seed {seed}"));
        let setting = Setting { key: "seed".to_owned(), text: seed.to_string() };
        let redo = [Stage::Modes, Stage::Goal, Stage::Attraction, Stage::Repulsion];
        let place = fold.folder.join(format!("gnp-seed-{seed}"));
        let config = RunConfig::read(&fold.run.folder.path("config.toml"), &[setting])?;
        let mut run = beside(&fold.run.folder, &config, &redo, &place, self.machine)?;
        run.train()?;
        evaluation::evaluate(
            material,
            &[System::predictor(FULL, run.model()?)],
            &fold.run.config.evaluate,
            self.machine,
        )
    }

    fn note(&self, fold: usize, number: usize, name: &str) {
        let fold = if self.folds() == 1 { String::new() } else { format!("fold {fold} of {}, ", self.folds()) };
        self.machine.progress.note(&format!(
            "{}: {fold}{number} of {}, {name}",
            self.stem,
            self.systems + self.seeds - 1
        ));
    }
}
