//! One writer at a time: an advisory lock on a file that says who holds it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};
use std::{env, fmt, fs, process};

use serde::{Deserialize, Serialize};

/// A lock that is held until it is dropped or the program ends, however that comes about. The file stays, empty when
/// nobody holds it. On a file system without locks nobody is kept out.
#[derive(Debug)]
pub struct Lock {
    file: File,
}

/// Who holds a lock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Owner {
    /// Number of the process.
    pub pid: u32,
    /// Name of the computer.
    pub host: String,
    /// Name of the program.
    pub program: String,
    /// Since when: `2026-11-26 03:50:12 UTC`.
    pub since: String,
}

/// A lock that cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// Another one holds it.
    #[error("{} is held by {}", path.display(), owner.as_ref().map_or_else(|| "another process".to_owned(), ToString::to_string))]
    Held {
        /// The file.
        path: PathBuf,
        /// Who, where that can be read.
        owner: Option<Owner>,
    },
    /// The file cannot be made.
    #[error("{} cannot be made", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl Owner {
    /// This process, now.
    fn now() -> Self {
        let program = env::current_exe().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Self {
            pid: process::id(),
            host: host(),
            program: program.unwrap_or_else(|| "gnp".to_owned()),
            since: utc(seconds),
        }
    }
}

/// Name of this computer; `unknown` where it has none.
pub(crate) fn host() -> String {
    let kernel = fs::read_to_string("/proc/sys/kernel/hostname").map(|name| name.trim().to_owned());
    let named = || ["HOSTNAME", "COMPUTERNAME"].iter().find_map(|key| env::var(key).ok());
    kernel.ok().or_else(named).unwrap_or_else(|| "unknown".to_owned())
}

impl fmt::Display for Owner {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pid, host, program, since } = self;
        write!(out, "{program} (process {pid} on {host}) since {since}")
    }
}

impl Lock {
    /// Takes the lock on the file at `path`, which is made if it is not there, and writes the owner into it; does not wait.
    ///
    /// # Errors
    /// [`LockError::Held`] when it is held, by this process, too; [`LockError::Io`] when the file cannot be made.
    pub fn take(path: &Path) -> Result<Self, LockError> {
        let io = |source| LockError::Io { path: path.to_owned(), source };
        // The owner would be written into what it points to.
        if path.symlink_metadata().is_ok_and(|found| found.is_symlink()) {
            return Err(io(io::Error::other("it is a symbolic link; remove it")));
        }
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(io)?;
        acquire(&mut file, path)?;
        // For people: a full disk is no reason to go without the lock.
        let _ = file.set_len(0);
        let _ = serde_json::to_vec(&Owner::now()).map(|text| file.write_all(&text));
        Ok(Self { file })
    }
}

/// Locks the file, which is at `path`, until it is closed.
///
/// # Errors
/// [`LockError::Held`] when it is locked already.
pub(crate) fn acquire(file: &mut File, path: &Path) -> Result<(), LockError> {
    if let Err(TryLockError::WouldBlock) = file.try_lock() {
        let mut text = String::new();
        // Where a lock keeps readers out, or its owner has not said yet who it is, it has no name.
        let owner = file.read_to_string(&mut text).ok().and_then(|_| serde_json::from_str(&text).ok());
        return Err(LockError::Held { path: path.to_owned(), owner });
    }
    Ok(())
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Closing frees it.
        let _ = self.file.set_len(0);
    }
}

/// Seconds since 1970 as a date and time of the proleptic Gregorian calendar.
fn utc(seconds: u64) -> String {
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Years that begin in March, so that a leap day is the last of its year (Howard Hinnant, "chrono-compatible
    // low-level date algorithms").
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march + 2) / 5 + 1;
    let month = if march < 10 { march + 3 } else { march - 9 };
    let year = year + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (second / 3_600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (951_868_800, "2000-03-01 00:00:00 UTC"),
            (1_795_665_012, "2026-11-26 03:50:12 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }

    #[test]
    fn a_second_one_is_told_who_holds_it_until_it_is_free() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        std::fs::write(&path, "what somebody who was killed left").unwrap();
        let held = Lock::take(&path).unwrap();
        let Err(LockError::Held { owner: Some(owner), .. }) = Lock::take(&path) else { panic!("it was not held") };
        assert_eq!(owner.pid, process::id());
        assert!(owner.to_string().contains("UTC"), "{owner}");
        drop(held);
        assert_eq!(std::fs::read(&path).unwrap(), b"");
        drop(Lock::take(&path).unwrap());
        assert!(matches!(Lock::take(&folder.path().join("missing/a.lock")), Err(LockError::Io { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn what_a_link_points_to_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let (victim, link) = (folder.path().join("victim"), folder.path().join("run.lock"));
        std::fs::write(&victim, "mine").unwrap();
        std::os::unix::fs::symlink(&victim, &link).unwrap();
        let message = std::error::Error::source(&Lock::take(&link).unwrap_err()).unwrap().to_string();
        assert!(message.contains("symbolic link"), "{message}");
        assert_eq!(std::fs::read(&victim).unwrap(), b"mine");
    }
}
