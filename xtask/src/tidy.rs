//! Rules of the project that the compiler does not know.
//!
//! The map in `docs/architecture.md` is true, gnp-force stands alone, every source file says what it
//! is, stays readable in length and has a name that means something, no file names somebody's machine,
//! every crate obeys the lints of the workspace, which forbid `unsafe`, and the bill of materials lists
//! what is locked.

mod files;
mod lints;
mod map;

use std::path::Path;

use anyhow::{Result, bail};

use crate::sbom;

/// Checks everything and prints each finding.
///
/// # Errors
/// When there is a finding, or the project cannot be read.
pub(crate) fn run(root: &Path) -> Result<()> {
    let findings = findings(root)?;
    if findings.is_empty() {
        return Ok(());
    }
    for finding in &findings {
        eprintln!("tidy: {finding}");
    }
    bail!(
        "tidy: {} to put right",
        if findings.len() == 1 { "one thing".into() } else { format!("{} things", findings.len()) }
    )
}

fn findings(root: &Path) -> Result<Vec<String>> {
    let mut findings = map::check(root)?;
    findings.extend(files::check(root)?);
    findings.extend(lints::check(root)?);
    findings.extend(sbom::check(root)?);
    Ok(findings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_project_is_tidy() {
        let root = crate::project::root();
        assert_eq!(findings(&root).unwrap(), Vec::<String>::new());
    }
}
