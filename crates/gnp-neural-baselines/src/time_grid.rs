//! From the windows' frames to the 5 Hz of the published networks, and back.

use gnp_data::WindowShape;

use crate::error::NeuralBaselineError;

/// Rate of the published networks, Hz (Deo and Trivedi 2018: every second frame of NGSIM).
pub(crate) const RATE_HZ: f64 = 5.;

/// Which frames of a window the networks see and predict.
///
/// Observed frames are counted back from the last one, so that the last point is always the last
/// observed frame: 16 points of a 3 s past, 25 of a 5 s future.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TimeGrid {
    t_obs: usize,
    t_pred: usize,
    every: usize,
}

impl TimeGrid {
    /// The points in windows of `shape`.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Windows`] when the windows' rate is no multiple of 5 Hz, the future is no
    /// whole number of points, or the past has fewer than three.
    pub(crate) fn new(shape: WindowShape) -> Result<Self, NeuralBaselineError> {
        let ratio = shape.rate_hz / RATE_HZ;
        let every = ratio.round();
        let refuse = |problem: String| Err(NeuralBaselineError::Windows { problem });
        if !(every >= 1. && (ratio - every).abs() < 1e-6) {
            return refuse(format!("{} Hz is no multiple of {RATE_HZ} Hz; set another `rate_hz`", shape.rate_hz));
        }
        let clock = Self { t_obs: shape.t_obs, t_pred: shape.t_pred, every: every as usize };
        if clock.past() < 3 {
            return refuse(format!("{} points of past at {RATE_HZ} Hz are fewer than 3; observe longer", clock.past()));
        }
        if shape.t_pred == 0 || !shape.t_pred.is_multiple_of(clock.every) {
            return refuse(format!("{} predicted frames are no whole number of points", shape.t_pred));
        }
        Ok(clock)
    }

    /// Points of the past, the last observed frame among them: 16 of 3 s.
    #[must_use]
    pub(crate) fn past(self) -> usize {
        (self.t_obs.saturating_sub(1)) / self.every + 1
    }

    /// Points of the future: 25 of 5 s.
    #[must_use]
    pub(crate) fn future(self) -> usize {
        self.t_pred / self.every
    }

    /// Observed frame of point `k` of the past, oldest first.
    #[must_use]
    pub(crate) fn observed_frame(self, k: usize) -> usize {
        self.t_obs - 1 - (self.past() - 1 - k) * self.every
    }

    /// Predicted frame of point `k` of the future.
    #[must_use]
    pub(crate) fn predicted_frame(self, k: usize) -> usize {
        (k + 1) * self.every - 1
    }

    /// Positions in every predicted frame, from `points` `[future][2]` and the origin at the last
    /// observed frame, linear in time between them.
    #[must_use]
    pub(crate) fn to_frames(self, points: &[[f32; 2]]) -> Vec<[f32; 2]> {
        let at = |k: usize| if k == 0 { [0.; 2] } else { points.get(k - 1).copied().unwrap_or_default() };
        let frame = |j: usize| {
            let (before, part) = (j / self.every, (j % self.every) as f32 / self.every as f32);
            if part == 0. {
                return at(before);
            }
            let (from, to) = (at(before), at(before + 1));
            [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * part)
        };
        (1..=self.t_pred).map(frame).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(t_obs: usize, t_pred: usize, rate_hz: f64) -> WindowShape {
        WindowShape { t_obs, t_pred, step: 1, rate_hz }
    }

    #[test]
    fn ten_hertz_gives_every_second_frame_and_ends_at_the_last() {
        let clock = TimeGrid::new(shape(31, 50, 10.)).unwrap();
        assert_eq!((clock.past(), clock.future()), (16, 25));
        assert_eq!((clock.observed_frame(0), clock.observed_frame(15)), (0, 30));
        assert_eq!((clock.predicted_frame(0), clock.predicted_frame(24)), (1, 49));
        // One frame less of past: one point less, still ending at the last frame.
        let clock = TimeGrid::new(shape(30, 50, 10.)).unwrap();
        assert_eq!((clock.past(), clock.observed_frame(0), clock.observed_frame(14)), (15, 1, 29));
    }

    #[test]
    fn frames_between_points_lie_on_the_line_between_them() {
        let clock = TimeGrid::new(shape(31, 4, 10.)).unwrap();
        assert_eq!(clock.to_frames(&[[2., -4.], [6., 0.]]), [[1., -2.], [2., -4.], [4., -2.], [6., 0.]]);
        let clock = TimeGrid::new(shape(16, 2, 5.)).unwrap();
        assert_eq!(clock.to_frames(&[[2., -4.], [6., 0.]]), [[2., -4.], [6., 0.]]);
    }

    #[test]
    fn windows_that_have_no_such_points_are_refused() {
        for (bad, word) in
            [(shape(31, 50, 12.), "12 Hz"), (shape(31, 49, 10.), "49"), (shape(3, 50, 10.), "fewer than 3")]
        {
            let message = TimeGrid::new(bad).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
