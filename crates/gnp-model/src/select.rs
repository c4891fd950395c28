//! Which of the decoded goals are handed out when fewer are asked for than there are modes.

use serde::{Deserialize, Serialize};

/// How `k` goals are chosen among all modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Selection {
    /// The `k` most probable modes, as published. Neighbouring modes share what is one intention,
    /// so that these may all stand in one place.
    MostProbable,
    /// The `k` modes that keep the expected distance from the end of the vehicle's path to the
    /// nearest of them small, each with the probability of the modes it stands for. Of one, the
    /// mode nearest to all others.
    Medoids,
    /// First the mode that ends nearest to the mean of all, which is where the squared error is expected to be least, then
    /// as with `medoids` those that stand for what it is far from. The first is not always the likeliest.
    Central,
}

impl Selection {
    /// Name in configurations and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::MostProbable => "most_probable",
            Self::Medoids => "medoids",
            Self::Central => "central",
        }
    }
}

/// Goals chosen by [`Selection::Medoids`]: indices into `goals`, with the probability of the goals each is nearest to,
/// likeliest first but behind `first`, which is taken in any case. `goals` are in m; `probabilities` sum to 1.
///
/// Chosen one after the other, each where it lowers the expected distance most (a greedy bound of
/// 1 - 1/e on the best choice); the first of equals.
pub(crate) fn medoids(goals: &[[f32; 2]], probabilities: &[f32], k: usize, first: Option<usize>) -> Vec<(usize, f32)> {
    let mut choice = Choice::default();
    choice.medoids(goals, probabilities, k, first);
    choice.picked
}

/// A choice of goals, in memory that the next one uses again.
#[derive(Debug, Default)]
pub(crate) struct Choice {
    /// What [`medoids`] gives.
    pub(crate) picked: Vec<(usize, f32)>,
    /// Distance of every goal to every other, `[goals, goals]`, m.
    distances: Vec<f32>,
    /// Of every goal: distance to the nearest that is chosen, and which of them that is.
    nearest: Vec<f32>,
    places: Vec<usize>,
    /// Expected distance to the nearest, were a goal chosen next.
    costs: Vec<f32>,
    chosen: Vec<usize>,
    /// Probability that each chosen one stands for, and the order of these.
    mass: Vec<f32>,
    order: Vec<usize>,
}

impl Choice {
    /// As [`medoids`], into [`Choice::picked`].
    pub(crate) fn medoids(&mut self, goals: &[[f32; 2]], probabilities: &[f32], k: usize, first: Option<usize>) {
        let Self { picked, distances, nearest, places, costs, chosen, mass, order } = self;
        let n = goals.len();
        distances_of(goals, distances);
        refill(nearest, n, f32::INFINITY);
        refill(places, n, 0);
        refill(costs, n, 0.);
        chosen.clear();
        while chosen.len() < k.min(n) {
            let best = match first.filter(|_| chosen.is_empty()) {
                Some(first) => first,
                None => {
                    costs.fill(0.);
                    // The costs of all candidates grow together, goal by goal.
                    for ((row, probability), nearest) in distances.chunks_exact(n).zip(probabilities).zip(&*nearest) {
                        for (cost, distance) in costs.iter_mut().zip(row) {
                            *cost += probability * if distance < nearest { *distance } else { *nearest };
                        }
                    }
                    let free = (0..n).filter(|goal| !chosen.contains(goal));
                    let Some(best) = free.reduce(|best, next| if costs[next] < costs[best] { next } else { best })
                    else {
                        break;
                    };
                    best
                }
            };
            for ((nearest, place), distance) in nearest.iter_mut().zip(&mut *places).zip(&distances[best * n..][..n]) {
                if distance < nearest {
                    (*nearest, *place) = (*distance, chosen.len());
                }
            }
            chosen.push(best);
        }
        refill(mass, chosen.len(), 0.);
        for (place, probability) in places.iter().zip(probabilities) {
            if let Some(mass) = mass.get_mut(*place) {
                *mass += probability;
            }
        }
        let total: f32 = mass.iter().sum();
        mass.iter_mut().for_each(|mass| *mass /= total);
        order.clear();
        order.extend(0..chosen.len());
        let rest = usize::from(first.is_some()).min(order.len());
        order[rest..].sort_unstable_by(|a, b| mass[*b].total_cmp(&mass[*a]).then(a.cmp(b)));
        picked.clear();
        picked.extend(order.iter().map(|place| (chosen[*place], mass[*place])));
    }
}

/// Makes `values` so many times `value`.
fn refill<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    values.clear();
    values.resize(count, value);
}

/// Distance of every goal to every other, `[goals, goals]`, m.
fn distances_of(goals: &[[f32; 2]], distances: &mut Vec<f32>) {
    refill(distances, goals.len() * goals.len(), 0.);
    for (row, a) in distances.chunks_exact_mut(goals.len().max(1)).zip(goals) {
        for (distance, b) in row.iter_mut().zip(goals) {
            // The squares of `f32` neither overflow nor round in `f64`.
            let [x, y] = [0, 1].map(|axis| f64::from(a[axis] - b[axis]));
            *distance = (x * x + y * y).sqrt() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_places_are_named_before_a_crowd_twice() {
        // Three modes around 0 with 0.2 each, one at 10 with 0.4: the most probable single mode is
        // at 10, but most of the probability is around 0.
        let goals = [[-1., 0.], [0., 0.], [1., 0.], [10., 0.]];
        let probabilities = [0.2, 0.2, 0.2, 0.4];
        assert_eq!(medoids(&goals, &probabilities, 1, None)[0].0, 2, "the median of what is likely");
        let two = medoids(&goals, &probabilities, 2, None);
        assert_eq!(two.iter().map(|p| p.0).collect::<Vec<_>>(), [2, 3]);
        assert!((two[0].1 - 0.6).abs() < 1e-6 && (two[1].1 - 0.4).abs() < 1e-6);
    }

    #[test]
    fn each_goal_lowers_the_expected_distance_most() {
        let wave = |i: usize, step: f32| (i as f32 * step).sin();
        let goals: Vec<[f32; 2]> = (0..40).map(|i| [30. * wave(i, 1.7), 4. * wave(i, 0.9)]).collect();
        let weights: Vec<f32> = (0..40).map(|i| 1.1 + wave(i, 2.3)).collect();
        let probabilities: Vec<f32> = weights.iter().map(|weight| weight / weights.iter().sum::<f32>()).collect();
        let expected = |chosen: &[usize]| -> f64 {
            let to = |goal: &[f32; 2], i: usize| f64::from((goal[0] - goals[i][0]).hypot(goal[1] - goals[i][1]));
            let nearest = |goal| chosen.iter().map(|i| to(goal, *i)).fold(f64::INFINITY, f64::min);
            goals.iter().zip(&probabilities).map(|(goal, p)| f64::from(*p) * nearest(goal)).sum()
        };
        for first in [None, Some(7)] {
            let mut found: Vec<usize> = medoids(&goals, &probabilities, 5, first).into_iter().map(|p| p.0).collect();
            let mut chosen: Vec<usize> = first.into_iter().collect();
            while chosen.len() < 5 {
                let with = |goal: usize| expected(&[&chosen[..], &[goal]].concat());
                chosen.extend((0..40).min_by(|a, b| with(*a).total_cmp(&with(*b))));
            }
            found.sort_unstable();
            chosen.sort_unstable();
            assert_eq!(found, chosen, "after {first:?}");
        }
    }

    #[test]
    fn all_modes_keep_their_own_probability() {
        let goals = [[0., 0.], [5., 0.], [0., 5.]];
        let all = medoids(&goals, &[0.2, 0.5, 0.3], 7, None);
        assert_eq!(all, [(1, 0.5), (2, 0.3), (0, 0.2)]);
    }

    #[test]
    fn goals_in_one_place_share_no_probability_twice() {
        let picked = medoids(&[[3., 1.]; 4], &[0.25; 4], 2, None);
        assert!((picked.iter().map(|p| p.1).sum::<f32>() - 1.).abs() < 1e-6, "{picked:?}");
    }

    #[test]
    fn the_central_one_comes_first_also_where_others_are_likelier() {
        // Two likely places on either side of an unlikely one, which is where the mean is.
        let (goals, probabilities) = ([[-6., 0.], [0.5, 0.], [7., 0.], [7.5, 0.]], [0.44, 0.1, 0.2, 0.26]);
        assert_eq!(gnp_data::nearest_to_mean(&goals, &probabilities), Some(1));
        let picked = medoids(&goals, &probabilities, 3, Some(1));
        assert_eq!(picked.iter().map(|p| p.0).collect::<Vec<_>>(), [1, 3, 0]);
        assert!((picked[0].1 - 0.1).abs() < 1e-6 && (picked[1].1 - 0.46).abs() < 1e-6, "{picked:?}");
        assert_eq!(medoids(&goals, &probabilities, 1, Some(1)), [(1, 1.)]);
    }
}
