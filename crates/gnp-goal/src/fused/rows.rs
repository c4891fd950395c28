//! What happens to one row: written so that the compiler makes vectors of it, in a fixed order.
//!
//! Everything here is inlined into a closure that [`pulp::Arch::dispatch`] runs with the machine's
//! vector instructions switched on.

use gnp_nn::DropoutMask;

/// Partial sums kept apart; a row's length is best a multiple of it.
pub(crate) const LANES: usize = 16;

#[inline(always)]
fn fold(a: &[f32], b: &[f32], f: impl Fn(f32, f32) -> f32) -> f32 {
    let (a_whole, a_rest) = a.as_chunks::<LANES>();
    let (b_whole, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0f32; LANES];
    for (a, b) in a_whole.iter().zip(b_whole) {
        for i in 0..LANES {
            sums[i] += f(a[i], b[i]);
        }
    }
    for (i, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[i] += f(*a, *b);
    }
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            sums[i] += sums[i + half];
        }
        half /= 2;
    }
    sums[0]
}

/// Sum of `a`.
#[inline(always)]
pub(crate) fn sum(a: &[f32]) -> f32 {
    fold(a, a, |a, _| a)
}

/// Sum of the products of `a` and `b`.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    fold(a, b, |a, b| a * b)
}

#[inline(always)]
fn largest(a: &[f32]) -> f32 {
    let (whole, rest) = a.as_chunks::<LANES>();
    let mut largest = [f32::MIN; LANES];
    for a in whole {
        for i in 0..LANES {
            largest[i] = if a[i] > largest[i] { a[i] } else { largest[i] };
        }
    }
    largest.iter().chain(rest).copied().fold(f32::MIN, f32::max)
}

/// `exp(x)` for `x` of 0 and below, to 2 units in the last place; 0 below -87.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // x = n ln 2 + r with |r| <= ln 2 / 2; adding 1.5 * 2^23 leaves n in the lowest bits.
    const SHIFT: f32 = 12_582_912.;
    let shifted = x * std::f32::consts::LOG2_E + SHIFT;
    let n = shifted - SHIFT;
    // ln 2 in two parts, the first with few bits, so that its product with n is exact.
    let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
    let series = [1. / 720., 1. / 120., 1. / 24., 1. / 6., 0.5, 1., 1f32];
    let mut e = series[0];
    for c in &series[1..] {
        e = e * r + c;
    }
    let power = f32::from_bits(e.to_bits().wrapping_add(shifted.to_bits() << 23));
    if x < -87. { 0. } else { power }
}

/// Softmax over the first `valid` values of `row`; the others become 0.
#[inline(always)]
pub(crate) fn softmax(row: &mut [f32], valid: usize) {
    let (row, padding) = row.split_at_mut(valid);
    padding.fill(0.);
    let shift = largest(row);
    for x in row.iter_mut() {
        *x = exp(*x - shift);
    }
    let scale = 1. / sum(row);
    for x in row.iter_mut() {
        *x *= scale;
    }
}

/// From `weights = softmax(scale * scores)` and the gradient with respect to the weights, which is
/// replaced by that with respect to the unscaled scores.
#[inline(always)]
pub(crate) fn softmax_gradient(weights: &[f32], gradient: &mut [f32], scale: f32) {
    let mean = dot(weights, gradient);
    for (g, w) in gradient.iter_mut().zip(weights) {
        *g = w * (*g - mean) * scale;
    }
}

/// Adds `added`, with dropped values left out, to `y` where `y` holds `added` and `x` the other
/// summand; `first` is the index of the row's first value in the mask.
#[inline(always)]
pub(crate) fn add_dropped(y: &mut [f32], x: &[f32], mask: DropoutMask, first: usize) {
    drop_values(y, mask, first);
    for (y, x) in y.iter_mut().zip(x) {
        *y += x;
    }
}

/// Applies the part of `mask` that begins at `first`.
#[inline(always)]
pub(crate) fn drop_values(y: &mut [f32], mask: DropoutMask, first: usize) {
    if !mask.is_none() {
        for (i, y) in y.iter_mut().enumerate() {
            *y *= mask.factor(first + i);
        }
    }
}

/// Normalises `row` in place to mean 0 and variance 1, and gives the reciprocal of its deviation.
#[inline(always)]
pub(crate) fn normalise(row: &mut [f32]) -> f32 {
    const EPSILON: f32 = 1e-5;
    let share = 1. / row.len() as f32;
    let mean = sum(row) * share;
    for x in row.iter_mut() {
        *x -= mean;
    }
    let scale = 1. / (dot(row, row) * share + EPSILON).sqrt();
    for x in row.iter_mut() {
        *x *= scale;
    }
    scale
}

/// `out = normalised * weight + bias`.
#[inline(always)]
pub(crate) fn affine(out: &mut [f32], normalised: &[f32], weight: &[f32], bias: &[f32]) {
    for (((out, n), w), b) in out.iter_mut().zip(normalised).zip(weight).zip(bias) {
        *out = n * w + b;
    }
}

/// Backward through [`normalise`] and [`affine`]: the gradient of `out` is replaced by that of the
/// row, those of `weight` and `bias` are added to. `scale` is what [`normalise`] gave.
#[inline(always)]
pub(crate) fn norm_gradient(
    gradient: &mut [f32],
    normalised: &[f32],
    scale: f32,
    weight: &[f32],
    d_weight: &mut [f32],
    d_bias: &mut [f32],
) {
    for (((g, n), dw), db) in gradient.iter().zip(normalised).zip(d_weight).zip(d_bias) {
        *dw += g * n;
        *db += g;
    }
    for (g, w) in gradient.iter_mut().zip(weight) {
        *g *= w;
    }
    let share = 1. / gradient.len() as f32;
    let (mean, along) = (sum(gradient) * share, dot(gradient, normalised) * share);
    for (g, n) in gradient.iter_mut().zip(normalised) {
        *g = scale * (*g - mean - n * along);
    }
}

/// `total += row`.
#[inline(always)]
pub(crate) fn add(total: &mut [f32], row: &[f32]) {
    for (t, r) in total.iter_mut().zip(row) {
        *t += r;
    }
}

/// The transpose of the `[rows, columns]` part of a matrix that begins with `from` and has `stride`,
/// times `scale`, into `to` `[columns, padded]`, with zeros where `padded` exceeds `rows`.
#[inline(always)]
pub(crate) fn transpose(
    to: &mut [f32],
    padded: usize,
    from: &[f32],
    stride: usize,
    [rows, columns]: [usize; 2],
    scale: f32,
) {
    for (column, to) in to.chunks_exact_mut(padded.max(1)).take(columns).enumerate() {
        let (to, padding) = to.split_at_mut(rows);
        padding.fill(0.);
        for (row, to) in to.iter_mut().enumerate() {
            *to = from[row * stride + column] * scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_exact_to_rounding() {
        for i in 0..87_000 {
            let x = -(i as f32) * 1e-3;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) / exact - 1.).abs() < 2.5e-7, "exp({x}) = {}, not {exact}", exp(x));
        }
        assert_eq!(exp(-87.1), 0.);
        assert_eq!(exp(f32::MIN), 0.);
        assert_eq!(exp(0.), 1.);
    }

    #[test]
    fn softmax_of_large_and_of_equal_values_is_finite() {
        let mut row = [1000., 1000., 1000. - 2f32.ln(), 7., 7.];
        softmax(&mut row, 3);
        for (x, e) in row.iter().zip([0.4, 0.4, 0.2, 0., 0.]) {
            assert!((x - e).abs() < 1e-4, "{row:?}");
        }
        let mut low = [-1e4; 40];
        softmax(&mut low, 40);
        assert!(low.iter().all(|x| (x - 0.025).abs() < 1e-7));
    }

    #[test]
    fn sums_reach_every_value() {
        for n in 0..50 {
            let row: Vec<f32> = (1..=n).map(|i| i as f32).collect();
            assert_eq!(sum(&row), (n * (n + 1) / 2) as f32);
        }
    }
}
