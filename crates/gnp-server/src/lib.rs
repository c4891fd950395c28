//! The web server of GNP: a scene one can change, with live forecasts, and the same as an HTTP API.
//!
//! [`Listening`] is bound to its port before there is anything to serve, [`Server::run`] answers. What it answers stands in `openapi.json`, which it serves; what it
//! refuses are problem details of a [`ProblemKind`]. Lengths in m, times in s, speeds in m/s, places in the road frame of
//! the carriageway: x forward, y to the left.

mod app;
mod config;
mod connections;
mod error;
mod explain;
mod limits;
mod local;
mod metrics;
mod model;
mod object;
mod page;
mod predict;
mod problem;
mod recordings;
mod scene;
mod security;
mod server;
mod work;

pub use crate::app::Route;
pub use crate::config::ServerConfig;
pub use crate::error::ServerError;
pub use crate::local::{Local, LocalAnswer};
pub use crate::page::OPENAPI;
pub use crate::problem::ProblemKind;
pub use crate::server::{Listening, Server};
