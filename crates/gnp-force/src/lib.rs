//! Social-force physics for vehicles on a motorway: potentials, analytic forces, their vector-Jacobian products,
//! integrators, and a simulator of many vehicles.
//!
//! A vehicle is drawn by its goal and pushed by its neighbours and by the lines on the road. The laws are those of GNP
//! (goal-based neural physics), in which networks set their parameters; here nothing is learned and nothing but nalgebra
//! is needed, so that a traffic simulation or a planner can use the physics alone.
//!
//! **Units and frame.** SI: m, s, m/s. Mass is 1, so that a force is an acceleration in m/s². One right-handed frame that
//! follows the road: x forward, y to the left. Positions are those of the vehicle's centre. Everything works in `f32` and
//! in `f64`.
//!
//! **Finite everywhere.** At the goal, with no time left, on a line, beyond a line and where two vehicles coincide, every
//! law has a stated, finite value; each module says which.
//!
//! One vehicle among given neighbours, step by step:
//!
//! ```
//! use gnp_force::{Attraction, ForceField, Neighbour, State, na::Point2, semi_implicit_euler};
//!
//! let (dt, steps) = (0.04, 125);
//! let mut state = State::new(0.0, 0.0, 30.0, 0.0);
//! for step in 0..steps {
//!     let time = dt * f64::from(step);
//!     let field = ForceField {
//!         goal: Some(Attraction { goal: Point2::new(150.0, 3.75), time_left: 5.0 - time, tau: 0.5 }),
//!         neighbours: &[Neighbour { position: Point2::new(40.0 + 25.0 * time, 0.0), k: 1.0, r_col: 26.0 }],
//!         lines: &[],
//!     };
//!     state = semi_implicit_euler(&state, field.total(&state), dt);
//! }
//! assert!((state.position - Point2::new(150.0, 3.75)).norm() < 2.0);
//! ```
//!
//! Each law is also a [`ForceTerm`] with a [`TermDescriptor`]: roll-outs, files and figures read its name, unit, colour and
//! parameters there, and a term of one's own stands beside the five of this crate.
//!
//! Traffic that mostly follows the vehicle ahead: the intelligent driver model, as two terms ([`FreeRoad`],
//! [`CarFollowing`]), as functions of a [`Driver`], and as the roll-out of a [`Platoon`].
//!
//! Many vehicles at once: [`Simulator`]. Drivers follow a [`PairRule`], of this crate ([`MotorwayRule`], [`Idm`], [`Newell`],
//! [`Published`]) or one's own, within the [`Limits`] of their vehicles, change lanes by [`Mobil`], and may be unsteady
//! ([`Noise`]). Roads may end, close to a ring and have closed lanes ([`Road`]); vehicles enter by an [`Inflow`] and pass a
//! [`Detector`]; what happens are [`Event`]s. Gradients of all that: [`Simulator::step_vjp`], [`RollOut`].
//!
//! Whole programs: `examples/calibrate.rs`, `car_following.rs`, `cut_in.rs`, `hour.rs`, `lane_change_past_truck.rs`,
//! `lane_drop.rs`, `motorway_section.rs`, `platoon.rs`, `ring.rs`.
//!
//! The `serde` feature makes states, parameters, roads, vehicles and whole simulators readable and writable, the `parallel`
//! feature steps large scenes on several threads with the same bits.
mod boxes;
mod car_following;
mod driver;
mod error;
mod field;
mod goal;
mod integrator;
mod line;
mod platoon;
mod road;
mod rule;
mod scalar;
mod simulator;
mod state;
mod term;
mod vehicle;

pub use crate::{
    boxes::{BoxForceVjp, Extent, Separation, box_force, box_force_vjp, box_potential, separation},
    car_following::{
        CarFollowing, FreeRoad, FreeVjp, HARDEST_BRAKING, InteractionVjp, LEAST_GAP, following_acceleration,
        free_acceleration, free_acceleration_vjp, interaction, interaction_vjp, standstill_potential,
    },
    driver::Driver,
    error::ForceError,
    field::{Attraction, FieldVjp, ForceField, Forces, Line, Neighbour},
    goal::{GoalAttraction, GoalForceVjp, MIN_TIME, goal_dissipation, goal_force, goal_force_vjp, goal_potential},
    integrator::{
        Accelerations, Integrator, RecordedStep, Workspace, explicit_euler, runge_kutta4, semi_implicit_euler,
    },
    line::{
        BOUNDARY_CAP, CENTRE_CUTOFF, LineForceVjp, LineRepulsion, MarkingKind, Side, line_force, line_force_vjp,
        line_potential,
    },
    platoon::{Follower, Platoon},
    road::{Closure, Road},
    rule::{
        DifferentiableRule, Ego, EgoGradient, Idm, Limits, MotorwayRule, Newell, Other, PATH_MARGIN, PairRule, Place,
        Published, PushGradient, Reach, Rule,
    },
    simulator::{
        AfterGoal, Detector, Drive, Event, ForceBreakdown, Gap, Given, Headways, Inflow, Mobil, Noise, Obstacle,
        Passage, Profile, RollOut, RollOutGradient, SceneGradient, Simulator, SimulatorParams, Steering, Surroundings,
        Undisturbed, Vehicle, VehicleGradient, VehicleId,
    },
    state::{State, StateGradient},
    term::{Arity, ForceTerm, Source, TermDescriptor, TermParameter, TermVjp, term, terms},
    vehicle::{SOFTENING, VehicleForceVjp, VehicleRepulsion, vehicle_force, vehicle_force_vjp, vehicle_potential},
};
/// The linear algebra of this crate, under a name that does not stand in the way of one's own `nalgebra`.
pub use nalgebra as na;

/// The README's programs are compiled and run with the documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// All names of this crate stand beside one's own nalgebra.
///
/// ```
/// use gnp_force::*;
/// use nalgebra::Point2;
/// let state: State<f64> = State::new(1.0, 2.0, 3.0, 0.0);
/// assert_eq!(state.position, Point2::new(1.0, 2.0));
/// ```
#[cfg(doctest)]
struct Glob;
