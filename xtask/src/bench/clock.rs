//! Timing: medians of repeats, and pairs measured in turn so that what else the machine does hits both.

use std::time::Instant;

use anyhow::Result;

/// Something that is timed.
pub(super) type Run<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// Seconds of every repeat, ascending.
#[derive(Clone, Debug)]
pub(crate) struct Sample(Vec<f64>);

/// Two things timed in turn.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    /// Median of the first, s.
    pub(super) first: f64,
    /// Median of the second, s.
    pub(super) second: f64,
    /// Median over the turns of second by first: each ratio is of two neighbours in time.
    pub(super) ratio: f64,
}

impl Sample {
    pub(crate) fn new(mut seconds: Vec<f64>) -> Self {
        seconds.sort_by(f64::total_cmp);
        Self(seconds)
    }

    /// The value that `share` of the repeats do not exceed (nearest rank); NaN without any.
    pub(crate) fn quantile(&self, share: f64) -> f64 {
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0.get(rank.max(1) - 1).copied().unwrap_or(f64::NAN)
    }

    /// Number of repeats.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn median(&self) -> f64 {
        let n = self.0.len();
        let upper = self.0.get(n / 2).copied().unwrap_or(f64::NAN);
        if n.is_multiple_of(2) {
            self.0.get((n / 2).wrapping_sub(1)).map_or(f64::NAN, |lower| (lower + upper) / 2.)
        } else {
            upper
        }
    }
}

/// Seconds of one run.
///
/// # Errors
/// Those of the run.
pub(super) fn once(run: Run<'_>) -> Result<f64> {
    let start = Instant::now();
    run()?;
    Ok(start.elapsed().as_secs_f64())
}

/// Times `repeats` runs after one that does not count.
///
/// # Errors
/// Those of the run.
pub(super) fn sample(repeats: usize, run: Run<'_>) -> Result<Sample> {
    run()?;
    Ok(Sample::new((0..repeats).map(|_| once(run)).collect::<Result<_>>()?))
}

/// Times both in turn, `turns` times, after a run of each that does not count.
///
/// # Errors
/// Those of the runs.
pub(super) fn pair(turns: usize, first: Run<'_>, second: Run<'_>) -> Result<Pair> {
    first()?;
    second()?;
    let turns = (0..turns).map(|_| Ok((once(first)?, once(second)?))).collect::<Result<Vec<_>>>()?;
    let median = |of: fn(&(f64, f64)) -> f64| Sample::new(turns.iter().map(of).collect()).median();
    Ok(Pair { first: median(|t| t.0), second: median(|t| t.1), ratio: median(|t| t.1 / t.0) })
}

/// Medians of several runs in turn, after a run of each that does not count, s.
///
/// # Errors
/// Those of the runs.
pub(super) fn medians<const N: usize>(turns: usize, runs: [Run<'_>; N]) -> Result<[f64; N]> {
    let mut seconds = [(); N].map(|()| Vec::with_capacity(turns));
    runs.iter().try_for_each(|run| run())?;
    for _ in 0..turns {
        for (run, seconds) in runs.iter().zip(&mut seconds) {
            seconds.push(once(*run)?);
        }
    }
    Ok(seconds.map(|seconds| Sample::new(seconds).median()))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn quantiles_are_of_the_sorted_sample() {
        let sample = Sample::new((1..=200).rev().map(f64::from).collect());
        assert_eq!(sample.median(), 100.5);
        assert_eq!(sample.quantile(0.5), 100.);
        assert_eq!(sample.quantile(0.99), 198.);
        assert_eq!(sample.quantile(1.), 200.);
        assert_eq!(Sample::new(vec![3., 1., 2.]).median(), 2.);
        assert!(Sample::new(Vec::new()).median().is_nan());
    }

    #[test]
    fn both_of_a_pair_run_equally_often() {
        let (a, b) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let count = |of: &AtomicUsize| {
            of.fetch_add(1, Ordering::Relaxed);
            Ok(())
        };
        pair(4, &|| count(&a), &|| count(&b)).unwrap();
        medians(2, [&|| count(&a)]).unwrap();
        assert_eq!((a.into_inner(), b.into_inner()), (8, 5));
    }
}
