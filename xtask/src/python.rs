//! The Python package: its wheel is built, and its tests, types and notebook run against that wheel.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use gnp::Progress as _;
use gnp_cli::Terminal;

use crate::workspace;

/// Names a Python that has what `python/requirements-ci.txt` lists; `.ci/run` makes one.
const VARIABLE: &str = "GNP_PYTHON_TESTS";

/// What the tests cannot do without.
const NEEDED: [&str; 6] = ["maturin", "pytest", "numpy", "polars", "pandas", "pyarrow"];

/// Builds the wheel and runs `python/tests` against it, in a folder beside what is compiled: nothing is installed.
///
/// # Errors
/// When the wheel cannot be built, or a test fails.
pub(crate) fn run(root: &Path, terminal: &Terminal) -> Result<()> {
    let python = std::env::var_os(VARIABLE).map_or_else(|| "python3".into(), PathBuf::from);
    if let Some(lacks) = lacks(&python) {
        terminal.note(&format!(
            "python: SKIPPED: {lacks}; set {VARIABLE} to a Python that has what python/requirements-ci.txt lists"
        ));
        return Ok(());
    }
    let target = workspace::read(root)?.target_directory;
    let (wheels, installed) = (target.join("wheels"), target.join("python"));
    for old in [&wheels, &installed] {
        if old.exists() {
            std::fs::remove_dir_all(old).with_context(|| format!("cannot empty {}", old.display()))?;
        }
    }
    let module = |name: &str| {
        let mut command = Command::new(&python);
        command.args(["-m", name]).current_dir(root.join("python"));
        command
    };
    checked(module("maturin").args(["build", "--quiet", "--interpreter"]).arg(&python).arg("--out").arg(&wheels))?;
    let wheel = std::fs::read_dir(&wheels)?.next().context("maturin made no wheel")??.path();
    checked(module("pip").args(["install", "--quiet", "--no-deps", "--target"]).arg(&installed).arg(&wheel))?;
    // From the folder of the tests: in that above Python would find the sources of the package first.
    let mut tests = module("pytest");
    tests.args(["-q", "-rs", "-p", "no:cacheprovider", "."]).current_dir(root.join("python/tests"));
    checked(tests.env("PYTHONPATH", &installed).env("PYTHONDONTWRITEBYTECODE", "1"))
}

/// What keeps the tests from running.
fn lacks(python: &Path) -> Option<String> {
    let found = Command::new(python).args(["-c", &format!("import {}", NEEDED.join(", "))]).output();
    match found {
        Err(_) => Some(format!("there is no {}", python.display())),
        Ok(output) if output.status.success() => None,
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr);
            Some(format!("{}: {}", python.display(), said.lines().last().unwrap_or_default()))
        }
    }
}

fn checked(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    if status.success() { Ok(()) } else { bail!("python: {command:?} failed ({status})") }
}
