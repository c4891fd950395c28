//! Who writes into a folder, as the only one: refused, or awaited.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::Duration;

use gnp_file::{Lock, LockError};

use crate::error::{Context as _, Error, Result};
use crate::machine::Machine;
use crate::run::manifest::Damage;

/// How often a lock that another process holds is asked after.
const PERIOD: Duration = Duration::from_millis(200);

/// The lock of who writes into the run folder `root`, to make good the `damage` in it, if there is any.
///
/// # Errors
/// When another one writes into it, naming it; when the folder cannot be written to.
pub(super) fn lock(root: &Path, damage: &[Damage]) -> Result<Lock> {
    let (path, dir) = (root.join(gnp_file::Draft::LOCK), root.display());
    Lock::take(&path).map_err(|error| match error {
        LockError::Held { owner, .. } => {
            let owner = owner.map_or_else(|| "another process".to_owned(), |owner| owner.to_string());
            Error::Folder(format!(
                "{dir} is being written by {owner}; wait for its end, stop it, or take another folder"
            ))
        }
        LockError::Io { source, .. } if !path.is_symlink() => {
            let why = damage.first().map_or_else(String::new, |one| format!(" and {}", one.words()));
            Error::Folder(format!("{dir} cannot be written to ({source}){why}"))
        }
        other => other.into(),
    })
}

/// Waits until no other process holds the lock at `path`, whose folder is made. `what` is done by who holds it.
///
/// # Errors
/// When the file cannot be made; [`Error::Stopped`](crate::Error) while it waits.
pub(crate) fn alone(path: &Path, what: &str, machine: &Machine) -> Result<Lock> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut told = false;
    loop {
        match Lock::take(path) {
            Err(LockError::Held { owner, .. }) => {
                if !told {
                    let owner = owner.map_or_else(|| "another process".to_owned(), |owner| owner.to_string());
                    machine.progress.note(&format!("{what}: {owner} does it; waiting for its end"));
                    told = true;
                }
                machine.stop.check()?;
                thread::sleep(PERIOD);
            }
            other => return Ok(other?),
        }
    }
}
