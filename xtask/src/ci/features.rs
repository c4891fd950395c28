//! Each crate checked alone, without its features and with each of them: built together, one crate's
//! features hide what another one lacks.

use std::path::Path;

use anyhow::Result;
use gnp_cli::Terminal;

use super::{Step, step};
use crate::workspace::{self, Package};

/// Features that hand a device on; they need what most machines lack and are left out.
const DEVICES: [&str; 4] = ["cuda", "cudnn", "metal", "mkl"];

/// Features that compile too much, or in another language, for a short check.
const LONG: [&str; 2] = ["coverage", "rerun"];

/// How much is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// Every crate and every feature but those of [`DEVICES`].
    All,
    /// Only crates that have features besides [`DEVICES`] and [`LONG`].
    Short,
}

/// Runs `cargo check` once for each case.
///
/// # Errors
/// Names the crate and the feature that do not build.
pub(crate) fn run(root: &Path, extent: Extent, terminal: &Terminal) -> Result<()> {
    for (package, feature) in cases(&workspace::read(root)?.packages, extent) {
        let mut arguments = vec!["check", "--package", package, "--no-default-features"];
        if let Some(feature) = feature {
            arguments.extend(["--features", feature]);
        }
        let name = format!("{package} {}", feature.unwrap_or("without features"));
        step(root, terminal, &Step { name: &name, arguments: &arguments, environment: &[] })?;
    }
    Ok(())
}

/// Packages, each without features and then with one after the other.
fn cases(packages: &[Package], extent: Extent) -> Vec<(&str, Option<&str>)> {
    let asked = |feature: &&str| {
        *feature != "default" && !DEVICES.contains(feature) && (extent == Extent::All || !LONG.contains(feature))
    };
    let mut cases = Vec::new();
    for package in packages {
        let features: Vec<&str> = package.features.keys().map(String::as_str).filter(asked).collect();
        if extent == Extent::All || !features.is_empty() {
            cases.push((package.name.as_str(), None));
        }
        cases.extend(features.into_iter().map(|feature| (package.name.as_str(), Some(feature))));
    }
    cases
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_check_takes_crates_with_features_of_their_own() {
        let package = |name: &str, features: &[&str]| Package {
            name: name.to_owned(),
            dependencies: Vec::new(),
            features: features.iter().map(|feature| ((*feature).to_owned(), Vec::new())).collect(),
            manifest_path: std::path::PathBuf::new(),
        };
        let packages = [package("a", &["default", "readers"]), package("b", &["cuda", "rerun"]), package("c", &[])];
        assert_eq!(cases(&packages, Extent::Short), [("a", None), ("a", Some("readers"))]);
        let all = [("a", None), ("a", Some("readers")), ("b", None), ("b", Some("rerun")), ("c", None)];
        assert_eq!(cases(&packages, Extent::All), all);
    }
}
