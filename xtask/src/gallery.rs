//! `gallery`: redraws the pictures of docs/gallery.md and README, from runs and tables that are there.

use gnp::{Progress, Run};
use gnp_cli::Program;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::browser::chromium;
use crate::cli::GalleryArgs;
use crate::project;

/// Width and height of a picture of the report, pixels.
const WINDOW: &str = "--window-size=1300,1040";

/// The moment that the pictures of the report show, and the picture of each theme.
const MOMENTS: [(&str, &str); 2] = [("report.png", "#t=30&theme=light"), ("report-dark.png", "#t=30&theme=dark")];

/// Draws the figures of a run, writes its report, copies the figures of tables, and takes pictures of the report.
///
/// # Errors
/// When the run is not finished, a table has no figures, or a file cannot be written.
pub(crate) fn run(args: &GalleryArgs, program: &Program) -> Result<()> {
    let out = args.out.clone().unwrap_or_else(|| project::root().join("docs/pictures"));
    let machine = gnp_cli::machine(&args.machine, program)?;
    let (page, figures) = gnp::write_report(&mut Run::finished(&args.run, &machine)?)?;
    fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let terminal = machine.progress.as_ref();
    for figure in &figures {
        write(&out.join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
        terminal.result(&format!("{}.svg: from {}", figure.name, args.run.display()));
    }
    for (stem, folder) in [("table1", &args.table1), ("table2", &args.table2)] {
        let Some(folder) = folder else {
            terminal.note(&format!("{stem}: not given (--{stem} DIR); its pictures stay as they are"));
            continue;
        };
        for name in figures_of(stem, folder)? {
            let from = folder.join(&name);
            let svg = fs::read(&from).with_context(|| format!("cannot read {}", from.display()))?;
            write(&out.join(&name), &svg)?;
            terminal.result(&format!("{name}: from {}", folder.display()));
        }
    }
    photograph(&page, &out, terminal)
}

/// Names of the SVG figures of a table, in order.
fn figures_of(stem: &str, folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    let mut names = Vec::new();
    for entry in entries {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        names.extend(
            name.to_str().filter(|n| n.starts_with(&format!("{stem}-")) && n.ends_with(".svg")).map(str::to_owned),
        );
    }
    if names.is_empty() {
        let verb = if stem == "table1" { "compare" } else { "ablate" };
        bail!(
            "{} has no figures; make them by `cargo xtask {verb} --dataset NAME --resume --out {0}`",
            folder.display()
        );
    }
    names.sort();
    Ok(names)
}

/// Times that a browser is started for a picture.
const ATTEMPTS: usize = 4;

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    gnp_file::save(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Pictures of the report in a browser without a window, light and dark; without a browser it says so.
fn photograph(page: &Path, out: &Path, terminal: &dyn Progress) -> Result<()> {
    let Some(browser) = chromium() else {
        terminal.note("no Chromium found (Debian: apt-get install chromium); pictures of the report stay as they are");
        return Ok(());
    };
    let page = page.canonicalize().with_context(|| format!("cannot find {}", page.display()))?;
    let place = tempfile::tempdir().context("cannot make a temporary folder")?;
    for (name, moment) in MOMENTS {
        let picture: PathBuf = place.path().join(name);
        let mut said = String::new();
        // On a busy computer a browser now and then ends without a picture.
        for attempt in 0..ATTEMPTS {
            let output = Command::new(&browser)
                .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", WINDOW])
                .arg("--virtual-time-budget=3000")
                .arg(format!("--user-data-dir={}", place.path().join(format!("{name}-{attempt}")).display()))
                .arg(format!("--screenshot={}", picture.display()))
                .arg(format!("file://{}{moment}", page.display()))
                .output()
                .with_context(|| format!("cannot start {}", browser.display()))?;
            if picture.exists() {
                break;
            }
            said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        }
        let Ok(bytes) = fs::read(&picture) else {
            bail!("{} took no picture of {} in {ATTEMPTS} attempts: {said}", browser.display(), page.display());
        };
        write(&out.join(name), &bytes)?;
        terminal.result(&format!("{name}: {} in {}", page.display(), browser.display()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_drawings_of_the_table_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["table1-b.svg", "table1-a.svg", "table1-a.png", "table1.md", "table2-a.svg"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(figures_of("table1", folder.path()).unwrap(), ["table1-a.svg", "table1-b.svg"]);
        let other = tempfile::tempdir().unwrap();
        let error = figures_of("table2", other.path()).unwrap_err();
        assert!(error.to_string().contains("cargo xtask ablate --dataset"), "{error}");
    }
}
