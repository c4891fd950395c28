//! The numerical crates built for 64-bit ARM, and their tests run by an emulator.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use gnp::Progress as _;
use gnp_cli::Terminal;

use super::supply::{find, installed};
use super::{Step, step};
use crate::workspace;

const TARGET: &str = "aarch64-unknown-linux-gnu";

/// Debian's cross compiler, which links.
const LINKER: &str = "aarch64-linux-gnu-gcc";

/// The emulator, package qemu-user.
const QEMU: &str = "qemu-aarch64";

/// Where Debian's cross compiler has the C library of that processor.
const SYSTEM: &str = "/usr/aarch64-linux-gnu";

/// All code that is written for vectors. With what it depends on, ten minutes of processor time to build.
const KERNELS: &str = "gnp-nn";

/// What is built on it, for which dependencies are compiled once more, and the physics, whose tests take minutes in
/// the emulator.
const OTHERS: [&str; 4] = ["gnp-goal", "gnp-traj", "gnp-modes", "gnp-force"];

/// How much is built and tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// [`KERNELS`] and [`OTHERS`].
    All,
    /// [`KERNELS`].
    Short,
}

/// What it takes.
#[derive(Debug, PartialEq, Eq)]
struct Means {
    rustc: PathBuf,
    qemu: PathBuf,
}

/// Builds and tests.
///
/// # Errors
/// Names the step that failed, or what is missing.
pub(crate) fn run(root: &Path, extent: Extent, terminal: &Terminal) -> Result<()> {
    match means()? {
        Ok(means) => test(root, &means, extent, terminal),
        Err(missing) => bail!("aarch64: {missing}"),
    }
}

/// [`Extent::Short`], or a line that says what is missing.
///
/// # Errors
/// Names the step that failed.
pub(super) fn short(root: &Path, terminal: &Terminal) -> Result<()> {
    match means()? {
        Ok(means) => test(root, &means, Extent::Short, terminal),
        Err(missing) => {
            terminal.note(&format!("ci: aarch64 SKIPPED: {missing}"));
            Ok(())
        }
    }
}

/// A compiler with the standard library of that processor, no older than the project's, and the emulator; or what is missing.
///
/// # Errors
/// When a variable of the environment names no file.
fn means() -> Result<Result<Means, String>> {
    if cfg!(target_arch = "aarch64") {
        return Ok(Err("this is such a processor; the other steps are its check".to_owned()));
    }
    let rustc = find("GNP_AARCH64_RUSTC", "rustc")?.unwrap_or_else(|| "rustc".into());
    let asked = |arguments: &[&str]| -> Result<String> {
        let output = Command::new(&rustc)
            .args(arguments)
            .output()
            .with_context(|| format!("cannot start {}", rustc.display()))?;
        Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let library = asked(&["--print", "target-libdir", "--target", TARGET])?;
    if !Path::new(&library).is_dir() {
        return Ok(Err(format!(
            "{} has no standard library for {TARGET}; `rustup target add {TARGET}`, or xtask/aarch64/toolchain.sh and \
             GNP_AARCH64_RUSTC",
            rustc.display()
        )));
    }
    if let Some(old) = too_old(&asked(&["-vV"])?, env!("CARGO_PKG_RUST_VERSION")) {
        return Ok(Err(format!("{} is {old}, older than the project's Rust", rustc.display())));
    }
    if installed(LINKER).is_none() {
        return Ok(Err(format!("there is no {LINKER} (package gcc-aarch64-linux-gnu)")));
    }
    Ok(installed(QEMU)
        .map(|qemu| Means { rustc, qemu })
        .ok_or_else(|| format!("there is no {QEMU} (package qemu-user)")))
}

/// The release that `version` (`rustc -vV`) tells, if it is older than `least`.
fn too_old(version: &str, least: &str) -> Option<String> {
    let numbers = |text: &str| -> Vec<u64> { text.split(['.', '-']).map_while(|part| part.parse().ok()).collect() };
    let release = version.lines().find_map(|line| line.strip_prefix("release: ")).unwrap_or("of unknown release");
    (numbers(release) < numbers(least)).then(|| release.to_owned())
}

fn test(root: &Path, means: &Means, extent: Extent, terminal: &Terminal) -> Result<()> {
    let workspace = workspace::read(root)?;
    // A folder of its own: another compiler would make anew what lies in that of this one.
    let folder = text(&workspace.target_directory.join("aarch64"))?;
    let runner = format!("{} -L {SYSTEM}", text(&means.qemu)?);
    let rustc = text(&means.rustc)?;
    let environment = [
        ("RUSTC", rustc.as_str()),
        ("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", LINKER),
        ("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", &runner),
    ];
    // Examples in documentation are compiled by rustdoc, which belongs to the other compiler.
    let mut arguments = vec!["test", "--tests", "--target", TARGET, "--target-dir", &folder];
    let others = OTHERS.into_iter().filter(|_| extent == Extent::All);
    arguments.extend([KERNELS].into_iter().chain(others).flat_map(|package| ["--package", package]));
    step(root, terminal, &Step { name: "aarch64", arguments: &arguments, environment: &environment })
}

fn text(path: &Path) -> Result<String> {
    path.to_str().map(str::to_owned).with_context(|| format!("{} has a name that is not text", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_compiler_is_told() {
        let of =
            |release: &str| format!("rustc {release} (0123456 2026-01-01)\nrelease: {release}\nLLVM version: 22.1.2");
        for release in ["1.95.0", "1.96.0-nightly", "1.100.0", "2.0.0"] {
            assert_eq!(too_old(&of(release), "1.95"), None, "{release}");
        }
        for release in ["1.94.1", "1.9.0"] {
            assert_eq!(too_old(&of(release), "1.95").as_deref(), Some(release));
        }
        assert!(too_old("", "1.95").is_some());
    }
}
