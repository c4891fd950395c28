//! Ctrl-C: the work in hand ends at the next safe point instead of in the middle of a file.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, Result};

/// Set once the user has asked to stop.
pub(crate) static STOP: AtomicBool = AtomicBool::new(false);

/// Exit code of an interrupted program: 128 and the number of SIGINT.
pub(crate) const EXIT_CODE: u8 = 130;

/// The user asked to stop; what is done so far is kept.
#[derive(Debug)]
pub(crate) struct Interrupted;

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("interrupted")
    }
}

impl std::error::Error for Interrupted {}

/// Installs the handler: the first Ctrl-C asks to stop, the second ends the program at once.
///
/// # Errors
/// When the system refuses a handler.
pub(crate) fn install() -> Result<()> {
    ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        eprintln!("\nstopping at the next safe point; press Ctrl-C again to stop at once");
    })
    .context("cannot listen for Ctrl-C")
}

/// Fails with [`Interrupted`] once the user has asked to stop: the safe point.
///
/// # Errors
/// [`Interrupted`].
pub(crate) fn check() -> Result<()> {
    if STOP.load(Ordering::SeqCst) { Err(Interrupted.into()) } else { Ok(()) }
}
