//! What the libraries below read from the environment when a program starts, and what is best there.
//!
//! - candle cuts operations on long tensors into parts for threads of its own, which then wait actively for the next one and
//!   keep the processor from ours: a training of CS-LSTM on two threads takes twice the processor time with them.
//!   `CANDLE_NUM_THREADS=1` leaves such an operation to the thread that asks for it.
//! - At every matrix product candle looks for the number of threads in `RAYON_NUM_THREADS`, and where it is not set it counts
//!   the cores in `/proc/cpuinfo`, which is long on a large computer.
//! - glibc gives memory back to the system as soon as little is in use, at the end of each step of a training, and takes it
//!   again, page by page, in the next: a fifth of the processor time. With higher thresholds it keeps what it has.
//!
//! A running program cannot change these safely: it starts itself anew, in its place, with what is missing.

use crate::processes;

/// Threads of rayon, and of candle's matrix products.
const THREADS: &str = "RAYON_NUM_THREADS";
/// Threads of candle's other operations.
const CANDLE_THREADS: &str = "CANDLE_NUM_THREADS";
/// Free bytes that glibc keeps at the end of its memory.
const KEPT: (&str, usize) = ("MALLOC_TRIM_THRESHOLD_", 1 << 30);
/// From so many bytes on a piece of memory goes back to the system when it is not used any more; the most that glibc takes.
const LARGE: (&str, usize) = ("MALLOC_MMAP_THRESHOLD_", 1 << 25);

/// The variables and their values for a program on so many threads.
#[must_use]
pub fn variables(threads: usize) -> Vec<(&'static str, String)> {
    let mut variables = vec![(THREADS, threads.to_string()), (CANDLE_THREADS, "1".to_owned())];
    if cfg!(all(target_os = "linux", target_env = "gnu")) {
        variables.extend([KEPT, LARGE].map(|(name, bytes)| (name, bytes.to_string())));
    }
    variables
}

/// Starts this program anew with the variables that it lacks, `threads` as asked for on the command line; only on Unix, where
/// the new one takes the place of the old. Comes back where nothing is missing, and where it cannot be done: then the
/// program is slower and nothing else.
pub(crate) fn settle(threads: Option<u16>) {
    let threads = threads.map(usize::from);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let missing = missing(threads, cores, |name| std::env::var(name).ok());
    if !missing.is_empty() {
        start_anew(missing);
    }
}

/// What is to be set. Others' values stay but for a number of threads that the command line contradicts; memory alone is no
/// reason to start anew, as the system may take its variables from the environment of a privileged program.
fn missing(
    threads: Option<usize>,
    cores: usize,
    present: impl Fn(&str) -> Option<String>,
) -> Vec<(&'static str, String)> {
    let lacks = |(name, value): &(&'static str, String)| match present(name) {
        None => true,
        Some(there) => *name == THREADS && threads.is_some() && there != *value,
    };
    let missing: Vec<_> = variables(threads.unwrap_or(cores)).into_iter().filter(lacks).collect();
    if missing.iter().any(|(name, _)| [THREADS, CANDLE_THREADS].contains(name)) { missing } else { Vec::new() }
}

#[cfg(unix)]
fn start_anew(variables: Vec<(&'static str, String)>) {
    use std::os::unix::process::CommandExt as _;

    let Ok(own) = processes::program() else { return };
    let mut command = std::process::Command::new(own);
    let mut words = std::env::args_os();
    if let Some(name) = words.next() {
        command.arg0(name);
    }
    // It comes back with an error, or not at all.
    let _ = command.args(words).envs(variables).exec();
}

#[cfg(not(unix))]
fn start_anew(_: Vec<(&'static str, String)>) {}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn asked(threads: Option<usize>, there: &BTreeMap<&str, String>) -> Vec<(&'static str, String)> {
        missing(threads, 8, |name| there.get(name).cloned())
    }

    #[test]
    fn what_is_missing_is_set_once() {
        for threads in [None, Some(1), Some(3)] {
            let mut there = BTreeMap::new();
            let first = asked(threads, &there);
            assert_eq!(first, variables(threads.unwrap_or(8)));
            there.extend(first);
            assert!(asked(threads, &there).is_empty(), "it would start itself for ever");
            // As a privileged program is left without the variables of memory.
            there.retain(|name, _| !name.starts_with("MALLOC"));
            assert!(asked(threads, &there).is_empty());
        }
    }

    #[test]
    fn what_the_user_set_stays_unless_the_command_line_says_otherwise() {
        let there = BTreeMap::from([(CANDLE_THREADS, "4".to_owned()), (THREADS, "2".to_owned())]);
        assert!(asked(None, &there).is_empty() && asked(Some(2), &there).is_empty());
        let set: BTreeMap<_, _> = asked(Some(5), &there).into_iter().collect();
        assert_eq!((set[THREADS].as_str(), set.get(CANDLE_THREADS)), ("5", None));
    }
}
