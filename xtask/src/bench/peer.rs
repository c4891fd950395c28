//! The reference programs in `xtask/peer/`, in a Python environment made for them.

use gnp::Progress as _;
use gnp_cli::Terminal;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use serde::de::DeserializeOwned;

use crate::project;

/// Milliseconds per window by what was measured, such as `ngsim.traj.train`.
pub(super) type Milliseconds = BTreeMap<String, f64>;

/// What the programs need; a copy in the environment says that it was installed.
const REQUIREMENTS: &str = include_str!("../../peer/requirements.txt");

/// Python with PyTorch and JAX.
#[derive(Debug)]
pub(super) struct Python {
    program: PathBuf,
}

impl Python {
    /// Finds or makes the environment `target/peer-venv`.
    ///
    /// # Errors
    /// When Python, its venv or pip is missing, or the installation fails.
    pub(super) fn prepare(terminal: &Terminal) -> Result<Self> {
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| project::root().join("target"), PathBuf::from);
        Self::prepare_at(&target.join("peer-venv"), "python3", terminal)
    }

    /// `python` as it is where that is named, else as [`Python::prepare`].
    ///
    /// # Errors
    /// When it cannot be started, or those of [`Python::prepare`].
    pub(super) fn find(python: Option<&Path>, terminal: &Terminal) -> Result<Self> {
        let Some(python) = python else { return Self::prepare(terminal) };
        let version = Command::new(python).arg("--version").output();
        if !version.is_ok_and(|output| output.status.success()) {
            bail!("--python {} cannot be started; give the file of a Python with PyTorch and JAX", python.display());
        }
        Ok(Self { program: python.to_owned() })
    }

    fn prepare_at(folder: &Path, python: &str, terminal: &Terminal) -> Result<Self> {
        let inside = if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" };
        let made = Self { program: folder.join(inside) };
        let installed = folder.join("requirements.txt");
        if fs::read_to_string(&installed).is_ok_and(|text| text == REQUIREMENTS) {
            return Ok(made);
        }
        let shown = folder.display();
        terminal.note(&format!(
            "bench: installing PyTorch and JAX into {shown}; PyTorch's default package for Linux brings CUDA along, \
             6 GB on disk in all. For the small one: PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu"
        ));
        let version = Command::new(python).arg("--version").output();
        if !version.is_ok_and(|output| output.status.success()) {
            bail!("{python} cannot be started; install Python 3.11 or later to compare with PyTorch and JAX");
        }
        run(Command::new(python).args(["-m", "venv"]).arg(folder)).with_context(|| {
            format!("{python} cannot make the environment {shown}; on Debian and Ubuntu: apt install python3-venv")
        })?;
        run(Command::new(&made.program).args(["-m", "pip", "--version"])).with_context(|| {
            format!("no pip in {shown}; run `{python} -m ensurepip`, remove that folder, try again")
        })?;
        let file = project::root().join("xtask/peer/requirements.txt");
        run(Command::new(&made.program).args(["-m", "pip", "install", "--quiet", "--requirement"]).arg(file))
            .with_context(|| format!("pip cannot install what {shown} needs; see its message above"))?;
        fs::write(&installed, REQUIREMENTS).with_context(|| format!("cannot write {}", installed.display()))?;
        Ok(made)
    }

    /// Runs one of the programs and calls `line` with each line it prints, as it comes; ends it at `end`, without an error.
    ///
    /// # Errors
    /// When the program fails.
    pub(super) fn follow(
        &self,
        program: &str,
        arguments: &[String],
        end: Instant,
        mut line: impl FnMut(&str),
    ) -> Result<()> {
        let mut child =
            self.command(program, arguments).stdout(Stdio::piped()).spawn().with_context(|| self.cannot_start())?;
        let (sender, lines) = mpsc::channel();
        let output = child.stdout.take();
        let reader = std::thread::spawn(move || {
            for line in output.into_iter().flat_map(|output| BufReader::new(output).lines().map_while(Result::ok)) {
                // Nobody listens any more once the time is over.
                let _ = sender.send(line);
            }
        });
        let over = loop {
            match lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(text) => line(&text),
                Err(RecvTimeoutError::Timeout) => break true,
                Err(RecvTimeoutError::Disconnected) => break false,
            }
        };
        if over {
            child.kill().with_context(|| format!("cannot end {program}"))?;
        }
        let status = child.wait()?;
        let _ = reader.join();
        if !over && !status.success() {
            bail!("{program} failed ({status}); see its message above");
        }
        Ok(())
    }

    fn command(&self, program: &str, arguments: &[String]) -> Command {
        let mut command = Command::new(&self.program);
        // The programs leave no compiled copy of themselves beside them.
        command.arg("-B").arg(project::root().join("xtask/peer").join(program)).args(arguments);
        command.stdin(Stdio::null()).stderr(Stdio::inherit());
        // What suits this program is not for others.
        gnp_cli::variables(1).iter().for_each(|(name, _)| _ = command.env_remove(name));
        command
    }

    fn cannot_start(&self) -> String {
        format!("cannot start {}", self.program.display())
    }

    /// Runs one of the programs; its last line is what it measured.
    ///
    /// # Errors
    /// When the program fails or prints something else.
    pub(super) fn measure<T: DeserializeOwned>(&self, program: &str, arguments: &[String]) -> Result<T> {
        let output = self.command(program, arguments).output().with_context(|| self.cannot_start())?;
        if !output.status.success() {
            bail!("{program} failed ({}); see its message above", output.status);
        }
        parse(&String::from_utf8_lossy(&output.stdout)).with_context(|| format!("{program} printed no measurements"))
    }
}

/// Runs to the end, quiet but for errors.
fn run(command: &mut Command) -> Result<()> {
    let name = Path::new(command.get_program()).file_name().unwrap_or(OsStr::new("python3")).to_owned();
    let status = command.stdin(Stdio::null()).stdout(Stdio::null()).status();
    let status = status.with_context(|| format!("cannot start {}", name.display()))?;
    if !status.success() {
        let arguments: Vec<_> = command.get_args().map(OsStr::to_string_lossy).collect();
        bail!("`{} {}` failed ({status})", name.display(), arguments.join(" "));
    }
    Ok(())
}

/// Reads the last line that is not empty.
fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    let line = text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
    Ok(serde_json::from_str(line)?)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_last_line_counts() {
        let read: Milliseconds = parse("a warning\n{\"ngsim.traj.train\": 18.6}\n\n").unwrap();
        assert_eq!(read, BTreeMap::from([("ngsim.traj.train".to_owned(), 18.6)]));
        let refused = |text| parse::<Milliseconds>(text).is_err();
        assert!(refused("") && refused("{\"x\": \"slow\"}"));
    }

    #[test]
    fn a_missing_python_is_said_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let terminal = Terminal::start(true, false, &gnp_cli::Program::default());
        let error = Python::prepare_at(&folder.path().join("venv"), "no-such-python", &terminal).unwrap_err();
        assert!(error.to_string().contains("no-such-python") && error.to_string().contains("install"), "{error}");
    }

    #[test]
    fn a_named_python_is_taken_as_it_is_or_refused() {
        let terminal = Terminal::start(true, false, &gnp_cli::Program::default());
        let error = Python::find(Some(Path::new("no-such-python")), &terminal).unwrap_err();
        assert!(error.to_string().contains("--python no-such-python"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn lines_are_read_as_they_come_and_a_program_ends_with_its_time() {
        let folder = tempfile::tempdir().unwrap();
        // Takes the option of Python, and is quicker to start.
        let python = Python { program: "bash".into() };
        let follow = |text: &str, seconds: u64| {
            let (program, mut seen) = (folder.path().join("program"), Vec::new());
            fs::write(&program, text).unwrap();
            let (begun, end) = (Instant::now(), Instant::now() + Duration::from_secs(seconds));
            let done =
                python.follow(program.to_str().unwrap(), &["x".to_owned()], end, |line| seen.push(line.to_owned()));
            assert!(begun.elapsed() < Duration::from_secs(20), "{text} went on");
            (seen, done.map_err(|error| error.to_string()))
        };
        assert_eq!(follow("echo $1; echo b", 30), (vec!["x".to_owned(), "b".to_owned()], Ok(())));
        assert_eq!(follow("echo a; exec sleep 30", 2), (vec!["a".to_owned()], Ok(())));
        assert!(follow("exit 3", 30).1.unwrap_err().contains("failed"));
    }

    #[cfg(unix)]
    #[test]
    fn a_python_without_venv_is_said_with_the_remedy() {
        // `true` starts and succeeds, but makes no environment.
        let folder = tempfile::tempdir().unwrap();
        let terminal = Terminal::start(true, false, &gnp_cli::Program::default());
        let error = Python::prepare_at(&folder.path().join("venv"), "true", &terminal).unwrap_err();
        assert!(format!("{error:#}").contains("pip"), "{error:#}");
    }
}
