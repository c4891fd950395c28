//! Which vehicles are predicted at which moments of a recording, and their forecasts.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use gnp_data::{
    Account, Forecast, Observation, Past, PredictError, Predictor, Recording, Snapshot, Track, WindowShape,
};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, bail};

/// Windows that are predicted at once.
const BATCH: usize = 256;

/// At which moments of a recording vehicles are predicted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum At {
    /// In the last frame.
    Last,
    /// From the first frame on, so many seconds apart.
    Every(f64),
    /// At these times, s, on the clock of the tracks; the frame nearest to each.
    Times(Vec<f64>),
}

/// A text that is none of [`At`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{text:?} is no time: give `last`, `every`, or seconds such as 12.5 or 10,20,30")]
#[non_exhaustive]
pub struct AtError {
    /// The text.
    pub text: String,
}

impl At {
    /// Seconds between the moments of `every`, unless told otherwise.
    pub const EVERY_S: f64 = 1.;

    /// Refuses times that are none.
    pub(super) fn check(&self) -> Result<()> {
        match self {
            Self::Last => {}
            Self::Every(seconds) if seconds.is_finite() && *seconds > 0. => {}
            Self::Every(seconds) => bail!(Config, "every {seconds} s: give a number of seconds above 0"),
            Self::Times(times) if times.is_empty() => bail!(Config, "no time is asked for"),
            Self::Times(times) => {
                if let Some(bad) = times.iter().find(|time| !time.is_finite()) {
                    bail!(Config, "at {bad} s: give a number of seconds");
                }
            }
        }
        Ok(())
    }
}

impl FromStr for At {
    type Err = AtError;

    /// `last`, `every` (a second apart), or times in s, separated by commas.
    fn from_str(text: &str) -> Result<Self, AtError> {
        match text.trim() {
            "last" => Ok(Self::Last),
            "every" => Ok(Self::Every(Self::EVERY_S)),
            times => {
                let times: Option<Vec<f64>> = times.split(',').map(|time| time.trim().parse().ok()).collect();
                let times = times.filter(|times| times.iter().all(|time| time.is_finite()));
                times.map(Self::Times).ok_or_else(|| AtError { text: text.to_owned() })
            }
        }
    }
}

/// Why a vehicle at a moment, or a moment, has no forecast.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Unpredicted {
    /// The time is before the first frame of the recording or after its last one.
    OutsideRecording,
    /// No vehicle is there.
    NobodyThere,
    /// The vehicle was seen in one frame alone, and its velocity is not recorded.
    NoVelocity,
    /// The model gives numbers for it that are not finite.
    NotFinite,
}

impl fmt::Display for Unpredicted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OutsideRecording => "asked times outside of a recording",
            Self::NobodyThere => "moments without a vehicle",
            Self::NoVelocity => "vehicles seen for one frame alone, of unknown velocity",
            Self::NotFinite => "vehicles for which the model gives no finite path",
        })
    }
}

/// The moments of a recording at which vehicles are predicted; or of one of its parts.
#[derive(Clone, Debug)]
pub struct Asked {
    shape: WindowShape,
    frames: Vec<u32>,
    left_out: BTreeMap<Unpredicted, u64>,
}

/// A vehicle's forecast, and what it was made from.
#[derive(Clone, Debug)]
pub struct Forecasted<'a> {
    /// What was seen of it, at its moment.
    pub observation: Observation<'a>,
    /// Frame of the recording.
    pub frame: u32,
    /// How much of its past was seen.
    pub past: Past,
    /// For how long it was seen, s, up to what the model needs.
    pub observed_s: f64,
    /// The futures, the prediction first, in the frame of the window, m.
    pub forecast: Forecast,
}

impl Forecasted<'_> {
    /// A sentence on what moves the vehicle, by the names of the recording; `None` without an explanation.
    #[must_use]
    pub fn why(&self, recording: &Recording) -> Option<String> {
        let seen = &self.observation;
        let prediction = self.forecast.modes.first()?;
        let account = Account::of(seen.vehicle(), prediction, seen.shape().dt())?;
        Some(account.named_as_in(recording).sentence())
    }
}

/// The asked moments of a recording that comes in parts, in the order of time.
pub(crate) struct Moments<'a> {
    at: &'a At,
    shape: WindowShape,
    /// First frame of the recording, once there is one.
    first: Option<u32>,
    /// Asked times that were in a part.
    met: BTreeSet<usize>,
}

impl<'a> Moments<'a> {
    pub(crate) fn new(at: &'a At, shape: WindowShape) -> Self {
        Self { at, shape, first: None, met: BTreeSet::new() }
    }

    /// The moments in a part that holds the frames `asked`; `last` says that no other part follows.
    ///
    /// # Errors
    /// When the recording has neither the rate of the model nor a whole multiple of it.
    pub(crate) fn of(&mut self, recording: &Recording, asked: &Range<u32>, last: bool) -> Result<Asked> {
        let Some(shape) = self.shape.at_rate(recording.meta().rate_hz) else {
            return Err(wrong_rate(recording, self.shape));
        };
        let tracks = recording.tracks();
        let in_part = |track: &&Track| track.last_frame() >= asked.start && track.first_frame < asked.end;
        let there = tracks.iter().filter(in_part);
        let ends = there.fold(None, |ends: Option<[u32; 2]>, track| {
            let [first, last] = ends.unwrap_or([u32::MAX, 0]);
            let own = [track.first_frame.max(asked.start), track.last_frame().min(asked.end - 1)];
            Some([first.min(own[0]), last.max(own[1])])
        });
        let Some([first, end]) = ends else {
            return Ok(Asked { shape, frames: Vec::new(), left_out: BTreeMap::new() });
        };
        let from = *self.first.get_or_insert(first);
        let frames: Vec<u32> = match self.at {
            At::Last if last => vec![end],
            At::Last => Vec::new(),
            At::Every(seconds) => {
                let step = (seconds * recording.meta().rate_hz).round().clamp(1., f64::from(u32::MAX)) as usize;
                let skipped = (step - (first - from) as usize % step) % step;
                (first..=end).skip(skipped).step_by(step).collect()
            }
            At::Times(times) => {
                let mut frames = BTreeSet::new();
                for (i, time) in times.iter().enumerate() {
                    let frame = ((time - recording.meta().start_s) * recording.meta().rate_hz).round();
                    if (f64::from(first)..=f64::from(end)).contains(&frame) {
                        self.met.insert(i);
                        frames.insert(frame as u32);
                    }
                }
                frames.into_iter().collect()
            }
        };
        let (frames, nobody): (Vec<u32>, Vec<u32>) =
            frames.into_iter().partition(|frame| !recording.present(*frame).is_empty());
        Ok(Asked { shape, frames, left_out: counted(Unpredicted::NobodyThere, nobody.len()) })
    }

    /// Asked times that were in no part.
    pub(crate) fn outside(&self) -> BTreeMap<Unpredicted, u64> {
        let asked = if let At::Times(times) = self.at { times.len() } else { 0 };
        counted(Unpredicted::OutsideRecording, asked - self.met.len())
    }
}

fn counted(why: Unpredicted, count: usize) -> BTreeMap<Unpredicted, u64> {
    if count > 0 { BTreeMap::from([(why, count as u64)]) } else { BTreeMap::new() }
}

impl Asked {
    /// The moments of `at` in a whole recording, for a model of windows like `shape`.
    ///
    /// # Errors
    /// When the recording has neither the rate of the model nor a whole multiple of it.
    pub fn of(recording: &Recording, at: &At, shape: WindowShape) -> Result<Self> {
        let mut moments = Moments::new(at, shape);
        let mut asked = moments.of(recording, &(0..u32::MAX), true)?;
        asked.left_out.extend(moments.outside());
        Ok(asked)
    }

    /// The frames.
    #[must_use]
    pub fn frames(&self) -> &[u32] {
        &self.frames
    }

    /// How many vehicles are there at these moments, all together.
    #[must_use]
    pub fn vehicles(&self, recording: &Recording) -> usize {
        self.frames.iter().map(|frame| recording.present(*frame).len()).sum()
    }

    /// Moments that have no forecast, by reason.
    #[must_use]
    pub fn left_out(&self) -> &BTreeMap<Unpredicted, u64> {
        &self.left_out
    }

    /// The frames in pieces of at least `vehicles` vehicles each, but for the last one.
    pub(super) fn pieces(&self, recording: &Recording, vehicles: usize) -> Vec<Self> {
        let mut pieces = Vec::new();
        let (mut frames, mut count) = (Vec::new(), 0);
        for frame in &self.frames {
            frames.push(*frame);
            count += recording.present(*frame).len();
            if count >= vehicles {
                pieces.push(std::mem::take(&mut frames));
                count = 0;
            }
        }
        pieces.extend((!frames.is_empty()).then_some(frames));
        let piece = |frames| Self { shape: self.shape, frames, left_out: BTreeMap::new() };
        pieces.into_iter().map(piece).collect()
    }
}

/// Predicts every vehicle at the asked moments, by moment and then in the order of the recording's tracks, and hands each
/// forecast on. Returns why vehicles at a moment were not predicted, and moments.
///
/// Windows are predicted many at a time across moments; the last bits of a forecast depend on that, and so on
/// what is asked, never on threads.
///
/// # Errors
/// Those of the predictor and of `take`.
pub fn forecasts(
    predictor: &dyn Predictor,
    recording: &Recording,
    asked: &Asked,
    k: usize,
    mut take: impl FnMut(&Forecasted<'_>) -> Result<()>,
) -> Result<BTreeMap<Unpredicted, u64>> {
    let mut left_out = asked.left_out.clone();
    let mut snapshots: Vec<Snapshot> = Vec::new();
    let mut rest = &asked.frames[..];
    while !rest.is_empty() {
        // Some moments at once, so that batches are full.
        let (mut moments, mut vehicles) = (0, 0);
        while moments < rest.len() && vehicles < BATCH {
            let frame = rest[moments];
            vehicles += recording.present(frame).len();
            match snapshots.get_mut(moments) {
                Some(snapshot) => snapshot.take(recording, frame).map_err(gnp_data::DataError::from)?,
                None => snapshots.push(Snapshot::of(recording, frame, asked.shape).map_err(gnp_data::DataError::from)?),
            }
            moments += 1;
        }
        let (now, later) = rest.split_at(moments);
        rest = later;
        let mut seen = Vec::with_capacity(vehicles);
        for (snapshot, frame) in snapshots.iter().zip(now) {
            for vehicle in snapshot.vehicles() {
                match vehicle.observation() {
                    Some(observation) => seen.push((observation, *frame, vehicle.past())),
                    None => *left_out.entry(Unpredicted::NoVelocity).or_default() += 1,
                }
            }
        }
        for batch in seen.chunks(BATCH) {
            let observations: Vec<Observation<'_>> = batch.iter().map(|(observation, ..)| *observation).collect();
            for ((observation, frame, past), forecast) in batch.iter().zip(predicted(predictor, &observations, k)?) {
                let Some(forecast) = forecast else {
                    *left_out.entry(Unpredicted::NotFinite).or_default() += 1;
                    continue;
                };
                let shape = asked.shape;
                let observed_s = match past {
                    Past::Filled { observed_s } => *observed_s,
                    _ => shape.observed_s(),
                };
                let (observation, frame, past) = (*observation, *frame, *past);
                take(&Forecasted { observation, frame, past, observed_s, forecast })?;
            }
        }
    }
    Ok(left_out)
}

/// The forecasts of a batch; where it fails as a whole, of each vehicle that it does not fail for.
fn predicted(
    predictor: &dyn Predictor,
    observations: &[Observation<'_>],
    k: usize,
) -> Result<Vec<Option<Forecast>>, PredictError> {
    match predictor.predict(observations, k) {
        Ok(forecasts) => Ok(forecasts.into_iter().map(Some).collect()),
        Err(error @ PredictError::Shape { .. }) => Err(error),
        Err(error) => {
            let alone = |seen: &Observation<'_>| predictor.predict(&[*seen], k).ok().and_then(|mut all| all.pop());
            let forecasts: Vec<Option<Forecast>> = observations.iter().map(alone).collect();
            // Then it is not one of the vehicles.
            if forecasts.iter().all(Option::is_none) { Err(error) } else { Ok(forecasts) }
        }
    }
}

/// Says that a recording does not have the rate of a model's windows.
pub(crate) fn wrong_rate(recording: &Recording, shape: WindowShape) -> Error {
    let (name, found, needs) = (&recording.meta().name, recording.meta().rate_hz, shape.rate_hz);
    Error::Recordings(format!(
        "recording {name} has {found} Hz, which is no whole multiple of the model's {needs} Hz: resample the tracks, or take a \
         model of another rate (`gnp pipeline --set windows.rate_hz=...` trains one)"
    ))
}

/// First and last time of a recording on the clock of the tracks, s.
pub(crate) fn span_s(recording: &Recording) -> [f64; 2] {
    let tracks = recording.tracks();
    let first = tracks.iter().map(|track| track.first_frame).min().unwrap_or(0);
    let last = tracks.iter().map(|track| track.last_frame()).max().unwrap_or(0);
    [first, last].map(|frame| recording.meta().time_s(frame))
}

#[cfg(test)]
mod tests {
    use gnp_data::{Columns, Dataset, RecordingMeta, Road};

    use super::*;

    const SHAPE: WindowShape = WindowShape { t_obs: 11, t_pred: 10, step: 1, rate_hz: 10. };

    /// One vehicle in the frames 5 to 64 of 10 Hz, with a gap from 30 to 34; the clock begins at 100 s.
    fn recording(rate_hz: f64) -> Recording {
        let tracks = [(0, 5, 0..25), (1, 35, 25..55)].map(|(segment, first_frame, rows)| {
            let mut track = Track::new(1, [4., 2.], first_frame, rows);
            track.segment = segment;
            track
        });
        let count = 55;
        let columns = Columns {
            x: (0..count).map(|i| i as f32).collect(),
            y: vec![0.; count],
            vx: vec![10.; count],
            vy: vec![0.; count],
            lane: vec![0; count],
            neighbours: vec![[u32::MAX; 8]; count],
            named_leader: None,
        };
        let meta = RecordingMeta::new(Dataset::NGSIM, "a", "a", rate_hz).with_start(100.);
        let road = Road { driving_direction: 2, lines: Vec::new(), fitted: false, axis: None };
        Recording::from_parts(meta, vec![road], tracks.to_vec(), columns).unwrap()
    }

    /// The frames of the parts together, and how many times are in none.
    fn in_parts(at: &At, cuts: &[u32]) -> (Vec<u32>, usize, BTreeMap<Unpredicted, u64>) {
        let (recording, mut moments) = (recording(10.), Moments::new(at, SHAPE));
        let ends: Vec<u32> = cuts.iter().copied().chain([u32::MAX]).collect();
        let (mut frames, mut nobody, mut from) = (Vec::new(), 0, 0);
        for (i, end) in ends.iter().enumerate() {
            let asked = moments.of(&recording, &(from..*end), i + 1 == ends.len()).unwrap();
            nobody += asked.left_out.values().sum::<u64>() as usize;
            frames.extend(asked.frames);
            from = *end;
        }
        (frames, nobody, moments.outside())
    }

    #[test]
    fn moments_do_not_depend_on_how_a_recording_is_cut() {
        for (at, expected, nobody) in [
            (At::Last, vec![64], 0),
            (At::Every(0.9), vec![5, 14, 23, 41, 50, 59], 1),
            (At::Every(100.), vec![5], 0),
            (At::Times(vec![104.02, 101.5, 90., 107., 103.2]), vec![15, 40], 1),
        ] {
            for cuts in [&[][..], &[20], &[6, 21, 40, 41, 60]] {
                let (frames, left, outside) = in_parts(&at, cuts);
                assert_eq!((frames, left), (expected.clone(), nobody), "{at:?} {cuts:?}");
                let expected = if matches!(at, At::Times(_)) { 2 } else { 0 };
                assert_eq!(outside, counted(Unpredicted::OutsideRecording, expected), "{at:?} {cuts:?}");
            }
        }
    }

    #[test]
    fn whole_steps_are_taken_and_other_rates_refused() {
        let asked = Asked::of(&recording(30.), &At::Last, SHAPE).unwrap();
        assert_eq!((asked.shape.step, asked.shape.rate_hz), (3, 10.));
        for rate_hz in [5., 15., 25.] {
            let message = Asked::of(&recording(rate_hz), &At::Last, SHAPE).unwrap_err().to_string();
            assert!(message.contains(&format!("{rate_hz} Hz")) && message.contains("10 Hz"), "{message}");
        }
    }

    #[test]
    fn times_are_read() {
        for (text, expected) in [
            ("last", At::Last),
            ("every", At::Every(1.)),
            ("12.5", At::Times(vec![12.5])),
            (" -1, 2e3 ", At::Times(vec![-1., 2000.])),
        ] {
            assert_eq!(text.parse::<At>().unwrap(), expected);
        }
        for bad in ["", "soon", "1;2", "nan", "inf", "1,"] {
            assert!(bad.parse::<At>().is_err(), "{bad}");
        }
    }
}
