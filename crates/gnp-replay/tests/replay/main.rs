//! Records of a small clip, and with the feature `rerun` what a file holds when it is read back.

// clippy.toml allows these inside test functions alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod clip;
#[cfg(feature = "rerun")]
mod file;
mod records;
#[cfg(not(feature = "rerun"))]
mod without;
