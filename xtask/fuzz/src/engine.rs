//! The plain engine: replays a corpus, then goes on with random inputs; panics are caught.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once, PoisonError};
use std::time::{Duration, Instant};

use crate::mutate::Mutator;
use crate::{Corpus, Finding, Scratch, Target};

/// Tries of the search for a shorter input.
const SHORTENING: usize = 2000;

/// With so many different failures there is enough to do.
const MOST_FAILURES: usize = 8;

/// What the last panic said and where, of any thread.
static PANIC: Mutex<Option<String>> = Mutex::new(None);

/// One execution at a time in a process: what a panic said is that of this one.
static ALONE: Mutex<()> = Mutex::new(());

thread_local! {
    /// Whether this thread tries an input.
    static TRYING: Cell<bool> = const { Cell::new(false) };
}

/// An input and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The input.
    pub input: Vec<u8>,
    /// What went wrong: a panic with its place, or a [`Finding`].
    pub what: String,
}

/// When to stop; the corpus is replayed in any case.
#[derive(Clone, Copy, Debug, Default)]
pub struct Limits {
    /// Executions, those of the corpus included.
    pub executions: Option<u64>,
    /// Time from the start.
    pub time: Option<Duration>,
    /// From which the inputs are drawn.
    pub seed: u64,
}

/// Keeps what panics say from the terminal and for [`execute`]; once for the process.
pub fn catch_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !TRYING.get() {
                usual(info);
            }
            let place = info.location().map(ToString::to_string).unwrap_or_default();
            let said = info.payload_as_str().unwrap_or("no message");
            if let Ok(mut last) = PANIC.lock() {
                // Of a panic that is handed from thread to thread the first place counts.
                last.get_or_insert_with(|| format!("panic at {place}: {said}"));
            }
        }));
    });
}

/// Tries one input.
///
/// # Errors
/// What went wrong, in words.
pub fn execute(target: &Target, scratch: &Scratch, input: &[u8]) -> Result<(), String> {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Ok(mut last) = PANIC.lock() {
        *last = None;
    }
    TRYING.set(true);
    let tried = catch_unwind(AssertUnwindSafe(|| (target.run)(scratch, input)));
    TRYING.set(false);
    match tried {
        // A panic of another thread that the code under test made an error of, or nothing. Those of parquet on damaged files
        // are caught where it is called.
        Ok(Ok(())) => last_panic().filter(|what| !what.contains("/parquet-")).map_or(Ok(()), Err),
        Ok(Err(finding)) => Err(match &finding {
            Finding::Scratch(error) => format!("{finding}: {error}"),
            _ => finding.to_string(),
        }),
        Err(_) => Err(last_panic().unwrap_or_else(|| "panic".to_owned())),
    }
}

fn last_panic() -> Option<String> {
    PANIC.lock().ok().and_then(|mut last| last.take())
}

/// What came of many executions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// How many there were.
    pub executions: u64,
    /// What went wrong: one input for each thing that did, made shorter where that was simple.
    pub failures: Vec<Failure>,
}

/// Replays `corpus` and goes on with random inputs until a limit is reached. Before each execution `before` is told how many
/// there were and the input.
pub fn run(
    target: &Target,
    scratch: &Scratch,
    corpus: &Corpus,
    limits: &Limits,
    before: &mut dyn FnMut(u64, &[u8]),
) -> Outcome {
    catch_panics();
    let started = Instant::now();
    let mut mutator = Mutator::new(limits.seed, corpus, target.words);
    let mut outcome = Outcome::default();
    let mut inputs = corpus.iter().cloned();
    loop {
        let input = match inputs.next() {
            Some(input) => input,
            None => {
                let spent = limits.time.is_some_and(|time| started.elapsed() >= time);
                let enough = limits.executions.is_some_and(|most| outcome.executions >= most);
                if spent || enough || outcome.failures.len() >= MOST_FAILURES {
                    return outcome;
                }
                mutator.next()
            }
        };
        let done = outcome.executions;
        before(done, &input);
        if let Err(what) = execute(target, scratch, &input)
            && !outcome.failures.iter().any(|known| kind(&known.what) == kind(&what))
        {
            let failure = Failure { input, what };
            outcome.failures.push(minimise(target, scratch, failure, &mut |input| before(done, input)));
        }
        outcome.executions += 1;
    }
}

/// A shorter input with which the same goes wrong, by leaving out parts of it. `before` is told each one that is tried.
fn minimise(target: &Target, scratch: &Scratch, failure: Failure, before: &mut dyn FnMut(&[u8])) -> Failure {
    let mut best = failure;
    let mut tries = 0;
    let mut part = best.input.len().next_power_of_two() / 2;
    while part > 0 {
        let mut at = 0;
        while at < best.input.len() && tries < SHORTENING {
            tries += 1;
            let end = best.input.len().min(at + part);
            let shorter = [&best.input[..at], &best.input[end..]].concat();
            before(&shorter);
            match execute(target, scratch, &shorter) {
                Err(what) if kind(&what) == kind(&best.what) => best = Failure { input: shorter, what },
                _ => at = end,
            }
        }
        part /= 2;
    }
    best
}

/// What tells one failure from another: its first words without numbers, which differ from input to input.
fn kind(what: &str) -> String {
    what.chars().take(48).filter(|c| !c.is_ascii_digit()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Panics on `x`, finds fault with `ab`.
    const PICKY: Target = Target {
        name: "picky",
        about: "",
        run: |_, input| {
            assert!(!input.contains(&b'x'), "an x");
            if input == b"thread" {
                let _ = std::thread::spawn(|| panic!("nobody looks")).join();
            }
            if input.windows(2).any(|pair| pair == b"ab") { Err(Finding::Believed("ab".to_owned())) } else { Ok(()) }
        },
        seeds: |_| Ok(Vec::new()),
        words: &["ab"],
    };

    #[test]
    fn failures_are_found_and_shortened() {
        let scratch = Scratch::new().unwrap();
        let limits = Limits { executions: Some(100_000), ..Limits::default() };
        let corpus = Corpus { seeds: vec![b"the quick brown f".to_vec()], ..Corpus::default() };
        let mut seen = 0;
        let outcome = run(&PICKY, &scratch, &corpus, &limits, &mut |_, _| seen += 1);
        let mut inputs: Vec<&[u8]> = outcome.failures.iter().map(|failure| &failure.input[..]).collect();
        inputs.sort_unstable();
        assert_eq!(inputs, [&b"ab"[..], b"x"], "one for each thing that goes wrong: {outcome:?}");
        assert!(outcome.executions == 100_000 && seen > outcome.executions);
        let given = Failure { input: b"some text with an x in it".to_vec(), what: String::new() };
        let what = execute(&PICKY, &scratch, &given.input).unwrap_err();
        assert!(what.contains("engine.rs") && what.contains("an x"), "{what}");
        assert_eq!(minimise(&PICKY, &scratch, Failure { what, ..given }, &mut |_| {}).input, b"x");
    }

    #[test]
    fn a_panic_that_is_passed_over_in_silence_is_a_failure() {
        catch_panics();
        let scratch = Scratch::new().unwrap();
        assert!(execute(&PICKY, &scratch, b"thread").unwrap_err().contains("nobody looks"));
        assert_eq!(execute(&PICKY, &scratch, b"threads"), Ok(()));
    }

    #[test]
    fn the_corpus_is_replayed_whatever_the_limit() {
        let scratch = Scratch::new().unwrap();
        let corpus = Corpus { seeds: vec![b"1".to_vec()], committed: vec![b"2".to_vec()] };
        let limits = Limits { executions: Some(1), ..Limits::default() };
        let outcome = run(&PICKY, &scratch, &corpus, &limits, &mut |_, _| {});
        assert_eq!(outcome, Outcome { executions: 2, failures: Vec::new() });
    }
}
