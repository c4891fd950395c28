//! Unsteady drivers: an acceleration that wanders.
use crate::{
    error::{ForceError, require_not_negative, require_positive},
    scalar::lit,
};
use nalgebra::RealField;

/// An Ornstein-Uhlenbeck process that adds to the acceleration along the road: normal with standard deviation `sigma`,
/// correlated over `correlation` s (Treiber and Kesting 2013, section 12.3).
///
/// The value at a step depends on the seed of the simulator, the vehicle's number and the steps before, and on nothing
/// else: other vehicles may come and go, on any number of threads.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Noise<T> {
    /// Standard deviation, in m/s²; typically 0.1 to 0.4.
    pub sigma: T,
    /// Time in which the correlation falls to 1/e, in s; typically 1 to 20.
    pub correlation: T,
}

impl<T: RealField + Copy> Noise<T> {
    /// Checks both numbers.
    ///
    /// # Errors
    /// [`ForceError::Value`] for the first that is not finite or out of its range.
    pub fn check(&self) -> Result<(), ForceError> {
        require_not_negative("noise.sigma", self.sigma)?;
        require_positive("noise.correlation", self.correlation)
    }

    /// The greatest value, in m/s².
    pub(crate) fn most(&self) -> T {
        self.sigma * lit(5.0)
    }

    /// The value after a step of `dt` s from `value`, in m/s², exact for any `dt`; `normal` is a draw. It is held at five
    /// standard deviations, so that every speed has a bound.
    pub(crate) fn after(&self, value: T, dt: T, normal: T) -> T {
        let kept = (-dt / self.correlation).exp();
        let next = value * kept + self.sigma * (T::one() - kept * kept).sqrt() * normal;
        next.max(-self.most()).min(self.most())
    }
}

/// A standard normal number for this seed, vehicle and step: SplitMix64 (Steele, Lea and Flood 2014) as a hash, then Box
/// and Muller.
pub(crate) fn normal<T: RealField + Copy>(seed: u64, vehicle: u64, step: u64) -> T {
    let key = mix(seed ^ mix(vehicle ^ mix(step)));
    let (first, second) = (uniform(mix(key.wrapping_add(1))), uniform(mix(key.wrapping_add(2))));
    lit((-2.0 * first.ln()).sqrt() * (std::f64::consts::TAU * second).cos())
}

/// A number in (0, 1] from 53 bits.
pub(crate) fn uniform(bits: u64) -> f64 {
    ((bits >> 11) + 1) as f64 / (1u64 << 53) as f64
}

/// The finaliser of SplitMix64.
pub(crate) fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_process_has_the_stated_spread_and_memory() {
        let noise = Noise { sigma: 0.3, correlation: 2.0 };
        let (dt, steps) = (0.1, 200_000);
        let mut values = Vec::with_capacity(steps as usize);
        let mut value = 0.0_f64;
        for step in 0..steps {
            value = noise.after(value, dt, normal(7, 3, step));
            values.push(value);
        }
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / f64::from(steps as u32);
        let centre = mean(&mut values.iter().copied());
        let variance = mean(&mut values.iter().map(|value| value * value));
        let lagged = mean(&mut values.iter().zip(&values[20..]).map(|(a, b)| a * b));
        assert!(centre.abs() < 0.02, "{centre}");
        assert!((variance.sqrt() - 0.3).abs() < 0.01, "{variance}");
        assert!((lagged / variance - (-1.0_f64).exp()).abs() < 0.03, "{}", lagged / variance);
    }

    #[test]
    fn seeds_vehicles_and_steps_draw_apart() {
        let draws = [normal::<f64>(1, 1, 1), normal(2, 1, 1), normal(1, 2, 1), normal(1, 1, 2), normal(0, 0, 0)];
        for (i, a) in draws.iter().enumerate() {
            assert!(a.is_finite() && draws[..i].iter().all(|b| (a - b).abs() > 1e-9), "{draws:?}");
        }
    }
}
