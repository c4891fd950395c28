//! Jobs of a table side by side, each in a process of its own.
//!
//! candle's operations on long tensors meet at one barrier in a process, where two trainings would wait for each other, and
//! one training with threads waits longer for them than they help: two processes of one thread do twice as much.

use std::io::Read as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use gnp::{Error, Result, Stop};

use crate::INTERRUPTED;

/// How often a job is looked at.
const PERIOD: Duration = Duration::from_millis(50);
/// Time in which a job that was asked to stop may end by itself. One that is killed loses what it did since its last epoch.
const PATIENCE: Duration = Duration::from_secs(20);

/// Does the job called `id` of the prepared table in `folder` in another process of this program, on one thread.
///
/// # Errors
/// [`Error::Unavailable`] with what the process wrote when it fails or cannot be started; [`Error::Stopped`].
pub(crate) fn perform(folder: &Path, id: &str, stop: &Stop) -> Result<()> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["compare", "--quiet", "--threads", "1", "--job", id, "--out"]).arg(folder);
    // What candle reads its number of threads from.
    command.env("RAYON_NUM_THREADS", "1").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    // Read as it is written: a full pipe would hold the job up.
    let written = child.stderr.take().map(|mut stderr| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let _ = stderr.read_to_end(&mut bytes);
            String::from_utf8_lossy(&bytes).into_owned()
        })
    });
    let ended = wait(&mut child, stop)?;
    match ended {
        Some(0) => Ok(()),
        None => Err(Error::Stopped { kept: None }),
        Some(code) if code == i32::from(INTERRUPTED) => Err(Error::Stopped { kept: None }),
        Some(_) => {
            let text = written.and_then(|reader| reader.join().ok()).unwrap_or_default();
            Err(Error::Unavailable(text.trim().trim_start_matches("error: ").to_owned()))
        }
    }
}

/// The exit code, -1 for a process that a signal ended; `None` for one that was stopped.
fn wait(child: &mut Child, stop: &Stop) -> Result<Option<i32>> {
    let mut asked: Option<Instant> = None;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(asked.map_or_else(|| Some(status.code().unwrap_or(-1)), |_| None));
        }
        // Ctrl-C reaches the job, too; a signal to this process alone does not.
        if stop.is_requested() && asked.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
            child.kill()?;
        }
        std::thread::sleep(PERIOD);
    }
}
