//! Lateral repulsion by the lines painted on the road.
//!
//! With `d` the signed lateral distance from the line to the vehicle in m, positive to the left of the line
//! (GNP paper, line repulsion):
//!
//! ```text
//! centre line   U = k exp(-d²)       F = 2 k d exp(-d²)     |d| < 4 m
//!               U = k exp(-16)       F = 0                  beyond
//! boundary      U = k / (2 s²)       F = k / s³             s >= 0.5 m, towards the road
//!               U = U(0.5) + (0.5 - s) F(0.5)    F = F(0.5)     s < 0.5 m
//! ```
//!
//! where `s` is `d` counted from a boundary towards the road. The lengths in both laws are in units of 1 m, so that `k`
//! is in m²/s² for a centre line and in m⁴/s² for a boundary.
//!
//! - A centre line is cut off at [`CENTRE_CUTOFF`]: the force there is 9e-7 k, and 0 beyond. It pushes most, 0.858 k, at
//!   0.71 m, and not at all a vehicle exactly on it.
//! - A boundary is capped at [`BOUNDARY_CAP`]: nearer than that, on it and beyond it, the force stays at 8 k and points
//!   to the road, so that a vehicle that has left the road is pushed back onto it.
use crate::{
    scalar::lit,
    state::State,
    term::{Arity, ForceTerm, Source, TermDescriptor, TermParameter, TermVjp},
};
use nalgebra::{RealField, Vector2};

/// Distance beyond which a centre line no longer pushes, in m.
pub const CENTRE_CUTOFF: f64 = 4.0;

/// Distance below which the push of a boundary no longer grows, in m.
pub const BOUNDARY_CAP: f64 = 0.5;

/// Whether a line on the road may be crossed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum MarkingKind {
    /// Edge of the carriageway: pushes to the road's side only.
    Boundary,
    /// Between two lanes: pushes away to both sides and may be crossed.
    LaneDivider,
}

/// A side of a line, looking along the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Side {
    /// Larger y.
    Left,
    /// Smaller y.
    Right,
}

impl Side {
    /// +1 to the left, -1 to the right: the sign of y.
    #[inline]
    #[must_use]
    pub fn sign<T: RealField>(self) -> T {
        match self {
            Self::Left => T::one(),
            Self::Right => -T::one(),
        }
    }
}

/// Potential of a line, in m²/s².
///
/// - `d`: lateral distance `y - y_line`, in m
/// - `k`: strength, in m²/s² (centre line) or m⁴/s² (boundary)
/// - `road`: the side of the line on which the road lies; a centre line has road on both and ignores it
#[inline]
#[must_use]
pub fn line_potential<T: RealField + Copy>(kind: MarkingKind, d: T, k: T, road: Side) -> T {
    match kind {
        MarkingKind::LaneDivider => {
            let d = d.abs().min(lit(CENTRE_CUTOFF));
            k * (-d * d).exp()
        }
        MarkingKind::Boundary => {
            let cap = lit::<T>(BOUNDARY_CAP);
            let s = d * road.sign::<T>();
            let free = s.max(cap);
            let half = lit::<T>(0.5) * k / (free * free);
            half + (free - s) * k / (cap * cap * cap)
        }
    }
}

/// Lateral push of a line in m/s², positive to the left; arguments as for [`line_potential`].
///
/// ```
/// use gnp_force::{MarkingKind, Side, line_force};
/// // One metre to the right of the left edge of the road: pushed to the right.
/// assert_eq!(line_force(MarkingKind::Boundary, -1.0, 0.3, Side::Right), -0.3);
/// // One metre beyond that edge: pushed back, with the capped strength 8 k.
/// assert_eq!(line_force(MarkingKind::Boundary, 1.0, 0.25, Side::Right), -2.0);
/// ```
#[inline]
#[must_use]
pub fn line_force<T: RealField + Copy>(kind: MarkingKind, d: T, k: T, road: Side) -> T {
    match kind {
        MarkingKind::LaneDivider if d.abs() < lit(CENTRE_CUTOFF) => lit::<T>(2.0) * k * d * (-d * d).exp(),
        MarkingKind::LaneDivider => T::zero(),
        MarkingKind::Boundary => {
            let side = road.sign::<T>();
            let s = (d * side).max(lit(BOUNDARY_CAP));
            side * k / (s * s * s)
        }
    }
}

/// Gradient of `cotangent F` for the push `F` of a line; see [`line_force_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineForceVjp<T> {
    /// With respect to the lateral distance, hence to the vehicle's y; 0 beyond the cut-off and under the cap.
    pub d: T,
    /// With respect to the strength.
    pub k: T,
}

/// Vector-Jacobian product of [`line_force`]: the gradient of `cotangent F` with respect to `d` and `k`.
#[inline]
#[must_use]
pub fn line_force_vjp<T: RealField + Copy>(kind: MarkingKind, d: T, k: T, road: Side, cotangent: T) -> LineForceVjp<T> {
    let slope = match kind {
        MarkingKind::LaneDivider if d.abs() < lit(CENTRE_CUTOFF) => {
            lit::<T>(2.0) * k * (T::one() - lit::<T>(2.0) * d * d) * (-d * d).exp()
        }
        MarkingKind::LaneDivider => T::zero(),
        MarkingKind::Boundary => {
            let s = d * road.sign::<T>();
            if s < lit(BOUNDARY_CAP) { T::zero() } else { lit::<T>(-3.0) * k / (s * s * s * s) }
        }
    };
    LineForceVjp { d: cotangent * slope, k: cotangent * line_force(kind, d, T::one(), road) }
}

/// The repulsion of lines as a term of the force: [`line_force`] across the road with the parameter `k`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineRepulsion;

impl LineRepulsion {
    /// Its name in files.
    pub const NAME: &'static str = "lines";
}

static PARAMETERS: [TermParameter; 1] = [TermParameter::varying("k", "m²/s², of a boundary m⁴/s²", "strength")];
static DESCRIPTOR: TermDescriptor = TermDescriptor::fixed(
    [LineRepulsion::NAME, "lane lines", "repulsion of all lane lines"],
    "#000000",
    Arity::PerLine,
    &PARAMETERS,
);

impl<T: RealField + Copy> ForceTerm<T> for LineRepulsion {
    fn descriptor(&self) -> &TermDescriptor {
        &DESCRIPTOR
    }

    #[inline]
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let (&Source::Line { kind, y, road }, &[k]) = (source, parameters) else { return Vector2::zeros() };
        Vector2::new(T::zero(), line_force(kind, state.position.y - y, k, road))
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
        let (&Source::Line { kind, y, road }, &[k], [dk]) = (source, parameters, dparameters) else {
            return TermVjp::zeros();
        };
        let vjp = line_force_vjp(kind, state.position.y - y, k, road, cotangent.y);
        *dk = vjp.k;
        let position = Vector2::new(T::zero(), vjp.d);
        TermVjp { position, source_position: -position, ..TermVjp::zeros() }
    }
}
