//! Cutting recordings into windows, and counting what did not become one.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::error::DataError;
use crate::recording::Recording;
use crate::window::{Window, WindowId};
use crate::window_shape::WindowShape;

/// How recordings are cut into windows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowConfig {
    /// Time from the first observed frame to the last one, s: 3.0 in the literature.
    pub observed_s: f64,
    /// Time from the last observed frame to the last predicted one, s: 5.0 in the literature.
    pub predicted_s: f64,
    /// Rate of the windows' frames, Hz: that of the recordings, or that divided by a whole number.
    pub rate_hz: f64,
    /// Time from one window of a track to the next, s.
    pub stride_s: f64,
    /// Another stride at single sites, such as `i-80`, s: so that a long recording does not drown
    /// short scenes.
    pub site_stride_s: BTreeMap<String, f64>,
}

impl WindowConfig {
    /// Every number but the strides of sites, which have the range of `stride_s`: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 4] = [
        // Nobody is predicted for more than minutes.
        ("observed_s", 1e-3, 600., "s"),
        ("predicted_s", 1e-3, 600., "s"),
        ("rate_hz", 1e-2, 1000., "Hz"),
        ("stride_s", 1e-3, 86_400., "s"),
    ];

    /// Checks each value by itself.
    ///
    /// # Errors
    /// When a time or the rate is out of its range, or a time is not a whole number of the windows' frames.
    pub fn check(&self) -> Result<(), DataError> {
        let within = |(_, least, most, unit): (&str, f64, f64, &str), key, value: f64| {
            let wrong = || bad_value(key, value, format!("give a number from {least} to {most} {unit}"));
            if (least..=most).contains(&value) { Ok(()) } else { Err(wrong()) }
        };
        let values = [self.observed_s, self.predicted_s, self.rate_hz, self.stride_s];
        Self::RANGES.into_iter().zip(values).try_for_each(|(range, value)| within(range, range.0, value))?;
        let [.., of_stride] = Self::RANGES;
        self.site_stride_s.values().try_for_each(|stride| within(of_stride, "site_stride_s", *stride))?;
        for (key, value) in [("observed_s", self.observed_s), ("predicted_s", self.predicted_s)] {
            frames(key, value, self.rate_hz)?;
        }
        Ok(())
    }

    /// The shape of windows cut from recordings of `recording_hz`.
    ///
    /// # Errors
    /// When the configuration is wrong in itself, or `rate_hz` is not `recording_hz` divided by a
    /// whole number.
    pub fn shape_for(&self, recording_hz: f64) -> Result<WindowShape, DataError> {
        self.check()?;
        let step = whole(recording_hz / self.rate_hz)
            .ok_or(DataError::WindowRate { recording_hz, window_hz: self.rate_hz })?;
        Ok(WindowShape {
            t_obs: frames("observed_s", self.observed_s, self.rate_hz)? + 1,
            t_pred: frames("predicted_s", self.predicted_s, self.rate_hz)?,
            step,
            rate_hz: self.rate_hz,
        })
    }

    /// What becomes of the candidate windows of one recording, none kept: a report on recordings
    /// that are read one at a time.
    ///
    /// # Errors
    /// As [`WindowConfig::shape_for`].
    pub fn count(&self, recording: &Recording) -> Result<RecordingDrops, DataError> {
        let rate_hz = recording.meta().rate_hz;
        let (shape, stride) = (self.shape_for(rate_hz)?, self.stride_for(&recording.meta().site, rate_hz)?);
        Ok(cut_recording(0, recording, shape, stride, &mut Vec::new()))
    }

    /// Recorded frames from one window of a track to the next.
    fn stride_for(&self, site: &str, recording_hz: f64) -> Result<usize, DataError> {
        match self.site_stride_s.get(site) {
            Some(stride) => frames("site_stride_s", *stride, recording_hz),
            None => frames("stride_s", self.stride_s, recording_hz),
        }
    }
}

/// Windows of several recordings, as 12-byte names of views: nothing else grows with their number.
#[derive(Clone, Debug)]
pub struct WindowSet<'a> {
    recordings: &'a [Recording],
    /// One a recording; they differ in `step` alone.
    shapes: Vec<WindowShape>,
    ids: Vec<WindowId>,
}

/// What became of the candidate windows, by recording, in the order of the recordings.
///
/// A candidate starts (first observed frame) in the first row of a track, and then every stride.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DropCounts {
    /// One entry a recording.
    pub recordings: Vec<RecordingDrops>,
}

/// Candidate windows of one recording: kept, and dropped by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingDrops {
    /// Name of the recording.
    pub recording: String,
    /// Starts that were tried; the sum of the next four.
    pub candidates: usize,
    /// Windows kept.
    pub windows: usize,
    /// Dropped: a gap in the vehicle's track lies in the window.
    pub gap: usize,
    /// Dropped: the whole track is shorter than a window.
    pub track_too_short: usize,
    /// Dropped: the track is long enough, but ends within a window that starts here.
    pub past_track_end: usize,
    /// Vehicles in the recording.
    pub vehicles: usize,
    /// Vehicles of which no window was kept.
    pub vehicles_without_window: usize,
}

impl<'a> WindowSet<'a> {
    /// Cuts every window of `recordings`, in the order of recordings, tracks and rows.
    ///
    /// # Errors
    /// When the configuration is wrong or does not suit a recording's rate, two recordings share a
    /// name, a recording has more rows than an id can hold, or no track is long enough for a window.
    pub fn cut(recordings: &'a [Recording], config: &WindowConfig) -> Result<(Self, DropCounts), DataError> {
        config.check()?;
        let mut set = Self { recordings, shapes: Vec::new(), ids: Vec::new() };
        let mut drops = DropCounts::default();
        let mut names = BTreeSet::new();
        for (index, recording) in recordings.iter().enumerate() {
            let meta = recording.meta();
            if !names.insert(&meta.name) {
                return Err(DataError::DuplicateRecording { recording: meta.name.clone() });
            }
            let shape = config.shape_for(meta.rate_hz)?;
            let stride = config.stride_for(&meta.site, meta.rate_hz)?;
            let index = narrow(index, &meta.name)?;
            narrow(recording.len(), &meta.name)?;
            drops.recordings.push(cut_recording(index, recording, shape, stride, &mut set.ids));
            set.shapes.push(shape);
        }
        if set.ids.is_empty() {
            return Err(DataError::NoWindow {
                needed_s: config.observed_s + config.predicted_s,
                longest_s: recordings.iter().map(longest_track_s).fold(0., f64::max),
            });
        }
        Ok((set, drops))
    }

    /// The recordings that the windows are views of.
    #[must_use]
    pub fn recordings(&self) -> &'a [Recording] {
        self.recordings
    }

    /// The recording of a window.
    #[must_use]
    pub fn recording(&self, id: WindowId) -> Option<&'a Recording> {
        self.recordings.get(id.recording as usize)
    }

    /// Shape of all windows. Where recordings differ in rate, `step` is that of the first one.
    #[must_use]
    pub fn shape(&self) -> WindowShape {
        self.shapes[0]
    }

    /// All windows, by recording, track and row.
    #[must_use]
    pub fn ids(&self) -> &[WindowId] {
        &self.ids
    }

    /// Number of windows; never 0.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // a set without windows is an error of `cut`
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// The window of that name; `None` when the recordings do not hold it, which no id of this set
    /// or of a split of it can bring about.
    #[must_use]
    pub fn get(&self, id: WindowId) -> Option<Window<'a>> {
        let recording = self.recording(id)?;
        let shape = self.shapes[id.recording as usize];
        Window::new(recording, shape, id.track as usize, id.row as usize).ok()
    }

    /// All windows, in the order of [`WindowSet::ids`].
    pub fn iter(&self) -> impl Iterator<Item = Window<'a>> {
        self.ids.iter().filter_map(|id| self.get(*id))
    }
}

impl DropCounts {
    /// Sums over all recordings; its name is empty.
    #[must_use]
    pub fn total(&self) -> RecordingDrops {
        let mut total = RecordingDrops::default();
        for drops in &self.recordings {
            total.candidates += drops.candidates;
            total.windows += drops.windows;
            total.gap += drops.gap;
            total.track_too_short += drops.track_too_short;
            total.past_track_end += drops.past_track_end;
            total.vehicles += drops.vehicles;
            total.vehicles_without_window += drops.vehicles_without_window;
        }
        total
    }
}

/// Appends the windows of one recording, whose rows are known to fit 32 bits.
fn cut_recording(
    index: u32,
    recording: &Recording,
    shape: WindowShape,
    stride: usize,
    ids: &mut Vec<WindowId>,
) -> RecordingDrops {
    let mut last_segment = BTreeMap::new();
    for track in recording.tracks() {
        let last = last_segment.entry(track.vehicle).or_insert(track.segment);
        *last = track.segment.max(*last);
    }
    let t_obs = (shape.t_obs - 1) * shape.step;
    let mut drops = RecordingDrops { recording: recording.meta().name.clone(), ..RecordingDrops::default() };
    let mut kept_of = BTreeSet::new();
    for (track_index, track) in recording.tracks().iter().enumerate() {
        let rows = &track.rows;
        for start in rows.clone().step_by(stride) {
            drops.candidates += 1;
            if start + shape.span() <= rows.end {
                ids.push(WindowId { recording: index, track: track_index as u32, row: (start + t_obs) as u32 });
                drops.windows += 1;
                kept_of.insert(track.vehicle);
            } else if last_segment.get(&track.vehicle).is_some_and(|last| track.segment < *last) {
                drops.gap += 1;
            } else if rows.len() < shape.span() {
                drops.track_too_short += 1;
            } else {
                drops.past_track_end += 1;
            }
        }
    }
    drops.vehicles = last_segment.len();
    drops.vehicles_without_window = drops.vehicles - kept_of.len();
    drops
}

/// Time from the first to the last row of the longest track, s.
fn longest_track_s(recording: &Recording) -> f64 {
    let rows = recording.tracks().iter().map(|track| track.rows.len()).max().unwrap_or(0);
    rows.saturating_sub(1) as f64 / recording.meta().rate_hz
}

/// `seconds` in frames of `rate_hz`; an error unless that is a whole number.
fn frames(key: &'static str, seconds: f64, rate_hz: f64) -> Result<usize, DataError> {
    whole(seconds * rate_hz).ok_or_else(|| {
        let frames = seconds * rate_hz;
        let mut near = [frames.floor(), frames.ceil()].map(|whole| format!("{:.4}", whole.max(1.) / rate_hz)).to_vec();
        near.dedup();
        bad_value(key, seconds, format!("is {frames:.3} frames at {rate_hz} Hz; take {}", near.join(" or ")))
    })
}

/// `value` as a whole number of at least 1, if it is one but for rounding.
fn whole(value: f64) -> Option<usize> {
    let rounded = value.round();
    let close = (value - rounded).abs() <= 1e-6 * rounded;
    (close && (1. ..1e9).contains(&rounded)).then_some(rounded as usize)
}

fn bad_value(key: &'static str, value: f64, problem: String) -> DataError {
    DataError::BadValue { key, value: value.to_string(), problem }
}

/// A count or index in the 32 bits of an id.
fn narrow(value: usize, recording: &str) -> Result<u32, DataError> {
    u32::try_from(value).map_err(|_| DataError::TooManyRows { recording: recording.to_owned(), rows: value })
}
