//! Source files: header, length, name; and no path of somebody's machine anywhere.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

/// Longest source file, in lines; most stay between 150 and 300.
const LONGEST: usize = 600;

/// Names that say nothing about what is inside.
const EMPTY_NAMES: [&str; 4] = ["utils", "common", "helpers", "misc"];

/// Starts of paths that exist on one machine only; split so that this file passes its own check.
const MACHINE_PATHS: [&str; 5] =
    [concat!("/ho", "me/"), concat!("/Us", "ers/"), concat!("C:", "\\"), concat!("/ro", "ot/"), concat!("/t", "mp/")];

/// Folders and files of the project that are looked at.
const LOOKED_AT: [&str; 8] = ["crates", "xtask", "configs", "docs", ".ci", "README.md", "CHANGELOG.md", "Cargo.toml"];

/// Findings about files.
pub(super) fn check(root: &Path) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for place in LOOKED_AT {
        collect(&root.join(place), &mut files)?;
    }
    files.sort();
    let mut findings = Vec::new();
    for file in files {
        let Ok(text) = fs::read_to_string(&file) else { continue }; // binary
        let shown = file.strip_prefix(root).unwrap_or(&file).display().to_string().replace('\\', "/");
        findings.extend(check_one(&shown, &text));
    }
    Ok(findings)
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    if path.is_file() {
        files.push(path.to_owned());
    } else if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
        let entries = fs::read_dir(path).with_context(|| format!("cannot list {}", path.display()))?;
        for entry in entries {
            collect(&entry?.path(), files)?;
        }
    }
    Ok(())
}

/// Findings about one file, named as in the project.
fn check_one(file: &str, text: &str) -> Vec<String> {
    let mut findings = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if let Some(path) = MACHINE_PATHS.iter().find(|path| line.contains(**path)) {
            findings.push(format!("{file}:{}: names a path of one machine (`{path}`)", number + 1));
        }
    }
    let Some(stem) = file.strip_suffix(".rs") else { return findings };
    if !text.starts_with("//! ") {
        findings.push(format!("{file}: begin with a line `//! What this file is.`"));
    }
    let lines = text.lines().count();
    if lines > LONGEST {
        findings.push(format!("{file}: {lines} lines; at most {LONGEST}: split it by idea"));
    }
    let name = stem.rsplit('/').next().unwrap_or(stem);
    // What several tests of a crate share has to be called so; cargo takes any other file for a test.
    if name == "mod" && !stem.contains("/tests/") {
        findings.push(format!("{file}: name it after its folder, beside the folder"));
    }
    if let Some(empty) = stem.split('/').find(|part| EMPTY_NAMES.contains(part)) {
        findings.push(format!("{file}: `{empty}` says nothing; name it for what is inside"));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_file_passes() {
        assert_eq!(check_one("crates/a/src/window.rs", "//! Windows.\nfn f() {}\n"), [""; 0]);
        assert_eq!(check_one("docs/data.md", "no header needed"), [""; 0]);
        assert_eq!(check_one("crates/a/tests/scene/mod.rs", "//! Scenes.\n"), [""; 0]);
    }

    #[test]
    fn each_rule_can_fail() {
        let long = format!("//! Long.\n{}", "//\n".repeat(LONGEST));
        for (file, text) in [
            ("a/src/window.rs", "fn f() {}"),
            ("a/src/window.rs", long.as_str()),
            ("a/src/window/mod.rs", "//! Windows."),
            ("a/src/utils.rs", "//! Things."),
            ("a/src/helpers/window.rs", "//! Things."),
            ("docs/data.md", concat!("see /ho", "me/me/data")),
        ] {
            assert_eq!(check_one(file, text).len(), 1, "{file}");
        }
    }
}
