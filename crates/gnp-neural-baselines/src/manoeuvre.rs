//! Manoeuvre classes of a window: labels for training, never an input of a prediction.

use gnp_data::{LaneMarking, TrackState, Window};

use crate::grid::lanes_to_left;
use crate::time_grid::TimeGrid;

/// Lateral classes: keep, left, right.
pub(crate) const LATERAL: usize = 3;

/// What the target does over the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Manoeuvre {
    /// Keep (0), left (1), right (2).
    pub(crate) lateral: usize,
    /// Normal (0), brake (1), accelerate (2).
    pub(crate) longitudinal: usize,
}

impl Manoeuvre {
    /// The classes of a recorded window.
    ///
    /// Lateral: the lane at the last observed frame against those 4 s later and, as far as the window
    /// reaches, 4 s earlier; right is tested first. Longitudinal: the mean speed of the future against that of the
    /// past, below 0.8 of it or above 1.25 (Deo and Trivedi 2018; the third class Chen et al. 2022).
    #[must_use]
    pub(crate) fn of(window: &Window<'_>, clock: TimeGrid) -> Self {
        let (observation, truth) = (window.observation(), window.truth());
        let shape = observation.shape();
        let lines: Vec<LaneMarking> = observation.lines().collect();
        let lane = |state: TrackState| lanes_to_left(&lines, state.y);
        let back = (4. * shape.rate_hz).round() as usize;
        let before = lane(observation.target((shape.t_obs - 1).saturating_sub(back)));
        let after = lane(truth.target(back.min(shape.t_pred).saturating_sub(1)));
        let first = observation.target(clock.observed_frame(0));
        let past = -first.x / ((clock.past() - 1) as f32 / crate::time_grid::RATE_HZ as f32);
        let last = truth.target(shape.t_pred - 1);
        let future = last.x / (clock.future() as f32 / crate::time_grid::RATE_HZ as f32);
        Self { lateral: lateral(before, after), longitudinal: longitudinal(past, future) }
    }

    /// Longitudinal class among `classes`: with two, to accelerate is normal.
    #[must_use]
    pub(crate) fn longitudinal_of(self, classes: usize) -> usize {
        if self.longitudinal < classes { self.longitudinal } else { 0 }
    }
}

/// From the lanes before and after, counted to the left from the one at the last observed frame.
fn lateral(before: i32, after: i32) -> usize {
    if after < 0 || before > 0 {
        2
    } else if after > 0 || before < 0 {
        1
    } else {
        0
    }
}

/// From mean speeds, m/s. Who stood still and stands still is normal.
fn longitudinal(past: f32, future: f32) -> usize {
    const STANDING: f32 = 0.1;
    match (past < STANDING, future < STANDING) {
        (true, true) => 0,
        (true, false) => 2,
        _ if future < 0.8 * past => 1,
        _ if future > 1.25 * past => 2,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_follow_lanes_and_speeds() {
        assert_eq!(
            [(0, 0), (0, 1), (0, -1), (-1, 0), (1, 0), (-1, -1)].map(|(b, a)| lateral(b, a)),
            [0, 1, 2, 1, 2, 2]
        );
        let speeds = [(0., 0.), (0., 3.), (10., 0.), (10., 7.9), (10., 8.1), (10., 12.4), (10., 12.6)];
        assert_eq!(speeds.map(|(past, future)| longitudinal(past, future)), [0, 2, 1, 1, 0, 0, 2]);
        assert_eq!(Manoeuvre { lateral: 0, longitudinal: 2 }.longitudinal_of(2), 0);
        assert_eq!(Manoeuvre { lateral: 0, longitudinal: 2 }.longitudinal_of(3), 2);
    }
}
