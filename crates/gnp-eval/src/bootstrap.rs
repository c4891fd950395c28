//! Intervals by resampling drivers, and wider ones by resampling events.
//!
//! Windows of one driver overlap, so they are far from independent: resampling windows would give
//! intervals several times too narrow. Drivers are drawn with replacement, each with all windows of
//! all recordings in which he is the target. Drivers of one event are not independent either: the
//! second bootstrap draws events, each with all its windows.
//!
//! Resamples of n clusters vary too little, by (n - 1) / n, and have light tails. So the ends are
//! not the 2.5th percentile but further out, as far as Student's distribution is (Hesterberg 2015,
//! "expanded percentile"): the 2.3rd for 100 clusters. Percentiles cannot reach beyond the least and
//! the largest resample, which is too near for few clusters: below 8 the interval is the value plus
//! and minus Student's quantile of n - 1 times the standard deviation of the resamples, widened by
//! sqrt(n / (n - 1)).
//!
//! A system that was trained with several seeds is resampled as the mean over them, and each half of
//! the interval is widened, in quadrature, by that of a mean of S trainings: Student's quantile of
//! S - 1 times s / sqrt(S), with s the standard deviation between trainings. So the interval is of
//! drivers or events *and* trainings. Of one seed differences between trainings are unknown and not
//! in the interval.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::clusters::Draw;
use crate::error::EvalError;
use crate::metric::{Direction, MetricKind};
use crate::sums::{Members, Pool};

/// How many resamples, and the seed. Resample `i` is the same for every metric and model scored on
/// the same vehicles, and on any number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bootstrap {
    /// Resamples; 1000 give the ends of a 95 % interval to about a twentieth of its width.
    pub resamples: usize,
    /// Seed of the draws.
    pub seed: u64,
}

/// A 95 % interval by resampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// How much one model's metric differs from another's on the same windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The first model's value minus the second's.
    pub value: f64,
    /// Interval of that difference by driver, both models resampled together, widened by what trainings
    /// differ; `None` with fewer than two drivers.
    pub interval: Option<Interval>,
    /// The same by event; `None` with fewer than three events.
    pub by_event: Option<Interval>,
    /// Share of resamples by driver in which the first model is better; differences between trainings
    /// are not in it.
    pub share_better: f64,
}

impl Difference {
    /// Whether the interval by driver leaves out zero and, with 3 events or more, that by event does
    /// so on the same side. With fewer events it rests on drivers alone.
    #[must_use]
    pub fn is_clear(&self) -> bool {
        let above = |interval: Interval| interval.low > 0.;
        let below = |interval: Interval| interval.high < 0.;
        self.interval.is_some_and(|interval| {
            (above(interval) && self.by_event.is_none_or(above)) || (below(interval) && self.by_event.is_none_or(below))
        })
    }
}

impl Bootstrap {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 2] = [
        // A 95 % interval needs 40; 1000 are usual, and beyond 10,000 its ends no longer move. All are in memory.
        ("resamples", 40., 1e5, "(a 95 % interval needs at least 40, 1000 are usual)"),
        // The largest number of TOML; other seeds come from sums and can be used.
        ("seed", 0., i64::MAX as f64, ""),
    ];

    /// Refuses fewer resamples than a 95 % interval needs, and more than anybody has a use for.
    ///
    /// # Errors
    /// Names the key and what to write.
    pub fn check(&self) -> Result<(), EvalError> {
        let [(key, least, most, unit), _] = Self::RANGES;
        if !(least..=most).contains(&(self.resamples as f64)) {
            let problem = format!("is {}; give a number from {least} to {most} {unit}", self.resamples);
            return Err(EvalError::Config { key, problem });
        }
        Ok(())
    }

    /// Interval of a share over vehicles; `counts` holds `[hits, trials]` of each. Those without trials are
    /// left out. `None` with fewer than two that have some.
    #[must_use]
    pub fn share(&self, counts: &[[u64; 2]]) -> Option<Interval> {
        let counting: Vec<[u64; 2]> = counts.iter().filter(|[_, trials]| *trials > 0).copied().collect();
        let share = |times: &[f64]| {
            let sum =
                |part: usize| counting.iter().zip(times).map(|(count, times)| count[part] as f64 * times).sum::<f64>();
            let (hits, trials) = (sum(0), sum(1));
            (trials > 0.).then(|| hits / trials)
        };
        Some(self.interval(counting.len(), share)?.within([0., 1.]))
    }

    /// Interval of any number that is worked out from vehicles: `of` is told how often each was drawn,
    /// and gives nothing for a draw that has no such number. `None` with fewer than two vehicles, and where
    /// all of them once have no such number.
    #[must_use]
    pub fn interval(&self, vehicles: usize, of: impl Fn(&[f64]) -> Option<f64> + Sync) -> Option<Interval> {
        if vehicles < 2 {
            return None;
        }
        let value = of(&vec![1.; vehicles])?;
        around(value, self.resample(vehicles, of).into_iter().flatten().collect(), vehicles)
    }

    /// An interval for each metric; `None` with too few clusters that contribute.
    pub(crate) fn intervals(&self, sums: &Members, kinds: &[MetricKind], draw: Draw) -> Vec<Option<Interval>> {
        let metrics: Vec<(usize, MetricKind)> = kinds.iter().copied().enumerate().collect();
        let pools = sums.pools(draw, &metrics);
        let values = self.resample(pools.len(), |times| {
            let mut sums = vec![Pool::default(); kinds.len()];
            for (row, times) in drawn(&pools, times) {
                sums.iter_mut().zip(row).for_each(|(sum, pool)| sum.add_times(*pool, times));
            }
            sums.iter().zip(kinds).map(|(pool, kind)| pool.value(*kind)).collect::<Vec<_>>()
        });
        let of_metric = |(index, kind): (usize, MetricKind)| {
            let clusters = contributing(sums, index, draw);
            let value = sums.value(index, kind).filter(|_| clusters >= draw.least())?;
            let resampled = values.iter().filter_map(|values| values[index]).collect();
            let trainings = of_trainings(&sums.by_seed(index, kind));
            Some(around(value, resampled, clusters)?.widened(value, trainings).within(kind.range()))
        };
        metrics.into_iter().map(of_metric).collect()
    }

    /// The difference of the metric at `index` between two models; both sums must be of the same
    /// vehicles. Where both have as many seeds, trainings differ as the differences do seed by seed; else
    /// as each model's do. `None` where no window contributed.
    pub(crate) fn difference(&self, a: &Members, b: &Members, index: usize, kind: MetricKind) -> Option<Difference> {
        let value = a.value(index, kind)? - b.value(index, kind)?;
        let [seeds_a, seeds_b] = [a, b].map(|sums| sums.by_seed(index, kind));
        let trainings = if seeds_a.len() == seeds_b.len() {
            of_trainings(&seeds_a.iter().zip(&seeds_b).map(|(a, b)| a - b).collect::<Vec<_>>())
        } else {
            of_trainings(&seeds_a).hypot(of_trainings(&seeds_b))
        };
        let resampled = |draw: Draw| -> Vec<[f64; 2]> {
            let [pools_a, pools_b] = [a, b].map(|sums| sums.pools(draw, &[(index, kind)]));
            let of = |pools: &Pools, times: &[f64]| {
                let mut sum = Pool::default();
                drawn(pools, times).for_each(|(row, times)| sum.add_times(row[0], times));
                sum.value(kind)
            };
            let values = self.resample(pools_a.len(), |times| Some([of(&pools_a, times)?, of(&pools_b, times)?]));
            values.into_iter().flatten().collect()
        };
        let interval = |draw: Draw, values: &[[f64; 2]]| {
            let clusters = contributing(a, index, draw);
            let differences = || values.iter().map(|[a, b]| a - b).collect();
            let interval = (clusters >= draw.least()).then(|| around(value, differences(), clusters)).flatten();
            interval.map(|it| it.widened(value, trainings))
        };
        let better = |[a, b]: &&[f64; 2]| match kind.direction() {
            Direction::Lower => a < b,
            Direction::Higher => a > b,
            Direction::Towards(ideal) => (a - ideal).abs() < (b - ideal).abs(),
        };
        let by_driver = resampled(Draw::Drivers);
        let share_better = by_driver.iter().filter(better).count() as f64 / by_driver.len().max(1) as f64;
        let events = contributing(a, index, Draw::Events) >= Draw::Events.least();
        let by_event = events.then(|| interval(Draw::Events, &resampled(Draw::Events))).flatten();
        Some(Difference { value, interval: interval(Draw::Drivers, &by_driver), by_event, share_better })
    }

    /// `of` each resample, in order: it is given how often each cluster was drawn.
    /// One result for each resample; of more than anybody has a use for, as many as [`Bootstrap::RANGES`] allows.
    fn resample<T: Send>(&self, clusters: usize, of: impl Fn(&[f64]) -> T + Sync) -> Vec<T> {
        let draw = |resample: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
            rng.set_stream(resample as u64);
            let mut times = vec![0.; clusters];
            for _ in 0..clusters {
                times[rng.random_range(0..clusters as u32) as usize] += 1.;
            }
            of(&times)
        };
        let [(_, _, most, _), _] = Self::RANGES;
        (0..self.resamples.min(most as usize)).into_par_iter().map(draw).collect()
    }
}

impl Interval {
    /// Each half as long as the hypotenuse of itself and `half`.
    fn widened(self, value: f64, half: f64) -> Self {
        if half > 0. {
            let [below, above] = [value - self.low, self.high - value].map(|own| own.max(0.).hypot(half));
            Self { low: value - below, high: value + above }
        } else {
            self
        }
    }

    /// What of it can be.
    fn within(self, [least, largest]: [f64; 2]) -> Self {
        Self { low: self.low.max(least), high: self.high.min(largest) }
    }
}

/// What each cluster adds to metrics, `[clusters][metrics]`.
type Pools = Vec<Vec<Pool>>;

/// Clusters with windows that contributed to the metric at `index`.
fn contributing(sums: &Members, index: usize, draw: Draw) -> usize {
    let counts = sums.counts(index);
    match draw {
        Draw::Drivers => counts.drivers,
        Draw::Events => counts.events,
    }
}

/// The rows of clusters that were drawn, each with how often.
fn drawn<'a>(pools: &'a Pools, times: &'a [f64]) -> impl Iterator<Item = (&'a [Pool], f64)> {
    pools.iter().zip(times).filter(|(_, times)| **times > 0.).map(|(row, times)| (&row[..], *times))
}

/// Clusters below which the ends are not percentiles of the resamples.
const FEW: usize = 8;

/// The 95 % interval of `value` from `resampled` values of so many clusters; `None` of nothing.
fn around(value: f64, resampled: Vec<f64>, clusters: usize) -> Option<Interval> {
    if clusters >= FEW {
        return between(resampled, tail(clusters));
    }
    let count = resampled.len() as f64;
    let mean = resampled.iter().sum::<f64>() / count;
    let deviation = (resampled.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / count).sqrt();
    let n = clusters.max(2) as f64;
    let half = student(clusters.max(2) - 1) * (n / (n - 1.)).sqrt() * deviation;
    (count > 0.).then_some(Interval { low: value - half, high: value + half })
}

/// Half the 95 % interval of the mean over trainings, of one value a seed; 0 of a single one.
fn of_trainings(by_seed: &[f64]) -> f64 {
    if by_seed.len() < 2 {
        return 0.;
    }
    let count = by_seed.len() as f64;
    let mean = by_seed.iter().sum::<f64>() / count;
    let variance = by_seed.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / (count - 1.);
    student(by_seed.len() - 1) * (variance / count).sqrt()
}

/// What lies between the quantiles `tail` and `1 - tail`, with linear interpolation between order statistics;
/// `None` of nothing.
fn between(mut values: Vec<f64>, tail: f64) -> Option<Interval> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| {
        let place = share * last as f64;
        let (below, above) = (place.floor() as usize, place.ceil() as usize);
        values[below] + (values[above] - values[below]) * (place - place.floor())
    };
    Some(Interval { low: at(tail), high: at(1. - tail) })
}

/// Share of resamples below a 95 % interval by so many clusters: 0.025 of many.
fn tail(clusters: usize) -> f64 {
    let n = clusters.max(2) as f64;
    0.5 * libm::erfc((n / (n - 1.)).sqrt() * student(clusters.max(2) - 1) * std::f64::consts::FRAC_1_SQRT_2)
}

/// Student's quantile at 97.5 % for so many degrees of freedom, at least one.
fn student(freedom: usize) -> f64 {
    /// 97.5 % of a normal distribution lie below.
    const Z: f64 = 1.959_963_985;
    /// For 1 to 6 degrees of freedom, where the expansion is too rough.
    const FEW: [f64; 6] = [12.706_205, 4.302_653, 3.182_446, 2.776_445, 2.570_582, 2.446_912];
    if let Some(exact) = FEW.get(freedom.max(1) - 1) {
        return *exact;
    }
    let freedom = freedom as f64;
    Z + (Z.powi(3) + Z) / (4. * freedom)
        + (5. * Z.powi(5) + 16. * Z.powi(3) + 3. * Z) / (96. * freedom.powi(2))
        + (3. * Z.powi(7) + 19. * Z.powi(5) + 17. * Z.powi(3) - 15. * Z) / (384. * freedom.powi(3))
}

#[cfg(test)]
mod tests;
