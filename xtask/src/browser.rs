//! The page of the server in a browser: driven as a person does, and filmed.
//!
//! The programs are in `xtask/browser`: Python with Playwright, and the Chromium that is installed. What they need and is not there
//! is said, and they are skipped.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use clap::Args;
use gnp::Progress as _;
use gnp_cli::Terminal;

use crate::ci::supply::installed;
use crate::process::own_file;
use crate::serve::Server;

/// Names a Python that has what `xtask/browser/requirements.txt` lists; `.ci/run` makes one.
const VARIABLE: &str = "GNP_PYTHON_BROWSER";

/// Names under which Chromium is installed.
const CHROMIUM: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// How schemathesis asks: examples of the description, values at the edges of its schemas, made-up ones; the same each time. A
/// request that the schema allows may still be refused: that there is a recording of a name no schema says.
const CONTRACT: [&str; 9] = [
    "--phases=examples,coverage,fuzzing",
    "--checks=not_a_server_error,status_code_conformance,content_type_conformance,response_headers_conformance,\
     response_schema_conformance,unsupported_method,allow_header_conformance,negative_data_rejection",
    "--max-examples=200",
    "--seed=1",
    "--generation-database=none",
    "--continue-on-failure",
    "--suppress-health-check=all",
    "--warnings=off",
    "--no-color",
];

/// What to do.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct BrowserArgs {
    /// Only tests whose name has this.
    #[arg(long, value_name = "TEXT", conflicts_with = "full")]
    pub(crate) only: Option<String>,
    /// Then let schemathesis make requests from openapi.json, well-formed and not, and hold the answers against it; minutes.
    #[arg(long)]
    pub(crate) full: bool,
    /// Folder for pictures of the page, for somebody to look at.
    #[arg(long, value_name = "DIR")]
    pub(crate) pictures: Option<PathBuf>,
}

/// Where to write the film.
#[derive(Clone, Debug, Args)]
pub(crate) struct RecordingArgs {
    /// The file [default: docs/pictures/play.gif].
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
}

/// What the programs run on.
struct Tools {
    python: PathBuf,
    chromium: PathBuf,
    /// The folder of the programs.
    folder: PathBuf,
}

/// Drives the page of a server of this build.
///
/// # Errors
/// When a test fails, or the server does not start or end well.
pub(crate) fn run(root: &Path, arguments: &BrowserArgs, terminal: &Terminal) -> Result<()> {
    let needed: &[&str] =
        if arguments.full { &["pytest", "playwright", "schemathesis"] } else { &["pytest", "playwright"] };
    let Some(tools) = tools(root, needed, "browser", terminal) else { return Ok(()) };
    let server = Server::start(&[])?;
    let mut tests = tools.command(&server)?;
    tests.args(["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "."]);
    if let Some(text) = &arguments.only {
        tests.args(["-k", text]);
    }
    if let Some(folder) = &arguments.pictures {
        tests.env("GNP_PICTURES", absolute(folder)?);
    }
    checked(&mut tests)?;
    if arguments.full {
        // It leaves a folder where it runs.
        let folder = tempfile::tempdir().context("cannot make a folder for schemathesis")?;
        let description = format!("{}/openapi.json", server.url());
        let mut contract = tools.command(&server)?;
        contract.args(["-m", "schemathesis.cli", "run", &description]).args(CONTRACT).current_dir(folder.path());
        checked(&mut contract)?;
    }
    server.stop()?;
    Ok(())
}

/// Films the page of a server of this build; the same build gives the same pictures.
///
/// # Errors
/// When the page does not do what is filmed, or the file cannot be written.
pub(crate) fn record(root: &Path, arguments: &RecordingArgs, terminal: &Terminal) -> Result<()> {
    let Some(tools) = tools(root, &["PIL", "playwright"], "recording", terminal) else { return Ok(()) };
    let out = arguments.out.clone().unwrap_or_else(|| root.join("docs/pictures/play.gif"));
    let server = Server::start(&[])?;
    checked(tools.command(&server)?.arg("record.py").arg(absolute(&out)?))?;
    server.stop()?;
    terminal.result(&format!("{}: filmed", out.display()));
    Ok(())
}

/// Chromium, under the first of its names that is in the path.
pub(crate) fn chromium() -> Option<PathBuf> {
    CHROMIUM.into_iter().find_map(installed)
}

/// What is there; otherwise says what is missing.
fn tools(root: &Path, modules: &[&str], name: &str, terminal: &Terminal) -> Option<Tools> {
    let python = std::env::var_os(VARIABLE).map_or_else(|| "python3".into(), PathBuf::from);
    let Some(chromium) = chromium() else {
        terminal.note(&format!("{name}: SKIPPED: no Chromium found (Debian: apt-get install chromium)"));
        return None;
    };
    let found = Command::new(&python).args(["-c", &format!("import {}", modules.join(", "))]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        terminal.note(&format!(
            "{name}: SKIPPED: {} has not all of {}; set {VARIABLE} to a Python with what xtask/browser/requirements.txt lists",
            python.display(),
            modules.join(", ")
        ));
        return None;
    }
    Some(Tools { python, chromium, folder: root.join("xtask/browser") })
}

impl Tools {
    /// Python in the folder of the programs, told where the server is.
    fn command(&self, server: &Server) -> Result<Command> {
        let mut command = Command::new(&self.python);
        command.current_dir(&self.folder).env("PYTHONDONTWRITEBYTECODE", "1");
        command.env("GNP_CHROMIUM", &self.chromium).env("GNP_URL", server.url()).env("GNP_PROGRAM", own_file()?);
        Ok(command)
    }
}

fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("cannot find {}", path.display()))
}

fn checked(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    if status.success() { Ok(()) } else { bail!("browser: {command:?} failed ({status})") }
}
