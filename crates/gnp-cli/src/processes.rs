//! Jobs of a table side by side, each in a process of its own.
//!
//! One training has too little to do in each operation for its threads not to wait for each other: two processes of one thread do
//! more.

#![expect(clippy::result_large_err, reason = "the library's error, which it asks for")]

use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use gnp::{Error, Result, Stop};

use crate::INTERRUPTED;
use crate::environment;
use crate::names::DeviceName;

/// How often a job is looked at.
const PERIOD: Duration = Duration::from_millis(50);
/// Time in which a job that was asked to stop may end by itself. One that is killed loses what it did since its last epoch.
const PATIENCE: Duration = Duration::from_secs(10);

/// Words between the file that runs and the arguments of this program: those that make Python run it.
static LAUNCHER: OnceLock<Vec<OsString>> = OnceLock::new();

/// Notes how this program was started, when it has so many arguments beside its name.
pub(crate) fn note_launcher(arguments: usize) {
    let words: Vec<OsString> = std::env::args_os().skip(1).collect();
    let launcher = words.len().saturating_sub(arguments);
    LAUNCHER.get_or_init(|| words.into_iter().take(launcher).collect());
}

/// Does the job called `id` of the prepared table in `folder` in another process of this program, on one thread.
///
/// # Errors
/// [`Error::Unavailable`] with what the process wrote when it fails or cannot be started; [`Error::Stopped`].
pub(crate) fn perform(folder: &Path, id: &str, device: DeviceName, stop: &Stop) -> Result<()> {
    let mut command = Command::new(program()?);
    command.args(LAUNCHER.get().into_iter().flatten());
    command.args(["compare", "--quiet", "--threads", "1", "--device", device.name(), "--job", id, "--out"]).arg(folder);
    command.envs(environment::variables(1)).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    // Read as it is written: a full pipe would hold the job up.
    let written = child.stderr.take().map(|mut stderr| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let _ = stderr.read_to_end(&mut bytes);
            String::from_utf8_lossy(&bytes).trim().trim_start_matches("error: ").to_owned()
        })
    });
    let Some(status) = wait(&mut child, stop)? else { return Err(Error::Stopped { kept: None }) };
    if status.success() {
        return Ok(());
    }
    if status.code() == Some(i32::from(INTERRUPTED)) {
        return Err(Error::Stopped { kept: None });
    }
    let text = written.and_then(|reader| reader.join().ok()).unwrap_or_default();
    let silent = || format!("its process ended with {status}; if memory was short, give fewer --workers");
    Err(Error::Unavailable(if text.is_empty() { silent() } else { text }))
}

/// This program: on Linux also when its file was replaced since it started, as a compiler does.
pub(crate) fn program() -> std::io::Result<PathBuf> {
    let file = std::env::current_exe()?;
    let own = Path::new("/proc/self/exe");
    Ok(if !file.exists() && own.exists() { own.to_owned() } else { file })
}

/// How it ended; `None` for one that was stopped.
fn wait(child: &mut Child, stop: &Stop) -> Result<Option<ExitStatus>> {
    let mut asked: Option<Instant> = None;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status).filter(|_| asked.is_none()));
        }
        // Ctrl-C reaches the job, too; a signal to this process alone does not.
        if stop.is_requested() && asked.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
            child.kill()?;
        }
        std::thread::sleep(PERIOD);
    }
}
