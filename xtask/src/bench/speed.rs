//! Milliseconds per window at the published sizes: ours, the floor, and PyTorch and JAX beside it.

use gnp::Progress as _;
use gnp_cli::Terminal;
use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Result;
use gnp_nn::Precision;
use gnp_traj::Engine;
use serde::Serialize;

use super::clock::{self, Run, Sample};
use super::networks::{GOALS, Goal, HIGHD, Lengths, NGSIM, Traj};
use super::peer::{Milliseconds, Python};
use super::{floor, load, pool, processor, table};
use crate::cli::BenchArgs;

/// Repeats of a round, of which the median is taken; five times as many of what takes milliseconds.
const REPEATS: usize = 3;

/// What is measured, and beside whom.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    threads: usize,
    windows: usize,
    rounds: usize,
    /// PyTorch and JAX, too.
    peers: bool,
    json: bool,
    python: Option<PathBuf>,
    /// What roll-outs multiply in beside f32.
    precision: Precision,
}

impl Plan {
    pub(super) fn new(threads: usize, args: &BenchArgs) -> Self {
        let &BenchArgs { windows, rounds, json, precision, against_torch: peers, .. } = args;
        Self { threads, windows, rounds, peers, json, python: args.python.clone(), precision }
    }
}

/// What everybody measured.
#[derive(Debug, Default)]
struct Rounds(BTreeMap<String, Vec<f64>>);

/// The last line of `--json`.
#[derive(Debug, Serialize)]
struct Comparison {
    unit: &'static str,
    threads: usize,
    windows: usize,
    ours: Milliseconds,
    torch: Milliseconds,
    jax: Milliseconds,
    /// PyTorch's time over ours.
    ratio: Milliseconds,
    /// JAX's time over ours.
    jax_ratio: Milliseconds,
    floor: Milliseconds,
}

impl Rounds {
    fn add(&mut self, round: Milliseconds) {
        for (key, value) in round {
            self.0.entry(key).or_default().push(value);
        }
    }

    fn medians(self) -> Milliseconds {
        self.0.into_iter().map(|(key, values)| (key, Sample::new(values).median())).collect()
    }
}

/// Measures `rounds` times, everybody in turn, and prints the table.
///
/// # Errors
/// When a network fails or a reference program cannot be run.
pub(super) fn run(plan: &Plan, terminal: &Terminal) -> Result<()> {
    let &Plan { threads, windows, rounds, peers, json, precision, .. } = plan;
    precision.check()?;
    let python = if peers { Some(Python::find(plan.python.as_deref(), terminal)?) } else { None };
    let load = load();
    let pool = pool(threads)?;
    let [mut ours, mut torch, mut jax] = [Rounds::default(), Rounds::default(), Rounds::default()];
    let mut rate = 0f64;
    let options =
        ["--threads", &threads.to_string(), "--windows", &windows.to_string(), "--repeats", &REPEATS.to_string()]
            .map(str::to_owned);
    for round in 1..=rounds {
        terminal.note(&format!("bench: round {round} of {rounds}"));
        rate = rate.max(pool.install(floor::rate)?);
        for lengths in [NGSIM, HIGHD] {
            ours.add(pool.install(|| measure(lengths, windows, precision))?);
        }
        if let Some(python) = &python {
            torch.add(python.measure("torch_gnp.py", &[&["bench".to_owned()], &options[..]].concat())?);
            jax.add(python.measure("jax_traj.py", &options)?);
        }
    }
    let times = [ours.medians(), torch.medians(), jax.medians()];
    let comparison = Comparison::new([threads, windows], times, floors(rate, windows)?);
    terminal.result(&format!(
        "Milliseconds per window, {windows} windows, published sizes, {threads} thread(s), median of {rounds} round(s); \
         load average {load}.\n{}.\nFloor: operations at {:.0} GFLOP/s, the fastest large f32 product of this run.\n{}",
        processor(),
        rate / 1e9,
        comparison.table(peers)
    ));
    if json {
        terminal.for_programs(&serde_json::to_string(&comparison)?);
    }
    Ok(())
}

/// Ours, in ms per window; where `precision` is not f32, also roll-outs in both, on weights that are packed before.
fn measure(lengths: Lengths, windows: usize, precision: Precision) -> Result<Milliseconds> {
    let (traj, goal) = (Traj::new(lengths, windows)?, Goal::new(lengths, windows)?);
    let cases: [(&str, usize, Run<'_>); 5] = [
        ("traj.forward", REPEATS, &|| traj.forward(Engine::Fused)),
        ("traj.train", REPEATS, &|| traj.train(Engine::Fused)),
        ("traj.forward_k20", 1, &|| traj.forward_many()),
        ("goal.forward", 5 * REPEATS, &|| goal.forward(Engine::Fused)),
        ("goal.train", 5 * REPEATS, &|| goal.train(Engine::Fused)),
    ];
    let median = |(key, repeats, run): (&str, usize, Run<'_>)| {
        let seconds = clock::sample(repeats, run)?.median();
        Ok((format!("{}.{key}", lengths.name), seconds * 1e3 / windows as f64))
    };
    let mut times = cases.into_iter().map(median).collect::<Result<Milliseconds>>()?;
    for precision in Precision::ALL.into_iter().filter(|_| precision != Precision::F32) {
        let traj = traj.frozen(precision)?;
        let cases: [(&str, usize, Run<'_>); 2] = [
            ("traj.forward", REPEATS, &|| traj.forward(Engine::Fused)),
            ("traj.forward_k20", 1, &|| traj.forward_many()),
        ];
        for case in cases {
            let (key, ms) = median(case)?;
            times.insert(format!("{key}.{precision}"), ms);
        }
    }
    Ok(times)
}

/// The floor of everything that is measured, in ms per window, at `rate` operations a second.
fn floors(rate: f64, windows: usize) -> Result<Milliseconds> {
    let mut floors = Milliseconds::new();
    for lengths in [NGSIM, HIGHD] {
        let (near, seen) = (Traj::new(lengths, windows)?.taken()?, Goal::new(lengths, windows)?.taken()?);
        for (key, operations) in [
            ("traj.forward", floor::traj(lengths, near, 1)),
            ("traj.train", 3. * floor::traj(lengths, near, 1)),
            ("traj.forward_k20", floor::traj(lengths, near, GOALS)),
            ("goal.forward", floor::goal(lengths, seen, GOALS)),
            ("goal.train", 3. * floor::goal(lengths, seen, 1)),
        ] {
            floors.insert(format!("{}.{key}", lengths.name), operations / rate * 1e3);
        }
    }
    Ok(floors)
}

impl Comparison {
    fn new([threads, windows]: [usize; 2], [ours, torch, jax]: [Milliseconds; 3], floor: Milliseconds) -> Self {
        let over = |theirs: &Milliseconds| -> Milliseconds {
            let ratio = |(key, theirs): (&String, &f64)| Some((key.clone(), theirs / ours.get(key)?));
            theirs.iter().filter_map(ratio).collect()
        };
        let (ratio, jax_ratio) = (over(&torch), over(&jax));
        Self { unit: "ms per window", threads, windows, ours, torch, jax, ratio, jax_ratio, floor }
    }

    /// One row for each of ours; the columns of others with `peers`.
    fn table(&self, peers: bool) -> String {
        let mut header = vec!["", "ours", "floor", "ours / floor"];
        if peers {
            header.extend(["PyTorch", "PyTorch / ours", "JAX", "JAX / ours"]);
        }
        let cell = |of: &Milliseconds, key: &str| of.get(key).map_or_else(String::new, |value| format!("{value:.2}"));
        let row = |(key, ours): (&String, &f64)| {
            // In another precision the operations are the same.
            let case = Precision::ALL.iter().find_map(|precision| key.strip_suffix(&format!(".{precision}")));
            let floor = self.floor.get(case.unwrap_or(key)).copied().unwrap_or(f64::NAN);
            let mut row =
                vec![key.clone(), format!("{ours:.3}"), format!("{floor:.3}"), format!("{:.2}", ours / floor)];
            if peers {
                row.extend([&self.torch, &self.ratio, &self.jax, &self.jax_ratio].map(|of| cell(of, key)));
            }
            row
        };
        table(header.into_iter().map(str::to_owned).collect(), self.ours.iter().map(row).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(pairs: &[(&str, f64)]) -> Milliseconds {
        pairs.iter().map(|(key, value)| ((*key).to_owned(), *value)).collect()
    }

    #[test]
    fn ratios_are_theirs_over_ours() {
        let ours = times(&[("ngsim.traj.train", 4.), ("ngsim.goal.train", 2.)]);
        let torch = times(&[("ngsim.traj.train", 20.), ("ngsim.goal.train", 3.)]);
        let jax = times(&[("ngsim.traj.train", 12.)]);
        let both = Comparison::new([2, 64], [ours, torch, jax], times(&[("ngsim.traj.train", 3.2)]));
        assert_eq!(both.ratio, times(&[("ngsim.traj.train", 5.), ("ngsim.goal.train", 1.5)]));
        assert_eq!(both.jax_ratio, times(&[("ngsim.traj.train", 3.)]));
        let text = both.table(true);
        assert!(
            text.contains("JAX") && text.contains("20.00") && text.contains("5.00") && text.contains("1.25"),
            "{text}"
        );
        assert!(!both.table(false).contains("JAX"));
    }

    #[test]
    fn rounds_give_their_median() {
        let mut rounds = Rounds::default();
        for value in [5., 1., 2.] {
            rounds.add(times(&[("a", value)]));
        }
        assert_eq!(rounds.medians(), times(&[("a", 2.)]));
    }

    #[test]
    fn everything_that_is_measured_has_a_floor() {
        let floors = floors(1e11, 2).unwrap();
        assert_eq!(floors.len(), 10);
        assert!(floors.values().all(|ms| *ms > 0.));
        let (train, forward) = (floors["highd.traj.train"], floors["highd.traj.forward"]);
        assert!((train - 3. * forward).abs() < 1e-12 * train, "{train} {forward}");
    }
}
