//! Where the project's own files are.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

/// A short recording, from the root.
const RECORDING: &str = "fixtures/ngsim/us101-13_1.csv.gz";

/// The folder of the workspace: cargo says where this crate is; a binary started by hand remembers.
pub(crate) fn root() -> PathBuf {
    let here =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    here.parent().map_or_else(|| here.clone(), Path::to_path_buf)
}

/// Copies one short recording into the new folder `data` in `place`, for runs of seconds; that folder.
///
/// # Errors
/// When it cannot be copied.
pub(crate) fn one_recording(place: &Path) -> Result<PathBuf> {
    let data = place.join("data");
    fs::create_dir_all(&data).with_context(|| format!("cannot make {}", data.display()))?;
    let from = root().join(RECORDING);
    let name = from.file_name().unwrap_or_default();
    fs::copy(&from, data.join(name)).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(data)
}
