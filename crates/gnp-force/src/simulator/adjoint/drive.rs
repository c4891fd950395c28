//! Gradients of what draws a vehicle and of how it takes its new state.
use super::gradient::VehicleGradient;
use crate::{
    goal::goal_force_vjp,
    rule::{DifferentiableRule, Ego, EgoGradient},
    simulator::{AfterGoal, Drive, SimulatorParams, Vehicle},
    state::{State, StateGradient},
};
use nalgebra::{RealField, Vector2};

impl<T: RealField + Copy> Drive<T> {
    /// Gradient of `cotangent` · [`Drive::pull`]; that with respect to wish, rule and goal is added to `own`.
    #[inline]
    pub(super) fn pull_vjp<R: DifferentiableRule<T>>(
        &self,
        me: &Ego<T>,
        rule: &R,
        time: T,
        params: &SimulatorParams<T>,
        cotangent: Vector2<T>,
        own: &mut VehicleGradient<T>,
    ) -> EgoGradient<T> {
        let State { position, velocity } = me.state;
        match self {
            Self::Goal { goal, due, .. } => {
                let time_left = (*due - time).max(params.dt);
                let tau = me.tau.min(time_left);
                let way = goal - position;
                let least = way.norm() / params.max_speed;
                let held = time_left.max(least);
                let pull = crate::goal::goal_force(position, velocity, *goal, held, tau);
                let cotangent = me.limits.hold_vjp(pull, velocity, cotangent);
                let vjp = goal_force_vjp(position, velocity, *goal, held, tau, cotangent);
                let mut gradient = EgoGradient::zeros();
                gradient.state = StateGradient { position: vjp.position, velocity: vjp.velocity };
                own.wish += vjp.goal;
                if least > time_left {
                    // The time is that of the way at the highest speed.
                    let longer = way * (vjp.time_left / (way.norm() * params.max_speed));
                    own.wish += longer;
                    gradient.state.position -= longer;
                }
                if me.tau < time_left {
                    gradient.tau = vjp.tau;
                }
                gradient
            }
            Self::Cruise { y, .. } => {
                let steering = &params.steering;
                let wanted = (*y - position.y) / steering.preview;
                let across = wanted.max(-steering.lateral_speed).min(steering.lateral_speed);
                let aside = (across - velocity.y) / me.tau;
                let cotangent = me.limits.hold_vjp(Vector2::new(rule.free(me), aside), velocity, cotangent);
                let mut gradient = rule.free_vjp(me, cotangent.x, &mut own.rule);
                let to_across = cotangent.y / me.tau;
                gradient.state.velocity.y -= to_across;
                gradient.tau -= to_across * aside;
                if wanted.abs() < steering.lateral_speed {
                    own.wish.y += to_across / steering.preview;
                    gradient.state.position.y -= to_across / steering.preview;
                }
                gradient
            }
            Self::Accelerate(_) | Self::Follow(_) | Self::Steady => EgoGradient::zeros(),
        }
    }

    /// Gradient of `cotangent` times [`Drive::wish`] with respect to the position along the road; that with respect to the
    /// wish itself is added to `own`. Of drives with a wish only.
    #[inline]
    pub(super) fn wish_vjp(
        &self,
        state: &State<T>,
        time: T,
        params: &SimulatorParams<T>,
        cotangent: T,
        own: &mut VehicleGradient<T>,
    ) -> T {
        match self {
            Self::Goal { goal, due, .. } => {
                let time_left = (*due - time).max(params.dt);
                let speed = (goal.x - state.position.x) / time_left;
                if speed <= T::zero() || speed >= params.max_speed {
                    return T::zero();
                }
                own.wish.x += cotangent / time_left;
                -cotangent / time_left
            }
            Self::Cruise { .. } => {
                own.wish.x += cotangent;
                T::zero()
            }
            Self::Accelerate(_) | Self::Follow(_) | Self::Steady => T::zero(),
        }
    }

    /// Gradient of what a goal becomes when it is due, with respect to the state then. `own` is with respect to the drive
    /// afterwards and becomes that with respect to the goal.
    pub(super) fn settle_vjp(
        &self,
        state: &State<T>,
        latest: T,
        params: &SimulatorParams<T>,
        own: &mut VehicleGradient<T>,
    ) {
        let Self::Goal { due, then: AfterGoal::Cruise, .. } = self else { return };
        if *due > latest {
            return;
        }
        if state.velocity.x > T::zero() && state.velocity.x < params.max_speed {
            own.state.velocity.x += own.wish.x;
        }
        own.wish.x = T::zero();
    }
}

impl<T: RealField + Copy, R> Vehicle<T, R> {
    /// Gradient of [`Vehicle::advance`] with respect to the state that the integrator found, `after`, and the state before
    /// the step, from that with respect to the state that is taken.
    #[inline]
    pub(super) fn advance_vjp(
        &self,
        after: &State<T>,
        dt: T,
        taken: StateGradient<T>,
    ) -> (StateGradient<T>, StateGradient<T>) {
        let (mut found, mut before) = (taken, StateGradient::zeros());
        match &self.drive {
            Drive::Goal { .. } | Drive::Steady => {}
            Drive::Cruise { .. } | Drive::Accelerate(_) => {
                let least = self.state.velocity.x.min(T::zero());
                if after.velocity.x < least {
                    before.velocity.x = std::mem::replace(&mut found.velocity.x, T::zero());
                    if after.position.x <= self.state.position.x + least * dt {
                        before.position.x = std::mem::replace(&mut found.position.x, T::zero());
                        before.velocity.x += before.position.x * dt;
                    }
                    if self.state.velocity.x >= T::zero() {
                        before.velocity.x = T::zero();
                    }
                }
            }
            Drive::Follow(_) => {
                before.position = taken.position;
                found = StateGradient::zeros();
            }
        }
        (found, before)
    }
}
