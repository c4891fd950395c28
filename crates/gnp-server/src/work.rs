//! Turns for work that takes a processor: so many at once, so many in line, and none for who has gone.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use gnp_model::Workspace;
use prometheus_client::metrics::counter::Counter;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use crate::problem::{Problem, ProblemKind};

/// Longest that a request waits for its turn.
const PATIENCE: Duration = Duration::from_secs(10);

/// Gives turns.
#[derive(Debug)]
pub(crate) struct Turns {
    /// Those that work.
    working: Arc<Semaphore>,
    /// Those that work and those in line.
    admitted: Semaphore,
    dropped: Counter,
    /// Memory of earlier work, used again.
    workspaces: Mutex<Vec<Workspace>>,
}

impl Turns {
    /// So many at once, with so many in line; `dropped` counts who went before his turn.
    pub(crate) fn new(jobs: usize, waiting: usize, dropped: Counter) -> Self {
        let jobs = jobs.clamp(1, Semaphore::MAX_PERMITS / 2);
        let admitted = jobs.saturating_add(waiting).min(Semaphore::MAX_PERMITS);
        Self {
            working: Arc::new(Semaphore::new(jobs)),
            admitted: Semaphore::new(admitted),
            dropped,
            workspaces: Mutex::new(Vec::new()),
        }
    }

    /// Does `work` on a thread of its own when its turn has come. When the caller is dropped before, which is what becomes of a
    /// request whose client has gone, the work is never begun; once begun it is brought to its end.
    ///
    /// # Errors
    /// [`ProblemKind::Busy`] where too many are in line or the turn does not come; [`ProblemKind::Internal`] where the work
    /// panics; what the work says.
    pub(crate) async fn take<T, F>(self: &Arc<Self>, work: F) -> Result<T, Problem>
    where
        T: Send + 'static,
        F: FnOnce(&mut Workspace) -> Result<T, Problem> + Send + 'static,
    {
        let turn = self.turn().await?;
        let turns = Arc::clone(self);
        let done = tokio::task::spawn_blocking(move || {
            let done = turns.here(work);
            drop(turn);
            done
        });
        done.await.map_err(|_| Problem::new(ProblemKind::Internal, "the work on this request failed"))?
    }

    /// Does `work` on the caller's thread, whosever turn it is.
    pub(crate) fn here<T>(&self, work: impl FnOnce(&mut Workspace) -> T) -> T {
        let mut workspace = self.workspace();
        let done = work(&mut workspace);
        // Not reached by work that panics, whose memory is not to be trusted.
        self.workspaces.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
        done
    }

    async fn turn(&self) -> Result<OwnedSemaphorePermit, Problem> {
        let Ok(_place) = self.admitted.try_acquire() else {
            return Err(Problem::new(ProblemKind::Busy, "too many requests wait for their turn").retry_after(1));
        };
        let waiting = Waiting(Some(&self.dropped));
        let turn = timeout(PATIENCE, Arc::clone(&self.working).acquire_owned()).await;
        waiting.over();
        match turn {
            Ok(Ok(turn)) => Ok(turn),
            _ => Err(Problem::new(ProblemKind::Busy, "the turn of this request did not come").retry_after(1)),
        }
    }

    /// Gives nobody in line a turn any more.
    pub(crate) fn close(&self) {
        self.working.close();
    }

    fn workspace(&self) -> Workspace {
        self.workspaces.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// All turns, so that nobody else has one.
    #[cfg(test)]
    pub(crate) async fn hold_all(&self) -> OwnedSemaphorePermit {
        let all = self.working.available_permits() as u32;
        Arc::clone(&self.working).acquire_many_owned(all).await.unwrap()
    }
}

/// Counts a request that is dropped while it waits.
struct Waiting<'a>(Option<&'a Counter>);

impl Waiting<'_> {
    fn over(mut self) {
        self.0 = None;
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if let Some(dropped) = self.0 {
            dropped.inc();
        }
    }
}
