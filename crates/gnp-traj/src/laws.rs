//! The laws of `gnp_force` on tensors; a test holds them against that crate.

use candle_core::{D, Result, Tensor};
use gnp_force::{BOUNDARY_CAP, CENTRE_CUTOFF};

/// Attraction `((goal - p) / time_left - v) / tau`, in m/s².
///
/// `p`, `v`, `goal` `[rows, 2]`, `tau` `[rows, 1]` in s, `time_left` in s; returns `[rows, 2]`.
pub(crate) fn goal_force(p: &Tensor, v: &Tensor, goal: &Tensor, time_left: f64, tau: &Tensor) -> Result<Tensor> {
    (((goal - p)? / time_left.max(gnp_force::MIN_TIME))? - v)?.broadcast_div(tau)
}

/// Push `k exp(-d / r_col) r / d` of other vehicles, `r` from the other to this one, in m/s².
///
/// `r` `[rows, slots, 2]`, `k` `[rows, slots]`; returns `[rows, slots, 2]`.
pub(crate) fn vehicle_force(r: &Tensor, k: &Tensor, r_col: f64) -> Result<Tensor> {
    let d = (r.sqr()?.sum(D::Minus1)? + gnp_force::SOFTENING)?.sqrt()?;
    let scale = (k * (&d / -r_col)?.exp()?)?.div(&d)?;
    r.broadcast_mul(&scale.unsqueeze(D::Minus1)?)
}

/// Lateral push of lines, in m/s²; `d`, `kind`, `side` and `k` `[rows, lines]`, `d = y - y_line` in m.
///
/// Lines between lanes: `2 k d exp(-d²)` within [`CENTRE_CUTOFF`]; boundaries: `k / distance³` towards
/// the road, the distance taken on the road's side and no smaller than [`BOUNDARY_CAP`].
pub(crate) fn line_force(kind: &Tensor, d: &Tensor, k: &Tensor, side: &Tensor) -> Result<Tensor> {
    let zeros = d.zeros_like()?;
    let centre = (d * d.sqr()?.neg()?.exp()?)?.affine(2., 0.)?;
    let centre = d.abs()?.lt(CENTRE_CUTOFF)?.where_cond(&centre, &zeros)?;
    let closest = (d.ones_like()? * BOUNDARY_CAP)?;
    let inside = (d * side)?;
    let distance = inside.gt(BOUNDARY_CAP)?.where_cond(&inside, &closest)?;
    let boundary = (side / (distance.sqr()? * &distance)?)?;
    kind.gt(0.5)?.where_cond(&boundary, &centre)? * k
}
