//! Intervals that are known, and what must not change them.

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
    let other = Bootstrap { seed: 6, ..bootstrap() }.intervals(&sums, &[MetricKind::RmseAt], Draw::Drivers)[0].unwrap();
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
    assert!((one.value(0, MetricKind::RmseAt).unwrap() - three.value(0, MetricKind::RmseAt).unwrap()).abs() < 1e-12);
    let other = sums(60, 2, |vehicle| 1. + normal(4, vehicle).powi(2));
    let difference = |a| bootstrap().difference(a, &other, 0, MetricKind::RmseAt).unwrap();
    let (alone, thrice) = (difference(&one), difference(&three));
    assert!((alone.value - thrice.value).abs() < 1e-12 && alone.share_better == thrice.share_better);
    assert!(near(alone.interval.unwrap(), thrice.interval.unwrap(), 1e-12));
}

/// All vehicles alike, three seeds at 1, 2 and 3: of their mean a textbook interval is 4.303 / sqrt(3) to each side.
#[test]
fn seeds_that_differ_widen_the_interval() {
    let at = |value: f64| sums(50, 1, move |_| value);
    let three = seeded([at(1.), at(2.), at(3.)]);
    assert!((three.value(0, MetricKind::Ade).unwrap() - 2.).abs() < 1e-12);
    let half = 4.302_653 / 3f64.sqrt();
    let of = |sums: &Members, kind| bootstrap().intervals(sums, &[kind], Draw::Drivers)[0].unwrap();
    let found = of(&three, MetricKind::LongitudinalBiasAt);
    assert!(near(found, Interval { low: 2. - half, high: 2. + half }, 1e-9), "{found:?}");
    assert_eq!(of(&three, MetricKind::Ade), Interval { low: 0., ..found }, "no distance is below 0");
    let alone = of(&at(2.), MetricKind::Ade);
    assert!((alone.high - alone.low).abs() < 1e-12, "one seed adds nothing");
    // Seeds move the difference to another model, and not that to the model itself.
    for swapped in [false, true] {
        let (a, b) = if swapped { (at(2.5), three.clone()) } else { (three.clone(), at(2.5)) };
        let difference = bootstrap().difference(&a, &b, 0, MetricKind::Ade).unwrap();
        let value = if swapped { 0.5 } else { -0.5 };
        assert!((difference.value - value).abs() < 1e-12 && !difference.is_clear(), "{difference:?}");
        assert!(near(difference.interval.unwrap(), Interval { low: value - half, high: value + half }, 1e-9));
    }
    let paired = bootstrap().difference(&three, &three, 0, MetricKind::Ade).unwrap();
    assert_eq!(paired.interval, Some(Interval { low: 0., high: 0. }), "seed by seed they do not differ");
    // Seeds that all gain 0.2 are better for sure, however much they differ among each other.
    let gained = seeded([at(1.2), at(2.2), at(3.2)]);
    let paired = bootstrap().difference(&three, &gained, 0, MetricKind::Ade).unwrap();
    assert!(near(paired.interval.unwrap(), Interval { low: -0.2, high: -0.2 }, 1e-9) && paired.is_clear());
    // Two seeds and three cannot be paired: both halves enter.
    let two = seeded([at(2.), at(3.)]);
    let unpaired = bootstrap().difference(&three, &two, 0, MetricKind::Ade).unwrap().interval.unwrap();
    let both = half.hypot(12.706_205 * 0.5);
    assert!(near(unpaired, Interval { low: -0.5 - both, high: -0.5 + both }, 1e-6), "{unpaired:?}");
}

/// Drivers and trainings add in quadrature, on each side.
#[test]
fn drivers_and_trainings_add_in_quadrature() {
    let of = |shift: f64| sums(60, 1, move |vehicle| shift + normal(3, vehicle).powi(2));
    let [alone, three] = [of(2.), seeded([of(1.9), of(2.), of(2.1)])]
        .map(|it| bootstrap().intervals(&it, &[MetricKind::Ade], Draw::Drivers)[0].unwrap());
    let value = of(2.).value(0, MetricKind::Ade).unwrap();
    let half = 4.302_653 * 0.1 / 3f64.sqrt();
    let expected = alone.widened(value, half);
    assert!(near(three, expected, 1e-9), "{three:?}, not {expected:?}");
    assert!(((value - three.low).powi(2) - (value - alone.low).powi(2) - half.powi(2)).abs() < 1e-9);
    assert!(((three.high - value).powi(2) - (alone.high - value).powi(2) - half.powi(2)).abs() < 1e-9);
}

/// Trainings of deviation 1 and drivers of deviation 1, of which there are 50: intervals of three seeds hold the truth
/// as often as they say, also of the difference to a system of one seed, and would not by percentiles of the seeds.
#[test]
fn intervals_cover_the_truth_where_trainings_dominate() {
    let bootstrap = Bootstrap { resamples: 200, seed: 8 };
    let samples = 300;
    let mut held = [0; 3];
    for sample in 0..samples {
        let shifts = [0, 1, 2].map(|seed| normal(3000 + sample, seed));
        let of = |shift: f64| sums(50, 1, move |vehicle| shift + normal(4000 + sample, vehicle));
        let three = seeded(shifts.map(of));
        let own = bootstrap.intervals(&three, &[MetricKind::LongitudinalBiasAt], Draw::Drivers)[0].unwrap();
        let other = sums(50, 1, |vehicle| normal(5000 + sample, vehicle));
        let paired = bootstrap.difference(&three, &other, 0, MetricKind::LongitudinalBiasAt).unwrap();
        // Percentiles of the mean of three seeds reach from the least seed to the largest at most.
        let least = shifts.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = shifts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let seeds = Interval { low: least, high: largest };
        for (count, interval) in held.iter_mut().zip([own, paired.interval.unwrap(), seeds]) {
            *count += usize::from(interval.low <= 0. && 0. <= interval.high);
        }
    }
    // Binomial: 285 expected, 3.8 the standard deviation.
    assert!(held[..2].iter().all(|held| (273..=297).contains(held)), "{held:?} of {samples}");
    assert!(held[2] < 250, "{held:?}");
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
    // Of the values 0 to 4 the mean has the deviation sqrt(2 / 200) by driver and sqrt(2.5 / 5) by event, of which
    // there are five: 2.776 to each side.
    let (by_driver, by_event) = (width(Draw::Drivers), width(Draw::Events));
    assert!((by_driver - 3.92 * 0.1).abs() < 0.05, "{by_driver}");
    assert!((by_event - 2. * 2.776 * 0.5f64.sqrt()).abs() < 0.2, "{by_event}");
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
    let found = between((0..=40).rev().map(f64::from).collect(), 0.025).unwrap();
    assert_eq!((found.low, found.high), (1., 39.));
    assert_eq!(between(Vec::new(), 0.025), None);
}

/// Student's quantiles from a table.
#[test]
fn few_clusters_have_wider_intervals() {
    let table = [(1, 12.706), (2, 4.303), (4, 2.776), (6, 2.447), (7, 2.365), (9, 2.262), (29, 2.045), (99, 1.984)];
    for (freedom, expected) in table {
        let found = student(freedom);
        assert!((found / expected - 1.).abs() < 1e-3, "{freedom}: {found}, not {expected}");
    }
    let normal = |z: f64| 0.5 * libm::erfc(z / 2f64.sqrt());
    assert!((tail(10) - normal((10f64 / 9.).sqrt() * 2.262)).abs() < 1e-4);
    assert!((tail(1_000_000) - 0.025).abs() < 1e-6);
}

/// Means of a few normal numbers: the interval holds the truth as often as it says from three on. Percentiles of the
/// resamples do not, neither plain ones nor, below eight, those further out.
#[test]
fn intervals_by_few_clusters_cover_the_truth() {
    let bootstrap = Bootstrap { resamples: 400, seed: 7 };
    let samples = 1000;
    for clusters in [3, 4, 5, 8, 30] {
        let mut held = [0; 3];
        for sample in 0..samples {
            let values: Vec<f64> = (0..clusters as u32).map(|cluster| normal(500 + sample, cluster)).collect();
            let mean = |times: &[f64]| {
                let sum: f64 = values.iter().zip(times).map(|(value, times)| value * times).sum();
                Some(sum / values.len() as f64)
            };
            let interval = bootstrap.interval(values.len(), mean).unwrap();
            let resampled: Vec<f64> = bootstrap.resample(values.len(), mean).into_iter().flatten().collect();
            let plain = between(resampled.clone(), 0.025).unwrap();
            let far_out = between(resampled, tail(values.len())).unwrap();
            for (count, it) in held.iter_mut().zip([interval, far_out, plain]) {
                *count += usize::from(it.low <= 0. && 0. <= it.high);
            }
        }
        let [held, far_out, plain] = held;
        // Binomial: 950 expected, 7 the standard deviation; what rests on percentiles covers a little less.
        let least = if clusters < FEW { 929 } else { 915 };
        assert!((least..=971).contains(&held), "{clusters}: {held} of {samples}");
        assert!(clusters >= FEW || far_out + 20 < held, "{clusters}: {far_out} beside {held}");
        assert!(clusters > FEW || plain < 915, "{clusters}: {plain} beside {held}");
    }
}

/// The same through sums of windows, by driver and by event, and for a difference.
#[test]
fn three_events_have_students_interval() {
    let mut gatherer = Gatherer::new(1);
    for vehicle in 0..30 {
        let event = vehicle % 3;
        gatherer.add_of("r", vehicle, [("r", vehicle), ("r", event)], &[Some(10. * f64::from(event))]);
    }
    let own = Members::one(gatherer.finish());
    let other = Members::one({
        let mut gatherer = Gatherer::new(1);
        for vehicle in 0..30 {
            gatherer.add_of("r", vehicle, [("r", vehicle), ("r", vehicle % 3)], &[Some(0.)]);
        }
        gatherer.finish()
    });
    // Of 0, 10 and 20: deviation 10 of one, 10 / sqrt(3) of the mean.
    let half = 4.303 * 10. / 3f64.sqrt();
    let found = bootstrap().intervals(&own, &[MetricKind::LongitudinalBiasAt], Draw::Events)[0].unwrap();
    assert!(near(found, Interval { low: 10. - half, high: 10. + half }, 0.05 * half), "{found:?}");
    let difference = bootstrap().difference(&own, &other, 0, MetricKind::LongitudinalBiasAt).unwrap();
    assert!(near(difference.by_event.unwrap(), found, 1e-9));
    assert!(difference.interval.unwrap().low > 0. && !difference.is_clear(), "three events cannot say");
}

/// Of few vehicles Student's interval of a share would leave 0 to 1.
#[test]
fn an_interval_of_a_share_stays_within_it() {
    let found = bootstrap().share(&[[9, 10], [10, 10], [5, 10]]).unwrap();
    assert!(found.high == 1. && (0. ..0.5).contains(&found.low), "{found:?}");
    let [alone, beside] = [&[[1, 2], [2, 2], [0, 2]][..], &[[1, 2], [0, 0], [2, 2], [0, 0], [0, 2]]]
        .map(|counts| bootstrap().share(counts).unwrap());
    assert_eq!(alone, beside, "vehicles without trials say nothing");
}

#[test]
fn too_few_resamples_are_refused() {
    let error = Bootstrap { resamples: 20, seed: 1 }.check().unwrap_err();
    assert!(error.to_string().contains("`resamples`"), "{error}");
    assert!(bootstrap().check().is_ok());
}
