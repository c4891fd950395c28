//! What a power cut leaves: files written last are cut off, end in zeros, or their last renames never happened.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context as _, Result, anyhow, bail};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;

use super::history::History;
use super::round::{Outcome, Round};
use crate::process::Signal;

/// How many of the last writes a power cut can reach.
const REACH: usize = 6;
/// Size of a block of a disk, bytes.
const BLOCK: usize = 4096;
/// Draws until something is torn; half of the kinds of damage always are.
const DRAWS: usize = 100;

/// A pipeline is killed, its last writes are torn, and it goes on.
///
/// # Errors
/// When what is torn is believed.
pub(super) fn play(round: &mut Round<'_>) -> Result<()> {
    let job = &round.stand.pipeline;
    let folder = round.folder("torn")?;
    let history = History::begin(&folder, &round.place.join("versions"))?;
    let end = AtomicBool::new(false);
    let mut running = job.start(&folder)?;
    let history = std::thread::scope(|scope| {
        let watching = scope.spawn(|| history.watch(&end));
        let killed = round.random_moment(job, &mut running, &folder).and_then(|_| running.send(Signal::Kill));
        let ended = running.end();
        end.store(true, Ordering::Relaxed);
        let history = watching.join().map_err(|_| anyhow!("what is written could not be watched"))?;
        killed.and(ended)?;
        history
    })?;
    let Some(damage) = tear(&mut round.chance, &folder, &history)? else {
        round.outcomes.push(Outcome::Skipped("it was killed before it wrote anything".to_owned()));
        return Round::go_on(job, &folder);
    };
    let outcome = Round::mend(job, &folder, &damage.paths).with_context(|| damage.said.clone())?;
    round.outcomes.push(outcome);
    Ok(())
}

/// What was torn.
#[derive(Clone, Debug)]
struct Damage {
    /// The file, or all that are lost.
    paths: Vec<String>,
    said: String,
}

/// Tears what was written last; `None` where nothing was written.
fn tear(chance: &mut ChaCha8Rng, folder: &Path, history: &History) -> Result<Option<Damage>> {
    if history.written().is_empty() {
        return Ok(None);
    }
    // Some draws change nothing: zeros where there were zeros, a file that a later stage removed.
    for _ in 0..DRAWS {
        if let Some(damage) = draw(chance, folder, history)? {
            return Ok(Some(damage));
        }
    }
    bail!("{DRAWS} draws tore nothing")
}

/// Tears something; `None` where that changes nothing.
fn draw(chance: &mut ChaCha8Rng, folder: &Path, history: &History) -> Result<Option<Damage>> {
    let written = history.written();
    let reach = written.len().saturating_sub(REACH)..written.len();
    let deed = chance.random_range(0..4);
    let path = written[chance.random_range(reach.clone())].path.clone();
    let place = folder.join(&path);
    match deed {
        0 | 1 => {
            let Ok(mut bytes) = fs::read(&place) else { return Ok(None) };
            let before = bytes.clone();
            let said = if deed == 0 {
                bytes.truncate(chance.random_range(0..bytes.len().max(1)));
                format!("{path} cut off at {} bytes", bytes.len())
            } else {
                let blocks = chance.random_range(0..bytes.len().div_ceil(BLOCK).max(1));
                bytes[blocks * BLOCK..].fill(0);
                format!("{path} zeros from byte {}", blocks * BLOCK)
            };
            // Under the same name, but not through the file's other name in the history.
            fs::remove_file(&place).with_context(|| format!("cannot remove {}", place.display()))?;
            fs::write(&place, &bytes).with_context(|| format!("cannot write {}", place.display()))?;
            Ok((bytes != before).then(|| Damage { paths: vec![path], said }))
        }
        2 => {
            let first = chance.random_range(reach.clone());
            (first..reach.end).rev().try_for_each(|index| history.lose(index))?;
            let said = format!("the last {} renames lost, from that of {} on", reach.end - first, written[first].path);
            Ok(Some(Damage { paths: written[first..].iter().map(|lost| lost.path.clone()).collect(), said }))
        }
        _ => {
            // The last version of a file, whatever was written after it.
            let of_path: Vec<usize> = reach.filter(|index| written[*index].path == path).collect();
            let Some(index) = of_path.last() else { return Ok(None) };
            history.lose(*index)?;
            Ok(Some(Damage { said: format!("the rename of {path} lost, later ones kept"), paths: vec![path] }))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use rand_chacha::rand_core::SeedableRng as _;

    use super::*;
    use crate::contents::Contents;

    #[test]
    fn what_is_torn_was_written_while_it_was_watched() {
        let place = tempfile::tempdir().unwrap();
        let mut torn = BTreeSet::new();
        for seed in 0..40 {
            let folder = place.path().join(format!("run-{seed}"));
            fs::create_dir(&folder).unwrap();
            gnp_file::save(&folder.join("before"), b"before").unwrap();
            let mut history = History::begin(&folder, &place.path().join(format!("versions-{seed}"))).unwrap();
            for name in ["a", "b"] {
                gnp_file::save(&folder.join(name), &[1; 3 * BLOCK]).unwrap();
                history.look().unwrap();
            }
            let whole = Contents::read(&folder).unwrap();
            let damage = tear(&mut ChaCha8Rng::seed_from_u64(seed), &folder, &history).unwrap().unwrap();
            let differences = whole.differences(&Contents::read(&folder).unwrap());
            assert!(!differences.is_empty(), "{damage:?}");
            let named = |one: &String| damage.paths.iter().any(|path| one.starts_with(path.as_str()));
            assert!(differences.iter().all(named), "{damage:?}: {differences:?}");
            assert!(!differences.iter().any(|one| one.starts_with("before")), "{differences:?}");
            torn.extend(differences);
        }
        // Each is cut off or zeroed in one of the rounds, and lost in another.
        assert_eq!(torn.into_iter().collect::<Vec<_>>(), ["a differs", "a is missing", "b differs", "b is missing"]);
    }
}
