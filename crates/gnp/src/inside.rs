//! Paths that a file or a name asks for, kept inside the folder that they are for.

use std::path::{Component, Path, PathBuf};

use crate::error::{Result, bail};

/// The file or folder called `name` in `folder`. Who sends a run or recordings also chooses the names in them; `../x` and
/// `/x` would lead anywhere.
///
/// # Errors
/// [`Error::Folder`](crate::Error::Folder) where `name` is empty, begins at the root or leads upwards.
pub(crate) fn inside(folder: &Path, name: &str) -> Result<PathBuf> {
    let mut parts = Path::new(name).components().peekable();
    if parts.peek().is_none() || !parts.all(|part| matches!(part, Component::Normal(_))) {
        bail!(Folder, "{}: {name:?} is no name of something in this folder; rename it", folder.display());
    }
    Ok(folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_lead_out() {
        let folder = Path::new("run");
        for name in ["a.rec", "recordings/a.rec", "..a", "a..", "a b"] {
            assert_eq!(inside(folder, name).unwrap(), folder.join(name));
        }
        for name in ["", ".", "..", "../a.rec", "recordings/../../a.rec", "/dev/zero", "./a"] {
            let message = inside(folder, name).unwrap_err().to_string();
            assert!(message.starts_with("run: ") && message.contains(&format!("{name:?}")), "{message}");
        }
    }
}
