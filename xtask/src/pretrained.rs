//! The weights that come with the program: trained and exported anew, or compared with the committed ones.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use gnp::{ExportRequest, Machine, Plan, RunConfig};
use gnp_model::ModelFolder;

use crate::project;

/// Trains `configs/pretrained/NAME.toml` and exports it; puts it in place of `models/NAME`, or compares every byte.
///
/// # Errors
/// When a stage fails; with `check`, when a file differs, naming it.
pub(crate) fn run(check: bool, machine: &Machine) -> Result<()> {
    let root = project::root();
    for name in gnp_pretrained::NAMES {
        let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
        let (run, made) = (scratch.path().join("run"), scratch.path().join("model"));
        let config = RunConfig::embedded(&format!("pretrained/{name}"), &[])?;
        Plan::new(config, None, &run).begin(machine)?.train()?;
        let card = Some(root.join(format!("configs/pretrained/{name}-card.toml")));
        let request = ExportRequest { run, out: made.clone(), name: Some(name.to_owned()), card };
        gnp::export(&request, machine)?;
        let place = root.join("models").join(name);
        if check {
            compare(&made, &place)?
        } else {
            replace(&made, &place)?
        }
        let done = if check { "is what its configuration makes, byte for byte" } else { "was made anew" };
        machine.progress.result(&format!("models/{name} {done}"));
    }
    Ok(())
}

/// Names of the files of a model folder.
fn files() -> impl Iterator<Item = &'static str> {
    ModelFolder::FILES.into_iter().chain(["card.json", "README.md"])
}

fn compare(made: &Path, place: &Path) -> Result<()> {
    let read = |path: &Path| fs::read(path).with_context(|| format!("cannot read {}", path.display()));
    let mut differ = Vec::new();
    for name in files() {
        if read(&made.join(name))? != read(&place.join(name))? {
            differ.push(name);
        }
    }
    if differ.is_empty() {
        return Ok(());
    }
    bail!(
        "{}: {} differ from what is made now; `cargo xtask pretrained` makes them anew",
        place.display(),
        differ.join(", ")
    )
}

fn replace(made: &Path, place: &Path) -> Result<()> {
    fs::create_dir_all(place).with_context(|| format!("cannot make the folder {}", place.display()))?;
    for name in files() {
        let to = place.join(name);
        gnp_file::copy(&made.join(name), &to).with_context(|| format!("cannot write {}", to.display()))?;
    }
    Ok(())
}
