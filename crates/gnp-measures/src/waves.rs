//! Stop-and-go waves: how fast they run upstream, how many there are, how deep.

use serde::{Deserialize, Serialize};

use crate::bins::Bins;
use crate::cells::CellSize;
use crate::error::{MeasureError, Missing};
use crate::robust::median;
use crate::traffic::Traffic;

/// Each place is compared with those so many places downstream of it, up to [`FARTHEST`]: near ones tell waves of short
/// periods from others, far ones tell the speed of long waves.
const APART: [usize; 9] = [1, 2, 3, 4, 6, 8, 12, 16, 24];
/// Distance of two places at most, m.
const FARTHEST: f64 = 500.;
/// Pairs of places of a lane at most; of a longer road an even choice of places.
const PAIRS: usize = 400;
/// Step of the slownesses (inverse speeds) that are tried, s/m; a tried one stands for a lag at every distance.
const SLOWNESS: f64 = 0.002;
/// Nothing slower than this is looked for, m/s: upstream, and downstream. Places are evenly apart, so that waves of period T
/// look as good at a slowness that differs by T over their distance; with places 20 m apart that is beyond these bounds
/// for periods above 17 s.
const SLOWEST: [f64; 2] = [2., 3.];
/// What runs downstream faster than any vehicle happens at once, m/s.
const FASTEST: f64 = 60.;

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
    /// Width of the moving mean that is subtracted, so that slow changes of the whole stretch are no wave, s.
    pub trend_s: f64,
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
    /// How far it must stand above the valleys that part it from other lags.
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
            trend_s: 240.,
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
            ("waves.trend_s", self.trend_s),
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
    /// How far that stands above the valleys that part it from other lags.
    pub prominence: f64,
    /// Greatest mean correlation at lags of patterns that travel with the traffic, as single vehicles do: where it is higher, there
    /// is more of these than of waves.
    pub with_traffic: f64,
    /// Pairs of places that are seen together long enough at the lag of every speed.
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
    /// Sum of correlations by slowness, from downstream to upstream.
    sums: Vec<f64>,
    pairs: usize,
    deviations: Vec<f64>,
}

impl Traffic<'_> {
    /// Waves of each lane of a carriageway, from left to right, and those of all of them last.
    ///
    /// The speed of small cells of one lane makes a series over time at each place. A wave that runs upstream is seen first
    /// downstream: every series is correlated with those of places downstream, up to 500 m, at every lag, and the upstream
    /// speed at which the mean correlation over the pairs has its highest peak is the wave's (the idea of correlating
    /// detectors; compare Cassidy and Windover 1995). A lag that only suits one
    /// distance, such as a whole period of the waves or a round of a ring, does not suit the others.
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
                (0..cells.x().count).map(|x| bridged(cells.speeds(plane, x), &settings)).collect();
            let series: Vec<Vec<f64>> =
                series.iter().map(|raw| moving_mean(raw, settings.smooth_s / settings.step_s)).collect();
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

/// Mean of the known values within `width` steps about each known one.
fn moving_mean(series: &[f64], width: f64) -> Vec<f64> {
    let half = (width / 2.) as usize;
    let (mut sum, mut known) = (vec![0.], vec![0usize]);
    for (i, value) in series.iter().enumerate() {
        sum.push(sum[i] + if value.is_nan() { 0. } else { *value });
        known.push(known[i] + usize::from(!value.is_nan()));
    }
    let mean = |i: usize| {
        let (from, to) = (i.saturating_sub(half), i.saturating_add(half + 1).min(series.len()));
        (sum[to] - sum[from]) / (known[to] - known[from]) as f64
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
    let mut stack = Stack { sums: vec![0.; tried()], ..Stack::default() };
    let known = series.iter().map(|s| s.iter().copied().filter(|v| !v.is_nan()).collect::<Vec<_>>());
    stack.deviations = known.filter_map(|known| moments(&known)).map(|[_, deviation]| deviation).collect();
    let together = (settings.together_s / settings.step_s).ceil().max(3.) as usize;
    let quick: Vec<Vec<f64>> = series.iter().map(|series| without_trend(series, settings)).collect();
    for up in (0..series.len()).step_by((series.len() * APART.len()).div_ceil(PAIRS).max(1)) {
        for by in APART {
            let down = if ring { (up + by) % series.len() } else { up + by };
            let distance = by as f64 * x.step;
            // On a ring the other way round must be farther.
            if down >= series.len() || (ring && by * 2 >= series.len()) || (by > 1 && distance > FARTHEST) {
                break;
            }
            let lag = |i: usize| distance * slowness(i) / settings.step_s;
            let first = lag(0).floor() as i64 - 1;
            let lags = first..=lag(tried() - 1).ceil() as i64 + 1;
            // A pair counts for every lag or for none: the nearer ones agree better, and would favour lags that only they have.
            let at_lag: Option<Vec<f64>> =
                lags.map(|lag| correlation(&quick[down], &quick[up], lag, together)).collect();
            let Some(at_lag) = at_lag else { continue };
            stack.pairs += 1;
            for (i, sum) in stack.sums.iter_mut().enumerate() {
                *sum += between_lags(&at_lag, lag(i) - first as f64);
            }
        }
    }
    stack
}

fn without_trend(series: &[f64], settings: &WaveSettings) -> Vec<f64> {
    let trend = moving_mean(series, settings.trend_s / settings.step_s);
    series.iter().zip(trend).map(|(value, trend)| value - trend).collect()
}

/// The correlation between two lags, on the cubic of Catmull and Rom; `lag` counts from the first, and two lags lie beyond it.
fn between_lags(at_lag: &[f64], lag: f64) -> f64 {
    let below = (lag as usize).clamp(1, at_lag.len().saturating_sub(3).max(1));
    let [Some(a), Some(b), Some(c), Some(d)] = [below - 1, below, below + 1, below + 2].map(|i| at_lag.get(i)) else {
        return 0.;
    };
    let t = lag - below as f64;
    b + t / 2. * (c - a + t * (2. * a - 5. * b + 4. * c - d + t * (3. * (b - c) + d - a)))
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
        self.sums.resize(tried(), 0.);
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, more)| *sum += more);
        self.pairs += other.pairs;
        self.deviations.extend(&other.deviations);
    }

    fn speed(&self, settings: &WaveSettings) -> Result<WaveSpeed, Missing> {
        let means: Vec<f64> = self.sums.iter().map(|sum| sum / self.pairs.max(1) as f64).collect();
        let greatest = |range: std::ops::Range<usize>| range.max_by(|a, b| means[*a].total_cmp(&means[*b]));
        // Where nothing changes there is no correlation either, hence first.
        if let Some(deviation) = median(self.deviations.clone()).filter(|found| *found < settings.least_deviation) {
            return Err(Missing::Steady { deviation, needed: settings.least_deviation });
        }
        let (Some(best), true) = (greatest(0..means.len()), self.pairs > 0) else {
            return Err(Missing::TooShort { needed_s: settings.together_s });
        };
        let first_above = |bound: f64| (0..means.len()).find(|i| slowness(*i) >= bound).unwrap_or(means.len());
        let (at_once, upstream) = (first_above(-1. / FASTEST), first_above(1. / settings.fastest));
        let peaks =
            (upstream.max(1)..means.len() - 1).filter(|i| means[*i] > means[i - 1] && means[*i] >= means[i + 1]);
        if let Some(peak) = peaks.max_by(|a, b| means[*a].total_cmp(&means[*b])) {
            let (correlation, prominence) = (means[peak], prominence(&means, peak));
            if correlation >= settings.least_correlation && prominence >= settings.least_prominence {
                // A parabola through the peak and its neighbours.
                let (before, after) = (means[peak - 1], means[peak + 1]);
                let bend = before - 2. * correlation + after;
                let offset = if bend < 0. { (before - after) / (2. * bend) } else { 0. };
                let speed = 1. / (slowness(peak) + SLOWNESS * offset);
                let with_traffic = greatest(0..at_once).map_or(0., |i| means[i]);
                return Ok(WaveSpeed { speed, correlation, prominence, with_traffic, pairs: self.pairs });
            }
        }
        let (correlation, prominence) = (means[best], prominence(&means, best));
        Err(if correlation < settings.least_correlation || prominence < settings.least_prominence {
            Missing::Weak { correlation, prominence }
        } else if best < at_once {
            Missing::Downstream { speed: -1. / slowness(best) }
        } else if best < upstream {
            Missing::AtOnce
        } else {
            Missing::OutOfRange { speed: 1. / slowness(best) }
        })
    }
}

/// Height of a peak over the valleys that part it from higher ones; on a side without a higher one, over the lowest there.
fn prominence(heights: &[f64], peak: usize) -> f64 {
    let lowest = |side: &mut dyn Iterator<Item = &f64>| {
        side.take_while(|height| **height <= heights[peak]).copied().fold(heights[peak], f64::min)
    };
    let sides = [lowest(&mut heights[..peak].iter().rev()), lowest(&mut heights[peak + 1..].iter())];
    heights[peak] - sides[0].max(sides[1])
}
