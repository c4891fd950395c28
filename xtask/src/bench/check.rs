//! Ratios of two times measured in one run, compared with limits.

use gnp::Progress as _;
use gnp_cli::Terminal;
use std::hint::black_box;

use anyhow::Result;
use gnp_traj::Engine;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::clock::{self, Pair, Run};
use super::limits::{Limit, Limits};
use super::networks::{Goal, Lengths, NGSIM, Traj};
use super::{cores, load, pool, table, traffic, training};

/// Turns of a loop that takes some 20 ms.
const LOOP: u64 = 20_000_000;

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Profile {
    /// Less than a minute, for CI.
    Quick,
    /// The published sizes.
    Full,
}

/// What a profile measures with.
struct Sizes {
    lengths: Lengths,
    windows: usize,
    /// Turns of what takes long, and of what does not.
    turns: [usize; 2],
    /// Vehicles in each lane of the traffic; twice as many beside it.
    vehicles: usize,
}

impl Profile {
    fn sizes(self) -> Sizes {
        match self {
            Self::Quick => Sizes {
                lengths: Lengths { observed: NGSIM.observed / 2, predicted: NGSIM.predicted / 2, ..NGSIM },
                windows: 32,
                turns: [3, 9],
                vehicles: 30,
            },
            Self::Full => Sizes { lengths: NGSIM, windows: 64, turns: [5, 15], vehicles: 120 },
        }
    }
}

/// A number and its limit.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) what: &'static str,
    measured: Measured,
    limit: Limit,
    again: bool,
}

/// A ratio, and what it is of.
#[derive(Clone, Debug)]
struct Measured {
    value: f64,
    /// Both sides, for people.
    sides: [String; 2],
}

impl Measured {
    /// The second of a pair over the first.
    fn pair(pair: &Pair) -> Self {
        let ms = |seconds: f64| format!("{:.2} ms", seconds * 1e3);
        Self { value: pair.ratio, sides: [ms(pair.first), ms(pair.second)] }
    }
}

impl Row {
    pub(super) fn holds(&self) -> bool {
        self.limit.holds(self.measured.value)
    }

    fn cells(&self) -> Vec<String> {
        let [first, second] = self.measured.sides.clone();
        let verdict = match (self.holds(), self.again) {
            (true, false) => "holds",
            (true, true) => "2nd try",
            (false, _) => "MISSED",
        };
        let value = format!("{:.2}", self.measured.value);
        vec![self.what.to_owned(), first, second, value, self.limit.text(), verdict.to_owned()]
    }
}

/// Measures once, and once more if the limit is missed; the better counts.
fn row(what: &'static str, limit: Limit, measure: impl Fn() -> Result<Measured>) -> Result<Row> {
    let mut measured = measure()?;
    let again = !limit.holds(measured.value);
    if again {
        let second = measure()?;
        if limit.better(measured.value, second.value) == second.value {
            measured = second;
        }
    }
    Ok(Row { what, measured, limit, again })
}

/// Measures every ratio and prints the table.
///
/// # Errors
/// When a benchmark fails; a missed limit is in the rows.
pub(super) fn measure(limits: &Limits, profile: Profile, terminal: &Terminal) -> Result<Vec<Row>> {
    let sizes = profile.sizes();
    let load = load();
    let mut rows = networks(limits, &sizes, terminal)?;
    rows.extend(growth(limits, &sizes, terminal)?);
    let Sizes { lengths, windows, .. } = sizes;
    let header = ["", "first", "second", "ratio", "limit", ""].map(str::to_owned).to_vec();
    terminal.result(&format!(
        "{windows} windows of {} + {} frames, published networks; load average {load}\n{}",
        lengths.observed,
        lengths.predicted,
        table(header, rows.iter().map(Row::cells).collect())
    ));
    Ok(rows)
}

/// The fused operations against the graph on all cores, and two threads against one.
fn networks(limits: &Limits, sizes: &Sizes, terminal: &Terminal) -> Result<Vec<Row>> {
    let [long, short] = sizes.turns;
    let (traj, goal) = (Traj::new(sizes.lengths, sizes.windows)?, Goal::new(sizes.lengths, sizes.windows)?);
    let all = pool(cores())?;
    let fused = |what, limit, turns, run: fn(&Traj, &Goal, Engine) -> Result<()>| {
        terminal.note(&format!("bench: {what}"));
        let on = |engine| run(&traj, &goal, engine);
        row(what, Limit::AtLeast(limit), || {
            let pair = all.install(|| clock::pair(turns, &|| on(Engine::Fused), &|| on(Engine::Graph)))?;
            Ok(Measured::pair(&pair))
        })
    };
    let of = &limits.fused;
    let mut rows = vec![
        fused("roll-out: graph/fused", of.traj_forward, long, |traj, _, engine| traj.forward(engine))?,
        fused("roll-out, gradient: graph/fused", of.traj_train, long, |traj, _, engine| traj.train(engine))?,
        fused("goals: graph/fused", of.goal_forward, short, |_, goal, engine| goal.forward(engine))?,
        fused("goals, gradient: graph/fused", of.goal_train, short, |_, goal, engine| goal.train(engine))?,
    ];
    if cores() < 2 {
        terminal.result("One core: two threads are not measured against one.");
        return Ok(rows);
    }
    let (one, two) = (pool(1)?, pool(2)?);
    let threads = |what, limit, run: Run<'_>| {
        terminal.note(&format!("bench: {what}"));
        row(what, Limit::AtLeast(limit), || gain(short, [&one, &two], run))
    };
    let of = &limits.threads;
    rows.push(threads("roll-out, gradient: 2 threads", of.traj_train, &|| traj.train(Engine::Fused))?);
    rows.push(threads("goals, gradient: 2 threads", of.goal_train, &|| goal.train(Engine::Fused))?);
    rows.push(threads("goals, step of training: 2 threads", of.goal_step, &|| training::step(&goal))?);
    Ok(rows)
}

/// How much faster `run` is on the second pool than on the first, as a share of what two loops that
/// need nothing of each other gain: on a busy machine these gain less, too.
fn gain(turns: usize, [one, two]: [&ThreadPool; 2], run: Run<'_>) -> Result<Measured> {
    let loops = || {
        (0..2u64).into_par_iter().for_each(|seed| {
            black_box((0..LOOP).fold(seed, |x, i| x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(i)));
        });
        Ok(())
    };
    let [loops_one, loops_two, run_one, run_two] = clock::medians(
        turns,
        [&|| one.install(loops), &|| two.install(loops), &|| one.install(run), &|| two.install(run)],
    )?;
    let [gain, possible] = [run_one / run_two, loops_one / loops_two];
    Ok(Measured { value: gain / possible, sides: [format!("{gain:.2} times"), format!("loops {possible:.2} times")] })
}

/// Twice as much against once, and the memory of windows.
fn growth(limits: &Limits, sizes: &Sizes, terminal: &Terminal) -> Result<Vec<Row>> {
    terminal.note("bench: growth of ingest and windows");
    let turns = sizes.turns[1];
    let ((once, n), (twice, _)) = (traffic::write(sizes.vehicles)?, traffic::write(2 * sizes.vehicles)?);
    let recordings = [traffic::ingest(once.path())?, traffic::ingest(twice.path())?];
    let features = traffic::features(&recordings[0])?;
    let ingest = row("ingest: 2 n rows / n", Limit::AtMost(limits.growth.ingest), || {
        let read = |folder: &tempfile::TempDir| traffic::ingest(folder.path()).map(|_| ());
        let measured = Measured::pair(&clock::pair(turns, &|| read(&once), &|| read(&twice))?);
        let [first, second] = measured.sides;
        Ok(Measured { sides: [format!("{first}, n={n}"), second], ..measured })
    })?;
    let windows = row("windows and features: 2 n / n", Limit::AtMost(limits.growth.windows), || {
        let see = |i: usize| traffic::cut_and_see(&recordings[i], &features).map(|_| ());
        let measured = Measured::pair(&clock::pair(turns, &|| see(0), &|| see(1))?);
        let [first, second] = measured.sides;
        let n = traffic::cut_and_see(&recordings[0], &features)?;
        Ok(Measured { sides: [format!("{first}, n={n}"), second], ..measured })
    })?;
    let mut rows = vec![ingest, windows];
    match traffic::bytes_a_window(&recordings[1])? {
        None => terminal.result("The system does not tell memory: bytes a window are not measured."),
        Some(_) => rows.push(row("memory: bytes / window", Limit::AtMost(limits.memory.window_bytes), || {
            let value = traffic::bytes_a_window(&recordings[1])?.unwrap_or(f64::NAN);
            Ok(Measured { value, sides: [String::new(), String::new()] })
        })?),
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    fn measured(value: f64) -> Measured {
        Measured { value, sides: [String::new(), String::new()] }
    }

    #[test]
    fn a_miss_is_measured_again_and_the_better_counts() {
        let calls = Cell::new(0);
        let values = |of: [f64; 2]| {
            let calls = &calls;
            calls.set(0);
            move || {
                calls.set(calls.get() + 1);
                Ok(measured(of[calls.get() - 1]))
            }
        };
        let good = row("good", Limit::AtLeast(2.), values([3., 1.])).unwrap();
        assert!(good.holds() && calls.get() == 1 && !good.again);
        let second = row("second", Limit::AtLeast(2.), values([1., 3.])).unwrap();
        assert!(second.holds() && calls.get() == 2 && second.again);
        let missed = row("missed", Limit::AtMost(2.), values([4., 5.])).unwrap();
        assert!(!missed.holds() && calls.get() == 2);
        assert_eq!(missed.measured.value, 4.);
        assert!(missed.cells().contains(&"MISSED".to_owned()));
    }
}
