//! Where the project's own files are.

use std::path::{Path, PathBuf};

/// The folder of the workspace: cargo says where this crate is; a binary started by hand remembers.
pub(crate) fn root() -> PathBuf {
    let here =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    here.parent().map_or_else(|| here.clone(), Path::to_path_buf)
}
