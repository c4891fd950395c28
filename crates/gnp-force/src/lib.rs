//! Social-force physics for vehicles: potentials, forces, integrators.
mod field;
mod goal;
mod integrator;
mod line;
mod scalar; // in reading order
mod state;
mod vehicle;

pub use crate::{
    field::{Attraction, FieldVjp, ForceField, Forces, Line, Neighbour},
    goal::{GoalForceVjp, MIN_TIME, goal_dissipation, goal_force, goal_force_vjp, goal_potential},
    integrator::{Integrator, Workspace, explicit_euler, runge_kutta4, semi_implicit_euler},
    line::{BOUNDARY_CAP, CENTRE_CUTOFF, LineForceVjp, LineKind, Side, line_force, line_force_vjp, line_potential},
    state::State,
    vehicle::{SOFTENING, VehicleForceVjp, vehicle_force, vehicle_force_vjp, vehicle_potential},
};
pub use nalgebra;
