//! The server as its clients see it: over a socket, byte by byte.

// clippy.toml allows these inside test functions alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod api;
mod client;
mod openapi;
mod refused;
mod security;
