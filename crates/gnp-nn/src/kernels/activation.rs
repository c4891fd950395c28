//! Exponential and what is made of it, without a branch: called in a loop over values, the compiler
//! makes vectors of them, for whatever instruction set the loop is compiled for.

/// `exp(x)` to 2e-7, for `x` between -87 and 88; beyond, the value at the nearer end.
#[inline(always)]
#[must_use]
pub fn exp(x: f32) -> f32 {
    scaled(x, |r| {
        let tail = 1.987_569_1e-4;
        let tail = tail * r + 1.398_199_9e-3;
        let tail = tail * r + 8.333_452e-3;
        let tail = tail * r + 4.166_579_6e-2;
        let tail = tail * r + 1.666_666_5e-1;
        let tail = tail * r + 0.5;
        tail * r * r + r + 1.
    })
}

/// `exp(x)` for `x` of 0 and below, to 2.5e-7; 0 below -87. The softmax of the goal network has this series,
/// and its published scores are these bits; else [`exp`] would serve.
#[inline(always)]
pub(crate) fn exp_or_zero(x: f32) -> f32 {
    let value = scaled(x, |r| {
        let series = [1. / 720., 1. / 120., 1. / 24., 1. / 6., 0.5, 1., 1f32];
        series[1..].iter().fold(series[0], |e, c| e * r + c)
    });
    if x < -87. { 0. } else { value }
}

/// `series(r)` times a power of two, where `x = n ln 2 + r` with `|r|` at most half of `ln 2`.
#[inline(always)]
fn scaled(x: f32, series: impl Fn(f32) -> f32) -> f32 {
    // Adding this number rounds to a whole one, which then stands in the low bits.
    const ROUND: f32 = 12_582_912.;
    // ln 2 in two parts, the first with few bits, so that its product with the power is exact.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87., 88.);
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let power = rounded - ROUND;
    let r = x - power * LN2_HIGH - power * LN2_LOW;
    let exponent = rounded.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    series(r) * f32::from_bits(exponent)
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
            assert!((f64::from(tanh(x)) - f64::from(x).tanh()).abs() < 2e-7, "tanh({x})");
            assert!((f64::from(sigmoid(x)) - 1. / (1. + (-f64::from(x)).exp())).abs() < 1e-7, "sigmoid({x})");
        }
        assert_eq!((tanh(1e9), tanh(-1e9), sigmoid(1e9)), (1., -1., 1.));
        assert!(sigmoid(-1e9) < 1e-30);
    }
}
