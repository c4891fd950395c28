//! The clock of a table: its rate, found from times, and frames.

use super::{TrackOptions, TrackTable};
use crate::error::{DataError, TrackProblem};
use crate::limits;
use crate::parts::MAX_FRAMES;
use crate::window_shape::same_rate;

/// How far a time may be off its frame, s.
pub(super) const TOLERANCE_S: f64 = 1e-3;

/// Times nearer than this are one moment, s.
const SAME_S: f64 = 1e-4;

/// Steps longer than this are of another unit, s.
const LONGEST_STEP_S: f64 = 5.;

/// Rate of tracks of a single moment, Hz, unless another one is asked for.
const RATE_OF_ONE_MOMENT: f64 = 10.;

/// Steps over a gap that take part in finding the rate, first roughly, then exactly.
const GAPS: [f64; 2] = [20., 2000.];

/// Frames of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Clock {
    /// Time of the table's first frame, s.
    first_s: f64,
    /// Frames per second of the table, Hz.
    table_hz: f64,
    /// Every how manieth frame is taken.
    stride: i64,
    /// Frame of the table that is taken first, below `stride`.
    phase: i64,
}

impl Clock {
    /// The clock of a table whose rows are `sorted` by vehicle and time.
    pub(super) fn of(table: &TrackTable, sorted: &[u32], options: &TrackOptions) -> Result<Self, DataError> {
        if let Some(rate_hz) = options.rate_hz.filter(|rate_hz| !limits::is_rate(*rate_hz)) {
            let (key, value, problem) = ("rate_hz", rate_hz.to_string(), "is no rate of recordings".to_owned());
            return Err(DataError::BadValue { key, value, problem });
        }
        let times = &table.time_s;
        let first_s = times.iter().copied().fold(f64::INFINITY, f64::min);
        let last_s = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let Some(step_s) = step(table, sorted) else {
            let table_hz = options.rate_hz.unwrap_or(RATE_OF_ONE_MOMENT);
            return Ok(Self { first_s: microseconds(first_s), table_hz, stride: 1, phase: 0 });
        };
        if step_s > LONGEST_STEP_S {
            let row = sorted.first().map(|row| *row as usize);
            let what = format!("rows of a vehicle are {step_s} s apart");
            let remedy =
                "times are in s; name the column `time_ms` if it is in ms, and give a row several times a second";
            return Err(table.wrong(TrackProblem::Unit, row, Some("time"), what, remedy));
        }
        if (last_s - first_s) / step_s > f64::from(MAX_FRAMES) {
            let far = |row: &usize| (times[*row] - first_s) / step_s > f64::from(MAX_FRAMES);
            let row = (0..times.len()).find(far);
            let what =
                format!("the time is more than {MAX_FRAMES} steps of {step_s} s after the first one, {first_s} s");
            let remedy = "repair it, or cut the tracks into several tables";
            return Err(table.wrong(TrackProblem::Time, row, Some("time"), what, remedy));
        }
        let clock = best(times, first_s, last_s, 1. / step_s);
        clock.check(table)?;
        clock.at(options.rate_hz, last_s)
    }

    /// Refuses times between frames.
    pub(super) fn check(&self, table: &TrackTable) -> Result<(), DataError> {
        let times = &table.time_s;
        let Some(row) = times.iter().position(|time| self.off_s(*time) > TOLERANCE_S) else { return Ok(()) };
        let off = times.iter().filter(|time| self.off_s(**time) > TOLERANCE_S).count();
        let what = format!(
            "the time {} s is {:.1} ms off a frame at {} Hz, and so are {} of {} rows",
            times[row],
            1e3 * self.off_s(times[row]),
            self.table_hz,
            off,
            times.len()
        );
        let remedy = "times must be uniform to 1 ms and the same for all vehicles; resample the tracks";
        Err(table.wrong(TrackProblem::Time, Some(row), Some("time"), what, remedy))
    }

    /// The same at the rate asked for, with the last frame.
    fn at(self, rate_hz: Option<f64>, last_s: f64) -> Result<Self, DataError> {
        let Some(rate_hz) = rate_hz else { return Ok(self) };
        let stride = (self.table_hz / rate_hz).round().max(1.);
        if !same_rate(self.table_hz, rate_hz * stride) {
            return Err(DataError::WindowRate { recording_hz: self.table_hz, window_hz: rate_hz });
        }
        let stride = stride as i64;
        Ok(Self { stride, phase: self.table_frame(last_s).rem_euclid(stride), ..self })
    }

    /// Frames per second of the recording, Hz.
    pub(super) fn rate_hz(&self) -> f64 {
        self.table_hz / self.stride as f64
    }

    /// Time of frame 0 of the recording, s.
    pub(super) fn start_s(&self) -> f64 {
        microseconds(self.first_s + self.phase as f64 / self.table_hz)
    }

    /// Frame of the recording at a time; `None` where it is left out.
    pub(super) fn frame(&self, time_s: f64) -> Option<u32> {
        let since = self.table_frame(time_s) - self.phase;
        (since % self.stride == 0).then(|| u32::try_from(since / self.stride).ok()).flatten()
    }

    fn table_frame(&self, time_s: f64) -> i64 {
        ((time_s - self.first_s) * self.table_hz).round() as i64
    }

    /// How far a time is off its frame, s.
    fn off_s(&self, time_s: f64) -> f64 {
        let exact = (time_s - self.first_s) * self.table_hz;
        (exact - exact.round()).abs() / self.table_hz
    }
}

/// Longest decimals that JSON gives back to the last bit.
fn microseconds(time_s: f64) -> f64 {
    (time_s * 1e6).round() / 1e6
}

/// Time between rows of a vehicle, s; `None` where no vehicle has two and there is one moment.
fn step(table: &TrackTable, sorted: &[u32]) -> Option<f64> {
    let times = &table.time_s;
    let of_vehicles = || {
        sorted.windows(2).filter_map(|pair| {
            let [a, b] = [pair[0] as usize, pair[1] as usize];
            let step = times[b] - times[a];
            (table.vehicle[a] == table.vehicle[b] && step > SAME_S).then_some(step)
        })
    };
    let mut steps: Vec<f64> = of_vehicles().collect();
    if steps.is_empty() {
        // Every vehicle is seen once.
        let mut moments = times.clone();
        moments.sort_unstable_by(f64::total_cmp);
        steps = moments.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > SAME_S).collect();
    }
    if steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let mut step = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Single steps are rounded as times are printed; many together are not.
    for most in GAPS {
        let (mut time, mut count) = (0., 0.);
        for found in &steps {
            let whole = (found / step).round();
            if (1. ..=most).contains(&whole) {
                time += found;
                count += whole;
            }
        }
        if count > 0. {
            step = time / count;
        }
    }
    Some(step)
}

/// The clock that most times fit, of a rate as clocks have and of the one measured.
fn best(times: &[f64], first_s: f64, last_s: f64, rate_hz: f64) -> Clock {
    let span = (last_s - first_s) * rate_hz;
    // Over the whole span a rate that is the same drifts by less than a third of a frame.
    let near = |candidate: &f64| *candidate > 0. && (candidate / rate_hz - 1.).abs() * span.max(1.) < 0.3;
    let nice = [rate_hz.round(), (1.001 * rate_hz).round() / 1.001, (10. * rate_hz).round() / 10.];
    let candidates = nice.into_iter().filter(near).chain([1. / (1. / rate_hz * 1e3).round() * 1e3]).filter(near);
    let clocks = candidates.chain([refined(times, first_s, rate_hz)]).map(|table_hz| {
        let clock = Clock { first_s, table_hz, stride: 1, phase: 0 };
        // The first time may be the one that is off.
        let mut off: Vec<f64> =
            times.iter().map(|time| (time - first_s) * table_hz).map(|exact| exact - exact.round()).collect();
        let middle = off.len() / 2;
        let shift = *off.select_nth_unstable_by(middle, f64::total_cmp).1 / table_hz;
        Clock { first_s: microseconds(first_s + shift), ..clock }
    });
    let count = |clock: &Clock| times.iter().filter(|time| clock.off_s(**time) > TOLERANCE_S).count();
    let fallback = Clock { first_s, table_hz: rate_hz, stride: 1, phase: 0 };
    let counted = clocks.map(|clock| (count(&clock), clock));
    counted.reduce(|best, other| if other.0 < best.0 { other } else { best }).map_or(fallback, |(_, clock)| clock)
}

/// The rate by which times and frames fit best in the mean, Hz.
fn refined(times: &[f64], first_s: f64, rate_hz: f64) -> f64 {
    let n = times.len() as f64;
    let frame = |time: &f64| ((time - first_s) * rate_hz).round();
    let (mean_f, mean_t) = times.iter().fold((0., 0.), |(f, t), time| (f + frame(time) / n, t + (time - first_s) / n));
    let (mut both, mut square) = (0., 0.);
    for time in times {
        let f = frame(time) - mean_f;
        both += f * (time - first_s - mean_t);
        square += f * f;
    }
    if both > 0. { square / both } else { rate_hz }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;

    fn table(times: &[f64]) -> TrackTable {
        let mut table = TrackTable::new(Dataset::TRACKS, "s", "n");
        table.set_names(times.iter().map(|_| "a"));
        (table.time_s, table.x, table.y) = (times.to_vec(), times.to_vec(), vec![0.; times.len()]);
        table
    }

    fn clock(times: &[f64], rate_hz: Option<f64>) -> Result<Clock, DataError> {
        let sorted: Vec<u32> = (0..times.len() as u32).collect();
        Clock::of(&table(times), &sorted, &TrackOptions { rate_hz, ..TrackOptions::default() })
    }

    /// Times of 3000 frames, with the rounding of their print.
    fn times(rate_hz: f64, from: f64, digits: f64) -> Vec<f64> {
        (0..3000).map(|i| ((from + f64::from(i) / rate_hz) * digits).round() / digits).collect()
    }

    #[test]
    fn the_rate_is_found_whatever_the_print_and_the_epoch() {
        for rate_hz in [10., 25., 30., 29.97002997002997, 12.5, 5., 2., 100., 59.94005994005994, 1.] {
            for from in [0., 17.3, 1_118_846_980.2] {
                let clock = clock(&times(rate_hz, from, 1e3), None).unwrap();
                assert!((clock.rate_hz() / rate_hz - 1.).abs() < 1e-9, "{rate_hz} Hz from {from} s: {clock:?}");
                assert!((clock.start_s() - from).abs() <= 1e-3, "{clock:?}");
                assert_eq!(clock.frame(from + 2999. / rate_hz), Some(2999), "{rate_hz}");
            }
        }
    }

    #[test]
    fn gaps_are_no_steps_and_the_last_frame_stays() {
        let gapped: Vec<f64> = times(10., 3., 1e3).into_iter().filter(|t| !(5.05..200.).contains(t)).collect();
        let clock = clock(&gapped, Some(2.5)).unwrap();
        assert_eq!((clock.rate_hz(), clock.frame(3.3), clock.frame(3.4), clock.frame(3.0)), (2.5, Some(0), None, None));
        assert_eq!(clock.frame(302.9), Some(749));
        assert_eq!(clock.start_s(), 3.3);
    }

    #[test]
    fn times_between_frames_are_named() {
        let mut jittered = times(10., 0., 1e3);
        jittered[7] += 0.02;
        let error = clock(&jittered, None).unwrap_err().to_string();
        assert!(error.contains("row 7, column `time`") && error.contains("20.0 ms off a frame at 10 Hz"), "{error}");
        assert!(error.contains("1 of 3000 rows"), "{error}");
        jittered[7] = 0.7;
        jittered[0] += 0.004;
        assert!(clock(&jittered, None).unwrap_err().to_string().contains("row 0"), "the first may be the one");
    }

    #[test]
    fn rates_that_cannot_be_had_are_refused() {
        let at = |rate_hz| clock(&times(25., 0., 1e3), Some(rate_hz));
        assert!(matches!(at(10.), Err(DataError::WindowRate { recording_hz: 25., window_hz: 10. })));
        assert!(matches!(at(50.), Err(DataError::WindowRate { .. })));
        assert!(matches!(at(0.), Err(DataError::BadValue { key: "rate_hz", .. })));
        assert_eq!(at(5.).unwrap().rate_hz(), 5.);
        let ms: Vec<f64> = times(10., 0., 1e3).into_iter().map(|t| 1e3 * t).collect();
        assert!(matches!(clock(&ms, None), Err(DataError::Tracks { problem: TrackProblem::Unit, .. })));
        assert_eq!(clock(&[4.; 3], None).unwrap().rate_hz(), RATE_OF_ONE_MOMENT);
    }
}
