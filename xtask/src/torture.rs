//! The crash harness: the commands that write folders are killed, run out of disk, find damaged files and each other, go on
//! to the end, and must have written what an undisturbed run writes, byte for byte.

mod disk;
mod flip;
mod history;
mod job;
mod round;
mod stop;
mod torn;
mod two;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use clap::{Args, ValueEnum};
use gnp::text::duration;
use gnp::{Progress as _, Stage};
use gnp_cli::Terminal;

use self::job::{Job, Kind};
use self::round::{Outcome, Round};
use crate::bench;
use crate::contents::SET_ASIDE;
use crate::process::Starter;

/// How much is tried.
#[derive(Clone, Debug, Args)]
pub(crate) struct TortureArgs {
    /// Rounds, each with one trouble; the troubles take turns.
    #[arg(long, value_name = "N", default_value_t = ONCE)]
    pub(crate) rounds: u64,
    /// Seed of the first round; the next one has the next seed.
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Only this trouble; repeatable.
    #[arg(long, value_enum, value_name = "NAME")]
    pub(crate) trouble: Vec<Trouble>,
    /// Stop pipelines in this stage only.
    #[arg(long, value_name = "NAME", value_parser = stage)]
    pub(crate) stage: Option<Stage>,
    /// No progress, only the table.
    #[arg(long, short)]
    pub(crate) quiet: bool,
}

/// Rounds in which every trouble has its turn.
const ONCE: u64 = 9;

/// Every trouble once.
///
/// # Errors
/// When a round fails.
pub(crate) fn once(terminal: &Terminal) -> Result<()> {
    run(&TortureArgs { rounds: ONCE, seed: 0, trouble: Vec::new(), stage: None, quiet: false }, terminal)
}

fn stage(name: &str) -> Result<Stage, String> {
    let names = Stage::ALL.map(Stage::name).join(", ");
    Stage::ALL.into_iter().find(|stage| stage.name() == name).ok_or_else(|| format!("the stages are {names}"))
}

/// What happens to a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Trouble {
    /// A pipeline is killed one to three times.
    Kill,
    /// After a kill, what was written last is torn as by a power cut.
    Torn,
    /// The disk is full for a while.
    Disk,
    /// Bits of a finished run flip.
    Flip,
    /// Two processes work on one folder.
    Two,
    /// A pipeline is interrupted by SIGINT or SIGTERM.
    Interrupt,
    /// The folder cannot be written for a while.
    ReadOnly,
    /// A comparison with jobs in processes of their own is killed.
    Compare,
    /// A simulation is killed.
    Simulate,
}

impl Trouble {
    /// In words, for the table.
    fn words(self) -> &'static str {
        match self {
            Self::Kill => "SIGKILL, 1 to 3 times",
            Self::Torn => "SIGKILL, last writes torn",
            Self::Disk => "full disk",
            Self::Flip => "bit flips in a finished run",
            Self::Two => "two processes on one folder",
            Self::Interrupt => "SIGINT or SIGTERM",
            Self::ReadOnly => "read-only folder",
            Self::Compare => "compare with 2 workers, SIGKILL",
            Self::Simulate => "simulate, SIGKILL",
        }
    }

    fn play(self, round: &mut Round<'_>) -> Result<()> {
        match self {
            Self::Kill => stop::kill(round),
            Self::Torn => torn::play(round),
            Self::Disk => disk::full(round),
            Self::Flip => flip::play(round),
            Self::Two => two::play(round),
            Self::Interrupt => stop::interrupt(round),
            Self::ReadOnly => disk::read_only(round),
            Self::Compare => stop::kill_other(round, Kind::Compare),
            Self::Simulate => stop::kill_other(round, Kind::Simulate),
        }
    }
}

/// Undisturbed jobs and where everything lies.
#[derive(Debug)]
struct Stand {
    pipeline: Job,
    compare: Job,
    simulate: Job,
    stage: Option<Stage>,
}

impl Stand {
    fn set_up(place: &Path, stage: Option<Stage>) -> Result<Self> {
        let (starter, inputs) = (Starter::own()?, place.join("inputs"));
        job::prepare(&inputs)?;
        let undisturbed = |kind, name: &str| Job::undisturbed(kind, &starter, &inputs, &place.join(name));
        let pipeline = undisturbed(Kind::Pipeline, "undisturbed/pipeline")?;
        // What is compared must be the same without any trouble.
        let again = undisturbed(Kind::Pipeline, "again/pipeline")?;
        pipeline.expect_same(&again.folder).context("two undisturbed runs")?;
        Ok(Self {
            pipeline,
            compare: undisturbed(Kind::Compare, "undisturbed/compare")?,
            simulate: undisturbed(Kind::Simulate, "undisturbed/simulate")?,
            stage,
        })
    }
}

/// What the rounds of one trouble came to.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    rounds: usize,
    tries: usize,
    resumed: usize,
    mended: usize,
    refused: usize,
    skipped: usize,
    failed: usize,
}

impl Tally {
    fn add(&mut self, outcomes: &[Outcome]) {
        self.rounds += 1;
        for outcome in outcomes {
            self.tries += 1;
            *match outcome {
                Outcome::Resumed => &mut self.resumed,
                Outcome::Mended => &mut self.mended,
                Outcome::Refused => &mut self.refused,
                Outcome::Skipped(_) => &mut self.skipped,
                Outcome::Failed(_) => &mut self.failed,
            } += 1;
        }
    }
}

/// Plays the rounds and prints what they came to.
///
/// # Errors
/// When a round fails; its folder is kept.
pub(crate) fn run(args: &TortureArgs, terminal: &Terminal) -> Result<()> {
    let troubles = if args.trouble.is_empty() { Trouble::value_variants() } else { &args.trouble };
    let place = tempfile::Builder::new().prefix("torture-").tempdir().context("cannot make a temporary folder")?;
    let begun = Instant::now();
    let stand = Stand::set_up(place.path(), args.stage)?;
    terminal.note(&format!(
        "torture: undisturbed: pipeline {:.2} s, compare {:.2} s, simulate {:.2} s",
        stand.pipeline.total.as_secs_f64(),
        stand.compare.total.as_secs_f64(),
        stand.simulate.total.as_secs_f64()
    ));
    let mut tallies = vec![Tally::default(); troubles.len()];
    let mut failed: Vec<PathBuf> = Vec::new();
    for seed in (args.seed..).take(usize::try_from(args.rounds)?) {
        // By the seed and not by the round, so that a seed alone repeats a round.
        let turn = usize::try_from(seed)? % troubles.len();
        let trouble = troubles[turn];
        let folder = place.path().join(format!("round-{seed}"));
        let mut round = Round::begin(&stand, seed, &folder)?;
        if let Err(error) = trouble.play(&mut round) {
            round.outcomes.push(Outcome::Failed(format!("{error:#}")));
        }
        tallies[turn].add(&round.outcomes);
        for outcome in &round.outcomes {
            match outcome {
                Outcome::Skipped(why) => terminal.note(&format!("torture: {} skipped: {why}", trouble.words())),
                Outcome::Failed(why) => terminal.note(&format!(
                    "torture: {} FAILED: {why}\n  its folder: {}\n  again: cargo xtask torture --trouble {} --rounds 1 --seed {seed}",
                    trouble.words(),
                    folder.display(),
                    trouble.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
                )),
                _ => {}
            }
        }
        if round.outcomes.iter().any(|outcome| matches!(outcome, Outcome::Failed(_))) {
            failed.push(folder);
        } else {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
        }
    }
    let rows = troubles.iter().zip(&tallies).filter(|(_, tally)| tally.rounds > 0);
    let rows = rows.map(|(trouble, tally)| {
        let counts =
            [tally.rounds, tally.tries, tally.resumed, tally.mended, tally.refused, tally.skipped, tally.failed];
        [trouble.words().to_owned()].into_iter().chain(counts.map(|n| n.to_string())).collect()
    });
    let head = ["trouble", "rounds", "tries", "resumed", "mended", "refused", "skipped", "failed"];
    terminal.for_programs(&bench::table(head.map(str::to_owned).to_vec(), rows.collect()));
    terminal.note(&format!("torture: {} rounds in {}. {SET_ASIDE}", args.rounds, duration(begun.elapsed())));
    if failed.is_empty() {
        return Ok(());
    }
    let kept = place.keep();
    bail!("{} of {} rounds failed; their folders are kept in {}", failed.len(), args.rounds, kept.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_are_counted_by_kind() {
        let mut tally = Tally::default();
        tally.add(&[Outcome::Resumed, Outcome::Refused, Outcome::Refused]);
        tally.add(&[Outcome::Failed("x".to_owned()), Outcome::Mended, Outcome::Skipped("y".to_owned())]);
        let counts = (tally.rounds, tally.tries, tally.resumed, tally.mended, tally.refused);
        assert_eq!(counts, (2, 6, 1, 1, 2));
        assert_eq!((tally.skipped, tally.failed), (1, 1));
        assert_eq!(Trouble::value_variants().len() as u64, ONCE);
        assert!(stage("goal").is_ok() && stage("gaol").unwrap_err().contains("evaluate"));
    }
}
