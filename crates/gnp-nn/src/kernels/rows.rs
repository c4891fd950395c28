//! What happens to rows: plain loops that the compiler makes vectors of, in a fixed order.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::aligned::LINE;
use super::matmul::Rows;
use crate::DropoutMask;

/// Functions that [`Arch::dispatch`] runs with the machine's vector instructions switched on. A
/// closure would do the same only where the compiler chooses to inline it.
macro_rules! vectorised {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $kind:ty),* $(,)?) $body:block)*) => {$(
        $(#[$doc])*
        pub fn $name($($arg: $kind),*) {
            struct Run<T>(T);
            impl WithSimd for Run<($($kind,)*)> {
                type Output = ();
                #[inline(always)]
                fn with_simd<S: Simd>(self, _: S) {
                    let ($($arg,)*) = self.0;
                    $body
                }
            }
            Arch::new().dispatch(Run(($($arg,)*)));
        }
    )*};
}

/// The sum of `f` over pairs, in [`LINE`] partial sums.
#[inline(always)]
fn fold(a: &[f32], b: &[f32], f: impl Fn(f32, f32) -> f32) -> f32 {
    let (a_whole, a_rest) = a.as_chunks::<LINE>();
    let (b_whole, b_rest) = b.as_chunks::<LINE>();
    let mut sums = [0f32; LINE];
    for (a, b) in a_whole.iter().zip(b_whole) {
        for i in 0..LINE {
            sums[i] += f(a[i], b[i]);
        }
    }
    for (i, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[i] += f(*a, *b);
    }
    let mut half = LINE / 2;
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
fn drop_row(row: &mut [f32], mask: DropoutMask, first: usize) {
    for (i, x) in row.iter_mut().enumerate() {
        *x *= mask.factor(first + i);
    }
}

/// Added to the variance before its root is taken.
pub(crate) const NORM_EPSILON: f64 = 1e-5;

/// To mean 0 and variance 1 in place; gives the reciprocal of the deviation.
#[inline(always)]
fn normalise(row: &mut [f32]) -> f32 {
    let share = 1. / row.len() as f32;
    let mean = sum(row) * share;
    for x in row.iter_mut() {
        *x -= mean;
    }
    let scale = 1. / (dot(row, row) * share + NORM_EPSILON as f32).sqrt();
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

/// Weight and bias of a norm, each `[width]`.
pub type Affine<'a> = (&'a [f32], &'a [f32]);

vectorised! {
    /// The norm of a residual layer, for each row of `y` `[rows, width]`: drops values of `y` (the mask
    /// comes with the index of the first of them in it), adds `x`, normalises `y` in place, keeps the
    /// reciprocal of its deviation in `scales` `[rows]`, and writes `y * weight + bias` to `out`.
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

    /// The adjoint of [`norm`]: `gradient` `[rows, width]` goes from that of `out` to that of the sum of
    /// `x` and the dropped `y`, and those of weight and bias in `d` are added to. `normalised` and
    /// `scales` are what [`norm`] left in `y` and `scales`.
    fn norm_adjoint(
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

    /// Each row of `rows` `[rows, width]` times `weight` plus `bias`, into `to`: what [`norm`] gave, from what it left.
    fn affine_rows(to: &mut [f32], rows: &[f32], affine: Affine<'_>) {
        let width = affine.0.len();
        for (to, row) in to.chunks_exact_mut(width).zip(rows.chunks_exact(width)) {
            for (((to, x), w), b) in to.iter_mut().zip(row).zip(affine.0).zip(affine.1) {
                *to = x * w + b;
            }
        }
    }

    /// The product of each row of `rows` `[rows, width]` with `vector` `[width]`, plus `bias`, into `to` `[rows]`.
    fn row_products(to: &mut [f32], rows: &[f32], vector: &[f32], bias: f32) {
        for (to, row) in to.iter_mut().zip(rows.chunks_exact(vector.len().max(1))) {
            *to = dot(row, vector) + bias;
        }
    }

    /// Each row of `width` values times its factor; rows begin `stride` values apart.
    fn scale_rows(rows: &mut [f32], stride: usize, width: usize, factors: &[f32]) {
        for (row, factor) in rows.chunks_mut(stride.max(1)).zip(factors) {
            for x in &mut row[..width] {
                *x *= factor;
            }
        }
    }

    /// Applies the part of a mask that begins at `first` to `values`, which is also its adjoint.
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

    /// The adjoint of [`relu`] on rows of `width` values: `gradient` `[rows, width]` becomes 0 wherever
    /// [`relu`] gave 0.
    fn relu_adjoint(width: usize, gradient: &mut [f32], activations: Rows<'_>) {
        for (row, gradient) in gradient.chunks_exact_mut(width.max(1)).enumerate() {
            let activations = &activations.data[activations.stride * row..][..width];
            for (g, a) in gradient.iter_mut().zip(activations) {
                *g = if *a > 0. { *g } else { 0. };
            }
        }
    }

    /// Adds every row of `rows` to `total`, one row long, in order.
    fn add_rows(total: &mut [f32], rows: &[f32]) {
        for row in rows.chunks_exact(total.len().max(1)) {
            add_row(total, row);
        }
    }

    /// Adds `row` to every row of `rows`.
    fn add_to_rows(rows: &mut [f32], row: &[f32]) {
        for to in rows.chunks_exact_mut(row.len().max(1)) {
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

/// Rows that are added up before they join the sum: fixed, so that the result does not depend on
/// threads, and small, so that little of a long sum is rounded away.
const BLOCK: usize = 256;

/// The sum of each of `columns` columns over all `rows` of `term`, in parallel. `term(row, sums)` adds
/// a row to the sums.
pub fn sum_rows(rows: usize, columns: usize, term: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let block = |first: usize| {
        let mut sums = vec![0f32; columns];
        (first..rows.min(first + BLOCK)).for_each(|row| term(row, &mut sums));
        sums
    };
    let blocks: Vec<Vec<f32>> = (0..rows).into_par_iter().step_by(BLOCK).map(block).collect();
    let mut all = vec![0f32; columns];
    for block in &blocks {
        add_rows(&mut all, block);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504. - 1.).collect()
    }

    /// `gradient` against central differences of `loss` at `at`.
    fn assert_gradient(name: &str, gradient: &[f32], at: &[f32], loss: impl Fn(&[f32]) -> f32) {
        for i in 0..at.len() {
            let moved = |by: f32| {
                let mut at = at.to_vec();
                at[i] += by;
                loss(&at)
            };
            let difference = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            let off = (difference - gradient[i]).abs();
            assert!(off < 5e-3 * (1. + difference.abs()), "{name}[{i}]: {} and {difference}", gradient[i]);
        }
    }

    #[test]
    fn the_adjoint_of_a_norm_is_the_difference() {
        let (rows, width, mask) = (3, 19, (crate::Dropout::new(0.3, 4).draw(), 5));
        let (y, x, upstream) = (values(rows * width, 1), values(rows * width, 2), values(rows * width, 3));
        let (weight, bias) = (values(width, 4), values(width, 5));
        let run = |y: &[f32], x: &[f32], weight: &[f32], bias: &[f32]| {
            let (mut y, mut scales, mut out) = (y.to_vec(), vec![0.; rows], vec![0.; y.len()]);
            norm(&mut y, x, mask, (weight, bias), &mut scales, &mut out);
            let mut again = vec![9.; out.len()];
            affine_rows(&mut again, &y, (weight, bias));
            assert_eq!(again, out);
            (out, y, scales)
        };
        let (_, normalised, scales) = run(&y, &x, &weight, &bias);
        for row in normalised.chunks_exact(width) {
            assert!(sum(row).abs() < 1e-5 && (dot(row, row) / width as f32 - 1.).abs() < 1e-3);
        }
        let (mut gradient, mut dweight, mut dbias) = (upstream.clone(), vec![0.; width], vec![0.; width]);
        norm_adjoint(&mut gradient, &normalised, &scales, &weight, (&mut dweight, &mut dbias));
        let loss = |y: &[f32], x: &[f32], weight: &[f32], bias: &[f32]| dot(&run(y, x, weight, bias).0, &upstream);
        assert_gradient("x", &gradient, &x, |x| loss(&y, x, &weight, &bias));
        assert_gradient("weight", &dweight, &weight, |weight| loss(&y, &x, weight, &bias));
        assert_gradient("bias", &dbias, &bias, |bias| loss(&y, &x, &weight, bias));
        drop_values(&mut gradient, mask.0, mask.1);
        assert_gradient("y", &gradient, &y, |y| loss(y, &x, &weight, &bias));
    }

    #[test]
    fn a_rectifier_passes_gradients_where_it_passed_values() {
        let mut kept = [1., -1., 0., 2., -3., 4., 5., -6., 9.];
        relu(&mut kept);
        assert_eq!(kept, [1., 0., 0., 2., 0., 4., 5., 0., 9.]);
        let mut gradient = [7.; 4];
        relu_adjoint(2, &mut gradient, Rows::new(&kept, 3));
        assert_eq!(gradient, [7., 0., 7., 0.]);
    }

    #[test]
    fn rows_are_added_up_each_to_each_and_turned() {
        let rows: Vec<f32> = (0..6).map(|i| i as f32).collect();
        let mut total = [1., 1., 1.];
        add_rows(&mut total, &rows);
        assert_eq!(total, [4., 6., 8.]);
        let mut moved = rows.clone();
        add_to_rows(&mut moved, &[10., 20., 30.]);
        assert_eq!(moved, [10., 21., 32., 13., 24., 35.]);
        let mut products = [9.; 2];
        row_products(&mut products, &rows, &[1., 2., 3.], 0.5);
        assert_eq!(products, [8.5, 26.5]);
        let mut scaled = rows.clone();
        scale_rows(&mut scaled[1..], 3, 2, &[2., 3.]);
        assert_eq!(scaled, [0., 2., 4., 3., 12., 15.]);
        let mut turned = [9.; 6];
        transpose(&mut turned, 3, &rows[1..], 3, [2, 2], 2.);
        assert_eq!(turned, [2., 8., 0., 4., 10., 0.]);
        let sums = sum_rows(2 * BLOCK + 3, 2, |row, sums| add_rows(sums, &[row as f32, 1.]));
        assert_eq!(sums, [(514 * 515 / 2) as f32, 515.]);
    }

    #[test]
    fn sums_reach_every_value() {
        for n in 0..50 {
            let row: Vec<f32> = (1..=n).map(|i| i as f32).collect();
            assert_eq!(sum(&row), (n * (n + 1) / 2) as f32);
        }
    }
}
