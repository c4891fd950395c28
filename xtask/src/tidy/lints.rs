//! Every crate obeys the lints of the workspace, and these forbid `unsafe`; but for the border to C.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use toml::{Table, Value};

use crate::workspace;

/// Crates that share memory with another language, each with the one file that may. They write the lints of the workspace
/// out, with `unsafe_code` denied instead of forbidden, and with [`STRICTER`].
const BORDERS: [(&str, &str); 2] = [("gnp-c", "src/border.rs"), ("gnp-python", "src/arrow.rs")];

/// Lints that matter only where there is `unsafe` code.
const STRICTER: [(&str, &str, &str); 2] =
    [("rust", "unsafe_op_in_unsafe_fn", "deny"), ("clippy", "undocumented_unsafe_blocks", "warn")];

/// Findings about lints. Forbidden, unlike denied, can be allowed again nowhere below.
pub(super) fn check(root: &Path) -> Result<Vec<String>> {
    let mut findings = Vec::new();
    let of_all = manifest(&root.join("Cargo.toml"))?;
    if at(&of_all, &["workspace", "lints", "rust", "unsafe_code"]) != Some(&Value::from("forbid")) {
        findings.push("Cargo.toml: forbid `unsafe_code` in [workspace.lints.rust]".to_owned());
    }
    for package in workspace::read(root)?.packages {
        let own = manifest(&package.manifest_path)?;
        if let Some((name, file)) = BORDERS.iter().find(|(name, _)| *name == package.name) {
            if own.get("lints") != denied(&of_all).as_ref() {
                let [a, b] = STRICTER.map(|(_, lint, level)| format!("{lint} = {level}"));
                findings.push(format!(
                    "{name}: its lints must be those of the workspace with `unsafe_code = deny`, `{a}` and `{b}`"
                ));
            }
            let folder = package.manifest_path.parent().unwrap_or(root);
            let others = allowing(&folder.join("src"))?.into_iter().filter(|path| *path != folder.join(file));
            findings.extend(others.map(|path| format!("{}: only {file} may allow `unsafe_code`", path.display())));
        } else if !obeys(&own) {
            findings.push(format!("{}: its Cargo.toml lacks `[lints] workspace = true`", package.name));
        }
    }
    Ok(findings)
}

/// The lints of a crate of [`BORDERS`].
fn denied(of_all: &Table) -> Option<Value> {
    let mut lints = at(of_all, &["workspace", "lints"])?.clone();
    for (tool, lint, level) in [("rust", "unsafe_code", "deny")].into_iter().chain(STRICTER) {
        lints.get_mut(tool)?.as_table_mut()?.insert(lint.to_owned(), Value::from(level));
    }
    Some(lints)
}

/// The source files in a folder and below that name the lint, and so may allow it.
fn allowing(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(allowing(&path)?);
        } else if fs::read_to_string(&path).is_ok_and(|text| text.contains("unsafe_code")) {
            found.push(path);
        }
    }
    Ok(found)
}

fn manifest(path: &Path) -> Result<Table> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    text.parse().with_context(|| path.display().to_string())
}

fn obeys(manifest: &Table) -> bool {
    at(manifest, &["lints", "workspace"]) == Some(&Value::from(true))
}

fn at<'a>(table: &'a Table, keys: &[&str]) -> Option<&'a Value> {
    let (first, rest) = keys.split_first()?;
    rest.iter().try_fold(table.get(*first)?, |value, key| value.get(key))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_border_has_the_lints_of_all_but_one() {
        let of_all: Table = "[workspace.lints]\nrust.unsafe_code = 'forbid'\nclippy.panic = 'warn'".parse().unwrap();
        let good = "[lints]\nrust.unsafe_code = 'deny'\nrust.unsafe_op_in_unsafe_fn = 'deny'\nclippy.panic = 'warn'\n\
            clippy.undocumented_unsafe_blocks = 'warn'";
        let own = |text: &str| text.parse::<Table>().unwrap().get("lints").cloned();
        assert_eq!(denied(&of_all), own(good));
        for (lint, level) in [("unsafe_code = 'deny'", "unsafe_code = 'allow'"), ("clippy.panic = 'warn'", "")] {
            assert_ne!(denied(&of_all), own(&good.replace(lint, level)), "{lint}");
        }
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("inner")).unwrap();
        fs::write(folder.path().join("safe.rs"), "//! Safe.").unwrap();
        fs::write(folder.path().join("inner/other.rs"), "#![allow(unsafe_code)]").unwrap();
        assert_eq!(allowing(folder.path()).unwrap(), [folder.path().join("inner/other.rs")]);
    }

    #[test]
    fn a_crate_obeys_only_in_so_many_words() {
        for (text, good) in [
            ("[lints]\nworkspace = true", true),
            ("[lints]\nworkspace = false", false),
            ("[lints.rust]", false),
            ("", false),
        ] {
            assert_eq!(obeys(&text.parse().unwrap()), good, "{text}");
        }
        assert_eq!(at(&"a.b = 1".parse().unwrap(), &["a", "b"]), Some(&Value::from(1)));
        assert_eq!(at(&"a.b = 1".parse().unwrap(), &["a", "c"]), None);
    }
}
