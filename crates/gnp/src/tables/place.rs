//! Where a table is made: its folder, and a folder for each fold of its split.

use std::path::{Path, PathBuf};

use gnp_file::Lock;

use super::files::Scored;
use super::jobs;
use crate::config::{RunConfig, Setting};
use crate::error::{Context as _, Error, Result, bail};
use crate::machine::Machine;
use crate::run::Run;
use crate::run::draft::{occupied, sweep};
use crate::run::lock::alone;
use crate::stages::Plan;

/// What preparation writes of what a comparison was asked for, once all of its folds are prepared.
pub(super) const ASKED: &str = "table.toml";
/// Stem of the files of a comparison.
pub(super) const COMPARISON: &str = "table1";

/// A table being made.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Stem of its files.
    pub(super) stem: &'static str,
    pub(super) folder: PathBuf,
    /// Of the full model, as written.
    pub(super) config: RunConfig,
}

/// Whether everything in a folder is of a table, also of one that was interrupted before there was a model.
fn is_table(stem: &str, folder: &Path) -> Result<bool> {
    let cannot = || format!("cannot list {}", folder.display());
    let ours = [stem, ASKED, "fold-", "gnp", "jobs", "learned", "published", "variants", "differences.json", "."];
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let name = entry.with_context(cannot)?.file_name();
        if !ours.iter().any(|start| name.to_string_lossy().starts_with(start)) {
            return Ok(false);
        }
    }
    Ok(true)
}

impl Place {
    /// Refuses a folder in use unless it is to be resumed.
    ///
    /// # Errors
    /// When the folder is in use or of something else, or the plan has no configuration or one without folds.
    pub(super) fn start(stem: &'static str, plan: &Plan) -> Result<Self> {
        let Some(config) = plan.config.clone() else { bail!(Config, "a table needs a configuration") };
        if plan.from.is_some() {
            bail!(Config, "the systems of a table are trained on its windows alone; leave the run to start from out");
        }
        if config.split.folds == 0 {
            bail!(Config, "split.folds is 0; give 1 or more");
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
        // A prepared folder says what it is, whatever else people keep in it.
        let prepared = folder.join(ASKED).is_file();
        if in_use && !(prepared && stem == COMPARISON) && (prepared || !is_table(stem, &folder)?) {
            bail!(Folder, "{} is not the folder of such a table; take another --out", folder.display());
        }
        Ok(Self { stem, folder, config })
    }

    /// Folds of the split; each has its own models.
    pub(super) fn folds(&self) -> usize {
        self.config.split.folds
    }

    /// Where the models of a fold, from 1, are kept.
    pub(super) fn of_fold(&self, fold: usize) -> PathBuf {
        if self.folds() == 1 { self.folder.clone() } else { self.folder.join(format!("fold-{fold}")) }
    }

    /// The run of the full model of a fold, begun with recordings and split unless it is there.
    ///
    /// # Errors
    /// As [`Plan::begin`].
    pub(super) fn begin(&self, plan: &Plan, fold: usize, machine: &Machine) -> Result<Run> {
        let setting = Setting { key: "split.fold".to_owned(), text: fold.to_string() };
        let plan = Plan {
            config: Some(self.config.with(&[setting])?),
            out: self.of_fold(fold).join("gnp"),
            resume: true,
            ..plan.clone()
        };
        plan.begin(machine)
    }

    /// Keeps other processes from writing the table until the lock is dropped; waits for the one that does. Temporary files
    /// of killed ones go.
    ///
    /// # Errors
    /// As [`alone`].
    pub(super) fn alone(&self, machine: &Machine) -> Result<Lock> {
        let lock = alone(&self.folder.join(jobs::FOLDER).join("table.lock"), self.stem, machine)?;
        sweep(std::slice::from_ref(&self.folder), machine);
        Ok(lock)
    }

    /// What every fold got, as one.
    ///
    /// # Errors
    /// As `of_fold`.
    pub(super) fn pooled(&self, of_fold: impl Fn(usize) -> Result<Scored>) -> Result<Scored> {
        let first = of_fold(1)?;
        (2..=self.folds()).try_fold(first, |earlier, fold| earlier.pooled(of_fold(fold)?))
    }

    /// An error of this table: what was interrupted goes on from its folder.
    pub(super) fn error(&self, error: Error) -> Error {
        if error.is_stopped() { Error::Stopped { kept: Some(self.folder.clone()) } } else { error }
    }

    /// A fold in words, where there are several.
    pub(super) fn fold_words(&self, fold: usize) -> String {
        if self.folds() == 1 { String::new() } else { format!("fold {fold} of {}, ", self.folds()) }
    }
}
