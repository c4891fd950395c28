//! Attraction by a goal: be there when the time is up.
//!
//! The velocity that reaches the goal in time is `(goal - p) / time_left`, and the force relaxes the present
//! velocity towards it within `tau` seconds (GNP paper, goal attraction):
//!
//! ```text
//! F = ((goal - p) / time_left - v) / tau
//! ```
//!
//! The paper writes the desired velocity as a speed times a unit vector; the product is the same and, unlike the unit
//! vector, smooth at the goal. In `p` the force is minus the gradient of [`goal_potential`], in `v` of
//! [`goal_dissipation`].
//!
//! Both times are taken as at least [`MIN_TIME`], which keeps the force finite when no time is left.
use crate::{
    scalar::lit,
    state::State,
    term::{Arity, ForceTerm, Source, TermDescriptor, TermParameter, TermVjp},
};
use nalgebra::{Point2, RealField, Vector2};

/// Least time left and least relaxation time, in s; smaller values count as this one.
pub const MIN_TIME: f64 = 1e-3;

/// The time used in place of `time`, and whether it is `time` itself.
#[inline]
fn floored<T: RealField + Copy>(time: T) -> (T, bool) {
    let least = lit(MIN_TIME);
    if time < least { (least, false) } else { (time, true) }
}

/// Part of the attraction that depends on the position, `|goal - p|² / (2 time_left tau)`, in m²/s².
///
/// Times in s, positions in m.
#[inline]
#[must_use]
pub fn goal_potential<T: RealField + Copy>(p: Point2<T>, goal: Point2<T>, time_left: T, tau: T) -> T {
    let ((time_left, _), (tau, _)) = (floored(time_left), floored(tau));
    (goal - p).norm_squared() / (lit::<T>(2.0) * time_left * tau)
}

/// Rayleigh's dissipation function of the attraction, `|v|² / (2 tau)`, in m²/s³: minus its gradient in `v` is the part
/// of the force that depends on the velocity.
#[inline]
#[must_use]
pub fn goal_dissipation<T: RealField + Copy>(v: Vector2<T>, tau: T) -> T {
    v.norm_squared() / (lit::<T>(2.0) * floored(tau).0)
}

/// Attraction by the goal, `((goal - p) / time_left - v) / tau`, in m/s².
///
/// `p` and `goal` in m, `v` in m/s, `time_left` until the goal is due and relaxation time `tau` in s.
///
/// ```
/// use gnp_force::{goal_force, na::{Point2, Vector2}};
/// // 100 m in 5 s ask for 20 m/s; at 18 m/s, 2 m/s are to be gained within tau = 0.5 s.
/// let force = goal_force(Point2::new(0.0, 0.0), Vector2::new(18.0, 0.0), Point2::new(100.0, 0.0), 5.0, 0.5);
/// assert_eq!(force, Vector2::new(4.0, 0.0));
/// ```
#[inline]
#[must_use]
pub fn goal_force<T: RealField + Copy>(
    p: Point2<T>,
    v: Vector2<T>,
    goal: Point2<T>,
    time_left: T,
    tau: T,
) -> Vector2<T> {
    let ((time_left, _), (tau, _)) = (floored(time_left), floored(tau));
    ((goal - p) / time_left - v) / tau
}

/// Gradient of `cotangent · F` for the attraction `F`; see [`goal_force_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoalForceVjp<T: RealField> {
    /// With respect to the position.
    pub position: Vector2<T>,
    /// With respect to the velocity.
    pub velocity: Vector2<T>,
    /// With respect to the goal.
    pub goal: Vector2<T>,
    /// With respect to the time left; 0 below [`MIN_TIME`].
    pub time_left: T,
    /// With respect to the relaxation time; 0 below [`MIN_TIME`].
    pub tau: T,
}

/// Vector-Jacobian product of [`goal_force`]: the gradient of `cotangent · F` with respect to every argument.
#[inline]
#[must_use]
pub fn goal_force_vjp<T: RealField + Copy>(
    p: Point2<T>,
    v: Vector2<T>,
    goal: Point2<T>,
    time_left: T,
    tau: T,
    cotangent: Vector2<T>,
) -> GoalForceVjp<T> {
    let ((time, time_free), (tau, tau_free)) = (floored(time_left), floored(tau));
    let way = goal - p;
    let velocity = -cotangent / tau;
    let position = velocity / time;
    GoalForceVjp {
        position,
        velocity,
        goal: -position,
        time_left: if time_free { position.dot(&way) / time } else { T::zero() },
        tau: if tau_free { velocity.dot(&(way / time - v)) / tau } else { T::zero() },
    }
}

/// The attraction as a term of the force: [`goal_force`] with the parameter `tau`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GoalAttraction;

impl GoalAttraction {
    /// Its name in files.
    pub const NAME: &'static str = "goal";
}

static PARAMETERS: [TermParameter; 1] = [TermParameter::varying("tau", "s", "relaxation time")];
static DESCRIPTOR: TermDescriptor =
    TermDescriptor::fixed([GoalAttraction::NAME, "goal", "attraction of the goal"], "#f5c400", Arity::One, &PARAMETERS);

impl<T: RealField + Copy> ForceTerm<T> for GoalAttraction {
    fn descriptor(&self) -> &TermDescriptor {
        &DESCRIPTOR
    }

    #[inline]
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let (&Source::Goal { goal, time_left }, &[tau]) = (source, parameters) else { return Vector2::zeros() };
        goal_force(state.position, state.velocity, goal, time_left, tau)
    }

    #[inline]
    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        dparameters: &mut [T],
    ) -> TermVjp<T> {
        let (&Source::Goal { goal, time_left }, &[tau], [dtau]) = (source, parameters, dparameters) else {
            return TermVjp::zeros();
        };
        let vjp = goal_force_vjp(state.position, state.velocity, goal, time_left, tau, cotangent);
        *dtau = vjp.tau;
        let (position, velocity) = (vjp.position, vjp.velocity);
        TermVjp { position, velocity, source_position: vjp.goal, source_velocity: Vector2::zeros() }
    }
}
