//! Distributions, and how far two of them are apart.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::robust::quantile;
use crate::traffic::Traffic;

/// Quantiles that a distribution is told by.
const QUANTILES: [f64; 9] = [0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99];

/// Bins of a histogram.
const BINS: usize = 40;

/// Values of one quantity, sorted: one a vehicle and frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    sorted: Vec<f64>,
    not_finite: usize,
}

/// Values of every quantity of a recording, one a vehicle and frame in which it is known.
///
/// Jerk is not among them: from positions at 10 to 25 Hz it is the noise of the recording more than the driver.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Samples {
    /// Speed along the road, m/s.
    pub speed: Sample,
    /// Acceleration along the road, m/s²: the difference of two velocities, a span apart.
    pub acceleration: Sample,
    /// Gap to the leader, bumper to bumper, m.
    pub gap: Sample,
    /// Time gap to the leader, s: see [`time_gap`](crate::time_gap).
    pub time_gap: Sample,
    /// Time to collision, s, where the gap closes and it is at most [`Samples::LONGEST_TTC`]: see [`ttc`](crate::ttc).
    pub ttc: Sample,
    /// From the centre of the lane, m, to the left.
    pub lateral_offset: Sample,
    /// Rows that a quantity does not have, by reason.
    pub left_out: BTreeMap<&'static str, u64>,
}

/// Counts of values in equal bins between the 0.5 % and the 99.5 % quantile.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// Start of the first bin, in the quantity's unit.
    pub from: f64,
    /// Width of a bin.
    pub width: f64,
    /// Values by bin.
    pub counts: Vec<u64>,
    /// Values below the first bin.
    pub below: u64,
    /// Values above the last bin.
    pub above: u64,
}

/// A distribution in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Distribution {
    /// Number of values: vehicles times frames, which are not independent.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
    /// Probabilities and quantiles.
    pub quantiles: Vec<[f64; 2]>,
    /// Histogram.
    pub histogram: Histogram,
}

/// The distributions of a recording; `None` where there is no value. Quantities and units are those of [`Samples`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)] // as in Samples
pub struct Distributions {
    pub speed: Option<Distribution>,
    pub acceleration: Option<Distribution>,
    pub gap: Option<Distribution>,
    pub time_gap: Option<Distribution>,
    pub ttc: Option<Distribution>,
    pub lateral_offset: Option<Distribution>,
}

/// How far two samples of one quantity are apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Distance {
    /// The quantity, named as in [`Samples`].
    pub quantity: &'static str,
    /// First Wasserstein distance, in the quantity's unit.
    pub wasserstein: f64,
    /// Kolmogorov's and Smirnov's distance, 0 to 1.
    pub kolmogorov_smirnov: f64,
    /// Values of either.
    pub counts: [usize; 2],
}

impl Sample {
    /// A sample of values in any order; those that are not finite are left out, and counted.
    #[must_use]
    pub fn new(values: impl IntoIterator<Item = f64>) -> Self {
        let mut not_finite = 0;
        let finite = |value: &f64| {
            not_finite += usize::from(!value.is_finite());
            value.is_finite()
        };
        let mut sorted: Vec<f64> = values.into_iter().filter(finite).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        Self { sorted, not_finite }
    }

    /// The values, sorted.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.sorted
    }

    /// Values that were left out because they are not finite.
    #[must_use]
    pub fn not_finite(&self) -> usize {
        self.not_finite
    }

    /// Quantile `p`, 0 to 1, between neighbouring values interpolated; `None` of no values.
    #[must_use]
    pub fn quantile(&self, p: f64) -> Option<f64> {
        quantile(&self.sorted, p)
    }

    /// First Wasserstein distance (earth mover's distance): the area between the two distribution functions, in the unit of the
    /// values. `None` where either has no value.
    #[must_use]
    pub fn wasserstein(&self, other: &Self) -> Option<f64> {
        self.steps(other, |width, apart, sum| sum + width * apart)
    }

    /// Kolmogorov's and Smirnov's distance: the greatest difference of the two distribution functions. `None` where either has
    /// no value.
    #[must_use]
    pub fn kolmogorov_smirnov(&self, other: &Self) -> Option<f64> {
        self.steps(other, |_, apart, most| most.max(apart))
    }

    /// Both distribution functions together: folds the width of each step between two different values, and how far apart the
    /// functions are on it.
    fn steps(&self, other: &Self, fold: impl Fn(f64, f64, f64) -> f64) -> Option<f64> {
        let (a, b) = (&self.sorted, &other.sorted);
        if a.is_empty() || b.is_empty() {
            return None;
        }
        let (mut i, mut j, mut result) = (0, 0, 0.);
        while i < a.len() && j < b.len() {
            let at = a[i].min(b[j]);
            i += a[i..].iter().take_while(|value| **value <= at).count();
            j += b[j..].iter().take_while(|value| **value <= at).count();
            let next = [a.get(i), b.get(j)].into_iter().flatten().fold(f64::INFINITY, |least, value| least.min(*value));
            let apart = (i as f64 / a.len() as f64 - j as f64 / b.len() as f64).abs();
            if next.is_finite() {
                result = fold(next - at, apart, result);
            }
        }
        // One of them is through: the rest of the other.
        let (rest, done, count) = if i < a.len() { (a, i, a.len()) } else { (b, j, b.len()) };
        for (k, pair) in rest.windows(2).enumerate().skip(done) {
            result = fold(pair[1] - pair[0], 1. - (k + 1) as f64 / count as f64, result);
        }
        Some(result)
    }

    /// The distribution in numbers; `None` of no values.
    #[must_use]
    pub fn distribution(&self) -> Option<Distribution> {
        let (min, max) = (*self.sorted.first()?, *self.sorted.last()?);
        let n = self.sorted.len() as f64;
        let mean = self.sorted.iter().sum::<f64>() / n;
        let variance = self.sorted.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
        let quantiles = QUANTILES.iter().filter_map(|p| Some([*p, self.quantile(*p)?])).collect();
        let histogram = self.histogram(self.quantile(0.005)?, self.quantile(0.995)?);
        Some(Distribution {
            count: self.sorted.len(),
            mean,
            deviation: variance.sqrt(),
            min,
            max,
            quantiles,
            histogram,
        })
    }

    fn histogram(&self, from: f64, to: f64) -> Histogram {
        let width = if to > from { (to - from) / BINS as f64 } else { 1. };
        let mut histogram = Histogram { from, width, counts: vec![0; BINS], below: 0, above: 0 };
        for value in &self.sorted {
            let bin = (value - from) / width;
            if *value < from {
                histogram.below += 1;
            } else if *value > to {
                histogram.above += 1;
            } else {
                histogram.counts[(bin as usize).min(BINS - 1)] += 1;
            }
        }
        histogram
    }
}

impl Distribution {
    /// The quantile nearest to probability `p` of those in `quantiles`.
    #[must_use]
    pub fn quantile(&self, p: f64) -> f64 {
        let nearest = self.quantiles.iter().min_by(|a, b| (a[0] - p).abs().total_cmp(&(b[0] - p).abs()));
        nearest.map_or(self.mean, |quantile| quantile[1])
    }
}

impl Samples {
    /// A longer time to collision tells nothing of safety, s.
    pub const LONGEST_TTC: f64 = 60.;

    fn named(&self) -> [(&'static str, &Sample); 6] {
        [
            ("speed", &self.speed),
            ("acceleration", &self.acceleration),
            ("gap", &self.gap),
            ("time_gap", &self.time_gap),
            ("ttc", &self.ttc),
            ("lateral_offset", &self.lateral_offset),
        ]
    }

    /// How far each quantity is from that of another recording; without those of which either has no value.
    #[must_use]
    pub fn distances(&self, other: &Self) -> Vec<Distance> {
        let both = self.named().into_iter().zip(other.named());
        both.filter_map(|((quantity, a), (_, b))| {
            let (wasserstein, kolmogorov_smirnov) = (a.wasserstein(b)?, a.kolmogorov_smirnov(b)?);
            Some(Distance { quantity, wasserstein, kolmogorov_smirnov, counts: [a.sorted.len(), b.sorted.len()] })
        })
        .collect()
    }

    /// All of them in numbers.
    #[must_use]
    pub fn distributions(&self) -> Distributions {
        let [speed, acceleration, gap, time_gap, ttc, lateral_offset] =
            self.named().map(|(_, sample)| sample.distribution());
        Distributions { speed, acceleration, gap, time_gap, ttc, lateral_offset }
    }
}

impl Traffic<'_> {
    /// Values of every quantity. Acceleration is the difference of velocities `span_s` apart, centred; at least two frames.
    #[must_use]
    pub fn samples(&self, span_s: f64) -> Samples {
        let columns = self.recording().columns();
        let half = ((span_s / self.frame_s() / 2.).round() as usize).max(1);
        let [mut speed, mut acceleration, mut gap, mut time_gap, mut ttc, mut offset] = [const { Vec::new() }; 6];
        let mut left_out: BTreeMap<&'static str, u64> = BTreeMap::new();
        let mut leave_out = |reason: &'static str| *left_out.entry(reason).or_default() += 1;
        for (index, track) in self.recording().tracks().iter().enumerate() {
            for row in track.rows.clone() {
                speed.push(f64::from(columns.vx[row]));
                match row
                    .checked_sub(half)
                    .filter(|from| track.rows.contains(from) && track.rows.contains(&(row + half)))
                {
                    Some(from) => {
                        let change = f64::from(columns.vx[row + half]) - f64::from(columns.vx[from]);
                        acceleration.push(change / (2. * half as f64 * self.frame_s()));
                    }
                    None => leave_out("acceleration: near the end of a track"),
                }
                match self.lane(row) {
                    Some(lane) => offset.push(f64::from(columns.y[row]) - lane.centre),
                    None => leave_out("lateral offset: no lane"),
                }
                match self.following(index, row) {
                    Ok(following) => {
                        gap.push(following.gap);
                        match following.time_gap() {
                            Some(value) => time_gap.push(value),
                            None => leave_out("time gap: slower than 1 m/s, or overlapping"),
                        }
                        match following.ttc() {
                            Some(value) if value <= Samples::LONGEST_TTC => ttc.push(value),
                            _ if following.leader_speed.is_none() => {
                                leave_out("time to collision: leader's speed not known")
                            }
                            _ => leave_out("time to collision: not closing, overlapping, or beyond 60 s"),
                        }
                    }
                    Err(crate::Unpaired::NoLane) => leave_out("gap: no lane"),
                    Err(crate::Unpaired::NoLeader) => leave_out("gap: nobody ahead in the lane"),
                }
            }
        }
        let [speed, acceleration, gap, time_gap, ttc, lateral_offset] =
            [speed, acceleration, gap, time_gap, ttc, offset].map(Sample::new);
        Samples { speed, acceleration, gap, time_gap, ttc, lateral_offset, left_out }
    }
}
