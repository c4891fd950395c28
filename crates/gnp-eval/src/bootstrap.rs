//! Intervals by resampling drivers, and wider ones by resampling events.
//!
//! Windows of one driver overlap, so they are far from independent: resampling windows would give
//! intervals several times too narrow. Drivers are drawn with replacement, each with all windows of
//! all recordings in which he is the target. Drivers of one event are not independent either: the
//! second bootstrap draws events, each with all its windows.
//!
//! Resamples of few clusters vary too little, by (n - 1) / n, and have light tails. So the ends are
//! not the 2.5th percentile but further out, as far as Student's distribution is (Hesterberg 2015,
//! "expanded percentile"): the 2.3rd for 100 clusters, and for up to five nearly the least and the
//! largest cluster.
//!
//! Of a system that was trained with several seeds these are drawn with replacement as well, so that
//! the interval is of drivers or events *and* trainings. Of n seeds that gives (n - 1) / n of the
//! variance between trainings: three seeds show four fifths of their spread.

use std::collections::BTreeMap;

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
    /// Interval of that difference by driver, both models resampled together; `None` with fewer
    /// than two drivers.
    pub interval: Option<Interval>,
    /// The same by event; `None` with fewer than three events.
    pub by_event: Option<Interval>,
    /// Share of resamples by driver in which the first model is better.
    pub share_better: f64,
}

impl Difference {
    /// Whether the interval by driver leaves out zero and, where there is one, that by event does
    /// so on the same side.
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
    /// Refuses fewer resamples than a 95 % interval needs.
    ///
    /// # Errors
    /// Names the key and what to write.
    pub fn check(&self) -> Result<(), EvalError> {
        if self.resamples < 40 {
            let problem = format!("is {}; a 95 % interval needs at least 40 resamples, 1000 are usual", self.resamples);
            return Err(EvalError::Config { key: "resamples", problem });
        }
        Ok(())
    }

    /// Interval of a share over all vehicles; `counts` holds `[hits, trials]` of each. `None` with fewer than
    /// two vehicles that have trials.
    #[must_use]
    pub fn share(&self, counts: &[[u64; 2]]) -> Option<Interval> {
        let counting = counts.iter().filter(|[_, trials]| *trials > 0).count();
        let interval = || {
            self.interval(counts.len(), |times| {
                let sum = |part: usize| {
                    counts.iter().zip(times).map(|(count, times)| count[part] as f64 * times).sum::<f64>()
                };
                let (hits, trials) = (sum(0), sum(1));
                (trials > 0.).then(|| hits / trials)
            })
        };
        (counting > 1).then(interval).flatten()
    }

    /// Interval of any number that is worked out from vehicles: `of` is told how often each was drawn,
    /// and gives nothing for a draw that has no such number. `None` with fewer than two vehicles.
    #[must_use]
    pub fn interval(&self, vehicles: usize, of: impl Fn(&[f64]) -> Option<f64> + Sync) -> Option<Interval> {
        let values = || self.resample(vehicles, [1], |times, _| of(times)).into_iter().flatten().collect();
        (vehicles > 1).then(|| between(values(), tail(vehicles))).flatten()
    }

    /// An interval for each metric; `None` with too few clusters that contribute.
    pub(crate) fn intervals(&self, sums: &Members, kinds: &[MetricKind], draw: Draw) -> Vec<Option<Interval>> {
        let metrics: Vec<(usize, MetricKind)> = kinds.iter().copied().enumerate().collect();
        let pools = sums.pools(draw, &metrics);
        let values = self.resample(clusters(&pools), [sums.seeds()], |times, [seeds]| {
            let mut sums = vec![Pool::default(); kinds.len()];
            for (row, times) in drawn(&pools, times, seeds) {
                sums.iter_mut().zip(row).for_each(|(sum, pool)| sum.add_times(*pool, times));
            }
            sums.iter().zip(kinds).map(|(pool, kind)| pool.value(*kind)).collect::<Vec<_>>()
        });
        let of_metric = |index: usize| {
            let resampled = || values.iter().filter_map(|values| values[index]).collect();
            let clusters = contributing(sums, index, draw);
            (clusters >= draw.least()).then(|| between(resampled(), tail(clusters))).flatten()
        };
        (0..kinds.len()).map(of_metric).collect()
    }

    /// The difference of the metric at `index` between two models; both sums must be of the same
    /// vehicles. Where both have as many seeds, the same are drawn for both. `None` where no window
    /// contributed.
    pub(crate) fn difference(&self, a: &Members, b: &Members, index: usize, kind: MetricKind) -> Option<Difference> {
        let value = a.value(index, kind)? - b.value(index, kind)?;
        let resampled = |draw: Draw| -> Vec<[f64; 2]> {
            let pools = [a, b].map(|sums| sums.pools(draw, &[(index, kind)]));
            let values = self.resample(clusters(&pools[0]), [a.seeds(), b.seeds()], |times, [seeds_a, seeds_b]| {
                let of = |pools: &Pools, seeds: &[f64]| {
                    let mut sum = Pool::default();
                    drawn(pools, times, seeds).for_each(|(row, times)| sum.add_times(row[0], times));
                    sum.value(kind)
                };
                Some([of(&pools[0], seeds_a)?, of(&pools[1], seeds_b)?])
            });
            values.into_iter().flatten().collect()
        };
        let interval = |draw: Draw, values: &[[f64; 2]]| {
            let differences = || values.iter().map(|[a, b]| a - b).collect();
            let clusters = contributing(a, index, draw);
            (clusters >= draw.least()).then(|| between(differences(), tail(clusters))).flatten()
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

    /// `of` each resample, in order: it is given how often each cluster was drawn, and for each system
    /// of `seeds` seeds how often each of these. One seed is always drawn; systems with as many seeds
    /// share a draw.
    fn resample<T: Send, const N: usize>(
        &self,
        clusters: usize,
        seeds: [usize; N],
        of: impl Fn(&[f64], [&[f64]; N]) -> T + Sync,
    ) -> Vec<T> {
        let draw = |resample: usize| {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
            rng.set_stream(resample as u64);
            let mut draw = |count: usize| {
                let mut times = vec![0.; count];
                for _ in 0..count {
                    times[rng.random_range(0..count as u32) as usize] += 1.;
                }
                times
            };
            let times = draw(clusters);
            let mut of_seeds: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
            for count in seeds {
                of_seeds.entry(count).or_insert_with(|| draw(count));
            }
            of(&times, seeds.map(|count| of_seeds.get(&count).map_or(&[][..], Vec::as_slice)))
        };
        (0..self.resamples).into_par_iter().map(draw).collect()
    }
}

/// What each cluster adds to metrics, `[seeds][clusters][metrics]`.
type Pools = Vec<Vec<Vec<Pool>>>;

fn clusters(pools: &Pools) -> usize {
    pools.first().map_or(0, Vec::len)
}

/// Clusters with windows that contributed to the metric at `index`.
fn contributing(sums: &Members, index: usize, draw: Draw) -> usize {
    let counts = sums.counts(index);
    match draw {
        Draw::Drivers => counts.drivers,
        Draw::Events => counts.events,
    }
}

/// The rows of clusters and seeds that were drawn, each with how often.
fn drawn<'a>(pools: &'a Pools, times: &'a [f64], seeds: &'a [f64]) -> impl Iterator<Item = (&'a [Pool], f64)> {
    let seeds = pools.iter().zip(seeds).filter(|(_, seed)| **seed > 0.);
    seeds.flat_map(move |(member, seed)| {
        let rows = member.iter().zip(times).filter(|(_, times)| **times > 0.);
        rows.map(move |(row, times)| (&row[..], times * seed))
    })
}

/// What lies between the quantiles `tail` and `1 - tail`, with linear interpolation between order statistics; `None` of
/// nothing.
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
    /// 97.5 % of a normal distribution lie below.
    const Z: f64 = 1.959_963_985;
    let n = clusters.max(2) as f64;
    let freedom = n - 1.;
    // Student's quantile by its expansion in 1 / freedom; what is off below 3 makes no difference so far out.
    let student = Z
        + (Z.powi(3) + Z) / (4. * freedom)
        + (5. * Z.powi(5) + 16. * Z.powi(3) + 3. * Z) / (96. * freedom.powi(2))
        + (3. * Z.powi(7) + 19. * Z.powi(5) + 17. * Z.powi(3) - 15. * Z) / (384. * freedom.powi(3));
    0.5 * libm::erfc((n / freedom).sqrt() * student * std::f64::consts::FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests;
