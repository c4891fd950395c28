//! Metrics of forecasts sampled twice a second, as nuScenes and Waymo score them.

use crate::case::ScoredWindow;
use crate::metric::MISS_M;
use crate::metric::overlap::heading;

/// Points a second.
const SAMPLES_HZ: f64 = 2.;
/// Waymo's box at `h` s reaches `0.4 h - 0.2` m to either side, and twice as far along: 1 by 2 m at
/// 3 s, 1.8 by 3.6 m at 5 s, 3 by 6 m at 8 s.
const BOX_GROWTH_MPS: f64 = 0.4;
const BOX_START_M: f64 = -0.2;
/// The box is halved up to the first speed and whole from the second on, m/s.
const BOX_SPEEDS: [f64; 2] = [1.4, 11.];

/// Least mean error over the points up to `horizon_s` among the first `k` modes, m.
pub(super) fn least_ade(case: &ScoredWindow<'_>, k: usize, horizon_s: f64) -> f64 {
    least(k, |mode| {
        let errors = errors(case, mode, horizon_s);
        errors.iter().sum::<f64>() / errors.len().max(1) as f64
    })
}

/// Whether in each of the first `k` modes some point up to `horizon_s` is [`MISS_M`] off or more.
pub(super) fn every_mode_leaves(case: &ScoredWindow<'_>, k: usize, horizon_s: f64) -> bool {
    least(k, |mode| errors(case, mode, horizon_s).into_iter().fold(0., f64::max)) >= MISS_M
}

/// Whether none of the first `k` modes ends, in the last of `frames` frames, in the box around the
/// recorded centre that is turned along the recorded path.
pub(super) fn outside_box(case: &ScoredWindow<'_>, k: usize, frames: usize, horizon_s: f64) -> bool {
    let reference = case.reference();
    let truth = reference.path();
    let [cos, sin] = heading(truth, frames - 1).map(f64::from);
    let lateral = (BOX_START_M + BOX_GROWTH_MPS * horizon_s) * box_scale(reference.speed());
    !case.modes()[..k].iter().any(|mode| {
        let [dx, dy] = difference(mode.path[frames - 1], truth[frames - 1]);
        (cos * dx + sin * dy).abs() <= 2. * lateral && (cos * dy - sin * dx).abs() <= lateral
    })
}

/// How much of the box counts at a present speed, m/s.
fn box_scale(speed: f64) -> f64 {
    let [low, high] = BOX_SPEEDS;
    0.5 + 0.5 * ((speed - low) / (high - low)).clamp(0., 1.)
}

/// Errors of a mode at each half second, m. Where that falls between two frames, as at 25 Hz, both
/// paths are taken as straight between them.
fn errors(case: &ScoredWindow<'_>, mode: usize, horizon_s: f64) -> Vec<f64> {
    let reference = case.reference();
    let (path, truth) = (&case.modes()[mode].path, reference.path());
    // Frame 0 is the last observed one, where nothing is off yet.
    let off = |frame: usize| if frame == 0 { [0.; 2] } else { difference(path[frame - 1], truth[frame - 1]) };
    let at = |sample: usize| {
        let place = sample as f64 / SAMPLES_HZ * reference.rate_hz();
        let below = (place + 1e-6).floor();
        let (frame, share) = ((below as usize).min(path.len()), (place - below).max(0.));
        let [a, b] = [off(frame), off((frame + 1).min(path.len()))];
        (a[0] + (b[0] - a[0]) * share).hypot(a[1] + (b[1] - a[1]) * share)
    };
    (1..=(horizon_s * SAMPLES_HZ + 1e-6).floor() as usize).map(at).collect()
}

fn difference(p: [f32; 2], q: [f32; 2]) -> [f64; 2] {
    [f64::from(p[0]) - f64::from(q[0]), f64::from(p[1]) - f64::from(q[1])]
}

fn least(k: usize, of_mode: impl Fn(usize) -> f64) -> f64 {
    (0..k).map(of_mode).fold(f64::INFINITY, f64::min)
}
