//! What a program shows while it works, and how it is asked to stop.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result};

/// Where results and progress go. The library prints nothing itself.
pub trait Progress: fmt::Debug + Send + Sync {
    /// Lines of a result.
    fn result(&self, text: &str);

    /// A line about what is going on.
    fn note(&self, text: &str);

    /// A piece of work of `total` units begins, `done` of which were done earlier; it ends when the returned value is dropped.
    fn start(&self, what: &str, done: u64, total: u64, unit: &'static str) -> Box<dyn Work>;
}

/// A piece of work that goes on.
pub trait Work: Send {
    /// `done` units are done; `message` says how it goes (a loss, a file).
    fn at(&self, done: u64, message: &str);
}

/// Shows nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn result(&self, _: &str) {}

    fn note(&self, _: &str) {}

    fn start(&self, _: &str, _: u64, _: u64, _: &'static str) -> Box<dyn Work> {
        Box::new(Self)
    }
}

impl Work for Silent {
    fn at(&self, _: u64, _: &str) {}
}

/// A request to stop, shared by its clones: the work in hand ends at the next safe point instead of in the
/// middle of a file.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Nobody has asked to stop.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Asks to stop; says whether that was asked before.
    pub fn request(&self) -> bool {
        self.0.swap(true, Ordering::SeqCst)
    }

    /// Whether somebody has asked to stop.
    #[must_use]
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }

    /// The safe point.
    ///
    /// # Errors
    /// [`Error::Stopped`] once somebody has asked to stop.
    pub fn check(&self) -> Result<()> {
        if self.is_requested() { Err(Error::Stopped { kept: None }) } else { Ok(()) }
    }

    /// For trainings, which look at it after each batch.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.0
    }
}
