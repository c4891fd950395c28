//! One step of an LSTM value by value: branch-free loops that the compiler makes vectors of, compiled
//! once for each instruction set.

use pulp::{Arch, Simd, WithSimd};

use super::activation::{fuses, mul_add, sigmoid_of, tanh_of};
use super::aligned::LINE;
use super::matmul::{Rows, RowsMut};

/// One step of an LSTM on rows of `hidden` units, a multiple of [`LINE`].
///
/// `gates` `[rows, 4 * hidden]` (input, forget, cell, output) holds the sums that enter the gates and
/// then what leaves them; `cell` `[rows, hidden]` goes from the old value to the new; `h` `[rows, hidden]`
/// receives the output.
pub fn lstm(hidden: usize, gates: &mut [f32], cell: &mut [f32], h: RowsMut<'_>) {
    Arch::new().dispatch(LstmStep { hidden, gates, cell, h });
}

struct LstmStep<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    cell: &'a mut [f32],
    h: RowsMut<'a>,
}

impl WithSimd for LstmStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if fuses::<S>() { self.run::<true>() } else { self.run::<false>() }
    }
}

impl LstmStep<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let n = self.hidden;
        for (row, gates) in self.gates.chunks_exact_mut(4 * n).enumerate() {
            let cell = &mut self.cell[n * row..][..n];
            let h = &mut self.h.data[self.h.stride * row..][..n];
            for j in (0..n).step_by(LINE) {
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (mut c, mut y) = (line(cell, j), [0.; LINE]);
                for l in 0..LINE {
                    i[l] = sigmoid_of::<FUSED>(i[l]);
                    f[l] = sigmoid_of::<FUSED>(f[l]);
                    g[l] = tanh_of::<FUSED>(g[l]);
                    o[l] = sigmoid_of::<FUSED>(o[l]);
                    c[l] = mul_add::<FUSED>(f[l], c[l], i[l] * g[l]);
                    y[l] = o[l] * tanh_of::<FUSED>(c[l]);
                }
                for (gate, values) in [i, f, g, o].iter().enumerate() {
                    gates[gate * n + j..][..LINE].copy_from_slice(values);
                }
                cell[j..][..LINE].copy_from_slice(&c);
                h[j..][..LINE].copy_from_slice(&y);
            }
        }
    }
}

/// A cache line of values by themselves, which cannot overlap with others that are written.
#[inline(always)]
fn line(values: &[f32], at: usize) -> [f32; LINE] {
    let mut line = [0.; LINE];
    line.copy_from_slice(&values[at..at + LINE]);
    line
}

/// The adjoint of [`lstm`].
///
/// `gates` holds what left the gates and then the gradients of what entered them; `before` and
/// `after` are the cell's values around the step, `[rows, hidden]`; `dh` is the gradient of the output,
/// `dcell` goes from the gradient of the new cell to that of the old.
pub fn lstm_adjoint(hidden: usize, gates: &mut [f32], before: &[f32], after: &[f32], dh: Rows<'_>, dcell: &mut [f32]) {
    Arch::new().dispatch(LstmAdjoint { hidden, gates, before, after, dh, dcell });
}

struct LstmAdjoint<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    before: &'a [f32],
    after: &'a [f32],
    dh: Rows<'a>,
    dcell: &'a mut [f32],
}

impl WithSimd for LstmAdjoint<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if fuses::<S>() { self.run::<true>() } else { self.run::<false>() }
    }
}

impl LstmAdjoint<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let n = self.hidden;
        for (row, gates) in self.gates.chunks_exact_mut(4 * n).enumerate() {
            let (before, after) = (&self.before[n * row..][..n], &self.after[n * row..][..n]);
            let dh = &self.dh.data[self.dh.stride * row..][..n];
            let dcell = &mut self.dcell[n * row..][..n];
            for j in (0..n).step_by(LINE) {
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (before, after, dh, mut dc) = (line(before, j), line(after, j), line(dh, j), line(dcell, j));
                for l in 0..LINE {
                    let bent = tanh_of::<FUSED>(after[l]);
                    let d = mul_add::<FUSED>(dh[l] * o[l], 1. - bent * bent, dc[l]);
                    dc[l] = d * f[l];
                    o[l] = dh[l] * bent * o[l] * (1. - o[l]);
                    f[l] = d * before[l] * f[l] * (1. - f[l]);
                    let (input, fresh) = (i[l], g[l]);
                    i[l] = d * fresh * input * (1. - input);
                    g[l] = d * input * (1. - fresh * fresh);
                }
                for (gate, values) in [i, f, g, o].iter().enumerate() {
                    gates[gate * n + j..][..LINE].copy_from_slice(values);
                }
                dcell[j..][..LINE].copy_from_slice(&dc);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 3;
    const HIDDEN: usize = 2 * LINE;
    /// Outputs lie among other values.
    const STRIDE: usize = HIDDEN + 5;

    fn values(count: usize, seed: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 336. - 1.5).collect()
    }

    /// Output and cell of unit `j` of a row, in f64.
    fn reference(gates: &[f64], cell: &[f64], j: usize) -> (f64, f64) {
        let sigmoid = |x: f64| 1. / (1. + (-x).exp());
        let gate = |gate: usize| gates[gate * HIDDEN + j];
        let c = sigmoid(gate(1)) * cell[j] + sigmoid(gate(0)) * gate(2).tanh();
        (sigmoid(gate(3)) * c.tanh(), c)
    }

    fn wide(values: &[f32]) -> Vec<f64> {
        values.iter().copied().map(f64::from).collect()
    }

    #[test]
    fn a_step_is_that_of_the_definition_and_its_adjoint_the_difference() {
        let (sums, old) = (values(ROWS * 4 * HIDDEN, 1), values(ROWS * HIDDEN, 2));
        let (mut gates, mut cell, mut h) = (sums.clone(), old.clone(), vec![9.; ROWS * STRIDE]);
        lstm(HIDDEN, &mut gates, &mut cell, RowsMut::new(&mut h, STRIDE));

        let (dh, dc) = (values(ROWS * STRIDE, 3), values(ROWS * HIDDEN, 4));
        let (mut dgates, mut dcell) = (gates.clone(), dc.clone());
        lstm_adjoint(HIDDEN, &mut dgates, &old, &cell, Rows::new(&dh, STRIDE), &mut dcell);

        for row in 0..ROWS {
            assert!(h[row * STRIDE..][HIDDEN..STRIDE].iter().all(|v| *v == 9.));
            let (sums, old) = (wide(&sums[row * 4 * HIDDEN..][..4 * HIDDEN]), wide(&old[row * HIDDEN..][..HIDDEN]));
            for j in 0..HIDDEN {
                let (y, c) = reference(&sums, &old, j);
                assert!((f64::from(h[row * STRIDE + j]) - y).abs() < 1e-6);
                assert!((f64::from(cell[row * HIDDEN + j]) - c).abs() < 1e-6);
                // What the gradients are gradients of.
                let loss = |sums: &[f64], old: &[f64]| {
                    let (y, c) = reference(sums, old, j);
                    y * f64::from(dh[row * STRIDE + j]) + c * f64::from(dc[row * HIDDEN + j])
                };
                let moved = |values: &[f64], at: usize, by: f64| {
                    let mut values = values.to_vec();
                    values[at] += by;
                    values
                };
                for gate in 0..4 {
                    let at = gate * HIDDEN + j;
                    let wanted = (loss(&moved(&sums, at, 1e-5), &old) - loss(&moved(&sums, at, -1e-5), &old)) / 2e-5;
                    assert!((f64::from(dgates[row * 4 * HIDDEN + at]) - wanted).abs() < 1e-5, "gate {gate}");
                }
                let wanted = (loss(&sums, &moved(&old, j, 1e-5)) - loss(&sums, &moved(&old, j, -1e-5))) / 2e-5;
                assert!((f64::from(dcell[row * HIDDEN + j]) - wanted).abs() < 1e-5);
            }
        }
    }
}
