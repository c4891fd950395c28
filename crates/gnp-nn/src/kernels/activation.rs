//! Exponential and what is made of it, without a branch: called in a loop over values, the compiler
//! makes vectors of them, for whatever instruction set the loop is compiled for.

/// `exp(x)` to 2e-7, for `x` between -87 and 88; beyond, the value at the nearer end.
#[inline(always)]
#[must_use]
pub fn exp(x: f32) -> f32 {
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
#[must_use]
pub fn sigmoid(x: f32) -> f32 {
    1. / (1. + exp(-x))
}

/// `tanh(x)`, to 1e-7 of 1.
#[inline(always)]
#[must_use]
pub fn tanh(x: f32) -> f32 {
    2. / (1. + exp(-2. * x)) - 1.
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
