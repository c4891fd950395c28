//! What one window adds to the metrics of distance.

use crate::case::ScoredWindow;

/// Least squared error in the last of `frames` frames among the first `k` modes, m².
pub(super) fn least_squared_at(case: &ScoredWindow<'_>, k: usize, frames: usize) -> f64 {
    least(k, |mode| case.squared(mode, frames)[frames - 1])
}

/// Least mean squared error over `frames` frames among the first `k` modes, m².
pub(super) fn least_squared_to(case: &ScoredWindow<'_>, k: usize, frames: usize) -> f64 {
    least(k, |mode| case.squared(mode, frames).iter().sum::<f64>() / frames as f64)
}

/// Least mean error over `frames` frames among the first `k` modes, m.
pub(super) fn least_ade(case: &ScoredWindow<'_>, k: usize, frames: usize) -> f64 {
    least(k, |mode| case.squared(mode, frames).iter().map(|squared| squared.sqrt()).sum::<f64>() / frames as f64)
}

/// Squared error of the first mode in the last of `frames` frames along one axis, m²: 0 along
/// the road, 1 across it.
pub(super) fn squared_along(case: &ScoredWindow<'_>, axis: usize, frames: usize) -> f64 {
    let (p, q) = (case.modes()[0].path[frames - 1], case.reference().path()[frames - 1]);
    (f64::from(p[axis]) - f64::from(q[axis])).powi(2)
}

/// How far the first mode, the prediction, is ahead of the record along the road in the last of `frames` frames, m.
pub(super) fn ahead(case: &ScoredWindow<'_>, frames: usize) -> f64 {
    f64::from(case.modes()[0].path[frames - 1][0]) - f64::from(case.reference().path()[frames - 1][0])
}

/// Squared error of the mode with the largest probability, of equal ones the first, in the last of `frames` frames, m².
pub(super) fn squared_of_likeliest(case: &ScoredWindow<'_>, frames: usize) -> f64 {
    let modes = case.modes();
    let likeliest = (0..modes.len()).rev().max_by(|a, b| modes[*a].probability.total_cmp(&modes[*b].probability));
    case.squared(likeliest.unwrap_or(0), frames)[frames - 1]
}

/// Squared error of the mean of all modes, weighted by probability, in the last of `frames`
/// frames, m².
pub(super) fn squared_of_mean(case: &ScoredWindow<'_>, frames: usize) -> f64 {
    let total: f64 = case.modes().iter().map(|mode| f64::from(mode.probability)).sum();
    let truth = case.reference().path()[frames - 1];
    let error = |axis: usize| {
        let sum: f64 =
            case.modes().iter().map(|m| f64::from(m.probability) * f64::from(m.path[frames - 1][axis])).sum();
        sum / total - f64::from(truth[axis])
    };
    error(0).powi(2) + error(1).powi(2)
}

/// Least error in the last of `frames` frames among the first `k` modes, plus (1 - p)² of that
/// mode. Its probability is taken among the `k`, as if no more had been asked for. Of equally good
/// modes the likeliest counts.
pub(super) fn brier_least_fde(case: &ScoredWindow<'_>, k: usize, frames: usize) -> f64 {
    let kept = &case.modes()[..k];
    let total: f64 = kept.iter().map(|mode| f64::from(mode.probability)).sum();
    let at_end = |mode: usize| case.squared(mode, frames)[frames - 1];
    let best = (0..k).min_by(|a, b| at_end(*a).total_cmp(&at_end(*b))).unwrap_or(0);
    let p = if total > 0. { f64::from(kept[best].probability) / total } else { 0. };
    at_end(best).sqrt() + (1. - p).powi(2)
}

/// Share of the first `k` modes with a centre beyond the outermost lines in any of `frames` frames.
pub(super) fn share_off_road(case: &ScoredWindow<'_>, k: usize, frames: usize) -> Option<f64> {
    let [right, left] = case.reference().edges()?;
    let leaves = |path: &[[f32; 2]]| path[..frames].iter().any(|p| p[1] < right || p[1] > left);
    let off = case.modes()[..k].iter().filter(|mode| leaves(&mode.path)).count();
    Some(off as f64 / k as f64)
}

fn least(k: usize, error: impl Fn(usize) -> f64) -> f64 {
    (0..k).map(error).fold(f64::INFINITY, f64::min)
}
