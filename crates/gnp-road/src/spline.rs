//! A smooth curve through points: a cubic spline with continuous curvature over the arc length.
//!
//! Chords alone jump in heading at every point; circles through three points follow a clothoid to no more than the
//! second order. The spline's error is of the fourth order in the distance of the points: on a radius of 150 m with
//! points every 20 m it is below 1 mm, and its curvature that of the arc to 1 part in 1,000.

use crate::piece::Piece;
use crate::plane::{Vector, add, length, scale, sub};

/// The pieces of the curve, one between two points. There are at least two points, apart from one another.
pub(crate) fn through(points: &[Vector]) -> Vec<Piece> {
    let mut spans: Vec<f64> = points.windows(2).map(|pair| length(sub(pair[1], pair[0]))).collect();
    let mut pieces = over(points, &spans);
    // An arc is longer than its chord, the more the farther its points are apart: over chords alone, points at unequal
    // distances would let the speed along the curve jump.
    for (span, piece) in spans.iter_mut().zip(&pieces) {
        *span = piece.length;
    }
    if points.len() > 2 {
        pieces = over(points, &spans);
    }
    let mut along = 0.;
    for piece in &mut pieces {
        piece.from = along;
        along += piece.length;
    }
    pieces
}

fn over(points: &[Vector], spans: &[f64]) -> Vec<Piece> {
    let second = second_derivatives(points, spans);
    (0..spans.len())
        .map(|i| {
            let h = spans[i];
            let slope = scale(sub(points[i + 1], points[i]), 1. / h);
            let bend = add(scale(second[i], 2.), second[i + 1]);
            let linear = sub(slope, scale(bend, h / 6.));
            let cubic = scale(sub(second[i + 1], second[i]), 1. / (6. * h));
            Piece::new([points[i], linear, scale(second[i], 0.5), cubic], h)
        })
        .collect()
}

/// How many times the first difference of the second derivative is carried on beyond the second point, for a first
/// span `ratio` times as long as the next: a curvature that changes evenly goes on to the end, unless the end is
/// so long that any noise would be multiplied.
fn carried(ratio: f64) -> f64 {
    ratio.min((6. - ratio).max(0.))
}

/// Second derivative of the curve at every point, from a tridiagonal system.
fn second_derivatives(points: &[Vector], h: &[f64]) -> Vec<Vector> {
    let n = points.len();
    if n == 2 {
        return vec![[0.; 2]; 2];
    }
    let slope = |i: usize| scale(sub(points[i + 1], points[i]), 1. / h[i]);
    let jump = |i: usize| scale(sub(slope(i), slope(i - 1)), 6.);
    if n == 3 {
        // A parabola: one second derivative everywhere.
        return vec![scale(jump(1), 1. / (3. * (h[0] + h[1]))); 3];
    }
    // At the ends m0 = m1 - first (m2 - m1), likewise at the last; both are put into the rows of their neighbours.
    let (first, last) = (carried(h[0] / h[1]), carried(h[n - 2] / h[n - 3]));
    let mut diagonal: Vec<f64> = (1..n - 1).map(|i| 2. * (h[i - 1] + h[i])).collect();
    let mut upper: Vec<f64> = h[1..n - 1].to_vec();
    let mut lower: Vec<f64> = h[..n - 2].to_vec();
    let mut right: Vec<Vector> = (1..n - 1).map(jump).collect();
    let inner = n - 2;
    diagonal[0] += h[0] * (1. + first);
    upper[0] -= h[0] * first;
    diagonal[inner - 1] += h[n - 2] * (1. + last);
    lower[inner - 1] -= h[n - 2] * last;
    for i in 1..inner {
        let factor = lower[i] / diagonal[i - 1];
        diagonal[i] -= factor * upper[i - 1];
        right[i] = sub(right[i], scale(right[i - 1], factor));
    }
    let mut second = vec![[0.; 2]; n];
    for i in (0..inner).rev() {
        let rest = if i + 1 < inner { scale(second[i + 2], upper[i]) } else { [0.; 2] };
        second[i + 1] = scale(sub(right[i], rest), 1. / diagonal[i]);
    }
    let beyond = |near: Vector, next: Vector, by: f64| sub(near, scale(sub(next, near), by));
    second[0] = beyond(second[1], second[2], first);
    second[n - 1] = beyond(second[n - 2], second[n - 3], last);
    second
}
