//! Repulsion between two vehicles taken as points.
//!
//! ```text
//! U = r_col k exp(-d / r_col)        d = sqrt(|r|² + 1e-8 m²)        r = p - p_j
//! F = k exp(-d / r_col) r / d
//! ```
//!
//! `F` is exactly minus the gradient of `U` (GNP paper, vehicle repulsion). The softening of the distance by
//! [`SOFTENING`] makes both smooth where two vehicles coincide: there the force is 0, and nowhere does it exceed `k`.
//! The law is symmetric: a vehicle behind pushes as one ahead does.
use crate::{
    scalar::lit,
    state::State,
    term::{Arity, ForceTerm, Source, TermDescriptor, TermParameter, TermVjp},
};
use nalgebra::{RealField, Vector2};

/// Added to the squared distance, in m²: 0.1 mm squared.
pub const SOFTENING: f64 = 1e-8;

/// Softened distance, in m.
#[inline]
fn distance<T: RealField + Copy>(r: Vector2<T>) -> T {
    (r.norm_squared() + lit(SOFTENING)).sqrt()
}

/// Potential of the repulsion, `r_col k exp(-d / r_col)`, in m²/s².
///
/// `r` from the neighbour to the vehicle in m, `k` in m/s², `r_col > 0` in m.
#[inline]
#[must_use]
pub fn vehicle_potential<T: RealField + Copy>(r: Vector2<T>, k: T, r_col: T) -> T {
    r_col * k * (-distance(r) / r_col).exp()
}

/// Push away from a neighbour, `k exp(-d / r_col) r / d`, in m/s²; 0 at `r = 0` and never above `k`.
///
/// - `r`: from the neighbour to the vehicle, in m
/// - `k`: strength, in m/s²
/// - `r_col > 0`: distance over which the push falls to 1/e, in m; 26 in the published code
///
/// ```
/// use gnp_force::{na::Vector2, vehicle_force};
/// // Ten metres behind the neighbour: pushed back.
/// let force = vehicle_force(Vector2::new(-10.0_f64, 0.0), 3.0, 26.0);
/// assert!((force.x + 3.0 * (-10.0_f64 / 26.0).exp()).abs() < 1e-8);
/// ```
#[inline]
#[must_use]
pub fn vehicle_force<T: RealField + Copy>(r: Vector2<T>, k: T, r_col: T) -> Vector2<T> {
    let d = distance(r);
    r * (k * (-d / r_col).exp() / d)
}

/// Gradient of `cotangent · F` for the repulsion `F`; see [`vehicle_force_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleForceVjp<T: RealField> {
    /// With respect to `r`: the gradient in the vehicle's position, and minus the one in the neighbour's.
    pub r: Vector2<T>,
    /// With respect to the strength.
    pub k: T,
    /// With respect to the range.
    pub r_col: T,
}

/// Vector-Jacobian product of [`vehicle_force`]: the gradient of `cotangent · F` with respect to every argument.
#[inline]
#[must_use]
pub fn vehicle_force_vjp<T: RealField + Copy>(
    r: Vector2<T>,
    k: T,
    r_col: T,
    cotangent: Vector2<T>,
) -> VehicleForceVjp<T> {
    let d = distance(r);
    let decay = (-d / r_col).exp();
    let along = r.dot(&cotangent);
    let bend = along * (T::one() / (d * d) + T::one() / (r_col * d));
    VehicleForceVjp {
        r: (cotangent - r * bend) * (k * decay / d),
        k: decay * along / d,
        r_col: k * decay * along / (r_col * r_col),
    }
}

/// The repulsion as a term of the force: [`vehicle_force`] with the parameters `k` and `r_col`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VehicleRepulsion;

impl VehicleRepulsion {
    /// Its name in files.
    pub const NAME: &'static str = "neighbours";
}

static PARAMETERS: [TermParameter; 2] = [
    TermParameter::varying("k", "m/s²", "strength"),
    TermParameter::constant("r_col", "m", "distance over which the push falls to 1/e"),
];
static DESCRIPTOR: TermDescriptor = TermDescriptor::fixed(
    [VehicleRepulsion::NAME, "neighbours", "repulsion of all neighbours"],
    "#0072b2",
    Arity::PerNeighbour,
    &PARAMETERS,
);

impl<T: RealField + Copy> ForceTerm<T> for VehicleRepulsion {
    fn descriptor(&self) -> &TermDescriptor {
        &DESCRIPTOR
    }

    #[inline]
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let (Source::Vehicle { state: other, .. }, &[k, r_col]) = (source, parameters) else {
            return Vector2::zeros();
        };
        vehicle_force(state.position - other.position, k, r_col)
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
        let (Source::Vehicle { state: other, .. }, &[k, r_col], [dk, dr_col]) = (source, parameters, dparameters)
        else {
            return TermVjp::zeros();
        };
        let vjp = vehicle_force_vjp(state.position - other.position, k, r_col, cotangent);
        (*dk, *dr_col) = (vjp.k, vjp.r_col);
        TermVjp { position: vjp.r, source_position: -vjp.r, ..TermVjp::zeros() }
    }
}
