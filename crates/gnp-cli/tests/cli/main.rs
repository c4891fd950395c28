//! The program as its users run it.

// clippy.toml allows these inside test functions alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod bad_input;
mod cluster;
mod convert;
mod copies;
mod pipeline;
mod play;
mod predict;
mod program;
mod replay;
mod settings;
mod tables;
