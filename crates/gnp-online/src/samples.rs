//! The last samples of a vehicle, and where it was in between.

use std::collections::VecDeque;

use gnp_data::limits::MAX_SPEED;

/// A vehicle may be this much farther from where it was than the greatest speed takes it, m: noise of the measurement.
const JUMP: f64 = 5.;

/// A velocity that is not measured is that of the positions in the last of this time, s.
const COAST_FROM_S: f64 = 0.5;

/// Times are the same if they differ by no more than this, s, or by the rounding of large ones.
const SAME_TIME_S: f64 = 1e-9;

/// A vehicle at a time, road frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// s
    pub(crate) time_s: f64,
    /// m
    pub(crate) position: [f64; 2],
    /// m/s
    pub(crate) velocity: Option<[f32; 2]>,
}

/// What samples are kept.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Keeping {
    /// Time before the last sample, s.
    pub(crate) span_s: f64,
    /// Least time between two samples but the last, s.
    pub(crate) spacing_s: f64,
}

impl Keeping {
    /// Most samples that are kept.
    pub(crate) fn most(&self) -> usize {
        (self.span_s / self.spacing_s).ceil() as usize + 4
    }
}

/// Samples in order of time, the last one the newest.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    kept: VecDeque<Sample>,
}

/// Where a vehicle was at regular times, from the earliest; its memory is used again.
#[derive(Debug, Default)]
pub(crate) struct Grid {
    /// m
    pub(crate) positions: Vec<[f32; 2]>,
    /// m/s, where they are measured.
    pub(crate) velocities: Vec<Option<[f32; 2]>>,
}

/// Largest difference between two times that are the same, s.
pub(crate) fn rounding(time_s: f64) -> f64 {
    SAME_TIME_S.max(4. * f64::EPSILON * time_s.abs())
}

fn mix<const N: usize>(a: [f64; N], b: [f64; N], share: f64) -> [f64; N] {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share)
}

impl Samples {
    /// Room for what is kept, so that adding allocates nothing.
    pub(crate) fn reserve(&mut self, keeping: &Keeping) {
        self.kept.reserve(keeping.most());
    }

    pub(crate) fn clear(&mut self) {
        self.kept.clear();
    }

    pub(crate) fn last(&self) -> Option<&Sample> {
        self.kept.back()
    }

    /// Adds a sample later than the last one. One to where no vehicle gets from there begins anew.
    pub(crate) fn add(&mut self, sample: Sample, keeping: &Keeping) {
        let count = self.kept.len();
        if count >= 2 && self.kept[count - 1].time_s - self.kept[count - 2].time_s < keeping.spacing_s * (1. - 1e-6) {
            self.kept.pop_back();
        }
        if let Some(last) = self.kept.back() {
            let [dx, dy] = [0, 1].map(|i| sample.position[i] - last.position[i]);
            if dx.hypot(dy) > f64::from(MAX_SPEED) * (sample.time_s - last.time_s) + JUMP {
                self.kept.clear();
            }
        }
        self.kept.push_back(sample);
        // One sample before the span is needed to know where it was at its beginning.
        let begin = sample.time_s - keeping.span_s;
        while self.kept.len() > keeping.most() || self.kept.get(1).is_some_and(|second| second.time_s <= begin) {
            self.kept.pop_front();
        }
    }

    /// Where it is at `time_s`, which is not before its last sample: going on at its velocity. `None` where that is not known.
    pub(crate) fn at(&self, time_s: f64) -> Option<Sample> {
        let last = *self.kept.back()?;
        if time_s - last.time_s <= rounding(time_s) {
            return Some(last);
        }
        let [vx, vy] = last.velocity.map(|v| v.map(f64::from)).or_else(|| self.velocity())?;
        let ahead = time_s - last.time_s;
        let position = [last.position[0] + vx * ahead, last.position[1] + vy * ahead];
        Some(Sample { time_s, position, ..last })
    }

    /// Velocity by the last positions, m/s.
    fn velocity(&self) -> Option<[f64; 2]> {
        let last = self.kept.back()?;
        let near = |sample: &&Sample| last.time_s - sample.time_s <= COAST_FROM_S;
        let earlier = self.kept.iter().rev().skip(1);
        // A single one may be older.
        let from = earlier.clone().take_while(near).last().or_else(|| earlier.clone().next())?;
        let time = last.time_s - from.time_s;
        Some([0, 1].map(|i| (last.position[i] - from.position[i]) / time))
    }

    /// Puts into `grid` where it was at `now.time_s` and each `period_s` before, at most `frames` times, as far back as
    /// it was seen. `now` is its last sample, or where it is by now. Returns the largest time between two of the samples
    /// in that span, s.
    pub(crate) fn onto(&self, grid: &mut Grid, now: Sample, period_s: f64, frames: usize) -> f64 {
        let Grid { positions, velocities } = grid;
        positions.clear();
        velocities.clear();
        let mut earlier = self.kept.iter().rev().copied().skip_while(|sample| sample.time_s >= now.time_s);
        let (mut after, mut before) = (now, earlier.next());
        let (same, mut gap_s) = (rounding(now.time_s), 0f64);
        for back in 0..frames {
            let time_s = now.time_s - back as f64 * period_s;
            // The nearest samples on both sides of the time.
            while let Some(sample) = before.filter(|sample| time_s < sample.time_s - same) {
                gap_s = gap_s.max(after.time_s - sample.time_s);
                (after, before) = (sample, earlier.next());
            }
            let (position, velocity) = match before {
                _ if (after.time_s - time_s).abs() <= same => (after.position, after.velocity),
                None => break,
                Some(sample) if (sample.time_s - time_s).abs() <= same => (sample.position, sample.velocity),
                Some(sample) => {
                    let share = (time_s - sample.time_s) / (after.time_s - sample.time_s);
                    let velocity = sample
                        .velocity
                        .zip(after.velocity)
                        .map(|(a, b)| mix(a.map(f64::from), b.map(f64::from), share).map(|value| value as f32));
                    gap_s = gap_s.max(after.time_s - sample.time_s);
                    (mix(sample.position, after.position, share), velocity)
                }
            };
            positions.push(position.map(|value| value as f32));
            velocities.push(velocity);
        }
        positions.reverse();
        velocities.reverse();
        gap_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEEPING: Keeping = Keeping { span_s: 1., spacing_s: 0.05 };

    fn at(time_s: f64, x: f64) -> Sample {
        Sample { time_s, position: [x, 0.], velocity: None }
    }

    fn samples(times: impl IntoIterator<Item = f64>, speed: f64) -> Samples {
        let mut samples = Samples::default();
        times.into_iter().for_each(|time_s| samples.add(at(time_s, speed * time_s), &KEEPING));
        samples
    }

    fn grid(samples: &Samples, time_s: f64, frames: usize) -> (Vec<f32>, f64) {
        let mut grid = Grid::default();
        let gap_s = samples.onto(&mut grid, samples.at(time_s).unwrap(), 0.1, frames);
        (grid.positions.iter().map(|position| position[0]).collect(), gap_s)
    }

    #[test]
    fn samples_on_the_times_are_taken_as_they_are() {
        let mut samples = Samples::default();
        let places = [0.1f32, 0.7, 0.2, 9.9];
        for (i, place) in places.iter().enumerate() {
            samples.add(at(1.7e9 + 0.1 * i as f64, f64::from(*place)), &KEEPING);
        }
        let (found, gap_s) = grid(&samples, 1.7e9 + 0.3, 5);
        assert_eq!(found, places, "and no more than there are");
        assert!((gap_s - 0.1).abs() < 1e-5);
    }

    #[test]
    fn between_samples_it_moves_evenly() {
        let samples = samples([0., 0.13, 0.18, 0.31], 10.);
        let (found, gap_s) = grid(&samples, 0.31, 9);
        let expected = [0.1, 1.1, 2.1, 3.1];
        assert!(found.len() == 4 && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        assert!((gap_s - 0.13).abs() < 1e-9, "{gap_s}");
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let many = samples((0..100_000).map(|i| f64::from(i) * 1e-3), 10.);
        assert!(many.kept.len() <= KEEPING.most(), "{}", many.kept.len());
        let (found, _) = grid(&many, 99.999, 11);
        assert_eq!(found.len(), 11);
        assert!(found.iter().enumerate().all(|(i, x)| (x - (999.99 - 1. * (10 - i) as f32)).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_missing_vehicle_goes_on() {
        let samples = samples([0., 0.1, 0.2], 10.);
        assert!((samples.at(0.5).unwrap().position[0] - 5.).abs() < 1e-9);
        let (found, gap_s) = grid(&samples, 0.5, 3);
        assert!((gap_s - 0.3).abs() < 1e-9 && (found[0] - 3.).abs() < 1e-6, "{found:?} {gap_s}");
        let mut once = Samples::default();
        once.add(at(0., 3.), &KEEPING);
        assert!(once.at(0.1).is_none() && once.at(0.).is_some());
        let mut measured = Samples::default();
        measured.add(Sample { velocity: Some([20., 0.]), ..at(0., 3.) }, &KEEPING);
        assert!((measured.at(0.1).unwrap().position[0] - 5.).abs() < 1e-6);
    }

    #[test]
    fn who_jumps_begins_anew() {
        let mut samples = samples([0., 0.1, 0.2], 10.);
        samples.add(at(0.3, 30.), &KEEPING);
        assert_eq!(samples.kept.len(), 1);
    }
}
