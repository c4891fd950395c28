//! Bits of a finished run that flip: found when it is opened, never believed.

use std::fs;

use anyhow::{Context as _, Result};
use rand::Rng as _;
use rand::seq::IndexedRandom as _;

use super::round::{Outcome, Reading, Round, copy};
use crate::contents::{in_events, paths};

/// Tries in a round, each on a copy of its own.
const TRIES: usize = 5;

/// Flips a bit of one file and opens the run, to go on with it or to read it.
///
/// # Errors
/// When a copy cannot be made.
pub(super) fn play(round: &mut Round<'_>) -> Result<()> {
    for number in 0..TRIES {
        let outcome = one(round, number).unwrap_or_else(|error| Outcome::Failed(format!("{error:#}")));
        round.outcomes.push(outcome);
    }
    Ok(())
}

fn one(round: &mut Round<'_>, number: usize) -> Result<Outcome> {
    let job = &round.stand.pipeline;
    let folder = round.folder(&format!("flipped-{number}"))?;
    copy(&job.folder, &folder)?;
    let mut files = paths(&folder)?;
    files.retain(|path| !in_events(path));
    let path = files.choose(&mut round.chance).context("the run is empty")?;
    let place = folder.join(path);
    let mut bytes = fs::read(&place).with_context(|| format!("cannot read {}", place.display()))?;
    if bytes.is_empty() {
        return Ok(Outcome::Skipped(format!("{path} is empty")));
    }
    let (at, bit) = (round.chance.random_range(0..bytes.len()), round.chance.random_range(0..8));
    bytes[at] ^= 1 << bit;
    fs::write(&place, bytes).with_context(|| format!("cannot write {}", place.display()))?;
    let said = || format!("bit {bit} of byte {at} of {path} flipped");
    if round.chance.random_bool(0.5) {
        let reading = *Reading::ALL.choose(&mut round.chance).context("nothing reads")?;
        let parent = folder.parent().unwrap_or(&folder);
        return reading.of(job, &folder, parent, true).with_context(said);
    }
    Round::mend(job, &folder, std::slice::from_ref(path)).with_context(said)
}
