//! The packages of the workspace, as cargo tells them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// What `cargo metadata --no-deps` tells, as far as it is needed here.
#[derive(Debug, Deserialize)]
pub(crate) struct Workspace {
    /// The members.
    pub(crate) packages: Vec<Package>,
    /// Where cargo puts what it makes.
    #[serde(default)]
    pub(crate) target_directory: PathBuf,
}

/// A member.
#[derive(Debug, Deserialize)]
pub(crate) struct Package {
    /// Its name.
    pub(crate) name: String,
    /// What it depends on.
    pub(crate) dependencies: Vec<Dependency>,
    /// Its features, each with what it switches on.
    #[serde(default)]
    pub(crate) features: BTreeMap<String, Vec<String>>,
    /// Its `Cargo.toml`.
    #[serde(default)]
    pub(crate) manifest_path: PathBuf,
}

/// A dependency of a member.
#[derive(Debug, Deserialize)]
pub(crate) struct Dependency {
    /// Its name.
    pub(crate) name: String,
    /// Absent for a normal dependency, `dev` or `build` for the others.
    pub(crate) kind: Option<String>,
}

/// What `Cargo.lock` tells.
#[derive(Debug, Deserialize)]
pub(crate) struct Lock {
    /// All packages that any feature on any platform can ask for.
    pub(crate) package: Vec<Locked>,
}

/// A package of `Cargo.lock`.
#[derive(Debug, Deserialize)]
pub(crate) struct Locked {
    /// Its name.
    pub(crate) name: String,
    /// Its version.
    #[serde(default)]
    pub(crate) version: String,
    /// SHA-256 of the archive it comes in; none for a member.
    #[serde(default)]
    pub(crate) checksum: Option<String>,
    /// What it needs: names, or a name and a version where several are locked.
    #[serde(default)]
    pub(crate) dependencies: Vec<String>,
}

/// Reads `Cargo.lock`.
///
/// # Errors
/// When it is missing or damaged.
pub(crate) fn lock(root: &Path) -> Result<Lock> {
    let text = std::fs::read_to_string(root.join("Cargo.lock")).context("cannot read Cargo.lock")?;
    toml::from_str(&text).context("Cargo.lock")
}

/// Asks cargo for the members alone.
///
/// # Errors
/// When cargo cannot be started or the workspace does not load.
pub(crate) fn read(root: &Path) -> Result<Workspace> {
    metadata(root, &["--no-deps"])
}

/// Asks cargo, with further arguments.
///
/// # Errors
/// When cargo cannot be started, the workspace does not load, or what cargo tells is not a `T`.
pub(crate) fn metadata<T: DeserializeOwned>(root: &Path, arguments: &[&str]) -> Result<T> {
    let output = cargo()
        .args(["metadata", "--format-version", "1"])
        .args(arguments)
        .current_dir(root)
        .output()
        .context("cannot start cargo metadata")?;
    if !output.status.success() {
        bail!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    serde_json::from_slice(&output.stdout).context("cargo metadata")
}

/// The cargo that runs us.
pub(crate) fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}
