//! The shape of a window, and why a recording does not hold a window.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

/// The shape of a window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowShape {
    /// Observed frames, the last one included: a full 3 s is 31 at 10 Hz.
    pub t_obs: usize,
    /// Predicted frames: 5 s is 50 at 10 Hz.
    pub t_pred: usize,
    /// Recorded frames from one frame of a window to the next: explicit resampling by whole steps.
    pub step: usize,
    /// Rate of the window's frames in Hz: that of the recording divided by `step`.
    pub rate_hz: f64,
}

impl WindowShape {
    /// A shape of `t_obs` and `t_pred` frames at `rate_hz`, each `step` recorded frames apart.
    ///
    /// # Errors
    /// [`WindowError::Shape`] when a count is 0 or the rate is not positive.
    pub fn new(t_obs: usize, t_pred: usize, step: usize, rate_hz: f64) -> Result<Self, WindowError> {
        let shape = Self { t_obs, t_pred, step, rate_hz };
        shape.check().map(|()| shape)
    }

    /// As [`WindowShape::new`]: the fields can be set to anything.
    pub(crate) fn check(&self) -> Result<(), WindowError> {
        let positive = self.rate_hz.is_finite() && self.rate_hz > 0.;
        let whole = self.t_obs > 0 && self.t_pred > 0 && self.step > 0;
        if positive && whole { Ok(()) } else { Err(WindowError::Shape { shape: *self }) }
    }

    /// The same windows in a recording of another rate, by whole steps; `None` where that rate is no whole multiple of the
    /// windows'.
    #[must_use]
    pub fn at_rate(&self, recording_hz: f64) -> Option<Self> {
        let step = (recording_hz / self.rate_hz).round();
        let whole = step >= 1. && same_rate(recording_hz, self.rate_hz * step);
        whole.then_some(Self { step: step as usize, ..*self })
    }

    /// Time from the first observed frame to the last one, s.
    #[must_use]
    pub fn observed_s(&self) -> f64 {
        self.t_obs.saturating_sub(1) as f64 / self.rate_hz
    }

    /// Period of the window's frames, s.
    #[must_use]
    pub fn dt(&self) -> f64 {
        1. / self.rate_hz
    }

    /// Recorded frames from the first observed frame to the last predicted one, both included.
    #[must_use]
    pub fn span(&self) -> usize {
        (self.t_obs.saturating_sub(1) + self.t_pred) * self.step + 1
    }

    /// Whether windows of both shapes look alike to a model: same frames at the same rate. The
    /// step may differ, since recordings of 25 and 50 Hz both give windows of 25 Hz.
    ///
    /// This is the one place that decides it.
    #[must_use]
    pub fn fits(&self, other: &Self) -> bool {
        self.t_obs == other.t_obs && self.t_pred == other.t_pred && same_rate(self.rate_hz, other.rate_hz)
    }
}

/// Whether two rates are the same but for rounding.
pub(crate) fn same_rate(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs()
}

impl fmt::Display for WindowShape {
    /// As in `31 + 50 frames at 10 Hz`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} + {} frames at {} Hz", self.t_obs, self.t_pred, self.rate_hz)
    }
}

/// Why a recording does not hold the window that was asked for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WindowError {
    /// A shape that no window has.
    #[error(
        "a window cannot have {shape}, {} recorded frames apart; each count must be 1 or more, the rate positive",
        shape.step
    )]
    Shape {
        /// The shape.
        shape: WindowShape,
    },
    /// Frames of the recording, taken every `step`, do not have the window's rate.
    #[error(
        "every {}. frame of a recording of {recording_hz} Hz is not a window of {} Hz; take the rate and the step \
         that WindowConfig::shape_for({recording_hz}) gives", shape.step, shape.rate_hz
    )]
    Rate {
        /// Rate of the recording, Hz.
        recording_hz: f64,
        /// Shape of the window.
        shape: WindowShape,
    },
    /// No such track.
    #[error("the recording has {tracks} tracks, none of them is number {track}")]
    NoTrack {
        /// Index asked for.
        track: usize,
        /// Tracks of the recording.
        tracks: usize,
    },
    /// The row belongs to another track, or to none.
    #[error("row {row} is not one of vehicle {vehicle}, whose track has the rows {rows:?}")]
    NoRow {
        /// Row asked for.
        row: usize,
        /// Vehicle of the track.
        vehicle: u32,
        /// Rows of the track.
        rows: Range<usize>,
    },
    /// The vehicle was not there long enough.
    #[error("vehicle {vehicle} was there for {found} recorded frames up to this one, {needed} are needed")]
    TooShort {
        /// Vehicle.
        vehicle: u32,
        /// Recorded frames up to the last observed one.
        found: usize,
        /// Recorded frames that the observed ones span.
        needed: usize,
    },
    /// The vehicle was absent for a frame or more.
    #[error("vehicle {vehicle} has a gap {found} recorded frames back, {needed} without a gap are needed")]
    Gap {
        /// Vehicle.
        vehicle: u32,
        /// Recorded frames since the gap, the last observed one included.
        found: usize,
        /// Recorded frames that the observed ones span.
        needed: usize,
    },
    /// Predicted frames are not recorded.
    #[error("vehicle {vehicle} is recorded for {found} frames after the last observed one, {needed} are needed")]
    NoFuture {
        /// Vehicle.
        vehicle: u32,
        /// Recorded frames after the last observed one.
        found: usize,
        /// Recorded frames that the predicted ones span.
        needed: usize,
    },
    /// A target of a single row, whose velocity is not recorded.
    #[error("the velocity of vehicle {vehicle} is not known in its first row; record it or take a later row")]
    NoVelocity {
        /// Vehicle.
        vehicle: u32,
    },
}
