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

/// Goals chosen by [`Selection::Medoids`]: indices into `goals`, with the probability of the goals each is nearest to,
/// likeliest first but behind `first`, which is taken in any case. `goals` are in m; `probabilities` sum to 1.
///
/// Chosen one after the other, each where it lowers the expected distance most (a greedy bound of
/// 1 - 1/e on the best choice); the first of equals.
pub(crate) fn medoids(goals: &[[f32; 2]], probabilities: &[f32], k: usize, first: Option<usize>) -> Vec<(usize, f32)> {
    let n = goals.len();
    let distance = |a: usize, b: usize| (goals[a][0] - goals[b][0]).hypot(goals[a][1] - goals[b][1]);
    let mut nearest: Vec<(f32, usize)> = vec![(f32::INFINITY, 0); n];
    let mut chosen: Vec<usize> = Vec::with_capacity(k.min(n));
    while chosen.len() < k.min(n) {
        let cost = |candidate: usize| -> f32 {
            (0..n).map(|goal| probabilities[goal] * nearest[goal].0.min(distance(goal, candidate))).sum()
        };
        let forced = first.filter(|_| chosen.is_empty());
        let free = (0..n).filter(|goal| !chosen.contains(goal));
        let best = free.map(|goal| (cost(goal), goal)).reduce(|best, next| if next.0 < best.0 { next } else { best });
        let Some(best) = forced.or(best.map(|(_, best)| best)) else { break };
        for (goal, nearest) in nearest.iter_mut().enumerate() {
            let to_best = distance(goal, best);
            if to_best < nearest.0 {
                *nearest = (to_best, chosen.len());
            }
        }
        chosen.push(best);
    }
    let mut mass = vec![0f32; chosen.len()];
    for ((_, place), probability) in nearest.iter().zip(probabilities) {
        if let Some(mass) = mass.get_mut(*place) {
            *mass += probability;
        }
    }
    let total: f32 = mass.iter().sum();
    let mut picked: Vec<(usize, f32)> = chosen.into_iter().zip(mass.into_iter().map(|mass| mass / total)).collect();
    let rest = usize::from(first.is_some()).min(picked.len());
    picked[rest..].sort_by(|a, b| b.1.total_cmp(&a.1));
    picked
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
