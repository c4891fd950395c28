//! Long work without the GIL: Ctrl-C ends it at the next safe point, and progress is told meanwhile.

use std::fmt;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use candle_core::Device;
use gnp::{Machine, Progress, Stop, Work};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{Failure, GnpError};

/// How often Python is asked for Ctrl-C.
const PERIOD: Duration = Duration::from_millis(50);

/// How far a piece of work is.
struct Report {
    what: Arc<str>,
    done: u64,
    total: u64,
}

/// Tells Python.
struct Teller(Sender<Report>);

struct Piece {
    what: Arc<str>,
    total: u64,
    teller: Sender<Report>,
}

impl fmt::Debug for Teller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Teller")
    }
}

impl Progress for Teller {
    fn result(&self, _: &str) {}

    fn note(&self, _: &str) {}

    fn start(&self, what: &str, done: u64, total: u64, _: &'static str) -> Box<dyn Work> {
        let piece = Piece { what: what.into(), total, teller: self.0.clone() };
        piece.at(done, "");
        Box::new(piece)
    }
}

impl Work for Piece {
    fn at(&self, done: u64, _: &str) {
        // Nobody listens once the work was stopped.
        let _ = self.teller.send(Report { what: Arc::clone(&self.what), done, total: self.total });
    }
}

/// Does `work` on a thread of its own, with `threads` threads, or those of all such work where `None`. `progress` is called
/// with what is done, how far it is, and how much there is.
///
/// # Errors
/// What the work returns; what `progress` raises; `KeyboardInterrupt` after Ctrl-C.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Machine) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let pool = match threads {
        None => None,
        Some(0) => return Err(PyValueError::new_err("threads is 0: give 1 or more, or None for all")),
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            Some(pool.map_err(|error| GnpError::new_err(format!("cannot start {threads} threads: {error}")))?)
        }
    };
    let (teller, mut reports) = channel();
    let stop = Stop::new();
    let machine = Machine::new(Device::Cpu, Arc::new(Teller(teller)), stop.clone());
    std::thread::scope(|scope| {
        let worker = scope.spawn(move || match pool {
            None => work(&machine),
            Some(pool) => pool.install(|| work(&machine)),
        });
        let mut raised = None;
        loop {
            let waiting = &mut reports;
            let told = match py.detach(move || waiting.recv_timeout(PERIOD)) {
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => None,
                Ok(report) => Some(report),
            };
            if raised.is_some() {
                continue;
            }
            let seen = match (told, progress) {
                (Some(Report { what, done, total }), Some(progress)) => progress.call1((&*what, done, total)).map(drop),
                _ => Ok(()),
            };
            if let Err(error) = seen.and_then(|()| py.check_signals()) {
                stop.request();
                raised = Some(error);
            }
        }
        let ended = py.detach(|| worker.join());
        match (raised, ended) {
            (Some(raised), _) => Err(raised),
            (None, Ok(result)) => result.map_err(|failure| failure.raised(py)),
            (None, Err(panic)) => resume_unwind(panic),
        }
    })
}
