//! The step backwards: gradients of a state after it as gradients of the state before it.
use super::{Integrator, Workspace};
use crate::{
    scalar::lit,
    state::{State, StateGradient},
};
use nalgebra::{RealField, Vector2};

/// Accelerations of vehicles that act on each other, and their vector-Jacobian product.
///
/// An integrator asks at one or more stages of a step, 0 the first, and when it goes back, at the same ones again, the last
/// first: what was worked out at a stage may be kept for it.
pub trait Accelerations<T: RealField + Copy> {
    /// Overwrites the acceleration of every vehicle among `states`, `elapsed` s after the step began.
    fn at(&mut self, stage: usize, states: &[State<T>], elapsed: T, out: &mut [Vector2<T>]);

    /// Adds the gradient of the sum of `cotangents` · accelerations with respect to the states.
    fn vjp(
        &mut self,
        stage: usize,
        states: &[State<T>],
        elapsed: T,
        cotangents: &[Vector2<T>],
        gradient: &mut [StateGradient<T>],
    );
}

/// A step that can be gone back.
#[derive(Clone, Debug)]
pub struct RecordedStep<T: RealField> {
    integrator: Integrator,
    dt: T,
    before: Vec<State<T>>,
    after: Vec<State<T>>,
    workspace: Workspace<T>,
}

impl Integrator {
    /// One step of `dt` s, as [`Integrator::step_all`] takes it, to be gone back.
    ///
    /// ```
    /// use gnp_force::{Accelerations, Integrator, State, StateGradient, na::Vector2};
    ///
    /// /// Everybody is drawn back to where the road begins.
    /// struct Spring;
    ///
    /// impl Accelerations<f64> for Spring {
    ///     fn at(&mut self, _: usize, states: &[State<f64>], _: f64, out: &mut [Vector2<f64>]) {
    ///         out.iter_mut().zip(states).for_each(|(out, state)| *out = -state.position.coords);
    ///     }
    ///
    ///     fn vjp(
    ///         &mut self,
    ///         _: usize,
    ///         _: &[State<f64>],
    ///         _: f64,
    ///         cotangents: &[Vector2<f64>],
    ///         gradient: &mut [StateGradient<f64>],
    ///     ) {
    ///         gradient.iter_mut().zip(cotangents).for_each(|(gradient, cotangent)| gradient.position -= cotangent);
    ///     }
    /// }
    ///
    /// let start = [State::new(1.0, 0.0, 0.0, 0.0)];
    /// let step = Integrator::RungeKutta4.record_all(&start, 0.1, &mut Spring);
    /// let mut gradient = [StateGradient { position: Vector2::x(), velocity: Vector2::zeros() }];
    /// step.vjp(&mut Spring, &mut gradient);
    /// let (x, v) = (gradient[0].position.x, gradient[0].velocity.x); // of x after the step: cos 0.1 and sin 0.1
    /// assert!((x - 0.1_f64.cos()).abs() < 1e-6 && (v - 0.1_f64.sin()).abs() < 1e-6);
    /// ```
    #[must_use]
    pub fn record_all<T: RealField + Copy>(
        self,
        states: &[State<T>],
        dt: T,
        field: &mut impl Accelerations<T>,
    ) -> RecordedStep<T> {
        let (mut after, mut workspace) = (states.to_vec(), Workspace::new());
        let mut stage = 0;
        self.step_all(&mut after, dt, &mut workspace, |states, elapsed, out| {
            field.at(stage, states, elapsed, out);
            stage += 1;
        });
        RecordedStep { integrator: self, dt, before: states.to_vec(), after, workspace }
    }
}

impl<T: RealField + Copy> RecordedStep<T> {
    /// The states after the step.
    #[must_use]
    pub fn after(&self) -> &[State<T>] {
        &self.after
    }

    /// Turns the gradient of a number with respect to the states after the step into that with respect to the states
    /// before it, with one entry a vehicle.
    pub fn vjp(&self, field: &mut impl Accelerations<T>, gradient: &mut [StateGradient<T>]) {
        let dt = self.dt;
        match self.integrator {
            Integrator::ExplicitEuler => {
                let cotangents: Vec<_> = gradient.iter().map(|d| d.velocity * dt).collect();
                gradient.iter_mut().for_each(|d| d.velocity += d.position * dt);
                field.vjp(0, &self.before, T::zero(), &cotangents, gradient);
            }
            Integrator::SemiImplicitEuler => {
                gradient.iter_mut().for_each(|d| d.velocity += d.position * dt);
                let cotangents: Vec<_> = gradient.iter().map(|d| d.velocity * dt).collect();
                field.vjp(0, &self.before, T::zero(), &cotangents, gradient);
            }
            Integrator::RungeKutta4 => self.runge_kutta4_vjp(field, gradient),
        }
    }

    /// A stage is `p + v' w`, `v + a' w`, with velocity and acceleration of the stage before and the weight `w`.
    fn runge_kutta4_vjp(&self, field: &mut impl Accelerations<T>, gradient: &mut [StateGradient<T>]) {
        let (half, sixth, two) = (self.dt * lit(0.5), self.dt / lit(6.0), lit::<T>(2.0));
        // What the last line of the step says of the velocities and the accelerations of all four stages.
        let weights = [sixth, sixth * two, sixth * two, sixth];
        let after = gradient.to_vec();
        gradient.iter_mut().zip(&after).for_each(|(d, after)| d.velocity += after.position * weights[0]);
        let mut cotangents: Vec<_> = after.iter().map(|d| d.velocity * weights[3]).collect();
        let mut to_stage: Vec<_> = after
            .iter()
            .map(|d| StateGradient { position: Vector2::zeros(), velocity: d.position * weights[3] })
            .collect();
        for (stage, length) in [(3, self.dt), (2, half), (1, half)] {
            field.vjp(stage, &self.workspace.stages[stage - 1], length, &cotangents, &mut to_stage);
            for (i, d) in gradient.iter_mut().enumerate() {
                *d += to_stage[i];
                cotangents[i] = after[i].velocity * weights[stage - 1] + to_stage[i].velocity * length;
                let earlier = to_stage[i].position * length;
                if stage == 1 {
                    // The stage before the first one is the state itself.
                    d.velocity += earlier;
                } else {
                    let velocity = after[i].position * weights[stage - 1] + earlier;
                    to_stage[i] = StateGradient { position: Vector2::zeros(), velocity };
                }
            }
        }
        field.vjp(0, &self.before, T::zero(), &cotangents, gradient);
    }
}
