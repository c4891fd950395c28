//! What PiP reads of windows: targets around an ego vehicle, the vehicles around each of them, and
//! the ego's plan.

use candle_core::{Device, Result, Tensor};
use gnp_data::{Neighbour, Observation, TrackState, Truth};

use crate::grid::{Grid, PLACE_CELLS, PLACE_CENTRE, by_place, place_cell};
use crate::inputs::{Inputs, by_time};
use crate::oriented_view::{OrientedView, Variation};

/// Where the ego's plan comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plan {
    /// Nowhere: the network takes none.
    None,
    /// Its velocity over the last 0.8 s goes on.
    Constant,
    /// What it really did.
    Recorded,
}

/// Windows as PiP sees them. Each window is a scene of its own: its target is predicted, other targets
/// around the same ego are context.
///
/// A point of a path comes with the points before and after it (zero beyond the ends), by axis: what a
/// convolution of three points along the path reads.
#[derive(Clone, Debug)]
pub(crate) struct Scenes {
    /// Number of windows.
    pub(crate) windows: usize,
    /// Paths of all targets, each relative to its own last point, `[points, targets, 6]`.
    pub(crate) targets: Tensor,
    /// Which of them is the target of each window.
    pub(crate) scored: Vec<u32>,
    /// Cell of each target in its ego's grid, `125 * window + cell`.
    pub(crate) target_cells: Vec<u32>,
    /// Paths of the vehicles around each target, relative to it at the same time, `[points, occupied, 6]`.
    pub(crate) neighbours: Tensor,
    /// Their cells, `125 * target + cell`.
    pub(crate) cells: Vec<u32>,
    /// The ego's plan relative to each target that has the ego in its grid, last point first,
    /// `[points, plans, 6]`.
    pub(crate) plans: Tensor,
    /// The ego's cells there, `125 * target + cell`.
    pub(crate) plan_cells: Vec<u32>,
    /// Windows in which nobody can be the ego.
    pub(crate) without_ego: usize,
}

/// One target of a scene, and where its ego is.
struct Target<'a> {
    observation: Observation<'a>,
    cell: usize,
}

/// The ego of a window: the nearest vehicle in the target's grid, then the one with the smaller id; with a
/// recorded plan, the nearest one whose whole future is recorded.
fn ego<'a>(grid: &Grid<'a>, truth: Option<&Truth<'_>>, last: usize, along: f32) -> Option<Neighbour<'a>> {
    let lasting = |n: &Neighbour<'a>| truth.is_none_or(|truth| truth.other(n, last).is_some());
    let distance = |n: &Neighbour<'_>| (n.now().x * along).hypot(n.now().y);
    grid.occupants.iter().map(|occupant| occupant.neighbour).filter(lasting).min_by(|a, b| {
        let near = distance(a).total_cmp(&distance(b));
        near.then(a.vehicle().cmp(&b.vehicle()))
    })
}

/// The window's target first, then the nearest of the other vehicles in the ego's grid.
fn targets<'a>(observation: &Observation<'a>, ego: Option<&Neighbour<'a>>, most: usize, along: f32) -> Vec<Target<'a>> {
    let alone = || vec![Target { observation: *observation, cell: PLACE_CENTRE }];
    let Some(around) = ego.and_then(Neighbour::observation) else { return alone() };
    let Some(at) = ego.map(Neighbour::now) else { return alone() };
    // On the very edge of a cell the two grids may disagree about who is inside.
    let cell = place_cell([-at.x * along, -at.y]).unwrap_or(PLACE_CENTRE);
    let mut all = vec![Target { observation: *observation, cell }];
    let mut others = by_place(&around, along).occupants;
    others.retain(|other| other.neighbour.track_index() != observation.track_index() && other.cell != cell);
    let distance = |n: &Neighbour<'_>| (n.now().x * along).hypot(n.now().y);
    others.sort_by(|a, b| distance(&a.neighbour).total_cmp(&distance(&b.neighbour)).then(a.cell.cmp(&b.cell)));
    let context = others
        .iter()
        .filter_map(|other| Some(Target { observation: other.neighbour.observation()?, cell: other.cell }));
    all.extend(context.take(most.saturating_sub(1)));
    all
}

/// The ego's plan in the window's frame, m, first point first.
fn plan(inputs: &Inputs, ego: &Neighbour<'_>, truth: Option<&Truth<'_>>) -> Vec<TrackState> {
    let (clock, points) = (inputs.clock, inputs.clock.future());
    if let Some(truth) = truth {
        return (0..points).map(|k| truth.other(ego, clock.predicted_frame(k)).unwrap_or_default()).collect();
    }
    let steps = 4.min(clock.past() - 1);
    let state = |k: usize| ego.state(clock.observed_frame(k)).unwrap_or_default();
    let (before, now) = (state(clock.past() - 1 - steps), state(clock.past() - 1));
    let time = |k: usize| (k + 1) as f32 / steps as f32;
    let ahead = |k: usize| TrackState {
        x: now.x + (now.x - before.x) * time(k),
        y: now.y + (now.y - before.y) * time(k),
        ..TrackState::default()
    };
    (0..points).map(ahead).collect()
}

/// Each point with its neighbours along the path: x of three, then y of three.
fn with_neighbours(path: &[[f32; 2]]) -> Vec<[f32; 6]> {
    let at = |k: Option<usize>, axis: usize| k.and_then(|k| path.get(k)).map_or(0., |point| point[axis]);
    let point = |k: usize| {
        let of = |axis| [at(k.checked_sub(1), axis), at(Some(k), axis), at(Some(k + 1), axis)];
        let ([a, b, c], [d, e, f]) = (of(0), of(1));
        [a, b, c, d, e, f]
    };
    (0..path.len()).map(point).collect()
}

impl Scenes {
    /// Scenes of `windows` with at most `most` targets each. `truths` are read for
    /// [`Plan::Recorded`] alone.
    pub(crate) fn new(
        inputs: &Inputs,
        windows: &[OrientedView<'_>],
        source: Plan,
        truths: Option<&[Truth<'_>]>,
        most: usize,
        device: &Device,
    ) -> Result<Self> {
        let truths = match (source, truths) {
            (Plan::Recorded, None) => candle_core::bail!("a recorded plan needs recorded futures"),
            (Plan::Recorded, truths) => truths,
            _ => None,
        };
        let (mut target_paths, mut scored, mut target_cells) = (Vec::new(), Vec::new(), Vec::new());
        let (mut neighbour_paths, mut cells) = (Vec::new(), Vec::new());
        let (mut plans, mut plan_cells) = (Vec::new(), Vec::new());
        let mut without_ego = 0;
        for (b, OrientedView { observation, variation }) in windows.iter().enumerate() {
            let variation = *variation;
            let Variation { along, .. } = variation;
            let truth = truths.and_then(|truths| truths.get(b));
            let last = observation.shape().t_pred.saturating_sub(1);
            let ego = ego(&by_place(observation, along), truth, last, along);
            without_ego += usize::from(ego.is_none());
            let planned = ego.as_ref().map(|ego| plan(inputs, ego, truth)).unwrap_or_default();
            scored.push(target_paths.len() as u32);
            for Target { observation: target, cell } in targets(observation, ego.as_ref(), most, along) {
                let n = target_paths.len();
                target_cells.push((PLACE_CELLS * b + variation.place_cell(cell)) as u32);
                let path = inputs.target(&OrientedView { observation: target, variation });
                for occupant in by_place(&target, along).occupants {
                    let mut other = inputs.neighbour(&occupant.neighbour, variation);
                    for (other, own) in other.iter_mut().zip(&path) {
                        *other = [other[0] - own[0], other[1] - own[1]];
                    }
                    neighbour_paths.push(with_neighbours(&other));
                    cells.push((PLACE_CELLS * n + variation.place_cell(occupant.cell)) as u32);
                }
                target_paths.push(with_neighbours(&path));
                let (from, to) = (observation.origin(), target.origin());
                let moved = |state: TrackState| TrackState {
                    x: state.x + from[0] - to[0],
                    y: state.y + from[1] - to[1],
                    ..state
                };
                let cell = ego.as_ref().map(|ego| moved(ego.now())).and_then(|now| place_cell([now.x * along, now.y]));
                if let Some(cell) = cell.filter(|_| source != Plan::None) {
                    let reversed: Vec<[f32; 2]> =
                        planned.iter().rev().map(|state| inputs.point(variation.turn(moved(*state)))).collect();
                    plans.push(with_neighbours(&reversed));
                    plan_cells.push((PLACE_CELLS * n + variation.place_cell(cell)) as u32);
                }
            }
        }
        let past = inputs.clock.past();
        Ok(Self {
            windows: windows.len(),
            targets: by_time(&target_paths, past, device)?,
            scored,
            target_cells,
            neighbours: by_time(&neighbour_paths, past, device)?,
            cells,
            plans: by_time(&plans, inputs.clock.future(), device)?,
            plan_cells,
            without_ego,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_comes_with_those_before_and_after() {
        let path = [[1., -1.], [2., -2.], [3., -3.]];
        let found = with_neighbours(&path);
        assert_eq!(found[0], [0., 1., 2., 0., -1., -2.]);
        assert_eq!(found[1], [1., 2., 3., -1., -2., -3.]);
        assert_eq!(found[2], [2., 3., 0., -2., -3., 0.]);
    }
}
