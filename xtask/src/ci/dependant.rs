//! A crate outside the workspace that depends on gnp-model: it builds on stable Rust, without our
//! settings, and compiles neither kmeans nor polars.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use gnp_cli::Terminal;

use super::{Step, step};
use crate::workspace;

/// What who only loads a model must not need: one asks for an unstable compiler, the other takes minutes.
const STRANGERS: [&str; 2] = ["kmeans", "polars"];

const PROGRAM: &str = r#"//! Loads a model and predicts.

use std::path::Path;

use gnp_data::{Forecast, Observation, Predictor};
use gnp_model::{Device, Gnp, NeighbourFuture};

fn futures(run: &Path, observations: &[Observation<'_>]) -> Result<Vec<Forecast>, Box<dyn std::error::Error>> {
    let gnp = Gnp::load(run, NeighbourFuture::ConstantVelocity, &Device::Cpu)?;
    Ok(gnp.predict(observations, 6)?)
}

fn main() {
    if let Err(error) = futures(Path::new("run"), &[]) {
        println!("{error}");
    }
}
"#;

/// Makes such a crate in a temporary folder and checks it.
///
/// # Errors
/// When it does not build, or needs one of [`STRANGERS`].
pub(super) fn run(root: &Path, terminal: &Terminal) -> Result<()> {
    let workspace = workspace::read(root)?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let write = |name: &str, text: &str| {
        fs::write(folder.path().join(name), text).with_context(|| format!("cannot write {name} of the dependant"))
    };
    let of = |name: &str, rest: &str| format!("{name} = {{ path = {:?}{rest} }}\n", root.join("crates").join(name));
    write(
        "Cargo.toml",
        &format!(
            "[package]\nname = \"dependant\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n{}{}",
            of("gnp-data", ", default-features = false"),
            of("gnp-model", "")
        ),
    )?;
    fs::create_dir(folder.path().join("src")).context("cannot make a folder of the dependant")?;
    write("src/main.rs", PROGRAM)?;
    // The same versions as ours; cargo drops what is not needed.
    let lock = folder.path().join("Cargo.lock");
    fs::copy(root.join("Cargo.lock"), &lock).context("cannot copy Cargo.lock")?;
    // A folder of its own: what was compiled under another RUSTC_BOOTSTRAP would be compiled anew.
    let target = workspace.target_directory.join("dependant");
    let target = target.to_str().context("the folder of compiled files has a name that is not text")?;
    let arguments = ["check", "--target-dir", target];
    step(folder.path(), terminal, &Step { name: "dependant", arguments: &arguments, environment: &[] })?;
    let locked = fs::read_to_string(&lock).context("cannot read Cargo.lock of the dependant")?;
    if let Some(name) = STRANGERS.iter().find(|name| locked.contains(&format!("name = \"{name}\""))) {
        bail!("ci: who depends on gnp-model alone compiles {name}; put it behind a feature");
    }
    Ok(())
}
