//! Gradients of the rules, for drivers that are fitted to recordings.
//!
//! What is differentiated is what the code computes. At a kink, such as a limit that is just reached, the gradient is that
//! of the side on which the argument no longer matters: 0.
mod following;
mod motorway;
mod published;

use super::{Ego, Limits, Other, PATH_MARGIN, PairRule, Place, in_path};
use crate::{error::ForceError, scalar::lit, state::StateGradient};
use nalgebra::{RealField, Vector2};

/// Gradient of a number with respect to an [`Ego`]; sizes and limits are constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EgoGradient<T: RealField> {
    /// With respect to its position and velocity.
    pub state: StateGradient<T>,
    /// With respect to the speed wished for.
    pub wish: T,
    /// With respect to the relaxation time.
    pub tau: T,
}

/// Gradient of a number with respect to the two vehicles of [`PairRule::push`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushGradient<T: RealField> {
    /// With respect to the vehicle that is pushed.
    pub me: EgoGradient<T>,
    /// With respect to position and velocity of the other one.
    pub other: StateGradient<T>,
}

impl<T: RealField + Copy> EgoGradient<T> {
    /// That of a number which does not depend on the vehicle.
    #[inline]
    #[must_use]
    pub fn zeros() -> Self {
        Self { state: StateGradient::zeros(), wish: T::zero(), tau: T::zero() }
    }
}

impl<T: RealField + Copy> PushGradient<T> {
    /// That of a number which does not depend on either vehicle.
    #[inline]
    #[must_use]
    pub fn zeros() -> Self {
        Self { me: EgoGradient::zeros(), other: StateGradient::zeros() }
    }

    /// From the gradient with respect to `r`, the way from the other vehicle to this one.
    #[inline]
    #[must_use]
    pub fn between(r: Vector2<T>) -> Self {
        let mut gradient = Self::zeros();
        gradient.me.state.position = r;
        gradient.other.position = -r;
        gradient
    }
}

/// A rule with vector-Jacobian products and parameters that can be listed, so that it can be fitted by gradients.
///
/// ```
/// use gnp_force::{DifferentiableRule, Idm, Driver};
/// let rule = Idm::of(&Driver::<f64>::motorway());
/// assert_eq!(rule.names(), ["time_gap", "standstill_gap", "acceleration", "braking"]);
/// assert_eq!(rule.parameters(), [1.0, 2.0, 1.0, 1.5]);
/// let slower = rule.with_parameters(&[1.8, 2.0, 1.0, 1.5])?;
/// assert_eq!(slower.time_gap, 1.8);
/// assert!(rule.with_parameters(&[1.8]).is_err());
/// # Ok::<(), gnp_force::ForceError>(())
/// ```
pub trait DifferentiableRule<T: RealField + Copy>: PairRule<T> {
    /// Names of the parameters.
    fn names(&self) -> &'static [&'static str];

    /// The parameters, in the order of [`DifferentiableRule::names`] and the units of the rule's fields.
    fn parameters(&self) -> Vec<T>;

    /// The same rule with other parameters.
    ///
    /// # Errors
    /// When there are not as many as names, or [`PairRule::check`] refuses one.
    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError>;

    /// Gradient of `cotangent` times [`PairRule::free`] with respect to the vehicle. What it is with respect to the
    /// parameters is added to `d`, which has as many entries as names.
    ///
    /// By default that of the default of [`PairRule::free`].
    #[inline]
    fn free_vjp(&self, me: &Ego<T>, cotangent: T, d: &mut [T]) -> EgoGradient<T> {
        let _ = d;
        relaxation_vjp(me, cotangent)
    }

    /// Gradient of `cotangent` · [`PairRule::push`] with respect to both vehicles. What it is with respect to the
    /// parameters is added to `d`, which has as many entries as names.
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T>;
}

/// Gradient of `cotangent` times `(wish - v) / tau` within the limits.
#[inline]
fn relaxation_vjp<T: RealField + Copy>(me: &Ego<T>, cotangent: T) -> EgoGradient<T> {
    let mut gradient = EgoGradient::zeros();
    let wanted = (me.wish - me.state.velocity.x) / me.tau;
    if me.limits.leave_along(wanted) {
        gradient.wish = cotangent / me.tau;
        gradient.state.velocity.x = -gradient.wish;
        gradient.tau = -gradient.wish * wanted;
    }
    gradient
}

impl<T: RealField + Copy> Limits<T> {
    /// Whether [`Limits::along`] leaves a wanted acceleration as it is.
    #[inline]
    pub(crate) fn leave_along(&self, wanted: T) -> bool {
        wanted > -self.braking && wanted < self.acceleration
    }

    /// Gradient with respect to `wanted` of `cotangent` · [`Limits::hold`].
    #[inline]
    pub(crate) fn hold_vjp(&self, wanted: Vector2<T>, velocity: Vector2<T>, cotangent: Vector2<T>) -> Vector2<T> {
        let along = if velocity.x < T::zero() { -wanted.x } else { wanted.x };
        Vector2::new(
            if self.leave_along(along) { cotangent.x } else { T::zero() },
            if wanted.y.abs() < self.lateral { cotangent.y } else { T::zero() },
        )
    }
}

/// Gradient of `cotangent` times [`in_path`] with respect to the lateral gap.
#[inline]
fn in_path_vjp<T: RealField + Copy>(place: Place, beside: T, cotangent: T) -> T {
    if place.shares_lane() || beside <= T::zero() {
        return T::zero();
    }
    let margin = lit::<T>(PATH_MARGIN);
    -cotangent * in_path(place, beside) * lit::<T>(2.0) * beside / (margin * margin)
}

/// As many numbers as a rule has parameters.
fn exactly<T: RealField + Copy, const N: usize>(parameters: &[T]) -> Result<[T; N], ForceError> {
    <[T; N]>::try_from(parameters).map_err(|_| ForceError::Value {
        key: "parameters",
        value: parameters.len() as f64,
        must: "as many numbers as the rule has names",
    })
}
