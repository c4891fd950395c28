//! Tables of systems trained where they are not yet, and scored on the same windows: GNP beside rules and neural
//! baselines ([`PreparedTable`]), and GNP beside its ablations ([`ablate`]).
//!
//! A table has a folder: `gnp/` is the run of the full model, `learned/` has the neural baselines, `gnp-seed-1/`,
//! `learned-seed-1/` and so on the same with other seeds, `published/` is a run of the published model, `variants/` are
//! the runs of ablations, `jobs/` says which trainings are done. With a split into folds there is one such folder a fold,
//! `fold-1/` and so on, and every window is scored once, by models that were not trained on what is
//! kept together with it. What is trained there stays; a table that is started again with
//! `--resume` trains what is missing and scores everything anew.

mod asked;
mod comparison;
mod derived;
mod files;
mod fit;
mod jobs;
mod place;
mod printed;
mod published;
mod recipes;
mod variants;
mod workers;

use gnp_data::{Split, WindowSet};

pub use self::asked::CompareRequest;
pub use self::comparison::PreparedTable;
use self::files::{Report, Scored, write_report};
use self::fit::Fit;
pub use self::jobs::{JobReport, JobState};
use self::place::Place;
pub use self::recipes::Recipes;
use self::variants::{FULL, VARIANTS};
use crate::config::RunConfig;
use crate::error::Result;
use crate::evaluation::faithfulness::Measured;
use crate::evaluation::systems::System;
use crate::evaluation::{self, Material, remarks};
use crate::machine::Machine;
use crate::run::Run;
use crate::stages::{Plan, kinds};

/// One fold of a table: what its systems are trained on.
pub(crate) struct Fold<'a> {
    /// Recordings, split and fitted rules; of the full model, which need not be trained.
    pub(crate) run: &'a Run,
    /// All windows.
    pub(crate) set: &'a WindowSet<'a>,
    /// Their parts.
    pub(crate) split: &'a Split,
}

/// The ablations of GNP.
///
/// # Errors
/// As [`PreparedTable::gather`]; when a training fails.
pub fn ablate(plan: &Plan, machine: &Machine) -> Result<()> {
    let place = Place::start("table2", plan)?;
    let scored = place.pooled(|fold| ablated(&place, plan, fold, machine)).map_err(|error| place.error(error))?;
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
        one_seed: &[],
        printed: printed::table2(scored.run.config.dataset),
    };
    let _alone = place.alone(machine)?;
    write_report(&report, &scored, &place.folder)
}

/// What the variants got on one fold.
fn ablated(place: &Place, plan: &Plan, number: usize, machine: &Machine) -> Result<Scored> {
    let note = |row: usize, name: &str| {
        let (fold, rows) = (place.fold_words(number), VARIANTS.len());
        machine.progress.note(&format!("{}: {fold}{row} of {rows}, {name}", place.stem));
    };
    note(1, FULL);
    let mut run = place.begin(plan, number, machine)?;
    run.train()?;
    scored_fold(run, 1, false, |fold, _| {
        let run = fold.run;
        // As written: a run has its seed added to the parts' own.
        let config = RunConfig::read(&run.folder.path("config.toml"), &[])?;
        let mut systems = Vec::new();
        for (done, variant) in VARIANTS.iter().enumerate() {
            if variant.left_out(run.path(), &config)?.is_some() {
                continue;
            }
            let folder = match variant.folder(&config) {
                None => run.path().to_owned(),
                Some(name) => {
                    note(done + 1, variant.name);
                    let folder = place.of_fold(number).join("variants").join(name);
                    let mut run = variant.start(&run.folder, &folder, machine)?;
                    variant.redo.iter().try_for_each(|stage| run.perform(*stage))?;
                    folder
                }
            };
            systems.push(variant.system(&folder, &variant.changed(run.path())?, &run.machine.device)?);
        }
        Ok(systems)
    })
}

/// Scores the systems of a fold, those of each seed in turn: seed 0 has them all, further ones some of them. `fitted`
/// asks for errors on training windows, too.
fn scored_fold(
    run: Run,
    seeds: usize,
    fitted: bool,
    systems: impl Fn(&Fold<'_>, usize) -> Result<Vec<System>>,
) -> Result<Scored> {
    let set = run.windows()?;
    let split = run.split(&set)?;
    let fold = Fold { run: &run, set: &set, split: &split };
    let fit = |systems: &[System]| if fitted { Fit::measure(&fold, systems) } else { Ok(Fit::default()) };
    let (config, machine) = (&run.config.evaluate, &run.machine);
    let words = format!("{}{}", kinds(split.kinds()), remarks(&split, config.subset));
    let fitting = evaluation::fitting(&set, &split, config.subset);
    let material =
        Material { set: &set, ids: split.subset(config.subset), split: words, fitting, data: &run.folder.state.data };
    let first = systems(&fold, 0)?;
    let mut evaluation = evaluation::evaluate(&material, &first, config, machine)?;
    let faithfulness = Measured::of_systems(&material, &first, machine)?;
    let mut errors = fit(&first)?;
    for further in 1..seeds {
        let more = systems(&fold, further)?;
        evaluation = evaluation.with_seed(evaluation::evaluate(&material, &more, config, machine)?)?;
        errors = errors.with(fit(&more)?);
    }
    let words = material.split;
    drop(set);
    Ok(Scored::new(&first, (evaluation, faithfulness, errors), words, &split, run))
}
