//! One step of an LSTM value by value: branch-free loops that the compiler makes vectors of, compiled
//! once for each instruction set.

use gnp_nn::{sigmoid, tanh};
use pulp::{Arch, Simd, WithSimd};

/// Values of a cache line; the number of hidden units is a multiple of it.
pub(crate) const LINE: usize = 16;

/// A cache line by itself, which cannot overlap with one that is written.
#[inline(always)]
fn line(values: &[f32], at: usize) -> [f32; LINE] {
    let mut line = [0.; LINE];
    line.copy_from_slice(&values[at..at + LINE]);
    line
}

/// `sum += more`, value by value.
pub(crate) fn add(sum: &mut [f32], more: &[f32]) {
    struct Add<'a>(&'a mut [f32], &'a [f32]);
    impl WithSimd for Add<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            for (sum, more) in self.0.iter_mut().zip(self.1) {
                *sum += more;
            }
        }
    }
    Arch::new().dispatch(Add(sum, more));
}

/// One step on rows of `hidden` units. `gates` `[rows, 4 * hidden]` (input, forget, cell, output) holds
/// what enters the gates and then what leaves them; `cells` goes from the old values to the new.
pub(crate) fn step(hidden: usize, gates: &mut [f32], cells: &mut [f32], h: &mut [f32]) {
    Arch::new().dispatch(Step { hidden, gates, cells, h });
}

struct Step<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    cells: &'a mut [f32],
    h: &'a mut [f32],
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.hidden;
        let rows = self.gates.chunks_exact_mut(4 * n).zip(self.cells.chunks_exact_mut(n));
        for ((gates, cells), h) in rows.zip(self.h.chunks_exact_mut(n)) {
            for j in (0..n).step_by(LINE) {
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (mut c, mut y) = (line(cells, j), [0.; LINE]);
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
                cells[j..][..LINE].copy_from_slice(&c);
                h[j..][..LINE].copy_from_slice(&y);
            }
        }
    }
}

/// The adjoint of [`step`]: `gates` holds what left the gates and then the gradients of what entered
/// them; `before` and `after` are the cells around the step, `dh` the gradient of its output; `dcells`
/// goes from the gradient of the new cells to that of the old.
pub(crate) fn step_adjoint(
    hidden: usize,
    gates: &mut [f32],
    before: &[f32],
    after: &[f32],
    dh: &[f32],
    dcells: &mut [f32],
) {
    Arch::new().dispatch(Adjoint { hidden, gates, before, after, dh, dcells });
}

struct Adjoint<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    before: &'a [f32],
    after: &'a [f32],
    dh: &'a [f32],
    dcells: &'a mut [f32],
}

impl WithSimd for Adjoint<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.hidden;
        for (row, gates) in self.gates.chunks_exact_mut(4 * n).enumerate() {
            for j in (0..n).step_by(LINE) {
                let at = row * n + j;
                let [mut i, mut f, mut g, mut o] = [0, 1, 2, 3].map(|gate| line(gates, gate * n + j));
                let (before, after) = (line(self.before, at), line(self.after, at));
                let (dh, mut dc) = (line(self.dh, at), line(self.dcells, at));
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
                self.dcells[at..][..LINE].copy_from_slice(&dc);
            }
        }
    }
}
