//! This program as a process of itself: started, watched, stopped by signals.

use std::ffi::{OsStr, OsString};
use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

/// What is started runs for seconds, in an emulator for tens of them: what takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(300);
/// How often a process is looked at.
pub(crate) const PERIOD: Duration = Duration::from_millis(1);

/// A program to start: this one, or another one that runs it.
#[derive(Clone, Debug)]
pub(crate) struct Starter {
    /// Words before the arguments, the first a program.
    words: Vec<OsString>,
    environment: Vec<(&'static str, String)>,
}

/// A process that runs, in a group of its own, with what it writes.
#[derive(Debug)]
pub(crate) struct Running {
    child: Child,
    out: Option<Pipe>,
    err: Option<Pipe>,
    command: String,
    deadline: Instant,
}

/// A process that ended.
#[derive(Clone, Debug)]
pub(crate) struct Ended {
    /// How.
    pub(crate) status: ExitStatus,
    /// What it wrote to stdout.
    pub(crate) out: String,
    /// What it wrote to stderr.
    pub(crate) err: String,
    /// The first of its arguments.
    pub(crate) command: String,
}

/// What a process group can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Signal {
    /// End at once, without a word.
    Kill,
    /// As Ctrl-C.
    Interrupt,
    /// As a system that shuts down.
    Terminate,
}

impl Signal {
    fn name(self) -> &'static str {
        match self {
            Self::Kill => "KILL",
            Self::Interrupt => "INT",
            Self::Terminate => "TERM",
        }
    }

    /// Its number.
    pub(crate) fn number(self) -> i32 {
        match self {
            Self::Kill => 9,
            Self::Interrupt => 2,
            Self::Terminate => 15,
        }
    }
}

/// The file of this program, to start it anew.
///
/// # Errors
/// When it is not known.
pub(crate) fn own_file() -> Result<PathBuf> {
    std::env::current_exe().context("cannot find this program to start it anew")
}

impl Starter {
    /// This program.
    ///
    /// # Errors
    /// When its file is not known.
    pub(crate) fn own() -> Result<Self> {
        Ok(Self { words: vec![own_file()?.into()], environment: Vec::new() })
    }

    /// The same, run by another program with arguments of its own.
    pub(crate) fn by<W: AsRef<OsStr>>(&self, words: &[W]) -> Self {
        let words = words.iter().map(|word| word.as_ref().to_owned()).chain(self.words.iter().cloned()).collect();
        Self { words, environment: self.environment.clone() }
    }

    /// The same with a variable of the environment.
    pub(crate) fn with(&self, name: &'static str, value: impl Into<String>) -> Self {
        let mut environment = self.environment.clone();
        environment.push((name, value.into()));
        Self { words: self.words.clone(), environment }
    }

    /// Starts it.
    ///
    /// # Errors
    /// When it cannot be started.
    pub(crate) fn start<A: AsRef<OsStr>>(&self, arguments: &[A]) -> Result<Running> {
        let (program, before) = self.words.split_first().context("there is no program to start")?;
        let mut command = Command::new(program);
        command.args(before).args(arguments);
        command.env("NO_COLOR", "1").envs(self.environment.iter().map(|(name, value)| (name, value)));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // So that a signal reaches the processes that it starts as well.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().with_context(|| format!("cannot start {}", program.display()))?;
        Ok(Running {
            out: child.stdout.take().map(Pipe::read),
            err: child.stderr.take().map(Pipe::read),
            child,
            command: arguments.first().map(|word| word.as_ref().to_string_lossy().into_owned()).unwrap_or_default(),
            deadline: Instant::now() + PATIENCE,
        })
    }

    /// Runs it to its end.
    ///
    /// # Errors
    /// When it cannot be started or hangs.
    pub(crate) fn run<A: AsRef<OsStr>>(&self, arguments: &[A]) -> Result<Ended> {
        self.start(arguments)?.end()
    }
}

/// What a process writes, read as it is written: a full pipe would hold the process up.
#[derive(Debug)]
struct Pipe {
    bytes: Arc<Mutex<Vec<u8>>>,
    reader: JoinHandle<()>,
}

impl Pipe {
    fn read(mut pipe: impl Read + Send + 'static) -> Self {
        let bytes = Arc::new(Mutex::new(Vec::new()));
        let filled = Arc::clone(&bytes);
        let reader = std::thread::spawn(move || {
            let mut piece = [0; 4096];
            // What was read before an error is what there is to show.
            while let Ok(count @ 1..) = pipe.read(&mut piece) {
                filled.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&piece[..count]);
            }
        });
        Self { bytes, reader }
    }

    /// What was written so far.
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }

    /// What was written until it was closed.
    fn end(self) -> String {
        let Self { bytes, reader } = self;
        // A reader does not panic; what it read is there either way.
        let _ = reader.join();
        let bytes = bytes.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

impl Running {
    /// Whether it still runs.
    ///
    /// # Errors
    /// When the system does not tell.
    pub(crate) fn runs(&mut self) -> Result<bool> {
        Ok(self.child.try_wait()?.is_none())
    }

    /// Waits until `done` says so; whether it still ran then.
    ///
    /// # Errors
    /// When it hangs, or `done` fails.
    pub(crate) fn wait_until(&mut self, mut done: impl FnMut() -> Result<bool>) -> Result<bool> {
        while self.runs()? {
            if done()? {
                return Ok(true);
            }
            self.hold_to_deadline()?;
            std::thread::sleep(PERIOD);
        }
        Ok(false)
    }

    /// Waits until `enough` finds in what it has written to stdout what it looks for; whether it still ran then.
    ///
    /// # Errors
    /// When it hangs.
    pub(crate) fn wait_until_saying(&mut self, mut enough: impl FnMut(&str) -> bool) -> Result<bool> {
        while self.runs()? {
            if enough(&self.out.as_ref().map(Pipe::text).unwrap_or_default()) {
                return Ok(true);
            }
            self.hold_to_deadline()?;
            std::thread::sleep(PERIOD);
        }
        Ok(false)
    }

    /// Waits for a time; whether it still ran then.
    ///
    /// # Errors
    /// When it hangs.
    pub(crate) fn sleep(&mut self, time: Duration) -> Result<bool> {
        let begun = Instant::now();
        self.wait_until(|| Ok(begun.elapsed() >= time))
    }

    /// Sends a signal to it and all that it started.
    ///
    /// # Errors
    /// When there is no program `kill`.
    pub(crate) fn send(&mut self, signal: Signal) -> Result<()> {
        let group = format!("-{}", self.child.id());
        let mut kill = Command::new("kill");
        kill.args(["-s", signal.name(), "--", &group]).stderr(Stdio::null());
        kill.status().context("cannot start `kill`, which sends signals")?;
        Ok(())
    }

    /// The number of the process.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// From now on it has as long as a process that was just started, before it is said to hang.
    pub(crate) fn renew(&mut self) {
        self.deadline = Instant::now() + PATIENCE;
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// When it hangs.
    pub(crate) fn end(mut self) -> Result<Ended> {
        let status = loop {
            if let Some(status) = self.child.try_wait()? {
                break status;
            }
            self.hold_to_deadline()?;
            std::thread::sleep(PERIOD);
        };
        let text = |pipe: Option<Pipe>| pipe.map(Pipe::end).unwrap_or_default();
        Ok(Ended { status, out: text(self.out.take()), err: text(self.err.take()), command: self.command.clone() })
    }

    fn hold_to_deadline(&mut self) -> Result<()> {
        if Instant::now() < self.deadline {
            return Ok(());
        }
        self.send(Signal::Kill)?;
        bail!("`{}` hangs: it did not end within {} s", self.command, PATIENCE.as_secs())
    }
}

impl Drop for Running {
    /// Nothing goes on when a round fails.
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            let _ = self.send(Signal::Kill);
            let _ = self.child.wait();
        }
    }
}

impl Ended {
    /// The exit code; `None` where a signal ended it.
    pub(crate) fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// The number of the signal that ended it.
    pub(crate) fn signal(&self) -> Option<i32> {
        #[cfg(unix)]
        return std::os::unix::process::ExitStatusExt::signal(&self.status);
        #[cfg(not(unix))]
        None
    }

    /// Requires that it did what it was to do.
    ///
    /// # Errors
    /// When it did not.
    pub(crate) fn well(self) -> Result<Self> {
        if !self.status.success() {
            bail!("failed, and should not have: {self}");
        }
        Ok(self)
    }

    /// Requires a refusal: exit code 1 and one sentence that has one of `words`.
    ///
    /// # Errors
    /// When it went on, panicked, or says too little.
    pub(crate) fn refused(&self, words: &[&str]) -> Result<()> {
        if self.code() != Some(1) {
            bail!("was to be refused with exit code 1: {self}");
        }
        if self.err.matches("error: ").count() != 1 || self.err.contains("panicked") {
            bail!("was to be refused with one sentence: {self}");
        }
        if !words.iter().any(|word| self.err.contains(word)) {
            bail!("the refusal says nothing of `{}`: {self}", words.join("` or `"));
        }
        Ok(())
    }

    /// As [`Ended::refused`], and the sentence must name `folder`.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn refused_of(&self, folder: &Path, words: &[&str]) -> Result<()> {
        self.refused(words)?;
        self.refused(&[&folder.to_string_lossy()])
    }
}

impl fmt::Display for Ended {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let said: Vec<&str> = self.err.trim().lines().rev().take(3).collect();
        let said: Vec<&str> = said.into_iter().rev().collect();
        write!(out, "`{}` ended with {} and said: {}", self.command, self.status, said.join(" | "))
    }
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Ended {
        let starter = Starter { words: vec!["sh".into()], environment: Vec::new() };
        starter.run(&["-c", script]).unwrap()
    }

    #[test]
    fn a_refusal_is_one_sentence_on_the_matter() {
        let good = shell("echo 'error: the disk is full' >&2; exit 1");
        good.refused(&["full", "No space"]).unwrap();
        assert!(good.refused(&["lock"]).is_err());
        let named = shell("echo 'error: runs/a: the disk is full' >&2; exit 1");
        named.refused_of(Path::new("runs/a"), &["full"]).unwrap();
        assert!(named.refused_of(Path::new("runs/b"), &["full"]).is_err());
        assert!(named.refused_of(Path::new("runs/a"), &["lock"]).is_err());
        for script in [
            "exit 0",
            "echo 'error: full' >&2; exit 2",
            "echo 'full' >&2; exit 1",
            "echo 'error: full error: full' >&2; exit 1",
            "echo 'panicked error: full' >&2; exit 1",
        ] {
            assert!(shell(script).refused(&["full"]).is_err(), "{script}");
        }
        assert!(shell("exit 3").well().unwrap_err().to_string().contains("exit status: 3"));
    }

    #[test]
    fn a_signal_reaches_what_a_process_started() {
        let starter = Starter { words: vec!["sh".into()], environment: Vec::new() };
        // The pipe stays open, and reading it goes on, as long as the inner one lives.
        let mut running = starter.start(&["-c", "sleep 60 & echo begun; wait"]).unwrap();
        assert!(running.runs().unwrap());
        let begun = Instant::now();
        running.send(Signal::Kill).unwrap();
        let ended = running.end().unwrap();
        assert_eq!((ended.signal(), ended.code()), (Some(9), None));
        assert!(begun.elapsed() < Duration::from_secs(30));
    }
}
