//! Whether a recorded lane change is among the predicted futures.
//!
//! A window has a lane change when the target is in another lane at the horizon by its recorded lane
//! numbers and lateral motion (as [`Manoeuvre`] has it), and the lines of the road put the two
//! places into different lanes. It **begins** at the last moment at which the centre is less than
//! [`BEGUN_M`] towards the new lane from where it was when last observed: a vehicle that swings and
//! comes back has not begun. It is **under way** where that much had been covered within the last
//! observed second ([`BEGUN_S`]). Where lines or the end's lane are not known nothing is counted.

use crate::case::ScoredWindow;
use crate::manoeuvre::{Manoeuvre, sideways};

/// Motion to the side with which a lane change has begun, m: vehicles wander by less within a lane in
/// a second, and one lane is 3.7 m wide.
pub const BEGUN_M: f32 = 0.3;
/// Time within which a lane change is to begin, and over which one under way is told from the past, s.
pub const BEGUN_S: f64 = 1.;

/// When a lane change begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Beginning {
    /// Before the last observed frame.
    Before,
    /// Within the first predicted second.
    FirstSecond,
}

/// 1 where one of the first `k` modes ends, after `frames` frames, in the lane in which the recorded
/// vehicle ends, else 0; `None` where there is no lane change that begins so.
pub(super) fn found(case: &ScoredWindow<'_>, k: usize, frames: usize, beginning: Beginning) -> Option<f64> {
    let reference = case.reference();
    let path = &reference.path()[..frames];
    let end = path.last()?[1];
    let left = match sideways(reference.lanes(frames), end) {
        Manoeuvre::Left => 1.,
        Manoeuvre::Right => -1.,
        Manoeuvre::Keep | Manoeuvre::Brake => return None,
    };
    let lane = lane_at(reference.lines(), end).filter(|lane| Some(*lane) != lane_at(reference.lines(), 0.))?;

    let second = ((BEGUN_S * reference.rate_hz()).round() as usize).max(1);
    let past = reference.past_y();
    let before = past.len().checked_sub(1 + second).and_then(|i| past.get(i)).or(past.first())?;
    let begins = if -before * left >= BEGUN_M {
        Some(Beginning::Before)
    } else {
        let away = |position: &[f32; 2]| position[1] * left >= BEGUN_M;
        let stays = path.get(second.min(frames) - 1..)?.iter().all(away);
        stays.then_some(Beginning::FirstSecond)
    };
    let ends_there = |mode: &gnp_data::Mode| lane_at(reference.lines(), mode.path[frames - 1][1]) == Some(lane);
    (begins == Some(beginning)).then(|| f64::from(u8::from(case.modes()[..k].iter().any(ends_there))))
}

/// Index of the lane between two lines (from right to left, m) in which a centre is; `None` beyond the
/// outermost.
fn lane_at(lines: &[f32], y: f32) -> Option<usize> {
    lines.windows(2).position(|line| line[0] <= y && y < line[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_centre_is_between_two_lines_or_in_no_lane() {
        let lines = [-5.5, -1.8, 1.9];
        let cases = [(-5.6, None), (-5.5, Some(0)), (-1.9, Some(0)), (-1.8, Some(1)), (0., Some(1)), (1.9, None)];
        for (y, lane) in cases {
            assert_eq!(lane_at(&lines, y), lane, "{y}");
        }
        assert_eq!(lane_at(&[0.3], 0.3), None);
        assert_eq!(lane_at(&[], 0.), None);
    }
}
