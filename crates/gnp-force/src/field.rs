//! All forces on one vehicle, apart by source.
use crate::{
    goal::{GoalForceVjp, goal_force, goal_force_vjp},
    line::{LineForceVjp, MarkingKind, Side, line_force, line_force_vjp},
    state::State,
    vehicle::{VehicleForceVjp, vehicle_force, vehicle_force_vjp},
};
use nalgebra::{Point2, RealField, Vector2};

/// A goal and how it draws; see [`goal_force`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Attraction<T: RealField> {
    /// Where to be, in m.
    pub goal: Point2<T>,
    /// Until when, in s from now.
    pub time_left: T,
    /// Relaxation time, in s: a short one makes a strong pull.
    pub tau: T,
}

/// A neighbour and how it pushes; see [`vehicle_force`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Neighbour<T: RealField> {
    /// Centre of the neighbour, in m.
    pub position: Point2<T>,
    /// Strength, in m/s².
    pub k: T,
    /// Distance over which the push falls to 1/e, in m.
    pub r_col: T,
}

/// A line along the road and how it pushes; see [`line_force`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Line<T> {
    /// Centre line or boundary.
    pub kind: MarkingKind,
    /// Lateral position, in m.
    pub y: T,
    /// The side on which the road lies; a centre line ignores it.
    pub road: Side,
    /// Strength, in m²/s² (centre line) or m⁴/s² (boundary).
    pub k: T,
}

/// Everything that acts on one vehicle at one time. It keeps nothing: the caller owns the state.
///
/// ```
/// use gnp_force::{Attraction, ForceField, Line, MarkingKind, Neighbour, Side, State, na::Point2};
/// let field = ForceField {
///     goal: Some(Attraction { goal: Point2::new(150.0, 0.0), time_left: 5.0, tau: 1.0 }),
///     neighbours: &[Neighbour { position: Point2::new(40.0, 0.0), k: 5.0, r_col: 26.0 }],
///     lines: &[Line { kind: MarkingKind::Boundary, y: -1.75, road: Side::Left, k: 0.3 }],
/// };
/// let forces = field.forces(&State::new(0.0, 0.0, 28.0, 0.0));
/// assert!(forces.goal.x > 0.0); // 30 m/s wanted
/// assert!(forces.neighbours[0].x < 0.0); // but somebody is in front
/// assert!(forces.lines[0].y > 0.0); // and the edge of the road is to the right
/// assert_eq!(forces.total(), forces.goal + forces.neighbours[0] + forces.lines[0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceField<'a, T: RealField> {
    /// The goal, or none for a vehicle that only evades.
    pub goal: Option<Attraction<T>>,
    /// The neighbours that push.
    pub neighbours: &'a [Neighbour<T>],
    /// The lines that push.
    pub lines: &'a [Line<T>],
}

/// Forces on one vehicle, in m/s² (its mass is 1), apart by source.
#[derive(Clone, Debug, PartialEq)]
#[must_use]
pub struct Forces<T: RealField> {
    /// Pull of the goal; 0 without one.
    pub goal: Vector2<T>,
    /// Push of each neighbour, in the order given.
    pub neighbours: Vec<Vector2<T>>,
    /// Push of each line, in the order given; lateral, so that x is 0.
    pub lines: Vec<Vector2<T>>,
}

impl<T: RealField + Copy> Forces<T> {
    /// Sum over the neighbours.
    #[must_use]
    pub fn neighbours_total(&self) -> Vector2<T> {
        self.neighbours.iter().fold(Vector2::zeros(), |sum, push| sum + push)
    }

    /// Sum over the lines.
    #[must_use]
    pub fn lines_total(&self) -> Vector2<T> {
        self.lines.iter().fold(Vector2::zeros(), |sum, push| sum + push)
    }

    /// Sum of everything: the acceleration.
    #[must_use]
    pub fn total(&self) -> Vector2<T> {
        self.goal + self.neighbours_total() + self.lines_total()
    }
}

/// Gradient of `cotangent · total` with respect to everything in a [`ForceField`]; see [`ForceField::total_vjp`].
#[derive(Clone, Debug, PartialEq)]
pub struct FieldVjp<T: RealField> {
    /// With respect to the vehicle's position, through all laws.
    pub position: Vector2<T>,
    /// With respect to the vehicle's velocity.
    pub velocity: Vector2<T>,
    /// Of the attraction alone: goal, time left and tau stand here; none without a goal.
    pub goal: Option<GoalForceVjp<T>>,
    /// Of each neighbour alone; the gradient in the neighbour's position is minus its `r`.
    pub neighbours: Vec<VehicleForceVjp<T>>,
    /// Of each line alone; the gradient in the line's y is minus its `d`.
    pub lines: Vec<LineForceVjp<T>>,
}

impl<T: RealField + Copy> ForceField<'_, T> {
    /// The forces on a vehicle in `state`, each by itself.
    pub fn forces(&self, state: &State<T>) -> Forces<T> {
        Forces {
            goal: self.pull(state),
            neighbours: self.neighbours.iter().map(|neighbour| neighbour.push(state)).collect(),
            lines: self.lines.iter().map(|line| line.push(state)).collect(),
        }
    }

    /// The acceleration of a vehicle in `state`, in m/s²: the sum of [`ForceField::forces`] without allocating.
    #[must_use]
    pub fn total(&self, state: &State<T>) -> Vector2<T> {
        let pushes = self.neighbours.iter().map(|neighbour| neighbour.push(state));
        let lines = self.lines.iter().map(|line| line.push(state));
        // Summed as `Forces::total` sums, so that both give the same bits.
        self.pull(state)
            + pushes.fold(Vector2::zeros(), |sum, push| sum + push)
            + lines.fold(Vector2::zeros(), |sum, push| sum + push)
    }

    /// Vector-Jacobian product of [`ForceField::total`]: the gradient of `cotangent · total` with respect to the state,
    /// the goal, the neighbours, the lines and their parameters.
    #[must_use]
    pub fn total_vjp(&self, state: &State<T>, cotangent: Vector2<T>) -> FieldVjp<T> {
        let goal = self
            .goal
            .as_ref()
            .map(|pull| goal_force_vjp(state.position, state.velocity, pull.goal, pull.time_left, pull.tau, cotangent));
        let neighbours: Vec<_> = self
            .neighbours
            .iter()
            .map(|other| vehicle_force_vjp(state.position - other.position, other.k, other.r_col, cotangent))
            .collect();
        let lines: Vec<_> = self
            .lines
            .iter()
            .map(|line| line_force_vjp(line.kind, state.position.y - line.y, line.k, line.road, cotangent.y))
            .collect();
        let mut position = goal.map_or_else(Vector2::zeros, |pull| pull.position);
        position += neighbours.iter().fold(Vector2::zeros(), |sum, push| sum + push.r);
        position.y += lines.iter().fold(T::zero(), |sum, push| sum + push.d);
        let velocity = goal.map_or_else(Vector2::zeros, |pull| pull.velocity);
        FieldVjp { position, velocity, goal, neighbours, lines }
    }

    fn pull(&self, state: &State<T>) -> Vector2<T> {
        self.goal.as_ref().map_or_else(Vector2::zeros, |pull| {
            goal_force(state.position, state.velocity, pull.goal, pull.time_left, pull.tau)
        })
    }
}

impl<T: RealField + Copy> Neighbour<T> {
    /// Push of this neighbour on a vehicle in `state`, in m/s².
    #[inline]
    #[must_use]
    pub fn push(&self, state: &State<T>) -> Vector2<T> {
        vehicle_force(state.position - self.position, self.k, self.r_col)
    }
}

impl<T: RealField + Copy> Line<T> {
    /// Push of this line on a vehicle in `state`, in m/s²; x is 0.
    #[inline]
    #[must_use]
    pub fn push(&self, state: &State<T>) -> Vector2<T> {
        Vector2::new(T::zero(), line_force(self.kind, state.position.y - self.y, self.k, self.road))
    }
}
