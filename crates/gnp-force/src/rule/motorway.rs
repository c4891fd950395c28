//! The social force between boxes, with the strength that makes drivers keep a gap.
use super::{Ego, Other, PairRule, Reach, fading};
use crate::{
    error::{ForceError, require_not_negative, require_positive},
    scalar::lit,
};
use nalgebra::{RealField, Vector2};

/// Drivers who look ahead and to the sides: the law between boxes, [`box_force`](crate::box_force), with `k` and `r_col`
/// set so that the push from ahead balances the wish to accelerate at the desired gap. Nobody is pushed from behind.
///
/// ```text
/// desired gap   g = standstill_gap + max(0, v headway + v w / (2 sqrt(a braking)))
/// from ahead    F = min(limit, k exp(-s / r_col)) exp(-(gap_y / path_margin)²) n_x² n
///               r_col = g / stiffness        k = a exp(stiffness), so that F = a at s = g
/// from beside   F = min(limit, beside exp(-s / beside_range)) n_y² n
/// ```
///
/// Between two vehicles of one lane, or one of which is changing into the lane of the other, the one behind brakes: `s` is
/// then the gap along the road, `n` points back along it, and who changes pushes nobody aside.
/// `limit` is the hardest braking of the vehicle ([`Limits`](crate::Limits)). The form is that of Helbing and Tilch's
/// generalised force model (1998), the gap that of the intelligent driver model.
///
/// **Range.** With [`MotorwayRule::standard`], steps up to 0.2 s, speeds up to 50 m/s and a wish up to 20 m/s above the
/// present speed, a vehicle that closes in on another in its lane with `w` m/s does not touch it when it starts at least
/// `2 m + w² / (2 (limit - a)) + w dt` away, that is, when braking with 7.5 m/s² (a lorry: 5.5 m/s²) from the first step on suffices; it comes
/// to rest 1.9 m behind a standing one. Nearer than that, no driver could stop, and the boxes overlap, which is an event.
/// A platoon 43 m apart at 30 m/s outlives a leader that brakes with 8 m/s² to a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct MotorwayRule<T> {
    /// Gap from bumper to bumper at standstill, in m.
    pub standstill_gap: T,
    /// Time gap kept to the vehicle ahead, in s.
    pub headway: T,
    /// Most that the wish for speed accelerates, in m/s²; `a` above.
    pub acceleration: T,
    /// Deceleration with which a slower vehicle is approached, in m/s².
    pub braking: T,
    /// How many times the push from ahead falls to 1/e over the desired gap: more keeps that gap more tightly.
    pub stiffness: T,
    /// Lateral gap at which a vehicle ahead pushes only 1/e of one in the path, in m.
    pub path_margin: T,
    /// Push of a vehicle beside at contact, in m/s².
    pub beside: T,
    /// Distance over which the push from beside falls to 1/e, in m.
    pub beside_range: T,
}

impl<T: RealField + Copy> MotorwayRule<T> {
    /// Drivers who keep 1.2 s, accelerate with 1.5 m/s² and brake with 2.5 m/s².
    #[must_use]
    pub fn standard() -> Self {
        Self {
            standstill_gap: lit(2.0),
            headway: lit(1.2),
            acceleration: lit(1.5),
            braking: lit(2.5),
            stiffness: lit(3.0),
            path_margin: lit(0.5),
            beside: lit(3.0),
            beside_range: lit(0.3),
        }
    }

    /// The gap that the driver desires at speed `v`, closing in with `closing` m/s, in m.
    #[inline]
    pub(super) fn desired_gap(&self, v: T, closing: T) -> T {
        let twice_root = lit::<T>(2.0) * (self.acceleration * self.braking).sqrt();
        self.standstill_gap + (v * (self.headway + closing / twice_root)).max(T::zero())
    }
}

impl<T: RealField + Copy> PairRule<T> for MotorwayRule<T> {
    fn reach(&self) -> Reach {
        Reach { ahead: 2, behind: 1, beside_ahead: 2, beside_behind: 1 }
    }

    #[inline]
    fn free(&self, me: &Ego<T>) -> T {
        let wanted = (me.wish - me.state.velocity.x) / me.tau;
        me.limits.along(wanted.min(self.acceleration))
    }

    #[inline]
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
        let gap = me.separation_from(other);
        let (nx, ny) = (gap.normal.x, gap.normal.y);
        let limit = me.limits.braking;
        let mut push = Vector2::zeros();
        let behind = other.place.shares_lane() && me.state.position.x < other.state.position.x;
        if behind || nx < T::zero() {
            let distance = if behind { gap.ahead } else { gap.distance };
            let aside = if other.place.merging { T::zero() } else { gap.beside.max(T::zero()) / self.path_margin };
            let share = fading(-aside * aside);
            if share > T::zero() {
                let v = me.state.velocity.x;
                let desired = self.desired_gap(v, v - other.state.velocity.x);
                let exponent = self.stiffness * (T::one() - distance / desired);
                let held = (self.acceleration * fading(exponent)).min(limit) * share;
                push += if behind { Vector2::new(-held, T::zero()) } else { gap.normal * (held * nx * nx) };
            }
        }
        if ny != T::zero() && !other.place.merging {
            push += gap.normal * ((self.beside * fading(-gap.distance / self.beside_range)).min(limit) * ny * ny);
        }
        push
    }

    fn check(&self) -> Result<(), ForceError> {
        require_positive("motorway.standstill_gap", self.standstill_gap)?;
        require_not_negative("motorway.headway", self.headway)?;
        require_positive("motorway.acceleration", self.acceleration)?;
        require_positive("motorway.braking", self.braking)?;
        require_positive("motorway.stiffness", self.stiffness)?;
        require_positive("motorway.path_margin", self.path_margin)?;
        require_not_negative("motorway.beside", self.beside)?;
        require_positive("motorway.beside_range", self.beside_range)
    }
}
