//! Two processes that write one folder: one does it, the other is refused.

use anyhow::{Context as _, Result, bail};
use rand::Rng as _;

use super::round::{Outcome, Round};
use crate::process::Signal;

/// Words of a refusal: somebody else holds the folder, or it has appeared meanwhile.
const REFUSALS: [&str; 2] = ["another", "not empty"];

/// A second process starts on the folder of a first one, which is fresh or goes on after a kill.
///
/// # Errors
/// When both go on, or neither.
pub(super) fn play(round: &mut Round<'_>) -> Result<()> {
    let job = &round.stand.pipeline;
    let folder = round.folder("shared")?;
    if round.chance.random_bool(0.5) {
        let mut running = job.start(&folder)?;
        round.random_moment(job, &mut running, &folder)?;
        running.send(Signal::Kill)?;
        let _ = running.end()?;
    }
    let mut first = job.start(&folder)?;
    let share = round.chance.random_range(0.0..0.5);
    first.sleep(job.total.mul_f64(share))?;
    let second = job.start(&folder)?.end()?;
    // A first one that was killed late and goes on may be done before the second begins.
    let overlaps = first.runs()?;
    let first = first.end()?;
    let outcome = match (first.status.success(), second.status.success()) {
        (true, true) if overlaps => bail!("both wrote the folder at once: {first}; {second}"),
        (true, true) => Outcome::Resumed,
        (true, false) => second.refused_of(&folder, &REFUSALS).map(|()| Outcome::Refused)?,
        (false, true) => first.refused_of(&folder, &REFUSALS).map(|()| Outcome::Refused)?,
        (false, false) => bail!("neither went on: {first}; {second}"),
    };
    round.finish(job, &folder, outcome).context("after two processes at once")
}
