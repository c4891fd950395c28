//! The crates that the project is built from: licences, sources, double versions, known vulnerabilities.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use gnp::Progress as _;
use gnp::text::duration;
use gnp_cli::Terminal;

use crate::workspace::cargo;

/// What is allowed, and why.
const CONFIG: &str = "configs/deny.toml";

/// Arguments of cargo and of cargo-deny that name everything that any feature brings along.
const EVERYTHING: [&str; 2] = ["--locked", "--all-features"];

/// What cargo-audit says where it has no list of vulnerabilities.
const NO_ADVISORIES: &str = "couldn't fetch advisory database";

/// What cargo says where it would have to change the lock file.
const STALE_LOCK: &str = "because --locked was passed";

/// Holds the dependencies against [`CONFIG`] with cargo-deny, and against the RustSec advisories with it and cargo-audit.
/// What cannot be looked up because a program or its data cannot be had is said to be skipped.
///
/// # Errors
/// When a program objects to a dependency or to its configuration.
pub(super) fn run(root: &Path, terminal: &Terminal) -> Result<()> {
    let skipped = |what: &str, why: &str| terminal.note(&format!("ci: {what} SKIPPED: {why}"));
    let Some(deny) = find("GNP_CARGO_DENY", "cargo-deny")? else {
        skipped("supply chain", "no cargo-deny here; xtask/supply/requirements.txt says how to get it");
        return Ok(());
    };
    let metadata = capture(cargo().arg("metadata").args(EVERYTHING).args(["--format-version", "1"]), root)?;
    if let Some(why) = fetched(metadata.status.success(), &metadata.stderr)? {
        skipped("supply chain", &why);
        return Ok(());
    }
    let started = Instant::now();
    let deny = |arguments: &[&str]| {
        let mut command = Command::new(&deny);
        command.args(EVERYTHING).args(["--config", CONFIG]).args(arguments);
        command
    };
    terminal.note(&format!("ci: supply chain (cargo deny, by {CONFIG})"));
    check(&mut deny(&["check", "--hide-inclusion-graph", "bans", "licenses", "sources"]), root)?;
    // A line that has gone silent is given up.
    let database = capture(
        deny(&["fetch", "db"]).envs([("GIT_HTTP_LOW_SPEED_LIMIT", "1000"), ("GIT_HTTP_LOW_SPEED_TIME", "30")]),
        root,
    )?;
    if database.status.success() {
        check(&mut deny(&["check", "--hide-inclusion-graph", "advisories"]), root)?;
    } else {
        skipped("advisories", &format!("their database cannot be had: {}", last_line(&database.stderr)));
    }
    match find("GNP_CARGO_AUDIT", "cargo-audit")? {
        Some(audit) => {
            let output = capture(Command::new(audit).arg("audit"), root)?;
            if let Some(why) = audited(output.status.success(), &output.stderr)? {
                skipped("audit", &why);
            }
        }
        None => skipped("audit", "no cargo-audit here; xtask/supply/requirements.txt says how to get it"),
    }
    terminal.note(&format!("ci: supply chain passed in {}", duration(started.elapsed())));
    Ok(())
}

/// The program that a variable of the environment names, or of that name where programs are sought.
///
/// # Errors
/// When the variable names no file.
pub(super) fn find(variable: &str, name: &str) -> Result<Option<PathBuf>> {
    match std::env::var_os(variable).filter(|path| !path.is_empty()) {
        Some(path) => named(variable, path.into()).map(Some),
        None => Ok(installed(name)),
    }
}

/// The program of that name where programs are sought.
pub(crate) fn installed(name: &str) -> Option<PathBuf> {
    std::env::var_os("PATH").and_then(|folders| in_path(folders, name))
}

fn named(variable: &str, path: PathBuf) -> Result<PathBuf> {
    if !path.is_file() {
        bail!("ci: {variable} names {}, which is no file; mend or unset it", path.display());
    }
    Ok(path)
}

fn in_path(folders: std::ffi::OsString, name: &str) -> Option<PathBuf> {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&folders).map(|folder| folder.join(&file)).find(|path| path.is_file())
}

fn capture(command: &mut Command, root: &Path) -> Result<Output> {
    command.current_dir(root).output().with_context(|| cannot(command))
}

fn check(command: &mut Command, root: &Path) -> Result<()> {
    let status = command.current_dir(root).status().with_context(|| cannot(command))?;
    if !status.success() {
        bail!("ci: supply chain failed ({status}); {command:?} alone says why, and {CONFIG} what is allowed");
    }
    Ok(())
}

fn cannot(command: &Command) -> String {
    format!("cannot start {}", command.get_program().display())
}

/// Why cargo could not fetch what the lock file names, if it could not.
///
/// # Errors
/// When the lock file is out of date: what it does not name would not be looked at.
fn fetched(passed: bool, stderr: &[u8]) -> Result<Option<String>> {
    if passed {
        return Ok(None);
    }
    if String::from_utf8_lossy(stderr).contains(STALE_LOCK) {
        bail!(
            "ci: Cargo.lock does not fit the manifests; `cargo check --workspace` brings it up to date, then commit it"
        );
    }
    Ok(Some(format!("not all crates can be fetched: {}", last_line(stderr))))
}

/// Why cargo-audit could not look, if it could not.
///
/// # Errors
/// When it looked and found something.
fn audited(passed: bool, stderr: &[u8]) -> Result<Option<String>> {
    let text = String::from_utf8_lossy(stderr);
    if passed {
        return Ok(None);
    }
    if text.contains(NO_ADVISORIES) {
        return Ok(Some(format!("the advisory database cannot be had: {}", last_line(stderr))));
    }
    bail!("ci: cargo audit failed; `cargo audit` alone says more: {}", text.trim());
}

/// The last line that is not empty, where programs say what stopped them.
fn last_line(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    text.lines().rev().map(str::trim).find(|line| !line.is_empty()).unwrap_or("it does not say why").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_found_where_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("cargo-deny{}", std::env::consts::EXE_SUFFIX));
        std::fs::write(&path, "").unwrap();
        let folders = std::env::join_paths([Path::new("nowhere"), folder.path()]).unwrap();
        assert_eq!(named("X", path.clone()).unwrap(), path);
        assert!(named("X", folder.path().join("gone")).unwrap_err().to_string().contains("X names"));
        assert_eq!(in_path(folders.clone(), "cargo-deny"), Some(path));
        assert_eq!(in_path(folders, "cargo-audit"), None);
    }

    #[test]
    fn a_lock_file_out_of_date_fails_and_a_network_that_is_down_does_not() {
        assert_eq!(fetched(true, b"").unwrap(), None);
        let stale = b"error: cannot update the lock file /p/Cargo.lock because --locked was passed to prevent this\n\
            If you want to try to generate the lock file without accessing the network, remove the --locked flag\n";
        assert!(fetched(false, stale).unwrap_err().to_string().contains("Cargo.lock"));
        assert!(
            fetched(false, b"error: failed to download\n  no such host\n").unwrap().unwrap().ends_with("no such host")
        );
    }

    /// An audit that could not look must not pass for one that found nothing, nor one that found something for one that could not look.
    #[test]
    fn an_audit_passes_finds_or_could_not_look() {
        assert_eq!(audited(true, b"").unwrap(), None);
        let offline = b"error: couldn't fetch advisory database: git operation failed\n  -> no such host\n\n";
        assert!(audited(false, offline).unwrap().unwrap().ends_with("-> no such host"));
        assert!(audited(false, b"error: 1 vulnerability found!").is_err());
    }
}
