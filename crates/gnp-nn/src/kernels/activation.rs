//! Exponential and what is made of it, without a branch: called in a loop over values, the compiler
//! makes vectors of them, for whatever instruction set the loop is compiled for.

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

/// `exp(x)` to 2e-7, for `x` between -87 and 88; beyond, the value at the nearer end.
#[inline(always)]
#[must_use]
pub fn exp(x: f32) -> f32 {
    exp_of::<false>(x)
}

/// [`exp`], with fused instructions or without.
#[inline(always)]
pub(crate) fn exp_of<const FUSED: bool>(x: f32) -> f32 {
    scaled::<FUSED>(x, |r| {
        let tail = 1.987_569_1e-4;
        let tail = mul_add::<FUSED>(tail, r, 1.398_199_9e-3);
        let tail = mul_add::<FUSED>(tail, r, 8.333_452e-3);
        let tail = mul_add::<FUSED>(tail, r, 4.166_579_6e-2);
        let tail = mul_add::<FUSED>(tail, r, 1.666_666_5e-1);
        let tail = mul_add::<FUSED>(tail, r, 0.5);
        mul_add::<FUSED>(tail * r, r, r) + 1.
    })
}

/// `exp(x)` for `x` of 0 and below, to 2.5e-7; 0 below -87. The softmax of the goal network has this series,
/// and its published scores are these bits; else [`exp`] would serve.
#[inline(always)]
pub(crate) fn exp_or_zero(x: f32) -> f32 {
    let value = scaled::<false>(x, |r| {
        let series = [1. / 720., 1. / 120., 1. / 24., 1. / 6., 0.5, 1., 1f32];
        series[1..].iter().fold(series[0], |e, c| e * r + c)
    });
    if x < -87. { 0. } else { value }
}

/// `series(r)` times a power of two, where `x = n ln 2 + r` with `|r|` at most half of `ln 2`.
#[inline(always)]
fn scaled<const FUSED: bool>(x: f32, series: impl Fn(f32) -> f32) -> f32 {
    // Adding this number rounds to a whole one, which then stands in the low bits.
    const ROUND: f32 = 12_582_912.;
    // ln 2 in two parts, the first with few bits, so that its product with the power is exact.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87., 88.);
    let rounded = mul_add::<FUSED>(x, std::f32::consts::LOG2_E, ROUND);
    let power = rounded - ROUND;
    let r = mul_add::<FUSED>(power, -LN2_LOW, mul_add::<FUSED>(power, -LN2_HIGH, x));
    let exponent = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    series(r) * f32::from_bits(exponent)
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
    fn the_exponential_of_a_softmax_is_exact_to_rounding_and_ends_in_zero() {
        for i in 0..87_000 {
            let x = -(i as f32) * 1e-3;
            let (found, wanted) = (f64::from(exp_or_zero(x)), f64::from(x).exp());
            assert!((found / wanted - 1.).abs() < 2.5e-7, "exp({x}) = {found}, wanted {wanted}");
        }
        assert_eq!([exp_or_zero(-87.1), exp_or_zero(f32::MIN), exp_or_zero(0.)], [0., 0., 1.]);
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
