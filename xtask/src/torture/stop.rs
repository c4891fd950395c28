//! Processes stopped at random moments.

use anyhow::{Result, bail};
use gnp::Stage;
use rand::Rng as _;

use super::job::{Job, Kind};
use super::round::{Outcome, Round};
use crate::process::Signal;

/// A pipeline is killed one to three times, then goes on to the end.
///
/// # Errors
/// When it does not, or writes something else.
pub(super) fn kill(round: &mut Round<'_>) -> Result<()> {
    let stand = round.stand;
    kills(round, &stand.pipeline)
}

/// The same with another command.
///
/// # Errors
/// As [`kill`].
pub(super) fn kill_other(round: &mut Round<'_>, kind: Kind) -> Result<()> {
    let stand = round.stand;
    kills(round, if kind == Kind::Compare { &stand.compare } else { &stand.simulate })
}

fn kills(round: &mut Round<'_>, job: &Job) -> Result<()> {
    let folder = round.folder("killed")?;
    for _ in 0..round.chance.random_range(1..=3) {
        let before = job.done(&folder)?;
        let mut running = job.start(&folder)?;
        if round.random_moment(job, &mut running, &folder)? {
            running.send(Signal::Kill)?;
            let _ = running.end()?;
        } else {
            running.end()?.well()?;
        }
        job.expect_kept(&before, &folder)?;
    }
    round.finish(job, &folder, Outcome::Resumed)
}

/// A pipeline is asked to stop, does so at the next safe point, and goes on to the end.
///
/// # Errors
/// When it does not, or writes something else.
pub(super) fn interrupt(round: &mut Round<'_>) -> Result<()> {
    let job = &round.stand.pipeline;
    let folder = round.folder("interrupted")?;
    let signal = if round.chance.random_bool(0.5) { Signal::Interrupt } else { Signal::Terminate };
    let mut running = job.start(&folder)?;
    let ran = round.random_moment(job, &mut running, &folder)?;
    // One that was in its last stage may be done before it looks again.
    let last = job.done(&folder)?.len() + 1 >= Stage::ALL.len();
    if ran {
        running.send(signal)?;
    }
    let ended = running.end()?;
    // In its first milliseconds nothing listens yet.
    let early = ended.signal() == Some(signal.number()) && !folder.exists();
    let asked = ended.code() == Some(130) && ended.err.contains("stopp");
    if !(early || asked && ran || ended.status.success() && (last || !ran)) {
        bail!("was to stop with exit code 130 and a sentence: {ended}");
    }
    if asked && folder.exists() && !ended.err.contains("--resume --out") {
        bail!("does not say how to go on: {ended}");
    }
    round.finish(job, &folder, Outcome::Resumed)
}
