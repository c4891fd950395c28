//! One window's features for the goal network, before standardising.

use std::ops::Range;

use gnp_data::{LaneMarking, MarkingKind, TrackState, WindowShape};

use crate::augmented_view::{AugmentedNeighbour, AugmentedView};
use crate::features::{FeatureConfig, Representation};
use crate::following;
use crate::situation::Situation;

/// Farthest lane line that is an input of the goal network, m.
const LINE_REACH: f32 = 6.;

/// States by observed frame of the target, and of another vehicle.
#[derive(Debug, Default)]
pub(crate) struct SeenStates {
    own: Vec<TrackState>,
    other: Vec<Option<TrackState>>,
}

impl SeenStates {
    pub(crate) fn of_target(situation: &Situation<'_>) -> Self {
        let mut states = Self::default();
        states.take_target(situation);
        states
    }

    pub(crate) fn take_target(&mut self, situation: &Situation<'_>) {
        let seen = &situation.seen;
        self.own.clear();
        self.own.extend((0..seen.observation().shape().t_obs).map(|i| seen.target(i)));
    }
}

/// Appends the features of the target, before standardising.
pub(crate) fn observed_row(config: &FeatureConfig, situation: &Situation<'_>, states: &SeenStates, row: &mut Vec<f32>) {
    let (seen, velocity, own) = (&situation.seen, situation.velocity, &states.own);
    let shape = seen.observation().shape();
    for block in config.blocks(shape) {
        row.extend(mean(block, |i| {
            let state = own[i];
            let t = (shape.t_obs - 1 - i) as f32 * shape.dt() as f32;
            Some(match config.representation {
                Representation::Position => [state.x, state.y, state.vx, state.vy],
                Representation::Deviation => [
                    state.x + velocity[0] * t,
                    state.y + velocity[1] * t,
                    state.vx - velocity[0],
                    state.vy - velocity[1],
                ],
            })
        }));
    }
    if config.representation == Representation::Deviation {
        row.extend(velocity);
        row.extend(seen.observation().size());
        row.extend(nearest_lines(seen));
    }
    if config.car_following_features {
        row.extend(following::hint(situation, config.velocity_window_s));
    }
}

/// Mean over the frames of a block in which there is a value; zeros where there is none.
fn mean<const N: usize>(block: Range<usize>, value: impl Fn(usize) -> Option<[f32; N]>) -> [f32; N] {
    let (mut sum, mut count) = ([0f32; N], 0u16);
    for value in block.filter_map(value) {
        sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
        count += 1;
    }
    sum.map(|sum| sum / f32::from(count.max(1)))
}

/// Distance to the nearest line on the right and on the left, and whether each is a boundary.
fn nearest_lines(seen: &AugmentedView<'_>) -> [f32; 4] {
    let right = seen.lines().filter(|line| line.y <= 0.).last();
    let left = seen.lines().find(|line| line.y > 0.);
    let distance = |line: Option<LaneMarking>| line.map_or(LINE_REACH, |line| line.y.abs().min(LINE_REACH));
    let edge = |line: Option<LaneMarking>| f32::from(line.is_none_or(|line| line.kind == MarkingKind::Boundary));
    [distance(right), distance(left), edge(right), edge(left)]
}

pub(crate) fn neighbour_width(config: &FeatureConfig, shape: WindowShape) -> usize {
    let steps = config.blocks(shape).count();
    match config.representation {
        Representation::Position => 4 * steps,
        Representation::Deviation => 5 * steps + 2,
    }
}

/// Appends the features of another vehicle, before standardising; zeros in steps without it.
pub(crate) fn neighbour_row(
    config: &FeatureConfig,
    situation: &Situation<'_>,
    neighbour: &AugmentedNeighbour<'_>,
    states: &mut SeenStates,
    row: &mut Vec<f32>,
) {
    let (shape, velocity) = (situation.seen.observation().shape(), situation.velocity);
    let SeenStates { own, other: states } = states;
    states.clear();
    states.extend((0..shape.t_obs).map(|i| neighbour.state(i)));
    for block in config.blocks(shape) {
        match config.representation {
            Representation::Position => {
                row.extend(mean(block, |i| states[i].map(|state| [state.x, state.y, state.vx, state.vy])));
            }
            Representation::Deviation => {
                let frames = block.len() as f32;
                let present = block.clone().filter(|i| states[*i].is_some()).count() as f32;
                row.extend(mean(block, |i| {
                    let (state, own) = (states[i]?, own[i]);
                    Some([state.x - own.x, state.y - own.y, state.vx - velocity[0], state.vy - velocity[1]])
                }));
                row.push(present / frames);
            }
        }
    }
    if config.representation == Representation::Deviation {
        row.extend(neighbour.size());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_the_mean_of_the_frames_with_a_value() {
        let value = |i: usize| (i != 2).then_some([i as f32, -1.]);
        assert_eq!(mean(1..5, value), [(1. + 3. + 4.) / 3., -1.]);
        assert_eq!(mean(2..3, value), [0., 0.]);
    }
}
