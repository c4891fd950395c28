//! How likely what happened is among roll-outs: the estimator of Waymo's sim agents challenge.
use super::measured::{Measured, Moment};
use crate::replay::Scene;
use serde::Serialize;

/// Added to each bin.
const SMOOTHING: f64 = 0.1;
/// Added to each of two possibilities.
const YES_NO_SMOOTHING: f64 = 0.001;

/// What is looked at, in groups: speed, acceleration and lateral speed; gap, time to collision and contacts; lane changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Feature {
    /// 0 to 45 m/s, 30 bins.
    Speed,
    /// -8 to 8 m/s², 16 bins.
    Acceleration,
    /// -2 to 2 m/s, 11 bins.
    LateralSpeed,
    /// 0 to 100 m, 20 bins.
    Gap,
    /// 0 to 10 s, 10 bins; where the gap does not close, the last.
    TimeToCollision,
    /// Whether the vehicle touches another one.
    Contact,
    /// Whether the vehicle changes lanes.
    LaneChange,
}

impl Feature {
    /// All of them, in order.
    pub const ALL: [Self; 7] = [
        Self::Speed,
        Self::Acceleration,
        Self::LateralSpeed,
        Self::Gap,
        Self::TimeToCollision,
        Self::Contact,
        Self::LaneChange,
    ];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::LateralSpeed => "lateral speed",
            Self::Gap => "gap",
            Self::TimeToCollision => "TTC",
            Self::Contact => "contact",
            Self::LaneChange => "lane change",
        }
    }

    /// The number of its group, from 0.
    fn group(self) -> usize {
        match self {
            Self::Speed | Self::Acceleration | Self::LateralSpeed => 0,
            Self::Gap | Self::TimeToCollision | Self::Contact => 1,
            Self::LaneChange => 2,
        }
    }

    /// Range and bins; none for what is or is not.
    fn bins(self) -> Option<([f64; 2], usize)> {
        match self {
            Self::Speed => Some(([0.0, 45.0], 30)),
            Self::Acceleration => Some(([-8.0, 8.0], 16)),
            Self::LateralSpeed => Some(([-2.0, 2.0], 11)),
            Self::Gap => Some(([0.0, 100.0], 20)),
            Self::TimeToCollision => Some(([0.0, 10.0], 10)),
            Self::Contact | Self::LaneChange => None,
        }
    }

    fn value(self, moment: &Moment) -> Option<f64> {
        match self {
            Self::Speed => Some(moment.speed),
            Self::Acceleration => moment.acceleration,
            Self::LateralSpeed => Some(moment.lateral_speed),
            Self::Gap => moment.gap,
            Self::TimeToCollision => moment.ttc,
            Self::Contact | Self::LaneChange => None,
        }
    }

    /// Whether it is so for an actor of a course.
    fn holds(self, measured: &Measured, actor: usize) -> bool {
        match self {
            Self::Contact => measured.is_touched(actor),
            _ => measured.lane_changes[actor] > 0,
        }
    }
}

/// The score of a feature in a scene, 0 to 1; none where nothing of it is recorded, and for lane changes where nobody may
/// change lanes because the file has a sample of the traffic.
pub(super) fn score(feature: Feature, scene: &Scene, truth: &Measured, roll_outs: &[Measured]) -> Option<f64> {
    if feature == Feature::LaneChange && scene.is_a_sample {
        return None;
    }
    let scored = scene.actors.iter().enumerate().filter(|(_, actor)| actor.is_scored()).map(|(index, _)| index);
    let (mut sum, mut count) = (0.0, 0usize);
    for actor in scored {
        let Some((range, bins)) = feature.bins() else {
            let happened = feature.holds(truth, actor);
            let alike = roll_outs.iter().filter(|roll_out| feature.holds(roll_out, actor) == happened).count();
            sum += ((alike as f64 + YES_NO_SMOOTHING) / (roll_outs.len() as f64 + 2.0 * YES_NO_SMOOTHING)).ln();
            count += 1;
            continue;
        };
        let values = |measured: &Measured| -> Vec<usize> {
            let values = measured.moments[actor].iter().filter_map(|moment| feature.value(moment));
            values.map(|value| bin(value, range, bins)).collect()
        };
        let mut counts = vec![SMOOTHING; bins];
        for found in roll_outs.iter().flat_map(values) {
            counts[found] += 1.0;
        }
        let all: f64 = counts.iter().sum();
        for found in values(truth) {
            sum += (counts[found] / all).ln();
            count += 1;
        }
    }
    (count > 0).then(|| (sum / count as f64).exp())
}

/// The mean of the groups' means of the scores that there are, in the order of [`Feature::ALL`].
pub(super) fn whole(scores: &[Option<f64>]) -> Option<f64> {
    let mut groups = [(0.0, 0usize); 3];
    for (feature, score) in Feature::ALL.iter().zip(scores) {
        if let Some(score) = score {
            let group = &mut groups[feature.group()];
            *group = (group.0 + score, group.1 + 1);
        }
    }
    let means: Vec<f64> =
        groups.iter().filter(|(_, count)| *count > 0).map(|(sum, count)| sum / *count as f64).collect();
    (!means.is_empty()).then(|| means.iter().sum::<f64>() / means.len() as f64)
}

/// The bin of a value, held in the range.
fn bin(value: f64, [from, to]: [f64; 2], bins: usize) -> usize {
    let place = ((value - from) / (to - from) * bins as f64).clamp(0.0, (bins - 1) as f64);
    place as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_beyond_a_range_are_in_the_outermost_bins() {
        assert_eq!(
            [-3.0, 0.0, 4.9, 5.1, 99.0, f64::INFINITY].map(|value| bin(value, [0.0, 10.0], 2)),
            [0, 0, 0, 1, 1, 1]
        );
    }

    #[test]
    fn the_whole_is_the_mean_of_the_groups() {
        let scores = [Some(0.2), Some(0.4), None, Some(0.6), None, Some(0.8), Some(1.0)];
        assert!((whole(&scores).unwrap() - (0.3 + 0.7 + 1.0) / 3.0).abs() < 1e-12);
        assert_eq!(whole(&[None; 7]), None);
    }
}
