//! The crate map in `docs/architecture.md` against what cargo says, and gnp-force's independence.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, Result};

use crate::workspace::{self, Lock, Package, Workspace};

/// The document with the map, and the crate that stands alone with what it must never come to need.
const DOCUMENT: &str = "docs/architecture.md";
const ALONE: &str = "gnp-force";
const STRANGERS: [&str; 3] = ["gnp-", "candle", "polars"];

/// Who depends on whom: crate to the crates of this project that it uses.
type Edges = BTreeMap<String, BTreeSet<String>>;

/// Findings about the map.
pub(super) fn check(root: &Path) -> Result<Vec<String>> {
    let metadata = workspace::read(root)?;
    let document = std::fs::read_to_string(root.join(DOCUMENT)).with_context(|| format!("cannot read {DOCUMENT}"))?;
    let lock = workspace::lock(root)?;
    let mut findings = compare(&documented(&document), &edges(&metadata));
    findings.extend(alone(&metadata, &lock));
    Ok(findings)
}

/// Normal dependencies between the project's crates. Test-only ones are not part of the map.
fn edges(metadata: &Workspace) -> Edges {
    let members: BTreeSet<&str> = metadata.packages.iter().map(|package| package.name.as_str()).collect();
    let knows = |package: &Package| {
        let normal = package.dependencies.iter().filter(|dependency| dependency.kind.is_none());
        normal.map(|dependency| dependency.name.clone()).filter(|name| members.contains(name.as_str())).collect()
    };
    metadata.packages.iter().map(|package| (package.name.clone(), knows(package))).collect()
}

/// Reads the table whose rows begin with a crate name in backticks and whose second cell lists the
/// crates it knows, in backticks.
fn documented(document: &str) -> Edges {
    let rows = document.lines().filter(|line| line.starts_with("| `"));
    rows.filter_map(|row| {
        let mut cells = row.trim_matches('|').split('|');
        let name = in_backticks(cells.next()?).into_iter().next()?;
        Some((name, in_backticks(cells.next()?)))
    })
    .filter(|(name, _)| name == "xtask" || name == "gnp" || name.starts_with("gnp-"))
    .collect()
}

fn in_backticks(cell: &str) -> BTreeSet<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn compare(documented: &Edges, real: &Edges) -> Vec<String> {
    let mut findings = Vec::new();
    for (name, knows) in real {
        match documented.get(name) {
            None => findings.push(format!("{DOCUMENT}: the map has no row for {name}")),
            Some(said) => {
                let missing = knows.difference(said).map(|other| format!("{DOCUMENT}: {name} also knows {other}"));
                let wrong = said.difference(knows).map(|other| format!("{DOCUMENT}: {name} does not know {other}"));
                findings.extend(missing.chain(wrong));
            }
        }
    }
    let gone = documented.keys().filter(|name| !real.contains_key(*name));
    findings.extend(gone.map(|name| format!("{DOCUMENT}: the map has {name}, which is no crate of the project")));
    findings
}

/// Everything gnp-force needs, directly or through others, by the lock file.
fn alone(metadata: &Workspace, lock: &Lock) -> Vec<String> {
    let Some(package) = metadata.packages.iter().find(|package| package.name == ALONE) else {
        return vec![format!("there is no crate {ALONE}")];
    };
    let direct = package.dependencies.iter().filter(|dependency| dependency.kind.is_none());
    let mut open: Vec<String> = direct.map(|dependency| dependency.name.clone()).collect();
    let mut needed = BTreeSet::new();
    while let Some(name) = open.pop() {
        if needed.insert(name.clone()) {
            let locked = lock.package.iter().filter(|locked| locked.name == name);
            // An entry is a name, or a name and a version where several are locked.
            let names = locked.flat_map(|locked| &locked.dependencies).filter_map(|entry| entry.split(' ').next());
            open.extend(names.map(str::to_owned));
        }
    }
    let strangers = needed.iter().filter(|name| STRANGERS.iter().any(|stranger| name.starts_with(stranger)));
    strangers.map(|name| format!("{ALONE} must stand alone, and needs {name}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "\
text\n\
| crate | knows | what |\n\
|---|---|---|\n\
| `gnp-data` | nobody | windows |\n\
| `gnp-eval` | `gnp-data` | `scores` |\n\
| `other` | `gnp-data` | not ours |\n";

    fn given(text: &[(&str, &[&str])]) -> Edges {
        text.iter().map(|(name, knows)| ((*name).into(), knows.iter().map(|name| (*name).into()).collect())).collect()
    }

    #[test]
    fn a_true_map_passes() {
        assert_eq!(compare(&documented(MAP), &given(&[("gnp-data", &[]), ("gnp-eval", &["gnp-data"])])), [""; 0]);
    }

    #[test]
    fn differences_are_named() {
        let real = given(&[("gnp-data", &["gnp-new"]), ("gnp-new", &[])]);
        let findings = compare(&documented(MAP), &real).join("\n");
        for part in ["gnp-data also knows gnp-new", "no row for gnp-new", "the map has gnp-eval"] {
            assert!(findings.contains(part), "{findings}");
        }
    }

    #[test]
    fn gnp_force_may_not_reach_candle() {
        let metadata: Workspace = serde_json::from_str(
            r#"{"packages": [{"name": "gnp-force", "dependencies": [
                {"name": "nalgebra", "kind": null}, {"name": "polars", "kind": "dev"}]}]}"#,
        )
        .unwrap();
        let lock = |inner: &str| -> Lock {
            toml::from_str(&format!(
                "[[package]]\nname = 'nalgebra'\ndependencies = ['simba 0.9.0']\n[[package]]\nname = 'simba'\ndependencies = ['{inner}']\n"
            ))
            .unwrap()
        };
        assert_eq!(alone(&metadata, &lock("num-traits")), [""; 0]);
        assert_eq!(alone(&metadata, &lock("candle-core")).len(), 1);
    }
}
