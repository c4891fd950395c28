//! The parts of the roll-out that work value by value, written so that the compiler makes vectors of
//! them: branch-free loops over slices of equal length, compiled once for each instruction set.

use pulp::{Arch, Simd, WithSimd};

use super::matmul::{Rows, RowsMut};

/// `exp(x)` to 2e-7, for `x` between -87 and 88; beyond, the value at the nearer end.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // Adding this number rounds to a whole one, which then stands in the low bits.
    const ROUND: f32 = 12_582_912.;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87., 88.);
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let power = rounded - ROUND;
    let r = x - power * LN2_HIGH - power * LN2_LOW;
    let tail = 1.987_569_1e-4;
    let tail = tail * r + 1.398_199_9e-3;
    let tail = tail * r + 8.333_452e-3;
    let tail = tail * r + 4.166_579_6e-2;
    let tail = tail * r + 1.666_666_5e-1;
    let tail = tail * r + 0.5;
    let mantissa = tail * r * r + r + 1.;
    let exponent = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    mantissa * f32::from_bits(exponent)
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1. / (1. + exp(-x))
}

/// `tanh(x)`, to 1e-7 of 1.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    2. / (1. + exp(-2. * x)) - 1.
}

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
            let (input, rest) = self.gates[4 * n * row..][..4 * n].split_at_mut(n);
            let (forget, rest) = rest.split_at_mut(n);
            let (fresh, output) = rest.split_at_mut(n);
            let (forget, fresh, output) = (&mut forget[..n], &mut fresh[..n], &mut output[..n]);
            let cell = &mut self.cell[n * row..][..n];
            let h = &mut self.h.data[self.h.stride * row..][..n];
            for j in 0..n {
                input[j] = sigmoid(input[j]);
                forget[j] = sigmoid(forget[j]);
                fresh[j] = tanh(fresh[j]);
                output[j] = sigmoid(output[j]);
                cell[j] = forget[j] * cell[j] + input[j] * fresh[j];
                h[j] = output[j] * tanh(cell[j]);
            }
        }
    }
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
            let (input, rest) = self.gates[4 * n * row..][..4 * n].split_at_mut(n);
            let (forget, rest) = rest.split_at_mut(n);
            let (fresh, output) = rest.split_at_mut(n);
            let (forget, fresh, output) = (&mut forget[..n], &mut fresh[..n], &mut output[..n]);
            let (before, after) = (&self.before[n * row..][..n], &self.after[n * row..][..n]);
            let dh = &self.dh.data[self.dh.stride * row..][..n];
            let dcell = &mut self.dcell[n * row..][..n];
            for j in 0..n {
                let bent = tanh(after[j]);
                let dc = dcell[j] + dh[j] * output[j] * (1. - bent * bent);
                let (i, f, g, o) = (input[j], forget[j], fresh[j], output[j]);
                input[j] = dc * g * i * (1. - i);
                forget[j] = dc * before[j] * f * (1. - f);
                fresh[j] = dc * i * (1. - g * g);
                output[j] = dh[j] * bent * o * (1. - o);
                dcell[j] = dc * f;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_exact_to_rounding_and_finite_far_out() {
        for i in -8700..=8700 {
            let x = i as f32 / 100.;
            let (found, wanted) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found / wanted - 1.).abs() < 3e-7, "exp({x}) = {found}, wanted {wanted}");
        }
        assert!(exp(1e30).is_finite() && exp(-1e30) > 0. && exp(f32::NAN).is_nan());
    }

    #[test]
    fn sigmoid_and_tanh_saturate_at_their_ends() {
        for i in -300..=300 {
            let x = i as f32 / 10.;
            assert!((f64::from(tanh(x)) - f64::from(x).tanh()).abs() < 2e-7, "tanh({x})");
            assert!((f64::from(sigmoid(x)) - 1. / (1. + (-f64::from(x)).exp())).abs() < 1e-7, "sigmoid({x})");
        }
        assert_eq!((tanh(1e9), tanh(-1e9), sigmoid(1e9)), (1., -1., 1.));
        assert!(sigmoid(-1e9) < 1e-30);
    }
}
