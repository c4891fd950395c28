//! Multi-head attention of one window, all of it in the cache.

use pulp::{Arch, Simd, WithSimd};

use super::activation::exp_vector;
use super::aligned::{LINE, padded};
use super::matmul::{Rows, RowsMut, Start, matmul, matmul_transposed};
use super::rows::{scale_rows, transpose};

/// Queries whose scores are in work at a time. Scores lie `[keys, queries]`, so that a softmax runs down the lanes of
/// vectors and never across them, and a strip of them goes from product to product without leaving the inner caches.
const STRIP: usize = 2 * LINE;

/// Scaled dot-product attention of some queries to some keys. It keeps no weights: the adjoint makes them again from the
/// statistics of each query, which costs less than to carry them through memory.
#[derive(Clone, Copy, Debug)]
pub struct Attention {
    /// Number of queries.
    pub queries: usize,
    /// Values of a query, a key or a value: a multiple of `heads`.
    pub width: usize,
    /// Number of heads.
    pub heads: usize,
}

/// Queries `first..first + count`, in `columns` columns of scores.
#[derive(Clone, Copy)]
struct Strip {
    first: usize,
    count: usize,
    columns: usize,
}

impl Attention {
    /// Values that [`Attention::forward`] leaves for [`Attention::adjoint`].
    #[must_use]
    pub fn statistics(&self) -> usize {
        self.heads * self.queries.div_ceil(STRIP) * 2 * STRIP
    }

    /// Values of the room to work in, for up to `keys` keys.
    #[must_use]
    pub fn room(&self, keys: usize) -> usize {
        STRIP * (self.head() + 2 * keys)
    }

    fn head(&self) -> usize {
        self.width / self.heads.max(1)
    }

    /// Factor of the scores.
    fn scale(&self) -> f32 {
        1. / (self.head() as f32).sqrt()
    }

    fn strips(&self) -> impl Iterator<Item = Strip> {
        let queries = self.queries;
        (0..queries).step_by(STRIP).map(move |first| {
            let count = STRIP.min(queries - first);
            Strip { first, count, columns: padded(count) }
        })
    }

    /// The product of each of `keys` `[n, head]` with each of the strip's `queries` `[count, head]`, times `scale`, into
    /// `to` `[n, columns]`; both begin with the head's first value and have a stride.
    fn scores(&self, [n, head]: [usize; 2], keys: Rows<'_>, queries: &[f32], strip: Strip, scale: f32, room: Room<'_>) {
        let Strip { count, columns, .. } = strip;
        transpose(room.turned, columns, queries, self.width, [count, head], scale);
        let to = RowsMut::new(room.scores, columns);
        matmul([n, head, columns], keys, Rows::new(room.turned, columns), Start::Zero, to);
    }

    /// What each `query` `[queries, width]` gathers, into `gathered` `[queries, width]`; without any key,
    /// zeros. A row of `key_value` `[keys, 2 * width]` is a key and then its value.
    pub fn forward(
        &self,
        query: &[f32],
        key_value: &[f32],
        gathered: &mut [f32],
        statistics: &mut [f32],
        room: &mut [f32],
    ) {
        let (width, head) = (self.width, self.head());
        let n = key_value.len() / (2 * width).max(1);
        if n == 0 {
            return gathered.fill(0.);
        }
        let (turned, scores) = room.split_at_mut(head * STRIP);
        let mut statistics = statistics.chunks_exact_mut(2 * STRIP);
        for at in (0..width).step_by(head) {
            let (keys, values) =
                (Rows::new(&key_value[at..], 2 * width), Rows::new(&key_value[width + at..], 2 * width));
            for (strip, statistics) in self.strips().zip(&mut statistics) {
                let Strip { first, count, columns } = strip;
                let from = first * width + at;
                let scores = &mut scores[..n * columns];
                self.scores([n, head], keys, &query[from..], strip, self.scale(), Room { turned, scores });
                let (largest, share) = statistics.split_at_mut(STRIP);
                Arch::new().dispatch(Softmax {
                    scores,
                    largest: &mut largest[..columns],
                    share: &mut share[..columns],
                });
                let to = RowsMut::new(&mut gathered[from..], width);
                matmul_transposed([count, n, head], Rows::new(scores, columns), values, Start::Zero, to);
                scale_rows(&mut gathered[from..], width, head, &share[..count]);
            }
        }
    }

    /// After [`Attention::forward`] on the same `query` and `key_value` left its `statistics`: their gradients, into
    /// `d_query` and `d_key_value`, from that of what was gathered.
    #[expect(clippy::too_many_arguments, reason = "inputs, their gradients and the room")]
    pub fn adjoint(
        &self,
        query: &[f32],
        key_value: &[f32],
        d_gathered: &[f32],
        statistics: &[f32],
        d_query: &mut [f32],
        d_key_value: &mut [f32],
        room: &mut [f32],
    ) {
        let (width, head, scale) = (self.width, self.head(), self.scale());
        let n = key_value.len() / (2 * width).max(1);
        if n == 0 {
            return d_query.fill(0.);
        }
        let (turned, scores) = room.split_at_mut(head * STRIP);
        let (scores, d_scores) = scores.split_at_mut(n * STRIP);
        let mut statistics = statistics.chunks_exact(2 * STRIP);
        for at in (0..width).step_by(head) {
            let (keys, values) =
                (Rows::new(&key_value[at..], 2 * width), Rows::new(&key_value[width + at..], 2 * width));
            for (strip, statistics) in self.strips().zip(&mut statistics) {
                let Strip { first, count, columns } = strip;
                let from = first * width + at;
                let (scores, d_scores) = (&mut scores[..n * columns], &mut d_scores[..n * columns]);
                self.scores([n, head], keys, &query[from..], strip, scale, Room { turned, scores });
                self.scores([n, head], values, &d_gathered[from..], strip, 1., Room { turned, scores: d_scores });
                let (largest, share) = statistics.split_at(STRIP);
                let (largest, share) = (&largest[..columns], &share[..columns]);
                Arch::new().dispatch(SoftmaxAdjoint { scores, d_scores, largest, share, scale });
                let (weights, d_scores) = (Rows::new(scores, columns), Rows::new(d_scores, columns));
                let start = if first == 0 { Start::Zero } else { Start::Sum };
                let (query, d_gathered) = (Rows::new(&query[from..], width), Rows::new(&d_gathered[from..], width));
                let to = RowsMut::new(&mut d_key_value[width + at..], 2 * width);
                matmul([n, count, head], weights, d_gathered, start, to);
                let to = RowsMut::new(&mut d_key_value[at..], 2 * width);
                matmul([n, count, head], d_scores, query, start, to);
                let to = RowsMut::new(&mut d_query[from..], width);
                matmul_transposed([count, n, head], d_scores, keys, Start::Zero, to);
            }
        }
    }
}

/// Where a strip's scores are made.
struct Room<'a> {
    turned: &'a mut [f32],
    scores: &'a mut [f32],
}

/// Vectors of a row that are in work at a time: enough to hide how long an addition takes.
const BLOCK: usize = 2;

/// Each column of `scores` `[keys, columns]` to the exponential of its distance to the largest, which goes to `largest`,
/// and 1 over their sum to `share`, both `[columns]`.
struct Softmax<'a> {
    scores: &'a mut [f32],
    largest: &'a mut [f32],
    share: &'a mut [f32],
}

impl WithSimd for Softmax<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (scores, largest) = (S::as_mut_simd_f32s(self.scores).0, S::as_mut_simd_f32s(self.largest).0);
        let share = S::as_mut_simd_f32s(self.share).0;
        let row = largest.len();
        for at in (0..row).step_by(BLOCK) {
            // One vector a row where vectors are as wide as the columns.
            if at + BLOCK <= row {
                softmax_columns::<S, BLOCK>(simd, scores, row, at, largest, share);
            } else {
                softmax_columns::<S, 1>(simd, scores, row, at, largest, share);
            }
        }
    }
}

#[inline(always)]
fn softmax_columns<S: Simd, const N: usize>(
    simd: S,
    scores: &mut [S::f32s],
    row: usize,
    at: usize,
    largest: &mut [S::f32s],
    share: &mut [S::f32s],
) {
    // Two at a time, because a maximum waits for the one before it.
    let mut most = [[simd.splat_f32s(f32::MIN); N]; 2];
    let pairs = scores.chunks_exact(2 * row);
    let last = pairs.remainder();
    for pair in pairs {
        let (even, odd) = (&pair[at..at + N], &pair[row + at..row + at + N]);
        for v in 0..N {
            most[0][v] = simd.max_f32s(most[0][v], even[v]);
            most[1][v] = simd.max_f32s(most[1][v], odd[v]);
        }
    }
    if !last.is_empty() {
        for v in 0..N {
            most[0][v] = simd.max_f32s(most[0][v], last[at + v]);
        }
    }
    let most: [S::f32s; N] = std::array::from_fn(|v| simd.max_f32s(most[0][v], most[1][v]));
    let mut sums = [simd.splat_f32s(0.); N];
    for scores in scores.chunks_exact_mut(row) {
        let scores = &mut scores[at..at + N];
        for v in 0..N {
            scores[v] = exp_vector(simd, simd.sub_f32s(scores[v], most[v]));
            sums[v] = simd.add_f32s(sums[v], scores[v]);
        }
    }
    for v in 0..N {
        largest[at + v] = most[v];
        share[at + v] = simd.div_f32s(simd.splat_f32s(1.), sums[v]);
    }
}

/// With what [`Softmax`] left: `scores` to the weights, and `d_scores` from the gradient of the weights to that of the
/// scores before they were scaled.
struct SoftmaxAdjoint<'a> {
    scores: &'a mut [f32],
    d_scores: &'a mut [f32],
    largest: &'a [f32],
    share: &'a [f32],
    scale: f32,
}

impl WithSimd for SoftmaxAdjoint<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (scores, d_scores) = (S::as_mut_simd_f32s(self.scores).0, S::as_mut_simd_f32s(self.d_scores).0);
        let (largest, share) = (S::as_simd_f32s(self.largest).0, S::as_simd_f32s(self.share).0);
        let (row, scale) = (largest.len(), simd.splat_f32s(self.scale));
        for at in (0..row).step_by(BLOCK) {
            let (largest, share) = (&largest[at..], &share[at..]);
            if at + BLOCK <= row {
                adjoint_columns::<S, BLOCK>(simd, scores, d_scores, [row, at], largest, share, scale);
            } else {
                adjoint_columns::<S, 1>(simd, scores, d_scores, [row, at], largest, share, scale);
            }
        }
    }
}

#[inline(always)]
fn adjoint_columns<S: Simd, const N: usize>(
    simd: S,
    scores: &mut [S::f32s],
    d_scores: &mut [S::f32s],
    [row, at]: [usize; 2],
    largest: &[S::f32s],
    share: &[S::f32s],
    scale: S::f32s,
) {
    let (largest, share): ([S::f32s; N], [S::f32s; N]) =
        (std::array::from_fn(|v| largest[v]), std::array::from_fn(|v| share[v]));
    let mut means = [simd.splat_f32s(0.); N];
    for (scores, d_scores) in scores.chunks_exact_mut(row).zip(d_scores.chunks_exact(row)) {
        let (scores, d_scores) = (&mut scores[at..at + N], &d_scores[at..at + N]);
        for v in 0..N {
            let exponential = exp_vector(simd, simd.sub_f32s(scores[v], largest[v]));
            scores[v] = simd.mul_f32s(exponential, share[v]);
            means[v] = simd.mul_add_e_f32s(scores[v], d_scores[v], means[v]);
        }
    }
    for (scores, d_scores) in scores.chunks_exact(row).zip(d_scores.chunks_exact_mut(row)) {
        let (scores, d_scores) = (&scores[at..at + N], &mut d_scores[at..at + N]);
        for v in 0..N {
            let off = simd.sub_f32s(d_scores[v], means[v]);
            d_scores[v] = simd.mul_f32s(simd.mul_f32s(off, scores[v]), scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504. - 1.).collect()
    }

    /// From the definition, in f64.
    fn reference([l, n, width, heads]: [usize; 4], query: &[f32], key_value: &[f32]) -> Vec<f64> {
        let (head, mut gathered) = (width / heads, vec![0f64; l * width]);
        for row in 0..l {
            for h in 0..heads {
                let key = |key: usize, i: usize| f64::from(key_value[key * 2 * width + h * head + i]);
                let dot = |k: usize| (0..head).map(|i| f64::from(query[row * width + h * head + i]) * key(k, i)).sum();
                let scores: Vec<f64> = (0..n).map(|k: usize| -> f64 { dot(k) }).collect();
                let weights: Vec<f64> = scores.iter().map(|score| (score / (head as f64).sqrt()).exp()).collect();
                let whole: f64 = weights.iter().sum();
                for i in 0..head {
                    let sum: f64 = (0..n).map(|k| weights[k] / whole * key(k, width + i)).sum();
                    gathered[row * width + h * head + i] = sum;
                }
            }
        }
        gathered
    }

    #[test]
    fn a_softmax_of_large_and_of_equal_values_is_finite() {
        // Columns of 1000, 1000 and 1000 - ln 2, and of three times -1e4.
        for columns in [LINE, STRIP] {
            let rows = [1000., 1000., 1000. - 2f32.ln()];
            let mut scores: Vec<f32> =
                rows.iter().flat_map(|x| (0..columns).map(move |i| if i % 2 == 0 { *x } else { -1e4 })).collect();
            let (mut largest, mut share) = (vec![9.; columns], vec![9.; columns]);
            Arch::new().dispatch(Softmax { scores: &mut scores, largest: &mut largest, share: &mut share });
            for (i, score) in scores.iter().enumerate() {
                let wanted = match (i % 2, i / columns) {
                    (0, 0 | 1) => 0.4,
                    (0, _) => 0.2,
                    _ => 1. / 3.,
                };
                assert!((score * share[i % columns] - wanted).abs() < 1e-4, "{i}: {score}");
            }
        }
    }

    #[test]
    fn it_is_that_of_the_definition_and_its_adjoint_the_difference() {
        let (most, width, heads) = (9, 12, 3);
        // More queries than a strip has, and a last strip of one.
        for (l, n) in [(5, 9), (7, 4), (1, 1), (3, 0), (STRIP + 1, 7), (STRIP / 2 + 3, 2)] {
            let (query, key_value) = (values(l * width, 1), values(n * 2 * width, 2));
            let sizes = [l, n, width, heads];
            let attention = Attention { queries: l, width, heads };
            let (mut statistics, mut room) = (vec![9.; attention.statistics()], vec![9.; attention.room(most)]);
            let mut gathered = vec![9.; l * width];
            attention.forward(&query, &key_value, &mut gathered, &mut statistics, &mut room);
            for (found, wanted) in gathered.iter().zip(reference(sizes, &query, &key_value)) {
                assert!((f64::from(*found) - wanted).abs() < 1e-6, "{found} {wanted}");
            }
            let upstream = values(l * width, 3);
            let (mut d_query, mut d_key_value) = (vec![9.; l * width], vec![9.; n * 2 * width]);
            attention.adjoint(&query, &key_value, &upstream, &statistics, &mut d_query, &mut d_key_value, &mut room);
            let loss = |query: &[f32], key_value: &[f32]| -> f64 {
                let gathered = reference(sizes, query, key_value);
                gathered.iter().zip(&upstream).map(|(g, u)| g * f64::from(*u)).sum()
            };
            let moved = |values: &[f32], at: usize, by: f32| {
                let mut values = values.to_vec();
                values[at] += by;
                values
            };
            let by = 1. / 256.;
            for (i, found) in d_query.iter().enumerate() {
                let [up, down] = [by, -by].map(|by| loss(&moved(&query, i, by), &key_value));
                assert!(((up - down) / f64::from(2. * by) - f64::from(*found)).abs() < 1e-4, "query {i}");
            }
            for (i, found) in d_key_value.iter().enumerate() {
                let [up, down] = [by, -by].map(|by| loss(&query, &moved(&key_value, i, by)));
                assert!(((up - down) / f64::from(2. * by) - f64::from(*found)).abs() < 1e-4, "keys {i}");
            }
        }
    }
}
