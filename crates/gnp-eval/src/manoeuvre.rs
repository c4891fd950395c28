//! What the recorded vehicle did while it was to be predicted: rows of a table by manoeuvre.
//!
//! Errors of lane changes and of braking drown in the many windows in which nothing happens. The
//! classes come from the recorded future alone, so every model is compared with the same windows:
//!
//! - **left**, **right**: the lane number at the last predicted frame differs from that at the last
//!   observed one, and the centre has moved at least [`CHANGE_M`] to that side. Lane numbers run
//!   one way in one data set and the other way in another, so the side is that of the motion. Where
//!   one of the two lanes is unknown the motion alone decides, from [`BARE_CHANGE_M`] on.
//! - **keep**: neither.
//! - **brake**: between some second of the predicted time and the next the mean speed along the road
//!   falls by at least [`BRAKE_MPS2`] times one second. It goes beside the other three: a window may
//!   count under keep and under brake.

use gnp_data::Window;
use serde::{Deserialize, Serialize};

/// Least motion to the side of a lane change, m: lanes of recordings flip where a vehicle drives on
/// the line between two.
pub const CHANGE_M: f32 = 1.;
/// Least motion to the side of a lane change where a lane is unknown, m: half a lane of 3.7 m.
pub const BARE_CHANGE_M: f32 = 1.85;
/// Least deceleration of braking, averaged over one second, m/s². Lifting the foot gives about 1.
pub const BRAKE_MPS2: f64 = 1.5;

/// What a vehicle did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Manoeuvre {
    /// Stayed in its lane.
    Keep,
    /// Changed lane to the left.
    Left,
    /// Changed lane to the right.
    Right,
    /// Braked, in whichever lane.
    Brake,
}

impl Manoeuvre {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Keep, Self::Left, Self::Right, Self::Brake];

    /// Name in score files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Keep => "keep",
            Self::Left => "left",
            Self::Right => "right",
            Self::Brake => "brake",
        }
    }

    /// What the target of a window did: one of keep, left and right, and perhaps brake.
    #[must_use]
    pub fn of(window: &Window<'_>) -> Vec<Self> {
        let (seen, truth) = (window.observation(), window.truth());
        let t_pred = seen.shape().t_pred;
        let states: Vec<_> = (0..t_pred).map(|j| truth.target(j)).collect();
        let end = states.last().copied().unwrap_or_default();
        let lanes = [seen.lane(), truth.lane(t_pred.saturating_sub(1))];
        let mut found = vec![sideways(lanes, end.y)];
        let along: Vec<f32> = std::iter::once(0.).chain(states.iter().map(|state| state.x)).collect();
        if brakes(&along, seen.shape().rate_hz) {
            found.push(Self::Brake);
        }
        found
    }
}

/// Keep, left or right, from the lanes now and at the end (0 where unknown) and the motion to the
/// left, m.
pub(crate) fn sideways([now, end]: [i16; 2], left_m: f32) -> Manoeuvre {
    let least = match (now, end) {
        (0, _) | (_, 0) => BARE_CHANGE_M,
        (now, end) if now == end => return Manoeuvre::Keep,
        _ => CHANGE_M,
    };
    if left_m >= least {
        Manoeuvre::Left
    } else if left_m <= -least {
        Manoeuvre::Right
    } else {
        Manoeuvre::Keep
    }
}

/// Whether the mean speed of some second lies [`BRAKE_MPS2`] below that of the second before.
/// Positions along the road by frame, the last observed one first, m.
fn brakes(along: &[f32], rate_hz: f64) -> bool {
    let second = (rate_hz.round() as usize).max(1);
    let seconds = second as f64 / rate_hz;
    let speed = |j: usize| f64::from(along[j + second] - along[j]) / seconds;
    let starts = along.len().saturating_sub(2 * second);
    (0..starts).any(|j| (speed(j) - speed(j + second)) / seconds >= BRAKE_MPS2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lane_change_needs_another_lane_and_motion() {
        use Manoeuvre::{Keep, Left, Right};
        for (lanes, left_m, expected) in [
            ([2, 2], 1.4, Keep),
            ([2, 3], 1.4, Left),
            ([3, 2], 1.4, Left), // numbers may run the other way
            ([2, 3], -3.6, Right),
            ([2, 3], 0.4, Keep), // drove on the line
            ([0, 3], 1.4, Keep),
            ([0, 3], 3.4, Left),
            ([2, 0], -3.4, Right),
            ([0, 0], -1.84, Keep),
        ] {
            assert_eq!(sideways(lanes, left_m), expected, "{lanes:?} {left_m}");
        }
    }

    /// A constant deceleration lowers the mean speed of each second by as much.
    #[test]
    fn braking_is_a_loss_of_speed_within_a_second() {
        let path = |deceleration: f32, rate: f32, from: f32| -> Vec<f32> {
            let x = |t: f32| 20. * t - deceleration * (t - from).max(0.).powi(2) / 2.;
            (0..=(5. * rate) as usize).map(|j| x(j as f32 / rate)).collect()
        };
        for rate in [10., 25., 2.] {
            assert!(brakes(&path(1.6, rate, 0.), f64::from(rate)), "{rate} Hz");
            assert!(!brakes(&path(1.4, rate, 0.), f64::from(rate)), "{rate} Hz");
            assert!(brakes(&path(4., rate, 3.), f64::from(rate)), "late, {rate} Hz");
            assert!(!brakes(&path(-3., rate, 0.), f64::from(rate)), "faster, {rate} Hz");
        }
        assert!(!brakes(&path(9., 10., 0.)[..20], 10.), "less than two seconds tell nothing");
    }

    #[test]
    fn names_are_those_of_score_files() {
        for manoeuvre in Manoeuvre::ALL {
            assert_eq!(serde_json::to_value(manoeuvre).unwrap(), manoeuvre.name());
        }
    }
}
