//! Disks that take nothing: full ones, and folders that cannot be written.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use rand::Rng as _;
use rand::seq::IndexedRandom as _;

use super::round::{Outcome, Reading, Round, copy};
use crate::process::Signal;

/// What a system says of a full disk, and of a file that may not grow further.
const FULL: [&str; 3] = ["No space left", "disk is full", "File too large"];
/// What a system says of a folder that cannot be written.
const CLOSED: [&str; 3] = ["Read-only", "read-only", "Permission denied"];

/// A disk that is mounted at a folder, until it is dropped.
#[derive(Debug)]
struct Mount(PathBuf);

impl Mount {
    /// `mount` with these options, at `place`; `None` where this system does not let us.
    fn at(place: &Path, words: &[&str]) -> Result<Option<Self>> {
        fs::create_dir_all(place).with_context(|| format!("cannot make {}", place.display()))?;
        Ok(mount(words, place).then(|| Self(place.to_owned())))
    }

    /// Mounts it anew with other options.
    fn again(&self, options: &str) -> Result<()> {
        if !mount(&["-o", options], &self.0) {
            bail!("cannot mount {} anew with {options}", self.0.display());
        }
        Ok(())
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        // What is left mounted is seen: the folder cannot be removed.
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

fn mount(words: &[&str], place: &Path) -> bool {
    Command::new("mount").args(words).arg(place).output().is_ok_and(|output| output.status.success())
}

/// A pipeline runs out of disk, says so, and goes on when there is room.
///
/// # Errors
/// When it says something else, or writes something else.
pub(super) fn full(round: &mut Round<'_>) -> Result<()> {
    let job = &round.stand.pipeline;
    let bytes: u64 = job.contents.files().values().map(|bytes| bytes.len() as u64).sum();
    let place = round.place.join("disk");
    let room = format!("size={}", (bytes as f64 * round.chance.random_range(0.02..0.9)) as u64);
    if let Some(disk) = Mount::at(&place, &["-t", "tmpfs", "-o", &room, "tmpfs"])? {
        let folder = place.join("run");
        job.start(&folder)?.end()?.refused_of(&folder, &FULL)?;
        disk.again("remount,size=1g")?;
        return round.finish(job, &folder, Outcome::Resumed);
    }
    // Without a disk of its own: a limit on the size of a file, in units of 512 or 1024 bytes.
    let largest = job.contents.files().values().map(Vec::len).max().unwrap_or(0);
    let blocks = (largest as f64 * round.chance.random_range(0.005..0.4) / 1024.) as u64;
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
    let folder = round.folder("limited")?;
    job.starter().by(&["sh", "-c", &script, "sh"]).run(&job.arguments(&folder))?.refused_of(&folder, &FULL)?;
    round.finish(job, &folder, Outcome::Resumed)
}

/// A run that cannot be written is read, is not gone on with, and goes on when it can be written again.
///
/// # Errors
/// When a refusal says something else, or something else is written.
pub(super) fn read_only(round: &mut Round<'_>) -> Result<()> {
    let job = &round.stand.pipeline;
    let folder = round.folder("closed")?;
    let half_done = round.chance.random_bool(0.5);
    if half_done {
        let mut running = job.start(&folder)?;
        round.random_moment(job, &mut running, &folder)?;
        running.send(Signal::Kill)?;
        let _ = running.end()?;
        if !folder.join("run.json").exists() || folder.join("report.html").exists() {
            return round.finish(job, &folder, Outcome::Resumed);
        }
    } else {
        copy(&job.folder, &folder)?;
    }
    let Some(closed) = Closed::close(&folder)? else {
        let why = "this user may write anywhere and may not mount a folder read-only".to_owned();
        round.outcomes.push(Outcome::Skipped(why));
        return Ok(());
    };
    let (words, outcome) = if half_done {
        (job.arguments(&folder), Outcome::Refused)
    } else {
        let reading = *Reading::ALL.choose(&mut round.chance).context("nothing reads")?;
        let read = reading.of(job, &folder, &round.place, false)?;
        round.outcomes.push(read);
        let run = folder.to_string_lossy().into_owned();
        (vec!["report".to_owned(), "--run".to_owned(), run], Outcome::Refused)
    };
    job.starter().run(&words)?.refused_of(&folder, &CLOSED)?;
    drop(closed);
    round.finish(job, &folder, outcome)
}

/// A folder that cannot be written, until it is dropped.
#[derive(Debug)]
enum Closed {
    /// By its permissions.
    Permissions(PathBuf),
    /// Mounted read-only over itself.
    Mounted(#[expect(dead_code, reason = "held until the folder is open again")] Mount),
}

impl Closed {
    /// Closes `folder`; `None` where this system does not let us.
    fn close(folder: &Path) -> Result<Option<Self>> {
        set_writable(folder, false)?;
        if fs::File::create(folder.join("probe")).is_err() {
            return Ok(Some(Self::Permissions(folder.to_owned())));
        }
        // Whom permissions do not bind.
        fs::remove_file(folder.join("probe")).context("cannot remove what was tried")?;
        set_writable(folder, true)?;
        let text = folder.to_string_lossy();
        let Some(mounted) = Mount::at(folder, &["--bind", &text])? else { return Ok(None) };
        mounted.again("remount,bind,ro")?;
        Ok(Some(Self::Mounted(mounted)))
    }
}

impl Drop for Closed {
    fn drop(&mut self) {
        if let Self::Permissions(folder) = self {
            let _ = set_writable(folder, true);
        }
    }
}

#[cfg(unix)]
fn set_writable(folder: &Path, writable: bool) -> Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = if writable { 0o755 } else { 0o555 };
    let cannot = || format!("cannot change the permissions of {}", folder.display());
    fs::set_permissions(folder, fs::Permissions::from_mode(mode)).with_context(cannot)
}

#[cfg(not(unix))]
fn set_writable(folder: &Path, writable: bool) -> Result<()> {
    bail!("{}: permissions cannot be set to {writable} on this system", folder.display())
}
