//! Newell's rule: drive as the vehicle ahead did, a moment later and a place further back.
use super::{Ego, Other, PairRule, Reach, in_path};
use crate::{
    error::{ForceError, require_not_negative, require_positive},
    scalar::lit,
};
use nalgebra::{RealField, Vector2};

/// Newell's simplified car following (Newell 2002): the path of the vehicle ahead, `wave_time` later and a
/// vehicle and `standstill_gap` further back.
///
/// Here as an acceleration, `(2 / wave_time) (min(wish, gap / wave_time) - v)`, the gap counted without `standstill_gap`:
/// the form of second order that agrees with the shift in time to second order and damps every oscillation (a single dip
/// may get deeper by up to a twentieth on the way, and wider). Waves run upstream with
/// `(length + standstill_gap) / wave_time`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Newell<T> {
    /// Time in which a disturbance passes from vehicle to vehicle, in s. Below two steps the speed swings.
    pub wave_time: T,
    /// Gap at standstill, bumper to bumper, in m.
    pub standstill_gap: T,
}

impl<T: RealField + Copy> Newell<T> {
    /// 1.2 s and 2 m.
    #[must_use]
    pub fn standard() -> Self {
        Self { wave_time: lit(1.2), standstill_gap: lit(2.0) }
    }

    /// Acceleration towards a speed in m/s.
    #[inline]
    pub(super) fn towards(&self, speed: T, v: T) -> T {
        (speed - v) * lit::<T>(2.0) / self.wave_time
    }
}

impl<T: RealField + Copy> PairRule<T> for Newell<T> {
    fn reach(&self) -> Reach {
        Reach { ahead: 1, behind: 0, beside_ahead: 2, beside_behind: 0 }
    }

    #[inline]
    fn free(&self, me: &Ego<T>) -> T {
        me.limits.along(self.towards(me.wish, me.state.velocity.x))
    }

    #[inline]
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
        let gap = me.separation_from(other);
        if other.state.position.x <= me.state.position.x {
            return Vector2::zeros();
        }
        let v = me.state.velocity.x;
        let follow = me.limits.along(self.towards((gap.ahead - self.standstill_gap) / self.wave_time, v));
        let push = (follow - self.free(me)).min(T::zero()) * in_path(other.place, gap.beside);
        Vector2::new(push, T::zero())
    }

    fn check(&self) -> Result<(), ForceError> {
        require_positive("newell.wave_time", self.wave_time)?;
        require_not_negative("newell.standstill_gap", self.standstill_gap)
    }
}
