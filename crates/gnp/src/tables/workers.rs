//! Jobs side by side.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use super::jobs::Job;
use crate::error::{Error, Result};
use crate::machine::Machine;
use crate::text::duration;

/// Does every job once, `workers` at a time, and says so on `machine` line by line. A job that fails lets the others go on.
///
/// # Errors
/// [`Error::Jobs`] with those that failed; [`Error::Stopped`].
pub(super) fn perform(
    stem: &str,
    jobs: &[Job],
    workers: usize,
    machine: &Machine,
    job: impl Fn(&Job) -> Result<()> + Sync,
) -> Result<()> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let total = jobs.len();
    let work = || -> Result<Vec<(String, Error)>> {
        let mut failed = Vec::new();
        while let Some(one) = jobs.get(next.fetch_add(1, Ordering::SeqCst)) {
            machine.stop.check()?;
            machine.progress.note(&format!("{stem}: {one} started"));
            let started = Instant::now();
            let result = job(one);
            match result {
                Err(error) if error.is_stopped() => return Err(error),
                Err(error) => {
                    machine.progress.note(&format!("{stem}: {one} failed: {}", error.chain()));
                    failed.push((one.to_string(), error));
                }
                Ok(()) => {
                    let done = 1 + done.fetch_add(1, Ordering::SeqCst);
                    machine
                        .progress
                        .note(&format!("{stem}: {one} done in {}, {done} of {total}", duration(started.elapsed())));
                }
            }
        }
        Ok(failed)
    };
    let results: Vec<Result<Vec<(String, Error)>>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers.clamp(1, total.max(1))).map(|_| scope.spawn(work)).collect();
        handles
            .into_iter()
            .map(|handle| handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    let failed: Vec<(String, Error)> = results.into_iter().collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    if failed.is_empty() { Ok(()) } else { Err(Error::Jobs { failed }) }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    fn jobs() -> Vec<Job> {
        (0..7).map(|seed| Job { fold: 1, stem: "gnp", seed }).collect()
    }

    #[test]
    fn every_job_is_done_once_and_a_failure_lets_the_others_finish() {
        for workers in [1, 3, 20] {
            let seen = Mutex::new(Vec::new());
            let result = perform("table1", &jobs(), workers, &Machine::default(), |job| {
                seen.lock().unwrap().push(job.seed);
                if job.seed == 2 { Err(Error::Config("is odd".to_owned())) } else { Ok(()) }
            });
            let mut seen = seen.into_inner().unwrap();
            seen.sort_unstable();
            assert_eq!(seen, [0, 1, 2, 3, 4, 5, 6]);
            let message = result.unwrap_err().to_string();
            assert!(
                message.starts_with("one job failed") && message.contains("fold-1/gnp/seed-2: is odd"),
                "{message}"
            );
        }
    }

    #[test]
    fn a_stop_ends_all_workers() {
        let (machine, started) = (Machine::default(), AtomicUsize::new(0));
        let result = perform("table1", &jobs(), 2, &machine, |_| {
            started.fetch_add(1, Ordering::SeqCst);
            machine.stop.request();
            machine.stop.check()
        });
        assert!(result.unwrap_err().is_stopped() && started.into_inner() <= 2);
        perform("table1", &[], 2, &Machine::default(), |_| Ok(())).unwrap();
    }
}
