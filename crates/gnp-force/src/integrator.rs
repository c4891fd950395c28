//! From accelerations to motion.
//!
//! - [`explicit_euler`]: `p' = p + v dt`, `v' = v + a dt`. The paper's expansion; order 1.
//! - [`semi_implicit_euler`]: `v' = v + a dt`, `p' = p + v' dt`. The published code; order 1, and the one to take by
//!   default: with `tau = time_left = dt` it ends exactly on the goal.
//! - [`runge_kutta4`]: order 4, four evaluations a step. A yardstick for the step size of the other two.
mod adjoint;

pub use self::adjoint::{Accelerations, RecordedStep};
use crate::{scalar::lit, state::State};
use nalgebra::{RealField, Vector2};

/// One step of `dt` s with `p' = p + v dt`, `v' = v + a dt`; acceleration `a` in m/s².
#[inline]
#[must_use]
pub fn explicit_euler<T: RealField + Copy>(state: &State<T>, a: Vector2<T>, dt: T) -> State<T> {
    State { position: state.position + state.velocity * dt, velocity: state.velocity + a * dt }
}

/// One step of `dt` s with `v' = v + a dt`, `p' = p + v' dt`: the position moves with the new velocity.
#[inline]
#[must_use]
pub fn semi_implicit_euler<T: RealField + Copy>(state: &State<T>, a: Vector2<T>, dt: T) -> State<T> {
    let velocity = state.velocity + a * dt;
    State { position: state.position + velocity * dt, velocity }
}

/// One classical Runge-Kutta step of `dt` s; `acceleration` takes a state and the time since the start of the step.
#[inline]
#[must_use]
pub fn runge_kutta4<T: RealField + Copy>(
    state: &State<T>,
    dt: T,
    mut acceleration: impl FnMut(&State<T>, T) -> Vector2<T>,
) -> State<T> {
    let half = dt * lit(0.5);
    let a1 = acceleration(state, T::zero());
    let mid1 = explicit_euler(state, a1, half);
    let a2 = acceleration(&mid1, half);
    let mid2 = State { position: state.position + mid1.velocity * half, velocity: state.velocity + a2 * half };
    let a3 = acceleration(&mid2, half);
    let end = State { position: state.position + mid2.velocity * dt, velocity: state.velocity + a3 * dt };
    let a4 = acceleration(&end, dt);
    weighted(state, dt, [mid1.velocity, mid2.velocity, end.velocity], [a1, a2, a3, a4])
}

/// The last line of the Runge-Kutta step: slopes with weights 1, 2, 2, 1.
fn weighted<T: RealField + Copy>(
    state: &State<T>,
    dt: T,
    velocities: [Vector2<T>; 3],
    accelerations: [Vector2<T>; 4],
) -> State<T> {
    let two = lit::<T>(2.0);
    let sixth = dt / lit(6.0);
    let [v2, v3, v4] = velocities;
    let [a1, a2, a3, a4] = accelerations;
    State {
        position: state.position + (state.velocity + (v2 + v3) * two + v4) * sixth,
        velocity: state.velocity + (a1 + (a2 + a3) * two + a4) * sixth,
    }
}

/// How a step is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Integrator {
    /// [`explicit_euler`], `explicit` in a configuration.
    #[cfg_attr(feature = "serde", serde(rename = "explicit", alias = "explicit_euler"))]
    ExplicitEuler,
    /// [`semi_implicit_euler`], `semi_implicit` in a configuration.
    #[cfg_attr(feature = "serde", serde(rename = "semi_implicit", alias = "semi_implicit_euler"))]
    SemiImplicitEuler,
    /// [`runge_kutta4`].
    RungeKutta4,
}

impl Integrator {
    /// One step of `dt` s of one vehicle; `acceleration` takes a state and the time since the start of the step.
    ///
    /// ```
    /// use gnp_force::{Integrator, State, na::Vector2};
    /// let fall = Integrator::RungeKutta4.step(&State::new(0.0, 0.0, 3.0, 0.0), 2.0, |_, _| Vector2::new(-1.0, 0.0));
    /// assert_eq!(fall, State::new(4.0, 0.0, 1.0, 0.0));
    /// ```
    #[inline]
    #[must_use]
    pub fn step<T: RealField + Copy>(
        self,
        state: &State<T>,
        dt: T,
        mut acceleration: impl FnMut(&State<T>, T) -> Vector2<T>,
    ) -> State<T> {
        match self {
            Self::ExplicitEuler => explicit_euler(state, acceleration(state, T::zero()), dt),
            Self::SemiImplicitEuler => semi_implicit_euler(state, acceleration(state, T::zero()), dt),
            Self::RungeKutta4 => runge_kutta4(state, dt, acceleration),
        }
    }

    /// One step of `dt` s of vehicles that act on each other, in place.
    ///
    /// `accelerations` takes all states and the time since the start of the step, and overwrites one acceleration per
    /// vehicle in its last argument. `workspace` keeps the intermediate states from step to step.
    pub fn step_all<T: RealField + Copy>(
        self,
        states: &mut [State<T>],
        dt: T,
        workspace: &mut Workspace<T>,
        mut accelerations: impl FnMut(&[State<T>], T, &mut [Vector2<T>]),
    ) {
        workspace.fit(states);
        let [a1, a2, a3, a4] = &mut workspace.slopes;
        accelerations(states, T::zero(), a1);
        match self {
            Self::ExplicitEuler => {
                states.iter_mut().zip(a1).for_each(|(state, a)| *state = explicit_euler(state, *a, dt));
            }
            Self::SemiImplicitEuler => {
                states.iter_mut().zip(a1).for_each(|(state, a)| *state = semi_implicit_euler(state, *a, dt));
            }
            Self::RungeKutta4 => {
                let half = dt * lit(0.5);
                let [mid1, mid2, end] = &mut workspace.stages;
                for (i, state) in states.iter().enumerate() {
                    mid1[i] = explicit_euler(state, a1[i], half);
                }
                accelerations(mid1, half, a2);
                for (i, state) in states.iter().enumerate() {
                    mid2[i].position = state.position + mid1[i].velocity * half;
                    mid2[i].velocity = state.velocity + a2[i] * half;
                }
                accelerations(mid2, half, a3);
                for (i, state) in states.iter().enumerate() {
                    end[i].position = state.position + mid2[i].velocity * dt;
                    end[i].velocity = state.velocity + a3[i] * dt;
                }
                accelerations(end, dt, a4);
                for (i, state) in states.iter_mut().enumerate() {
                    let velocities = [mid1[i].velocity, mid2[i].velocity, end[i].velocity];
                    *state = weighted(state, dt, velocities, [a1[i], a2[i], a3[i], a4[i]]);
                }
            }
        }
    }
}

/// Memory that [`Integrator::step_all`] uses again from step to step.
#[derive(Clone, Debug)]
pub struct Workspace<T: RealField> {
    slopes: [Vec<Vector2<T>>; 4],
    stages: [Vec<State<T>>; 3],
}

impl<T: RealField + Copy> Workspace<T> {
    /// An empty one; it grows with the first step.
    #[must_use]
    pub fn new() -> Self {
        Self { slopes: Default::default(), stages: [Vec::new(), Vec::new(), Vec::new()] }
    }

    /// As many entries as there are vehicles.
    fn fit(&mut self, states: &[State<T>]) {
        for slopes in &mut self.slopes {
            slopes.resize(states.len(), Vector2::zeros());
        }
        for stage in &mut self.stages {
            stage.clear();
            stage.extend_from_slice(states);
        }
    }
}

impl<T: RealField + Copy> Default for Workspace<T> {
    fn default() -> Self {
        Self::new()
    }
}
