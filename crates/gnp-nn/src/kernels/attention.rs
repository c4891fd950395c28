//! Multi-head attention of one window, all of it in the cache.

use super::aligned::padded;
use super::matmul::{Rows, RowsMut, Start, matmul, matmul_transposed};
use super::rows::{softmax, softmax_adjoint, transpose};

/// Scaled dot-product attention of some queries to some keys, with the room it works in: what
/// [`Attention::forward`] leaves there is what [`Attention::adjoint`] needs.
#[derive(Clone, Debug)]
pub struct Attention {
    queries: usize,
    width: usize,
    heads: usize,
    /// One head's keys or values, transposed, `[width / heads, padded keys]`.
    turned: Vec<f32>,
    /// Attention weights `[heads, queries, padded keys]`; of one head only without an adjoint.
    weights: Vec<f32>,
    /// Gradients of one head's scores `[queries, padded keys]`; empty without an adjoint.
    scores: Vec<f32>,
}

impl Attention {
    /// Room for `queries` queries and up to `keys` keys of `width` values, a multiple of `heads`.
    #[must_use]
    pub fn new([queries, keys, width, heads]: [usize; 4], adjoint: bool) -> Self {
        let (room, scores) = (|n: usize| vec![0f32; n], queries * padded(keys));
        Self {
            queries,
            width,
            heads,
            turned: room(width / heads.max(1) * padded(keys)),
            weights: room(if adjoint { heads * scores } else { scores }),
            scores: room(if adjoint { scores } else { 0 }),
        }
    }

    fn head(&self) -> usize {
        self.width / self.heads.max(1)
    }

    /// Factor of the scores.
    fn scale(&self) -> f32 {
        1. / (self.head() as f32).sqrt()
    }

    /// What each `query` `[queries, width]` gathers, into `gathered` `[queries, width]`; without any key,
    /// zeros. A row of `key_value` `[keys, 2 * width]` is a key and then its value.
    pub fn forward(&mut self, query: &[f32], key_value: &[f32], gathered: &mut [f32]) {
        let (l, width, head, scale) = (self.queries, self.width, self.head(), self.scale());
        let n = key_value.len() / (2 * width).max(1);
        if n == 0 {
            return gathered.fill(0.);
        }
        let wide = padded(n);
        let kept = if self.scores.is_empty() { 0 } else { l * wide };
        for h in 0..self.heads {
            let at = h * head;
            let weights = &mut self.weights[h * kept..][..l * wide];
            transpose(&mut self.turned, wide, &key_value[at..], 2 * width, [n, head], scale);
            let (query, keys) = (Rows::new(&query[at..], width), Rows::new(&self.turned, wide));
            matmul([l, head, wide], query, keys, Start::Zero, RowsMut::new(weights, wide));
            softmax(weights, wide, n);
            let (weights, values) = (Rows::new(weights, wide), Rows::new(&key_value[width + at..], 2 * width));
            matmul([l, n, head], weights, values, Start::Zero, RowsMut::new(&mut gathered[at..], width));
        }
    }

    /// After [`Attention::forward`] on the same `query` and `key_value`: their gradients, into `d_query` and
    /// `d_key_value`, from that of what was gathered.
    pub fn adjoint(
        &mut self,
        query: &[f32],
        key_value: &[f32],
        d_gathered: &[f32],
        d_query: &mut [f32],
        d_key_value: &mut [f32],
    ) {
        let (l, width, head, scale) = (self.queries, self.width, self.head(), self.scale());
        let n = key_value.len() / (2 * width).max(1);
        if n == 0 {
            return d_query.fill(0.);
        }
        let wide = padded(n);
        for h in 0..self.heads {
            let at = h * head;
            let (weights, scores) = (&self.weights[h * l * wide..][..l * wide], &mut self.scores[..l * wide]);
            let d_gathered = Rows::new(&d_gathered[at..], width);
            let d_values = RowsMut::new(&mut d_key_value[width + at..], 2 * width);
            matmul_transposed([n, l, head], Rows::new(weights, wide), d_gathered, Start::Zero, d_values);
            transpose(&mut self.turned, wide, &key_value[width + at..], 2 * width, [n, head], 1.);
            let values = Rows::new(&self.turned, wide);
            matmul([l, head, wide], d_gathered, values, Start::Zero, RowsMut::new(scores, wide));
            softmax_adjoint(scores, weights, wide, scale);
            let (scores, keys) = (Rows::new(scores, wide), Rows::new(&key_value[at..], 2 * width));
            matmul([l, n, head], scores, keys, Start::Zero, RowsMut::new(&mut d_query[at..], width));
            let d_keys = RowsMut::new(&mut d_key_value[at..], 2 * width);
            matmul_transposed([n, l, head], scores, Rows::new(&query[at..], width), Start::Zero, d_keys);
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
    fn it_is_that_of_the_definition_and_its_adjoint_the_difference() {
        let (most, width, heads) = (9, 12, 3);
        for (l, n) in [(5, 9), (7, 4), (1, 1), (3, 0)] {
            let (query, key_value) = (values(l * width, 1), values(n * 2 * width, 2));
            let sizes = [l, n, width, heads];
            for adjoint in [false, true] {
                let mut gathered = vec![9.; l * width];
                Attention::new([l, most, width, heads], adjoint).forward(&query, &key_value, &mut gathered);
                for (found, wanted) in gathered.iter().zip(reference(sizes, &query, &key_value)) {
                    assert!((f64::from(*found) - wanted).abs() < 1e-6, "{found} {wanted}");
                }
            }
            let (upstream, mut gathered) = (values(l * width, 3), vec![0.; l * width]);
            let (mut d_query, mut d_key_value) = (vec![9.; l * width], vec![9.; n * 2 * width]);
            let mut attention = Attention::new([l, most, width, heads], true);
            attention.forward(&query, &key_value, &mut gathered);
            attention.adjoint(&query, &key_value, &upstream, &mut d_query, &mut d_key_value);
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
