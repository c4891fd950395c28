//! Exponential and what is made of it, without a branch: called in a loop over values, the compiler
//! makes vectors of them, for whatever instruction set the loop is compiled for. [`exp_vector`] takes vectors as they are.

use pulp::Simd;

/// Whether vectors of that kind multiply and add in one instruction. Without it, a loop over [`f32::mul_add`] calls
/// a function for every value.
#[inline(always)]
pub(crate) fn fuses<S: Simd>() -> bool {
    size_of::<S::f32s>() > size_of::<f32>()
}

/// `a * b + c`, in one instruction and one rounding if `FUSED`.
#[inline(always)]
pub(crate) fn mul_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Adding this number rounds to a whole one, which then stands in the low bits.
const ROUND: f32 = 12_582_912.;
/// ln 2 in two parts, the first with few bits, so that its product with the power is exact.
const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;
/// `(exp(r) - 1 - r) / r²` for `|r|` up to half of ln 2, highest power first.
const SERIES: [f32; 6] = [1.987_569_1e-4, 1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5];

/// `exp(x)` to 2e-7, for `x` between -87 and 88; beyond, the value at the nearer end.
#[inline(always)]
#[must_use]
pub fn exp(x: f32) -> f32 {
    exp_of::<false>(x)
}

/// [`exp`], with fused instructions or without.
#[inline(always)]
pub(crate) fn exp_of<const FUSED: bool>(x: f32) -> f32 {
    let x = x.clamp(-87., 88.);
    let rounded = mul_add::<FUSED>(x, std::f32::consts::LOG2_E, ROUND);
    let power = rounded - ROUND;
    let r = mul_add::<FUSED>(power, -LN2_LOW, mul_add::<FUSED>(power, -LN2_HIGH, x));
    let exponent = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    let tail = SERIES[1..].iter().fold(SERIES[0], |tail, c| mul_add::<FUSED>(tail, r, *c));
    (mul_add::<FUSED>(tail * r, r, r) + 1.) * f32::from_bits(exponent)
}

/// [`exp`] of each value for `x` up to 88, with fused multiply-adds where the processor has them; of bad values, bad ones.
#[inline(always)]
pub(crate) fn exp_vector<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let splat = |value| simd.splat_f32s(value);
    let least = splat(-87.);
    // `max` would turn NaN into a number on some processors.
    let x = simd.select_f32s(simd.less_than_f32s(x, least), least, x);
    let rounded = simd.mul_add_e_f32s(x, splat(std::f32::consts::LOG2_E), splat(ROUND));
    let power = simd.sub_f32s(rounded, splat(ROUND));
    let r = simd.mul_add_e_f32s(power, splat(-LN2_HIGH), x);
    let r = simd.mul_add_e_f32s(power, splat(-LN2_LOW), r);
    let bias = simd.splat_u32s(127u32.wrapping_sub(ROUND.to_bits()));
    let exponent = simd.add_u32s(simd.transmute_u32s_f32s(rounded), bias);
    let factor = simd.transmute_f32s_u32s(simd.wrapping_dyn_shl_u32s(exponent, simd.splat_u32s(23)));
    let tail = SERIES[1..].iter().fold(splat(SERIES[0]), |tail, c| simd.mul_add_e_f32s(tail, r, splat(*c)));
    let series = simd.add_f32s(simd.mul_add_e_f32s(simd.mul_f32s(tail, r), r, r), splat(1.));
    simd.mul_f32s(series, factor)
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
#[must_use]
pub fn sigmoid(x: f32) -> f32 {
    sigmoid_of::<false>(x)
}

/// [`sigmoid`], with fused instructions or without.
#[inline(always)]
pub(crate) fn sigmoid_of<const FUSED: bool>(x: f32) -> f32 {
    1. / (1. + exp_of::<FUSED>(-x))
}

/// `tanh(x)`, to 1e-7 of 1.
#[inline(always)]
#[must_use]
pub fn tanh(x: f32) -> f32 {
    tanh_of::<false>(x)
}

/// [`tanh`], with fused instructions or without.
#[inline(always)]
pub(crate) fn tanh_of<const FUSED: bool>(x: f32) -> f32 {
    2. / (1. + exp_of::<FUSED>(-2. * x)) - 1.
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    #[test]
    fn the_exponential_is_exact_to_rounding_and_finite_far_out() {
        for i in -8700..=8700 {
            let x = i as f32 / 100.;
            for found in [exp(x), exp_of::<true>(x)] {
                let (found, wanted) = (f64::from(found), f64::from(x).exp());
                assert!((found / wanted - 1.).abs() < 3e-7, "exp({x}) = {found}, wanted {wanted}");
            }
        }
        assert!(exp(1e30).is_finite() && exp(-1e30) > 0. && exp(f32::NAN).is_nan());
    }

    #[test]
    fn the_exponential_of_vectors_is_that_of_values() {
        struct Run<'a>(&'a mut [f32]);
        impl WithSimd for Run<'_> {
            type Output = ();
            fn with_simd<S: Simd>(self, simd: S) {
                for x in S::as_mut_simd_f32s(self.0).0 {
                    *x = exp_vector(simd, *x);
                }
            }
        }
        let given: Vec<f32> = (-87 * 16..=88 * 16).map(|i| i as f32 / 16.).chain([f32::NAN; 15]).collect();
        let mut widest = given.clone();
        Arch::new().dispatch(Run(&mut widest));
        let mut one = given.clone();
        pulp::Scalar.vectorize(Run(&mut one));
        let whole = given.len() / 16 * 16;
        for found in [&widest[..whole], &one[..whole]] {
            for (x, found) in given.iter().zip(found) {
                let off = f64::from(*found) / f64::from(*x).exp() - 1.;
                assert!(off.abs() < 3e-7 || (x.is_nan() && found.is_nan()), "exp({x}) = {found}");
            }
        }
        let mut far = [-1e30; 16];
        Arch::new().dispatch(Run(&mut far));
        assert!(far.iter().all(|x| (0. ..1e-37).contains(x)), "{far:?}");
    }

    #[test]
    fn sigmoid_and_tanh_saturate_at_their_ends() {
        for i in -300..=300 {
            let x = i as f32 / 10.;
            for (tanh, sigmoid) in [(tanh(x), sigmoid(x)), (tanh_of::<true>(x), sigmoid_of::<true>(x))] {
                assert!((f64::from(tanh) - f64::from(x).tanh()).abs() < 2e-7, "tanh({x})");
                assert!((f64::from(sigmoid) - 1. / (1. + (-f64::from(x)).exp())).abs() < 1e-7, "sigmoid({x})");
            }
        }
        assert_eq!((tanh(1e9), tanh(-1e9), sigmoid(1e9)), (1., -1., 1.));
        assert!(sigmoid(-1e9) < 1e-30);
    }
}
