//! GNP for C and C++: forecasts frame by frame, behind `include/gnp.h`.
//!
//! A model is loaded once and shared; each stream of tracks belongs to one thread at a time. Frames of tracks go in as an
//! array of structs, forecasts come out as flat arrays that the stream owns until its next frame. Every function returns a
//! status; no panic crosses the border. What C sees is in [`border`], the only file of the project with `unsafe` code, from
//! which `cargo xtask c --write` makes the header.

pub mod border;
mod failure;
mod stream;
