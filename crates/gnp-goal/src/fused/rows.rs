//! What happens to rows: plain loops that the compiler makes vectors of, in a fixed order.

use gnp_nn::DropoutMask;
use pulp::{Arch, Simd, WithSimd};

/// Partial sums kept apart; a row's length is best a multiple of it.
pub(crate) const LANES: usize = 16;

/// Functions that [`Arch::dispatch`] runs with the machine's vector instructions switched on. A
/// closure would do the same only where the compiler chooses to inline it.
macro_rules! vectorised {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $kind:ty),* $(,)?) $body:block)*) => {$(
        $(#[$doc])*
        pub(crate) fn $name(arch: Arch, $($arg: $kind),*) {
            struct Run<T>(T);
            impl WithSimd for Run<($($kind,)*)> {
                type Output = ();
                #[inline(always)]
                fn with_simd<S: Simd>(self, _: S) {
                    let ($($arg,)*) = self.0;
                    $body
                }
            }
            arch.dispatch(Run(($($arg,)*)));
        }
    )*};
}

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

#[inline(always)]
fn sum(a: &[f32]) -> f32 {
    fold(a, a, |a, _| a)
}

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
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

#[inline(always)]
fn softmax_row(row: &mut [f32], valid: usize) {
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

#[inline(always)]
fn drop_row(row: &mut [f32], mask: DropoutMask, first: usize) {
    for (i, x) in row.iter_mut().enumerate() {
        *x *= mask.factor(first + i);
    }
}

/// To mean 0 and variance 1 in place; gives the reciprocal of the deviation.
#[inline(always)]
fn normalise(row: &mut [f32]) -> f32 {
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

#[inline(always)]
fn add_row(total: &mut [f32], row: &[f32]) {
    for (t, r) in total.iter_mut().zip(row) {
        *t += r;
    }
}

/// Weight and bias of a norm, or their gradients.
pub(crate) type Affine<'a> = (&'a [f32], &'a [f32]);

vectorised! {
    /// Softmax over the first `valid` values of each row of `wide`; the others become 0.
    fn softmax(rows: &mut [f32], wide: usize, valid: usize) {
        for row in rows.chunks_exact_mut(wide) {
            softmax_row(row, valid);
        }
    }

    /// For rows of `weights = softmax(scale * scores)`: the gradient with respect to the weights is
    /// replaced by that with respect to the unscaled scores.
    fn softmax_gradient(gradient: &mut [f32], weights: &[f32], wide: usize, scale: f32) {
        for (gradient, weights) in gradient.chunks_exact_mut(wide).zip(weights.chunks_exact(wide)) {
            let mean = dot(weights, gradient);
            for (g, w) in gradient.iter_mut().zip(weights) {
                *g = w * (*g - mean) * scale;
            }
        }
    }

    /// For each row: drops values of `y` (`first` is the index of the first in the mask), adds `x`,
    /// normalises `y` in place, keeps the reciprocal of its deviation in `scales`, and writes
    /// `y * weight + bias` to `out`.
    fn norm(
        y: &mut [f32],
        x: &[f32],
        mask: (DropoutMask, usize),
        affine: Affine<'_>,
        scales: &mut [f32],
        out: &mut [f32],
    ) {
        let width = affine.0.len();
        let lines = y.chunks_exact_mut(width).zip(x.chunks_exact(width)).zip(out.chunks_exact_mut(width));
        for (row, (((y, x), out), scale)) in lines.zip(scales).enumerate() {
            if !mask.0.is_none() {
                drop_row(y, mask.0, mask.1 + row * width);
            }
            add_row(y, x);
            *scale = normalise(y);
            for (((out, n), w), b) in out.iter_mut().zip(&*y).zip(affine.0).zip(affine.1) {
                *out = n * w + b;
            }
        }
    }

    /// Backward through [`norm`]: the gradient of `out` is replaced by that of the sum, and those of
    /// weight and bias are added to. `normalised` and `scales` are what the forward pass left.
    fn norm_gradient(
        gradient: &mut [f32],
        normalised: &[f32],
        scales: &[f32],
        weight: &[f32],
        d: (&mut [f32], &mut [f32]),
    ) {
        let width = weight.len();
        let share = 1. / width as f32;
        let lines = gradient.chunks_exact_mut(width).zip(normalised.chunks_exact(width)).zip(scales);
        for ((gradient, normalised), scale) in lines {
            for (((g, n), dw), db) in gradient.iter().zip(normalised).zip(&mut *d.0).zip(&mut *d.1) {
                *dw += g * n;
                *db += g;
            }
            for (g, w) in gradient.iter_mut().zip(weight) {
                *g *= w;
            }
            let (mean, along) = (sum(gradient) * share, dot(gradient, normalised) * share);
            for (g, n) in gradient.iter_mut().zip(normalised) {
                *g = scale * (*g - mean - n * along);
            }
        }
    }

    /// Applies the part of a mask that begins at `first`.
    fn drop_values(values: &mut [f32], mask: DropoutMask, first: usize) {
        if !mask.is_none() {
            drop_row(values, mask, first);
        }
    }

    /// Negative values become 0.
    fn relu(values: &mut [f32]) {
        for x in values {
            *x = if *x > 0. { *x } else { 0. };
        }
    }

    /// Gradients become 0 where [`relu`] gave 0.
    fn relu_gradient(gradient: &mut [f32], activations: &[f32]) {
        for (g, a) in gradient.iter_mut().zip(activations) {
            *g = if *a > 0. { *g } else { 0. };
        }
    }

    /// Adds every row of `rows` to `total`, one row long.
    fn add_rows(total: &mut [f32], rows: &[f32]) {
        for row in rows.chunks_exact(total.len()) {
            add_row(total, row);
        }
    }

    /// Adds `row` to every row of `rows`.
    fn add_to_rows(rows: &mut [f32], row: &[f32]) {
        for to in rows.chunks_exact_mut(row.len()) {
            add_row(to, row);
        }
    }

    /// The transpose of the `[rows, columns]` (`sizes`) part of a matrix that begins with `from` and
    /// has `stride`, times `scale`, into `to` `[columns, wide]`, with zeros where `wide` exceeds
    /// `rows`.
    fn transpose(to: &mut [f32], wide: usize, from: &[f32], stride: usize, sizes: [usize; 2], scale: f32) {
        let [rows, columns] = sizes;
        for (column, to) in to.chunks_exact_mut(wide.max(1)).take(columns).enumerate() {
            let (to, padding) = to.split_at_mut(rows);
            padding.fill(0.);
            for (row, to) in to.iter_mut().enumerate() {
                *to = from[row * stride + column] * scale;
            }
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
        softmax(Arch::new(), &mut row, 5, 3);
        for (x, e) in row.iter().zip([0.4, 0.4, 0.2, 0., 0.]) {
            assert!((x - e).abs() < 1e-4, "{row:?}");
        }
        let mut low = [-1e4; 40];
        softmax(Arch::new(), &mut low, 40, 40);
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
