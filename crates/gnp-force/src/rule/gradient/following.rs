//! Gradients of the rules of car following: the intelligent driver model and Newell's.
use super::{DifferentiableRule, EgoGradient, PushGradient, exactly, in_path_vjp};
use crate::{
    boxes::Separation,
    car_following::{Following, free_acceleration_vjp, interaction_vjp},
    error::ForceError,
    rule::{Ego, Idm, Newell, Other, PairRule, in_path},
    scalar::lit,
};
use nalgebra::{RealField, Vector2};

impl<T: RealField + Copy> DifferentiableRule<T> for Idm<T> {
    fn names(&self) -> &'static [&'static str] {
        &["time_gap", "standstill_gap", "acceleration", "braking"]
    }

    fn parameters(&self) -> Vec<T> {
        vec![self.time_gap, self.standstill_gap, self.acceleration, self.braking]
    }

    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError> {
        let [time_gap, standstill_gap, acceleration, braking] = exactly(parameters)?;
        let rule = Self { time_gap, standstill_gap, acceleration, braking };
        PairRule::<T>::check(&rule).map(|()| rule)
    }

    #[inline]
    fn free_vjp(&self, me: &Ego<T>, cotangent: T, d: &mut [T]) -> EgoGradient<T> {
        let mut gradient = EgoGradient::zeros();
        let (driver, v) = (self.driver(me.wish), me.state.velocity.x);
        if me.wish <= T::zero() {
            let wanted = -v / me.tau;
            if wanted > -self.braking && me.limits.leave_along(wanted) {
                gradient.state.velocity.x = -cotangent / me.tau;
                gradient.tau = -cotangent * wanted / me.tau;
            } else if wanted < -self.braking
                && me.limits.leave_along(-self.braking)
                && let [_, _, _, braking] = d
            {
                *braking -= cotangent;
            }
            return gradient;
        }
        if me.limits.leave_along(Following::new(&driver).free(v)) {
            let vjp = free_acceleration_vjp(v, &driver, cotangent);
            gradient.state.velocity.x = vjp.speed;
            gradient.wish = vjp.driver.desired_speed;
            if let [_, _, acceleration, _] = d {
                *acceleration += vjp.driver.acceleration;
            }
        }
        gradient
    }

    #[inline]
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T> {
        let r = me.state.position - other.state.position;
        let [d_time_gap, d_standstill_gap, d_acceleration, d_braking] = d else { return PushGradient::zeros() };
        if r.x >= T::zero() {
            return PushGradient::zeros();
        }
        let gap = me.separation_from(other);
        let share = in_path(other.place, gap.beside);
        if share == T::zero() {
            return PushGradient::zeros();
        }
        let body = (me.extent.length + other.extent.length) * lit(0.5);
        let (v, leader) = (me.state.velocity.x, other.state.velocity.x);
        let driver = self.driver(me.wish);
        let vjp = interaction_vjp(-r.x, body, v, leader, &driver, cotangent.x * share);
        *d_time_gap += vjp.driver.time_gap;
        *d_standstill_gap += vjp.driver.standstill_gap;
        *d_acceleration += vjp.driver.acceleration;
        *d_braking += vjp.driver.braking;
        let mut to_r = Vector2::new(-vjp.distance, T::zero());
        if !other.place.shares_lane() {
            let push = Following::new(&driver).interaction(-r.x, body, v, leader);
            let to_beside = in_path_vjp(other.place, gap.beside, cotangent.x * push);
            to_r += gap.vjp(r, &Separation { beside: to_beside, ..Separation::zeros() });
        }
        let mut gradient = PushGradient::between(to_r);
        gradient.me.state.velocity.x = vjp.speed;
        gradient.other.velocity.x = vjp.leader_speed;
        gradient
    }
}

impl<T: RealField + Copy> Newell<T> {
    /// Gradient of `cotangent` times [`Newell::towards`], within the limits, with respect to the speed aimed at and the
    /// present one; that with respect to `wave_time` is added to its place.
    #[inline]
    fn towards_vjp(&self, me: &Ego<T>, speed: T, cotangent: T, d_wave_time: &mut T) -> (T, T) {
        let wanted = self.towards(speed, me.state.velocity.x);
        if !me.limits.leave_along(wanted) {
            return (T::zero(), T::zero());
        }
        *d_wave_time -= cotangent * wanted / self.wave_time;
        let to_speed = cotangent * lit::<T>(2.0) / self.wave_time;
        (to_speed, -to_speed)
    }
}

impl<T: RealField + Copy> DifferentiableRule<T> for Newell<T> {
    fn names(&self) -> &'static [&'static str] {
        &["wave_time", "standstill_gap"]
    }

    fn parameters(&self) -> Vec<T> {
        vec![self.wave_time, self.standstill_gap]
    }

    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError> {
        let [wave_time, standstill_gap] = exactly(parameters)?;
        let rule = Self { wave_time, standstill_gap };
        PairRule::<T>::check(&rule).map(|()| rule)
    }

    #[inline]
    fn free_vjp(&self, me: &Ego<T>, cotangent: T, d: &mut [T]) -> EgoGradient<T> {
        let mut gradient = EgoGradient::zeros();
        if let [d_wave_time, _] = d {
            (gradient.wish, gradient.state.velocity.x) = self.towards_vjp(me, me.wish, cotangent, d_wave_time);
        }
        gradient
    }

    #[inline]
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T> {
        let r = me.state.position - other.state.position;
        let [d_wave_time, d_standstill_gap] = d else { return PushGradient::zeros() };
        let gap = me.separation_from(other);
        let aim = (gap.ahead - self.standstill_gap) / self.wave_time;
        let follow = me.limits.along(self.towards(aim, me.state.velocity.x));
        let less = follow - self.free(me);
        if r.x >= T::zero() || less >= T::zero() {
            return PushGradient::zeros();
        }
        let to_less = cotangent.x * in_path(other.place, gap.beside);
        let (to_aim, to_v) = self.towards_vjp(me, aim, to_less, d_wave_time);
        let (to_wish, to_v_free) = self.towards_vjp(me, me.wish, -to_less, d_wave_time);
        *d_wave_time -= to_aim * aim / self.wave_time;
        *d_standstill_gap -= to_aim / self.wave_time;
        let to_gap = Separation {
            ahead: to_aim / self.wave_time,
            beside: in_path_vjp(other.place, gap.beside, cotangent.x * less),
            ..Separation::zeros()
        };
        let mut gradient = PushGradient::between(gap.vjp(r, &to_gap));
        gradient.me.state.velocity.x = to_v + to_v_free;
        gradient.me.wish = to_wish;
        gradient
    }
}
