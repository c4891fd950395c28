//! Gradients of the social force between boxes.
use super::{DifferentiableRule, EgoGradient, PushGradient, exactly};
use crate::{
    boxes::Separation,
    error::ForceError,
    rule::{Ego, MotorwayRule, Other, PairRule, fading},
    scalar::lit,
};
use nalgebra::{RealField, Vector2};

impl<T: RealField + Copy> DifferentiableRule<T> for MotorwayRule<T> {
    fn names(&self) -> &'static [&'static str] {
        &["standstill_gap", "headway", "acceleration", "braking", "stiffness", "path_margin", "beside", "beside_range"]
    }

    fn parameters(&self) -> Vec<T> {
        vec![
            self.standstill_gap,
            self.headway,
            self.acceleration,
            self.braking,
            self.stiffness,
            self.path_margin,
            self.beside,
            self.beside_range,
        ]
    }

    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError> {
        let [standstill_gap, headway, acceleration, braking, stiffness, path_margin, beside, beside_range] =
            exactly(parameters)?;
        let rule =
            Self { standstill_gap, headway, acceleration, braking, stiffness, path_margin, beside, beside_range };
        PairRule::<T>::check(&rule).map(|()| rule)
    }

    #[inline]
    fn free_vjp(&self, me: &Ego<T>, cotangent: T, d: &mut [T]) -> EgoGradient<T> {
        let wanted = (me.wish - me.state.velocity.x) / me.tau;
        if wanted < self.acceleration {
            return super::relaxation_vjp(me, cotangent);
        }
        if let [_, _, acceleration, ..] = d
            && me.limits.leave_along(self.acceleration)
        {
            *acceleration += cotangent;
        }
        EgoGradient::zeros()
    }

    #[inline]
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T> {
        let [d_standstill_gap, d_headway, d_acceleration, d_braking, d_stiffness, d_path_margin, d_beside, d_range] = d
        else {
            return PushGradient::zeros();
        };
        let (zero, one, two) = (T::zero(), T::one(), lit::<T>(2.0));
        let gap = me.separation_from(other);
        let (nx, ny) = (gap.normal.x, gap.normal.y);
        let limit = me.limits.braking;
        let to_push = gap.normal.dot(&cotangent);
        let mut to_gap = Separation::zeros();
        let (mut to_v, mut to_other_v) = (zero, zero);
        let mut push = zero;
        let behind = other.place.shares_lane() && me.state.position.x < other.state.position.x;
        if behind || nx < zero {
            let distance = if behind { gap.ahead } else { gap.distance };
            // How much of the push goes along the normal, and what is asked of it.
            let (square, to_push) = if behind { (one, -cotangent.x) } else { (nx * nx, to_push) };
            let counts = !other.place.merging && gap.beside > zero;
            let aside = if counts { gap.beside / self.path_margin } else { zero };
            let share = fading(-aside * aside);
            if share > zero {
                let v = me.state.velocity.x;
                let closing = v - other.state.velocity.x;
                let desired = self.desired_gap(v, closing);
                let decay = fading(self.stiffness * (one - distance / desired));
                let strength = self.acceleration * decay;
                let held = strength.min(limit);
                if !behind {
                    push += held * share * nx * nx;
                    to_gap.normal.x += to_push * held * share * two * nx;
                }
                if strength < limit {
                    let to_strength = to_push * share * square;
                    *d_acceleration += to_strength * decay;
                    let to_exponent = to_strength * strength;
                    *d_stiffness += to_exponent * (one - distance / desired);
                    let to_distance = if behind { &mut to_gap.ahead } else { &mut to_gap.distance };
                    *to_distance -= to_exponent * self.stiffness / desired;
                    let to_desired = to_exponent * self.stiffness * distance / (desired * desired);
                    *d_standstill_gap += to_desired;
                    let twice_root = two * (self.acceleration * self.braking).sqrt();
                    let per_speed = self.headway + closing / twice_root;
                    if v * per_speed > zero {
                        let slope = v / twice_root * to_desired;
                        to_v += per_speed * to_desired + slope;
                        to_other_v -= slope;
                        *d_headway += v * to_desired;
                        // The closing speed's share of the desired gap goes with 1 / sqrt(a b).
                        *d_acceleration -= slope * closing / (two * self.acceleration);
                        *d_braking -= slope * closing / (two * self.braking);
                    }
                }
                if counts {
                    let to_aside = -to_push * held * square * share * two * aside;
                    to_gap.beside += to_aside / self.path_margin;
                    *d_path_margin -= to_aside * aside / self.path_margin;
                }
            }
        }
        if ny != zero && !other.place.merging {
            let decay = fading(-gap.distance / self.beside_range);
            let strength = self.beside * decay;
            let held = strength.min(limit);
            push += held * ny * ny;
            to_gap.normal.y += to_push * held * two * ny;
            if strength < limit {
                let to_strength = to_push * ny * ny;
                *d_beside += to_strength * decay;
                to_gap.distance -= to_strength * strength / self.beside_range;
                *d_range += to_strength * strength * gap.distance / (self.beside_range * self.beside_range);
            }
        }
        to_gap.normal += cotangent * push;
        let r = me.state.position - other.state.position;
        let mut gradient = PushGradient::between(gap.vjp(r, &to_gap));
        gradient.me.state.velocity.x = to_v;
        gradient.other.velocity.x = to_other_v;
        gradient
    }
}
