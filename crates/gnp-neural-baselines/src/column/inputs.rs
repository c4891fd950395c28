//! What the column network sees of a window, along the road.

use gnp_data::{Observation, TrackState, WindowShape};

/// Leaders that are seen.
const LEADERS: usize = 3;
/// Stretches of the past over which speeds are seen: the target's own, and each leader's.
const BLOCKS: [usize; 2] = [6, 4];
/// Length of such a stretch, s.
const BLOCK_S: f64 = 0.5;
/// Time over which the present speed is estimated, s.
const SPEED_SPAN_S: f64 = 0.8;
/// A larger gap counts as this one, m.
const FARTHEST_M: f64 = 80.;
/// Unit of gaps, m.
const GAP_UNIT_M: f64 = 20.;
/// Unit of displacements, m.
pub(super) const UNIT_M: f64 = 5.;

/// The predicted frames that the network is asked for: after every whole second, and the last one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Horizons(pub(super) Vec<usize>);

impl Horizons {
    /// Those of windows of `shape`, counted from 1.
    pub(super) fn of(shape: WindowShape) -> Self {
        let second = (shape.rate_hz.round() as usize).max(1);
        let mut steps: Vec<usize> = (second..=shape.t_pred).step_by(second).collect();
        if steps.last() != Some(&shape.t_pred) {
            steps.push(shape.t_pred);
        }
        Self(steps)
    }

    /// Values in every step of a smooth curve, at rest at 0 in the beginning, that passes through `values` at these
    /// steps: cubic between them, with the slope of its neighbours in each.
    pub(super) fn curve(&self, values: &[f64]) -> Vec<f64> {
        let knots: Vec<(f64, f64)> = std::iter::once((0., 0.))
            .chain(self.0.iter().map(|step| *step as f64).zip(values.iter().copied()))
            .collect();
        let slope = |i: usize| {
            let (before, after) = (knots[i - 1], knots[(i + 1).min(knots.len() - 1)]);
            (after.1 - before.1) / (after.0 - before.0)
        };
        let mut path = Vec::with_capacity(self.0.last().copied().unwrap_or_default());
        for (i, pair) in knots.windows(2).enumerate() {
            let ((t0, v0), (t1, v1)) = (pair[0], pair[1]);
            let length = t1 - t0;
            let (m0, m1) = (if i == 0 { 0. } else { slope(i) * length }, slope(i + 1) * length);
            for step in t0 as usize + 1..=t1 as usize {
                let u = (step as f64 - t0) / length;
                let bend = v0 + m0 * u + (3. * (v1 - v0) - 2. * m0 - m1) * u * u;
                path.push(bend + (2. * (v0 - v1) + m0 + m1) * u.powi(3));
            }
        }
        path
    }
}

/// Width of [`Seen::row`] for so many horizons.
pub(super) fn width(horizons: &Horizons) -> usize {
    1 + BLOCKS[0] + LEADERS * (3 + BLOCKS[1]) + horizons.0.len()
}

/// A window as the network sees it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    /// Own speed; own speeds over the past 3 s relative to it, latest first; of each leader presence, gap, relative
    /// speed and its speeds over the past 2 s relative to its own; how far the platoon gets ahead of constant velocity.
    pub(super) row: Vec<f32>,
    /// How far constant velocity gets ahead of the platoon at each horizon, m.
    pub(super) ahead: Vec<f64>,
}

impl Seen {
    /// The window of `observation`, whose target the platoon takes along `platoon`, m.
    pub(super) fn of(observation: &Observation<'_>, platoon: &[[f32; 2]], horizons: &Horizons) -> Self {
        let shape = observation.shape();
        let span = periods(SPEED_SPAN_S, shape);
        let own = latest_first(shape.t_obs, |i| Some(observation.target(i)));
        let speed = speed(&own[..own.len().min(span + 1)], shape.dt()).unwrap_or_default().max(0.);
        let mut row = vec![speed];
        row.extend(speeds(&own, speed, BLOCKS[0], shape));
        let mut behind = (0., f64::from(observation.size()[0]), speed);
        for leader in observation.column().take(LEADERS) {
            let past = latest_first(shape.t_obs, |i| leader.state(i));
            let (x, length) = (f64::from(leader.now().x), f64::from(leader.size()[0]));
            let now = self::speed(&past[..past.len().min(span + 1)], shape.dt()).map_or(behind.2, |now| now.max(0.));
            let gap = x - behind.0 - (length + behind.1) / 2.;
            row.extend([1., gap.min(FARTHEST_M) / GAP_UNIT_M, now - speed]);
            row.extend(speeds(&past, now, BLOCKS[1], shape));
            behind = (x, length, now);
        }
        row.resize(width(horizons) - horizons.0.len(), 0.);
        let reach = |step: usize| platoon.get(step - 1).map_or(0., |point| f64::from(point[0]));
        let ahead: Vec<f64> = horizons.0.iter().map(|step| speed * *step as f64 * shape.dt() - reach(*step)).collect();
        row.extend(ahead.iter().map(|ahead| -ahead / UNIT_M));
        Self { row: row.into_iter().map(|value| value as f32).collect(), ahead }
    }
}

fn periods(seconds: f64, shape: WindowShape) -> usize {
    ((seconds * shape.rate_hz).round() as usize).max(1)
}

/// Positions back from the last observed frame for as long as the vehicle was there, m.
fn latest_first(t_obs: usize, state: impl Fn(usize) -> Option<TrackState>) -> Vec<f64> {
    (0..t_obs).rev().map_while(state).map(|state| f64::from(state.x)).collect()
}

/// Slope of the straight line through positions, m/s; `None` for fewer than two.
fn speed(latest_first: &[f64], dt: f64) -> Option<f64> {
    let middle = latest_first.len().checked_sub(2)? as f64 / 2. + 0.5;
    let time = |i: usize| middle - i as f64;
    let moment: f64 = latest_first.iter().enumerate().map(|(i, x)| time(i) * x).sum();
    let squares: f64 = (0..latest_first.len()).map(|i| time(i).powi(2)).sum();
    Some(moment / (squares * dt))
}

/// Speeds over `count` stretches of the past relative to `now`, latest first; 0 where the vehicle was not there, m/s.
fn speeds(latest_first: &[f64], now: f64, count: usize, shape: WindowShape) -> impl Iterator<Item = f64> {
    let length = periods(BLOCK_S, shape);
    (0..count).map(move |block| {
        let stretch = latest_first.get(block * length..=(block + 1) * length);
        stretch.and_then(|stretch| speed(stretch, shape.dt())).map_or(0., |speed| speed - now)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: WindowShape = WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };

    #[test]
    fn a_curve_passes_through_its_points_and_begins_at_rest() {
        let horizons = Horizons::of(SHAPE);
        assert_eq!(horizons.0, [10, 20, 30, 40, 50]);
        let values = [0.2, 0.9, 2.5, 2., 4.];
        let path = horizons.curve(&values);
        assert_eq!(path.len(), 50);
        for (step, value) in horizons.0.iter().zip(values) {
            assert!((path[step - 1] - value).abs() < 1e-12, "{step}");
        }
        assert!(path[0].abs() < 0.01, "{}", path[0]);
        // Nothing jumps: speeds next to each other are alike, also across the points.
        let speeds: Vec<f64> = path.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(speeds.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.1), "{speeds:?}");
        // A parabola from rest is kept where both neighbours of a point are known.
        let squares: Vec<f64> = horizons.0.iter().map(|step| (*step as f64 / 10.).powi(2)).collect();
        let path = horizons.curve(&squares);
        assert!((path[24] - 6.25).abs() < 1e-12, "{}", path[24]);
    }

    #[test]
    fn the_last_frame_is_asked_for_also_within_a_second() {
        assert_eq!(Horizons::of(WindowShape { t_pred: 24, ..SHAPE }).0, [10, 20, 24]);
        assert_eq!(Horizons::of(WindowShape { t_pred: 7, ..SHAPE }).0, [7]);
    }

    #[test]
    fn speeds_are_slopes_and_relative_to_the_present_one() {
        // 20 m/s until 0.5 s ago, 10 m/s since.
        let positions: Vec<f64> =
            (0..31).map(|i| if i <= 5 { -f64::from(i) } else { 5. - 2. * f64::from(i) }).collect();
        assert!((speed(&positions[..6], 0.1).unwrap() - 10.).abs() < 1e-12);
        assert_eq!(speed(&positions[..1], 0.1), None);
        let found: Vec<f64> = speeds(&positions, 10., 6, SHAPE).collect();
        for (found, expected) in found.iter().zip([0., 10., 10., 10., 10., 10.]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        // Who was there for 1.2 s has two stretches.
        let found: Vec<f64> = speeds(&positions[..13], 10., 4, SHAPE).collect();
        assert!((found[1] - 10.).abs() < 1e-12 && found[2..] == [0., 0.], "{found:?}");
    }
}
