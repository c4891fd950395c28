//! Stop-and-go waves: how fast they run upstream, how many there are, how deep.

use serde::{Deserialize, Serialize};

use crate::bins::Bins;
use crate::cells::CellSize;
use crate::error::{MeasureError, Missing};
use crate::robust::median;
use crate::traffic::Traffic;

/// Places that each place is compared with, downstream of it.
const NEAR: usize = 6;
/// Pairs of places of a lane at most; of a longer road an even choice of places.
const PAIRS: usize = 400;
/// Step of the slownesses (inverse speeds) that are tried, s/m; a tried one stands for a lag at every distance.
const SLOWNESS: f64 = 0.002;
/// Nothing slower than this is looked for, m/s: upstream, and downstream. Places are evenly apart, so that waves of period T
/// look as good at a slowness that differs by T over their distance; with places 20 m apart that is beyond these bounds
/// for periods above 17 s.
const SLOWEST: [f64; 2] = [2., 3.];
/// Share of the pairs of places that a lag needs.
const SEEN: f64 = 0.5;

/// How waves are looked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaveSettings {
    /// Distance between places, m; `None`: a twelfth of the stretch, between 10 and 20 m.
    /// Places farther apart confuse waves of short periods with others.
    pub spacing: Option<f64>,
    /// Step of the speed series, s.
    pub step_s: f64,
    /// Width of the moving mean over a series, s.
    pub smooth_s: f64,
    /// Longest time without a vehicle that is bridged, s.
    pub bridge_s: f64,
    /// Time that two places must be seen together, s.
    pub together_s: f64,
    /// Fastest wave, m/s upstream. Places that change faster one after the other change at once.
    pub fastest: f64,
    /// Least standard deviation of the speed over time at a place, median over places, m/s.
    pub least_deviation: f64,
    /// Least mean correlation of pairs of places at the best lag.
    pub least_correlation: f64,
    /// How far it must stand above the median over all lags.
    pub least_prominence: f64,
    /// A stop-and-go wave is a fall of the speed by at least this, and a rise by as much after it, m/s.
    pub swing: f64,
    /// Its slowest speed is at most this, m/s.
    pub trough: f64,
}

impl Default for WaveSettings {
    fn default() -> Self {
        Self {
            spacing: None,
            step_s: 0.5,
            smooth_s: 5.,
            bridge_s: 20.,
            together_s: 30.,
            fastest: 15.,
            least_deviation: 0.7,
            least_correlation: 0.4,
            least_prominence: 0.15,
            swing: 3.,
            trough: 15.,
        }
    }
}

impl WaveSettings {
    pub(crate) fn checked(self) -> Result<Self, MeasureError> {
        let positive = [
            ("waves.spacing", self.spacing.unwrap_or(1.)),
            ("waves.step_s", self.step_s),
            ("waves.smooth_s", self.smooth_s),
            ("waves.bridge_s", self.bridge_s),
            ("waves.together_s", self.together_s),
            ("waves.fastest", self.fastest),
            ("waves.swing", self.swing),
            ("waves.trough", self.trough),
        ];
        positive.into_iter().try_for_each(|(name, value)| MeasureError::positive(name, value).map(|_| ()))?;
        Ok(self)
    }
}

/// Speed of waves that run against the traffic.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WaveSpeed {
    /// Speed upstream, m/s.
    pub speed: f64,
    /// Mean correlation over pairs of places at the lag of this speed: the wave's strength.
    pub correlation: f64,
    /// How far that stands above the median over all lags.
    pub prominence: f64,
    /// Pairs of places.
    pub pairs: usize,
}

/// What one place of one lane shows over time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlaceWaves {
    /// Lane number of the file.
    pub lane: i16,
    /// Middle of the cell, m.
    pub x: f64,
    /// Time for which its speed is known, s.
    pub known_s: f64,
    /// Mean speed over time, m/s.
    pub mean: f64,
    /// Standard deviation of the speed over time, m/s.
    pub deviation: f64,
    /// Stop-and-go waves that passed.
    pub waves: usize,
    /// Median fall of speed of these, m/s; `None` without one.
    pub fall: Option<f64>,
}

/// Waves of one lane, or of all lanes of a carriageway.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Waves {
    /// Index of the carriageway.
    pub road: u16,
    /// Lane number of the file; `None`: pairs of places of all lanes, each lane for itself.
    pub lane: Option<i16>,
    /// Their speed.
    pub speed: Result<WaveSpeed, Missing>,
    /// What each place shows.
    pub places: Vec<PlaceWaves>,
}

/// The mean correlation of pairs of places over slowness.
#[derive(Clone, Default)]
struct Stack {
    /// Sum of correlations and number of pairs by slowness, from downstream to upstream.
    sums: Vec<(f64, usize)>,
    pairs: usize,
    deviations: Vec<f64>,
}

impl Traffic<'_> {
    /// Waves of each lane of a carriageway, from left to right, and those of all of them last.
    ///
    /// The speed of small cells of one lane makes a series over time at each place. A wave that runs upstream is seen first
    /// downstream: every series is correlated with those of the six places downstream at every lag, and the speed at
    /// which the mean correlation over the pairs is greatest is the wave's (the idea of the cross-correlation of detectors;
    /// compare Cassidy and Windover 1995 and Treiber and Kesting 2013, chapter 18). A lag that only suits one distance,
    /// such as a whole period of the waves or a round of a ring, does not suit the others.
    ///
    /// # Errors
    /// [`MeasureError::Setting`] for settings that are not positive, [`MeasureError::TooFine`].
    pub fn waves(&self, road: u16, settings: &WaveSettings) -> Result<Vec<Waves>, MeasureError> {
        let settings = settings.checked()?;
        let Some([from, to]) = self.extent(road) else { return Ok(Vec::new()) };
        let spacing = settings.spacing.unwrap_or(((to - from) / 12.).clamp(10., 20.));
        let Some(cells) = self.cells(road, CellSize { x: spacing, t: settings.step_s })? else { return Ok(Vec::new()) };
        let ring = self.circumference().is_some();
        let mut all = (Stack::default(), Vec::new());
        let mut waves: Vec<Waves> = Vec::new();
        for (plane, number) in cells.lanes().iter().enumerate() {
            let series: Vec<Vec<f64>> =
                (0..cells.x().count).map(|x| smooth(&bridged(cells.speeds(plane, x), &settings), &settings)).collect();
            let places = places(*number, cells.x(), &series, &settings);
            let stack = stacked(&series, cells.x(), ring, &settings);
            all.0.add(&stack);
            all.1.extend(places.iter().copied());
            waves.push(Waves { road, lane: Some(*number), speed: stack.speed(&settings), places });
        }
        waves.push(Waves { road, lane: None, speed: all.0.speed(&settings), places: all.1 });
        Ok(waves)
    }
}

/// Speed over time; where no vehicle was, straight between the times before and after if they are near, else NaN.
fn bridged(speeds: impl Iterator<Item = Option<f64>>, settings: &WaveSettings) -> Vec<f64> {
    let mut series: Vec<f64> = speeds.map(|speed| speed.unwrap_or(f64::NAN)).collect();
    let mut before: Option<usize> = None;
    for now in 0..series.len() {
        if series[now].is_nan() {
            continue;
        }
        if let Some(before) = before.filter(|before| (now - before) as f64 * settings.step_s <= settings.bridge_s) {
            let (from, slope) = (series[before], (series[now] - series[before]) / (now - before) as f64);
            (before + 1..now).for_each(|i| series[i] = from + slope * (i - before) as f64);
        }
        before = Some(now);
    }
    series
}

/// Moving mean of what is known, about each known value.
fn smooth(series: &[f64], settings: &WaveSettings) -> Vec<f64> {
    let half = (settings.smooth_s / settings.step_s / 2.) as usize;
    let mean = |i: usize| {
        let around = &series[i.saturating_sub(half)..(i.saturating_add(half + 1)).min(series.len())];
        let known = around.iter().filter(|v| !v.is_nan());
        known.clone().sum::<f64>() / known.count() as f64
    };
    (0..series.len()).map(|i| if series[i].is_nan() { f64::NAN } else { mean(i) }).collect()
}

fn places(lane: i16, x: &Bins, series: &[Vec<f64>], settings: &WaveSettings) -> Vec<PlaceWaves> {
    let place = |(i, series): (usize, &Vec<f64>)| {
        let known: Vec<f64> = series.iter().copied().filter(|v| !v.is_nan()).collect();
        let [mean, deviation] = moments(&known)?;
        let falls = falls(&known, settings);
        // The first may have begun before the recording.
        let fall = median(falls.clone());
        let known_s = known.len() as f64 * settings.step_s;
        Some(PlaceWaves { lane, x: x.middle(i), known_s, mean, deviation, waves: falls.len(), fall })
    };
    series.iter().enumerate().filter_map(place).collect()
}

fn moments(values: &[f64]) -> Option<[f64; 2]> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (!values.is_empty()).then(|| [mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()])
}

/// The fall of speed of every wave that has passed: down by a swing, into slow traffic, and up again by a swing.
fn falls(speeds: &[f64], settings: &WaveSettings) -> Vec<f64> {
    let mut falls = Vec::new();
    let Some(first) = speeds.first() else { return falls };
    let (mut top, mut bottom, mut inside) = (*first, *first, false);
    for speed in speeds {
        if inside {
            bottom = bottom.min(*speed);
            if *speed >= bottom + settings.swing {
                if bottom <= settings.trough {
                    falls.push(top - bottom);
                }
                (top, inside) = (*speed, false);
            }
        } else {
            top = top.max(*speed);
            if *speed <= top - settings.swing {
                (bottom, inside) = (*speed, true);
            }
        }
    }
    falls
}

/// Slowness of the `i`-th one tried, s/m: negative downstream.
fn slowness(i: usize) -> f64 {
    i as f64 * SLOWNESS - 1. / SLOWEST[1]
}

fn tried() -> usize {
    ((1. / SLOWEST[0] + 1. / SLOWEST[1]) / SLOWNESS).round() as usize + 1
}

fn stacked(series: &[Vec<f64>], x: &Bins, ring: bool, settings: &WaveSettings) -> Stack {
    let mut stack = Stack { sums: vec![(0., 0); tried()], ..Stack::default() };
    let known = series.iter().map(|s| s.iter().copied().filter(|v| !v.is_nan()).collect::<Vec<_>>());
    stack.deviations = known.filter_map(|known| moments(&known)).map(|[_, deviation]| deviation).collect();
    let together = (settings.together_s / settings.step_s).ceil().max(3.) as usize;
    for up in (0..series.len()).step_by((series.len() * NEAR).div_ceil(PAIRS).max(1)) {
        for by in 1..=NEAR {
            let down = if ring { (up + by) % series.len() } else { up + by };
            // On a ring of few places the other way round would be as near.
            if down >= series.len() || (ring && by * 2 >= series.len()) {
                break;
            }
            let distance = by as f64 * x.step;
            let longest = (distance / SLOWEST[0] / settings.step_s).ceil() as i64 + 1;
            let at_lag: Vec<Option<f64>> =
                (-longest..=longest).map(|lag| correlation(&series[down], &series[up], lag, together)).collect();
            stack.pairs += usize::from(at_lag.iter().any(Option::is_some));
            for (i, sum) in stack.sums.iter_mut().enumerate() {
                let lag = distance * slowness(i) / settings.step_s + longest as f64;
                if let Some(correlation) = between_lags(&at_lag, lag) {
                    sum.0 += correlation;
                    sum.1 += 1;
                }
            }
        }
    }
    stack
}

/// The correlation at a place between lags, on the cubic through two lags on either side; straight at the ends.
fn between_lags(at_lag: &[Option<f64>], lag: f64) -> Option<f64> {
    let below = lag.floor().max(0.) as usize;
    let at = |i: usize| at_lag.get(i).copied().flatten();
    let (b, c) = (at(below)?, at(below + 1)?);
    let a = below.checked_sub(1).and_then(at).unwrap_or(2. * b - c);
    let d = at(below + 2).unwrap_or(2. * c - b);
    let t = lag - below as f64;
    // Catmull and Rom.
    Some(b + t / 2. * (c - a + t * (2. * a - 5. * b + 4. * c - d + t * (3. * (b - c) + d - a))))
}

/// Pearson's correlation of `down` and, `lag` steps later, `up`, over the times when both are known; `None` where these are
/// fewer than `together`, or where one does not change.
fn correlation(down: &[f64], up: &[f64], lag: i64, together: usize) -> Option<f64> {
    let (mut n, mut a, mut b, mut aa, mut bb, mut ab) = (0usize, 0., 0., 0., 0., 0.);
    let shift = lag.unsigned_abs() as usize;
    let (early, late) = if lag >= 0 { (down, up) } else { (up, down) };
    for (p, q) in early.iter().zip(late.get(shift..)?).filter(|(p, q)| !p.is_nan() && !q.is_nan()) {
        n += 1;
        a += p;
        b += q;
        aa += p * p;
        bb += q * q;
        ab += p * q;
    }
    let count = n as f64;
    let [va, vb] = [aa - a * a / count, bb - b * b / count];
    (n >= together && va > 1e-6 * count && vb > 1e-6 * count).then(|| (ab - a * b / count) / (va * vb).sqrt())
}

impl Stack {
    fn add(&mut self, other: &Self) {
        self.sums.resize(tried(), (0., 0));
        for (sum, more) in self.sums.iter_mut().zip(&other.sums) {
            *sum = (sum.0 + more.0, sum.1 + more.1);
        }
        self.pairs += other.pairs;
        self.deviations.extend(&other.deviations);
    }

    fn speed(&self, settings: &WaveSettings) -> Result<WaveSpeed, Missing> {
        let enough = (self.pairs as f64 * SEEN).max(1.);
        let mean = |(sum, pairs): &(f64, usize)| (*pairs as f64 >= enough).then(|| sum / *pairs as f64);
        let means: Vec<Option<f64>> = self.sums.iter().map(mean).collect();
        let known = || means.iter().enumerate().filter_map(|(i, mean)| Some((i, (*mean)?)));
        let best = known().max_by(|a, b| a.1.total_cmp(&b.1));
        let (Some((i, correlation)), Some(usual)) = (best, median(known().map(|(_, mean)| mean).collect())) else {
            return Err(Missing::TooShort { needed_s: settings.together_s });
        };
        let deviation = median(self.deviations.clone()).unwrap_or_default();
        if deviation < settings.least_deviation {
            return Err(Missing::Steady { deviation, needed: settings.least_deviation });
        }
        let prominence = correlation - usual;
        if correlation < settings.least_correlation || prominence < settings.least_prominence {
            return Err(Missing::Weak { correlation, prominence });
        }
        // A parabola through the best and its neighbours.
        let beside = [i.checked_sub(1).and_then(|i| means[i]), means.get(i + 1).copied().flatten()];
        let [Some(before), Some(after)] = beside else {
            return Err(Missing::OutOfRange { speed: 1. / slowness(i) });
        };
        let bend = before - 2. * correlation + after;
        let offset = if bend < 0. { (before - after) / (2. * bend) } else { 0. };
        let best = slowness(i) + SLOWNESS * offset.clamp(-1., 1.);
        if best < -1. / settings.fastest / 4. {
            return Err(Missing::Downstream { speed: -1. / best });
        }
        if best < 1. / settings.fastest {
            return Err(Missing::OutOfRange { speed: 1. / best });
        }
        Ok(WaveSpeed { speed: 1. / best, correlation, prominence, pairs: self.pairs })
    }
}
