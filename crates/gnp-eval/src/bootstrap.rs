//! Intervals by resampling drivers, and wider ones by resampling events.
//!
//! Windows of one driver overlap, so they are far from independent: resampling windows would give
//! intervals several times too narrow. Drivers are drawn with replacement, each with all windows of
//! all recordings in which he is the target. Drivers of one event are not independent either: the
//! second bootstrap draws events, each with all its windows. Of n events it, too, gives (n - 1) / n
//! of the variance, so that intervals by few events are still too narrow. Of a system that was trained with several seeds these are drawn with
//! replacement as well, so that the interval is of drivers or events *and* trainings. Of n seeds that gives
//! (n - 1) / n of the variance between trainings: three seeds show four fifths of their spread.

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

/// The middle 95 % of what resampling gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// 2.5th percentile.
    pub low: f64,
    /// 97.5th percentile.
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
        (vehicles > 1).then(|| middle(values())).flatten()
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
            let resampled = values.iter().filter_map(|values| values[index]).collect();
            (contributing(sums, index, draw) >= draw.least()).then(|| middle(resampled)).flatten()
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
            (contributing(a, index, draw) >= draw.least()).then(|| middle(differences())).flatten()
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

/// The middle 95 %, with linear interpolation between order statistics; `None` of nothing.
fn middle(mut values: Vec<f64>) -> Option<Interval> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| {
        let place = share * last as f64;
        let (below, above) = (place.floor() as usize, place.ceil() as usize);
        values[below] + (values[above] - values[below]) * (place - place.floor())
    };
    Some(Interval { low: at(0.025), high: at(0.975) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sums::Gatherer;

    fn bootstrap() -> Bootstrap {
        Bootstrap { resamples: 2000, seed: 5 }
    }

    /// `vehicles` vehicles with `windows` windows each; every window of vehicle `i` contributes
    /// `of(i)`.
    fn sums(vehicles: u32, windows: usize, of: impl Fn(u32) -> f64) -> Members {
        let mut gatherer = Gatherer::new(1);
        for vehicle in 0..vehicles {
            for _ in 0..windows {
                gatherer.add_alone("r", vehicle, &[Some(of(vehicle))]);
            }
        }
        Members::one(gatherer.finish())
    }

    /// Standard normal numbers (Box and Muller), seeded by vehicle.
    fn normal(seed: u64, vehicle: u32) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(vehicle));
        let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.), rng.random());
        (-2. * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    /// Whole vehicles are right or wrong: a share of 0.3 of 200 has a deviation of sqrt(0.3 * 0.7 / 200), however
    /// many windows each has.
    #[test]
    fn interval_of_a_share_counts_vehicles() {
        let counts = |windows: u64| -> Vec<[u64; 2]> {
            (0..200).map(|vehicle| [if vehicle % 10 < 3 { windows } else { 0 }, windows]).collect()
        };
        let half = 1.96 * (0.3f64 * 0.7 / 200.).sqrt();
        let found = bootstrap().share(&counts(1)).unwrap();
        assert!((found.low - (0.3 - half)).abs() < 0.01 && (found.high - (0.3 + half)).abs() < 0.01, "{found:?}");
        let many = bootstrap().share(&counts(30)).unwrap();
        assert!((many.low - found.low).abs() < 1e-9 && (many.high - found.high).abs() < 1e-9, "{many:?} {found:?}");
        assert_eq!(bootstrap().share(&[[3, 5], [0, 0]]), None);
    }

    /// The mean of n normal numbers has the standard error s / sqrt(n): its interval is known.
    #[test]
    fn interval_of_a_mean_is_the_textbook_one() {
        let sums = sums(400, 3, |vehicle| 10. + normal(1, vehicle));
        let values: Vec<f64> = (0..400).map(|vehicle| 10. + normal(1, vehicle)).collect();
        let mean = values.iter().sum::<f64>() / 400.;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 399.).sqrt();
        let half = 1.96 * deviation / 400f64.sqrt();
        let found = bootstrap().intervals(&sums, &[MetricKind::Ade], Draw::Drivers)[0].unwrap();
        assert!((found.low - (mean - half)).abs() < 0.1 * half, "{found:?}, {mean} +- {half}");
        assert!((found.high - (mean + half)).abs() < 0.1 * half, "{found:?}, {mean} +- {half}");
    }

    /// A 95 % interval holds the true value in about 95 of 100 samples.
    #[test]
    fn intervals_cover_the_truth_as_often_as_they_say() {
        let bootstrap = Bootstrap { resamples: 400, seed: 6 };
        let held = (0..200)
            .filter(|sample| {
                let sums = sums(60, 1, |vehicle| normal(100 + sample, vehicle).powi(2));
                let interval = bootstrap.intervals(&sums, &[MetricKind::RmseAt], Draw::Drivers)[0].unwrap();
                interval.low <= 1. && 1. <= interval.high
            })
            .count();
        // Binomial: 190 expected, 3.1 the standard deviation; small samples cover a little less.
        assert!((176..=199).contains(&held), "{held} of 200");
    }

    /// More windows of the same vehicles are no more vehicles: the interval stays.
    #[test]
    fn intervals_do_not_shrink_with_windows_of_the_same_vehicles() {
        let of = |windows| {
            let interval =
                bootstrap().intervals(&sums(50, windows, f64::from), &[MetricKind::Ade], Draw::Drivers)[0].unwrap();
            interval.high - interval.low
        };
        assert!((of(1) - of(100)).abs() < 1e-9);
        assert!(of(1) > 5.);
    }

    #[test]
    fn same_bits_on_one_thread_and_on_two() {
        let sums = sums(37, 2, |vehicle| normal(2, vehicle).powi(2));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bootstrap().intervals(&sums, &[MetricKind::RmseAt], Draw::Drivers)[0].unwrap())
        };
        let (one, two) = (on(1), on(2));
        assert_eq!((one.low.to_bits(), one.high.to_bits()), (two.low.to_bits(), two.high.to_bits()));
        let other =
            Bootstrap { seed: 6, ..bootstrap() }.intervals(&sums, &[MetricKind::RmseAt], Draw::Drivers)[0].unwrap();
        assert_ne!(one, other);
    }

    /// Vehicles differ by metres, the two models by a tenth: only the paired difference shows it.
    #[test]
    fn pairing_finds_a_small_difference() {
        let a = sums(80, 2, |vehicle| 5. + 3. * normal(3, vehicle));
        let b = sums(80, 2, |vehicle| 5.1 + 3. * normal(3, vehicle) + 0.01 * normal(4, vehicle));
        let difference = bootstrap().difference(&a, &b, 0, MetricKind::MinFde).unwrap();
        assert!((difference.value + 0.1).abs() < 0.01);
        assert!(difference.is_clear() && difference.share_better == 1.);
        let [alone_a, alone_b] =
            [&a, &b].map(|sums| bootstrap().intervals(sums, &[MetricKind::MinFde], Draw::Drivers)[0].unwrap());
        assert!(alone_a.high > alone_b.low, "the models' own intervals overlap");
    }

    #[test]
    fn a_model_is_not_better_than_itself() {
        let a = sums(30, 2, |vehicle| normal(3, vehicle).powi(2));
        let difference = bootstrap().difference(&a, &a, 0, MetricKind::RmseAt).unwrap();
        assert_eq!(difference.value, 0.);
        assert!(!difference.is_clear());
        assert_eq!(difference.share_better, 0.);
    }

    fn seeded(members: impl IntoIterator<Item = Members>) -> Members {
        members.into_iter().reduce(|all, more| all.with(more).unwrap()).unwrap()
    }

    fn near(a: Interval, b: Interval, within: f64) -> bool {
        (a.low - b.low).abs() < within && (a.high - b.high).abs() < within
    }

    /// A seed that is repeated says nothing new.
    #[test]
    fn identical_seeds_give_what_one_gives() {
        let one = sums(60, 2, |vehicle| normal(3, vehicle).powi(2));
        let three = seeded([one.clone(), one.clone(), one.clone()]);
        let of = |sums| bootstrap().intervals(sums, &[MetricKind::RmseAt], Draw::Drivers)[0].unwrap();
        assert!(near(of(&one), of(&three), 1e-12), "{:?} {:?}", of(&one), of(&three));
        assert!(
            (one.value(0, MetricKind::RmseAt).unwrap() - three.value(0, MetricKind::RmseAt).unwrap()).abs() < 1e-12
        );
        let other = sums(60, 2, |vehicle| 1. + normal(4, vehicle).powi(2));
        let difference = |a| bootstrap().difference(a, &other, 0, MetricKind::RmseAt).unwrap();
        let (alone, thrice) = (difference(&one), difference(&three));
        assert!((alone.value - thrice.value).abs() < 1e-12 && alone.share_better == thrice.share_better);
        assert!(near(alone.interval.unwrap(), thrice.interval.unwrap(), 1e-12));
    }

    /// All vehicles alike, three seeds at 1, 2 and 3: only the draw of seeds moves the mean. Of its 27 draws one gives
    /// 1, three give 4/3: the middle 95 % reaches from 1 to 3.
    #[test]
    fn seeds_that_differ_widen_the_interval() {
        let at = |value: f64| sums(50, 1, move |_| value);
        let three = seeded([at(1.), at(2.), at(3.)]);
        assert!((three.value(0, MetricKind::Ade).unwrap() - 2.).abs() < 1e-12);
        let found = bootstrap().intervals(&three, &[MetricKind::Ade], Draw::Drivers)[0].unwrap();
        assert!((found.low - 1.).abs() < 1e-12 && (found.high - 3.).abs() < 1e-12, "{found:?}");
        let alone = bootstrap().intervals(&at(2.), &[MetricKind::Ade], Draw::Drivers)[0].unwrap();
        assert!((alone.high - alone.low).abs() < 1e-12);
        // Seeds move the difference to another model, and not that to the model itself.
        let difference = bootstrap().difference(&three, &at(2.5), 0, MetricKind::Ade).unwrap();
        assert!((difference.value + 0.5).abs() < 1e-12 && !difference.is_clear(), "{difference:?}");
        assert!((0.8..0.9).contains(&difference.share_better), "23 of 27 draws: {}", difference.share_better);
        let paired = bootstrap().difference(&three, &three, 0, MetricKind::Ade).unwrap();
        assert_eq!(paired.interval, Some(Interval { low: 0., high: 0. }), "the same seeds are drawn for both");
    }

    #[test]
    fn one_vehicle_has_no_interval() {
        assert_eq!(bootstrap().intervals(&sums(1, 40, |_| 2.), &[MetricKind::Ade], Draw::Drivers), [None]);
        let difference = bootstrap().difference(&sums(1, 4, |_| 2.), &sums(1, 4, |_| 1.), 0, MetricKind::Ade);
        assert_eq!(difference.unwrap().interval, None);
    }

    /// Five events of forty drivers, who differ little within an event: by driver the mean looks sure, by event not.
    #[test]
    fn events_that_differ_give_the_wider_interval() {
        let of = |shift: f64| {
            let mut gatherer = Gatherer::new(1);
            for vehicle in 0..200 {
                let event = vehicle / 40;
                let value = shift + f64::from(event) + 0.1 * normal(7, vehicle);
                gatherer.add_of("r", vehicle, [("r", vehicle), ("r", 40 * event)], &[Some(value)]);
            }
            Members::one(gatherer.finish())
        };
        let width = |draw| {
            let interval = bootstrap().intervals(&of(0.), &[MetricKind::Ade], draw)[0].unwrap();
            interval.high - interval.low
        };
        // Of the values 0 to 4 the mean has the deviation sqrt(2 / 200) by driver and sqrt(2 / 5) by event.
        let (by_driver, by_event) = (width(Draw::Drivers), width(Draw::Events));
        assert!((by_driver - 3.92 * 0.1).abs() < 0.05, "{by_driver}");
        assert!((by_event - 3.92 * 0.4f64.sqrt()).abs() < 0.4, "{by_event}");
        let difference = bootstrap().difference(&of(0.), &of(0.2), 0, MetricKind::Ade).unwrap();
        let near = |it: Interval| (it.low + 0.2).abs() < 1e-9 && (it.high + 0.2).abs() < 1e-9;
        assert!(near(difference.interval.unwrap()) && near(difference.by_event.unwrap()), "{difference:?}");
        assert!(difference.is_clear());
    }

    /// Forty drivers of two events: too few events for an interval.
    #[test]
    fn two_events_are_no_sample() {
        let of = |events: u32| {
            let mut gatherer = Gatherer::new(1);
            for vehicle in 0..40 {
                let cluster = [("r", vehicle), ("r", vehicle % events)];
                gatherer.add_of("r", vehicle, cluster, &[Some(f64::from(vehicle))]);
            }
            Members::one(gatherer.finish())
        };
        let interval = |events, draw| bootstrap().intervals(&of(events), &[MetricKind::Ade], draw)[0];
        assert!(interval(2, Draw::Events).is_none() && interval(2, Draw::Drivers).is_some());
        assert!(interval(3, Draw::Events).is_some());
        let difference = |events| bootstrap().difference(&of(events), &of(events), 0, MetricKind::Ade).unwrap();
        assert!(difference(2).by_event.is_none() && difference(3).by_event.is_some());
    }

    /// Which of two is nearer to what it should be is no matter of sign.
    #[test]
    fn a_share_that_has_an_ideal_is_better_near_it() {
        let at = |value: f64| sums(30, 1, move |_| value);
        let share_better =
            |a: f64, b: f64| bootstrap().difference(&at(a), &at(b), 0, MetricKind::Coverage50At).unwrap().share_better;
        assert_eq!([share_better(0.45, 0.6), share_better(0.6, 0.45)], [1., 0.]);
        assert_eq!([share_better(0.3, 0.6), share_better(0.6, 0.3)], [0., 1.]);
    }

    #[test]
    fn percentiles_interpolate() {
        // 0, 1, ..., 40: 2.5 % of 40 steps is one step.
        let found = middle((0..=40).rev().map(f64::from).collect()).unwrap();
        assert_eq!((found.low, found.high), (1., 39.));
        assert_eq!(middle(Vec::new()), None);
    }

    #[test]
    fn too_few_resamples_are_refused() {
        let error = Bootstrap { resamples: 20, seed: 1 }.check().unwrap_err();
        assert!(error.to_string().contains("`resamples`"), "{error}");
        assert!(bootstrap().check().is_ok());
    }
}
