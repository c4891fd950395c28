//! Every crate obeys the lints of the workspace, and these forbid `unsafe`.

use std::path::Path;

use anyhow::{Context as _, Result};
use toml::{Table, Value};

use crate::workspace;

/// Findings about lints. Forbidden, unlike denied, can be allowed again nowhere below.
pub(super) fn check(root: &Path) -> Result<Vec<String>> {
    let mut findings = Vec::new();
    if at(&manifest(&root.join("Cargo.toml"))?, &["workspace", "lints", "rust", "unsafe_code"])
        != Some(&Value::from("forbid"))
    {
        findings.push("Cargo.toml: forbid `unsafe_code` in [workspace.lints.rust]".to_owned());
    }
    for package in workspace::read(root)?.packages {
        if !obeys(&manifest(&package.manifest_path)?) {
            findings.push(format!("{}: its Cargo.toml lacks `[lints] workspace = true`", package.name));
        }
    }
    Ok(findings)
}

fn manifest(path: &Path) -> Result<Table> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
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
