//! The parts of the roll-out that work value by value, written so that the compiler makes vectors of
//! them: branch-free loops over slices of equal length, compiled once for each instruction set.

use gnp_nn::{sigmoid, tanh};
use pulp::{Arch, Simd, WithSimd};

use super::aligned::LINE;
use super::matmul::{Rows, RowsMut};

/// One step of an LSTM on `count` rows of `hidden` units.
///
/// `gates` `[count, 4 * hidden]` (input, forget, cell, output) holds the sums that enter the gates and
/// then what leaves them; `cell` `[count, hidden]` goes from the old value to the new.
pub(crate) fn lstm(count: usize, hidden: usize, gates: &mut [f32], cell: &mut [f32], h: RowsMut<'_>) {
    Arch::new().dispatch(LstmStep { count, hidden, gates, cell, h });
}

struct LstmStep<'a> {
    count: usize,
    hidden: usize,
    gates: &'a mut [f32],
    cell: &'a mut [f32],
    h: RowsMut<'a>,
}

impl WithSimd for LstmStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.hidden;
        for row in 0..self.count {
            let gates = &mut self.gates[4 * n * row..][..4 * n];
            let cell = &mut self.cell[n * row..][..n];
            let h = &mut self.h.data[self.h.stride * row..][..n];
            for j in (0..n).step_by(LINE) {
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (mut c, mut y) = (line(cell, j), [0.; LINE]);
                for l in 0..LINE {
                    i[l] = sigmoid(i[l]);
                    f[l] = sigmoid(f[l]);
                    g[l] = tanh(g[l]);
                    o[l] = sigmoid(o[l]);
                    c[l] = f[l] * c[l] + i[l] * g[l];
                    y[l] = o[l] * tanh(c[l]);
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
/// `after` are the cell's values around the step; `dh` is the gradient of the output, `dcell` goes from
/// the gradient of the new cell to that of the old.
pub(crate) fn lstm_adjoint(
    count: usize,
    hidden: usize,
    gates: &mut [f32],
    before: &[f32],
    after: &[f32],
    dh: Rows<'_>,
    dcell: &mut [f32],
) {
    Arch::new().dispatch(LstmAdjoint { count, hidden, gates, before, after, dh, dcell });
}

struct LstmAdjoint<'a> {
    count: usize,
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
        let n = self.hidden;
        for row in 0..self.count {
            let gates = &mut self.gates[4 * n * row..][..4 * n];
            let (before, after) = (&self.before[n * row..][..n], &self.after[n * row..][..n]);
            let dh = &self.dh.data[self.dh.stride * row..][..n];
            let dcell = &mut self.dcell[n * row..][..n];
            for j in (0..n).step_by(LINE) {
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (before, after, dh, mut dc) = (line(before, j), line(after, j), line(dh, j), line(dcell, j));
                for l in 0..LINE {
                    let bent = tanh(after[l]);
                    let d = dc[l] + dh[l] * o[l] * (1. - bent * bent);
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

/// Sets `gradient` to 0 wherever the rectified `value` is not positive; both `[count, width]`.
pub(crate) fn relu_adjoint(count: usize, width: usize, value: Rows<'_>, gradient: RowsMut<'_>) {
    Arch::new().dispatch(ReluAdjoint { count, width, value, gradient });
}

struct ReluAdjoint<'a> {
    count: usize,
    width: usize,
    value: Rows<'a>,
    gradient: RowsMut<'a>,
}

impl WithSimd for ReluAdjoint<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for row in 0..self.count {
            let value = &self.value.data[self.value.stride * row..][..self.width];
            let gradient = &mut self.gradient.data[self.gradient.stride * row..][..self.width];
            for (gradient, &value) in gradient.iter_mut().zip(value) {
                *gradient = if value > 0. { *gradient } else { 0. };
            }
        }
    }
}
