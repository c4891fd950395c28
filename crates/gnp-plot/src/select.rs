//! Scenes found in the data by rule.

use gnp_data::{MarkingKind, Observation, Window};

/// Lateral way of a lane change, m.
const CHANGE: f32 = 2.5;
/// Lateral way up to which driving counts as straight, m.
const STRAIGHT: f32 = 0.6;
/// Vehicles nearer than this along the road are traffic, m.
const NEAR: f32 = 45.;

/// What a driver did in the predicted time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LateralManoeuvre {
    /// Stayed in the lane.
    Straight,
    /// Changed one or more lanes to the left.
    Left,
    /// Changed one or more lanes to the right.
    Right,
}

impl LateralManoeuvre {
    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Straight => "straight",
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// What happened in a window; `None` for what is neither straight nor a lane change begun and ended
/// within it.
#[must_use]
pub fn lateral_manoeuvre(window: &Window<'_>) -> Option<LateralManoeuvre> {
    let [_, y] = window.truth().goal();
    let (low, high) = (y.min(0.), y.max(0.));
    let crossed =
        window.observation().lines().any(|l| l.kind == MarkingKind::LaneDivider && l.y > low + 0.6 && l.y < high - 0.6);
    match y {
        _ if y.abs() < STRAIGHT && !crossed => Some(LateralManoeuvre::Straight),
        _ if y > CHANGE && crossed => Some(LateralManoeuvre::Left),
        _ if y < -CHANGE && crossed => Some(LateralManoeuvre::Right),
        _ => None,
    }
}

/// Kinds of scenes that show what the forces are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneRule {
    /// Straight on with the most vehicles within 45 m.
    StraightWithTraffic,
    /// A lane change with the most vehicles on the side it leads to.
    ChangeAgainstTraffic,
    /// A lane change with the fewest vehicles within 45 m.
    ChangeAlone,
}

impl SceneRule {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::StraightWithTraffic, Self::ChangeAgainstTraffic, Self::ChangeAlone];

    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::StraightWithTraffic => "straight with traffic",
            Self::ChangeAgainstTraffic => "lane change against traffic",
            Self::ChangeAlone => "lane change with the fewest around",
        }
    }

    /// How well a window fits, the most the best; `None` where it is of another kind.
    fn rank(self, window: &Window<'_>) -> Option<(i64, i64)> {
        let what = lateral_manoeuvre(window)?;
        let seen = window.observation();
        let near = near(&seen, |_| true);
        // Tracks near an end of the recording have few neighbours only because these were not recorded.
        let slow = i64::from(-(seen.target(seen.shape().t_obs - 1).vx.min(40.) as i32));
        match (self, what) {
            (Self::StraightWithTraffic, LateralManoeuvre::Straight) => Some((near, -slow)),
            (Self::ChangeAgainstTraffic, LateralManoeuvre::Left) => Some((self::near(&seen, |y| y > 1.), near)),
            (Self::ChangeAgainstTraffic, LateralManoeuvre::Right) => Some((self::near(&seen, |y| y < -1.), near)),
            (Self::ChangeAlone, LateralManoeuvre::Left | LateralManoeuvre::Right) => Some((-near, -slow)),
            _ => None,
        }
    }
}

/// Vehicles within 45 m along the road and two lanes, at a lateral offset that counts.
fn near(seen: &Observation<'_>, counts: impl Fn(f32) -> bool) -> i64 {
    seen.others().map(|other| other.now()).filter(|s| s.x.abs() < NEAR && s.y.abs() < 7.5 && counts(s.y)).count() as i64
}

/// Index of the window that fits a rule best; the first among equals.
#[must_use]
pub fn find_scene(rule: SceneRule, windows: &[Window<'_>]) -> Option<usize> {
    let ranked = windows.iter().enumerate().filter_map(|(i, window)| Some((rule.rank(window)?, i)));
    ranked.max_by(|a, b| a.0.cmp(&b.0).then(b.1.cmp(&a.1))).map(|(_, i)| i)
}

/// Indices of the items at the given shares of the ranking by `value`, each of another `group`: `[0.5]`
/// is the median. Fewer where there are not enough groups.
#[must_use]
pub fn quantiles<G: PartialEq>(items: &[(f64, G)], shares: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..items.len()).filter(|i| items[*i].0.is_finite()).collect();
    order.sort_by(|a, b| items[*a].0.total_cmp(&items[*b].0).then(a.cmp(b)));
    let mut found: Vec<usize> = Vec::new();
    for share in shares {
        let wanted = (share.clamp(0., 1.) * order.len().saturating_sub(1) as f64).round() as usize;
        let free = |at: &usize| {
            let group = &items[order[*at]].1;
            !found.iter().any(|i| items[*i].1 == *group)
        };
        let above = (wanted..order.len()).find(free);
        let below = (0..wanted.min(order.len())).rev().find(free);
        let nearest = match (above, below) {
            (Some(a), Some(b)) => Some(if a - wanted <= wanted - b { a } else { b }),
            (one, other) => one.or(other),
        };
        found.extend(nearest.map(|at| order[at]));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_different_groups() {
        let items: Vec<(f64, usize)> = [5., 1., 3., 2., 4., f64::NAN].into_iter().zip([0, 1, 2, 2, 4, 5]).collect();
        assert_eq!(quantiles(&items, &[0., 1.]), [1, 0]);
        // Item 2 is the median; item 3 is of its group, so that the next is 1 or 4.
        assert_eq!(quantiles(&items, &[0.5, 0.5]), [2, 4]);
        assert_eq!(quantiles::<usize>(&[], &[0.5]), [0usize; 0]);
        assert_eq!(quantiles(&[(1., 7), (2., 7)], &[0., 1.]), [0]);
    }
}
