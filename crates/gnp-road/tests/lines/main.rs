//! Reference lines against roads whose course is known.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod bad_lines;
mod files;
mod mapping;
mod open_drive;
mod roads;
