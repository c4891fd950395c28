//! Repulsion between two vehicles that have a length and a width.
//!
//! The law is the one between points with the distance of the points replaced by the signed distance of the boxes:
//!
//! ```text
//! U = r_col k exp(-s / r_col)        F = k exp(-s / r_col) n        n = grad s, |n| = 1
//! ```
//!
//! `s` is the gap between the boxes, and when they overlap minus the shorter way out. Boxes lie along the road: a heading
//! of a few degrees, as in a lane change, is neglected. Boxes of no size give the law between points (without its
//! softening); boxes in one lane push along the road only, boxes side by side only across it.
use crate::scalar::lit;
use nalgebra::{RealField, Vector2};

/// Length and width of a vehicle, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Extent<T> {
    /// Along the road, in m.
    pub length: T,
    /// Across the road, in m.
    pub width: T,
}

impl<T: RealField + Copy> Extent<T> {
    /// A passenger car, 4.6 m by 1.9 m.
    #[must_use]
    pub fn car() -> Self {
        Self { length: lit(4.6), width: lit(1.9) }
    }

    /// An articulated lorry, 16.5 m by 2.5 m.
    #[must_use]
    pub fn truck() -> Self {
        Self { length: lit(16.5), width: lit(2.5) }
    }

    /// A point, for the published law.
    #[must_use]
    pub fn point() -> Self {
        Self { length: T::zero(), width: T::zero() }
    }
}

/// How two boxes lie to each other; see [`separation`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Separation<T: RealField> {
    /// Gap in m; negative when they overlap, then minus the shortest way out.
    pub distance: T,
    /// Unit vector from the neighbour to the vehicle along which the distance grows; 0 for boxes centred on each other.
    pub normal: Vector2<T>,
    /// Gap in x, in m; negative when the boxes share a stretch of road.
    pub ahead: T,
    /// Gap in y, in m; negative when one is in the other's path.
    pub beside: T,
}

/// Separation of two boxes along the road whose centres are `r` apart (neighbour to vehicle), in m.
///
/// ```
/// use gnp_force::{Extent, na::Vector2, separation};
/// // A car 20 m behind a car in the same lane: 15.4 m from bumper to bumper.
/// let gap = separation(Vector2::new(-20.0, 0.3), Extent::car(), Extent::car());
/// assert_eq!((gap.distance, gap.normal), (15.4, Vector2::new(-1.0, 0.0)));
/// ```
#[inline]
#[must_use]
pub fn separation<T: RealField + Copy>(r: Vector2<T>, vehicle: Extent<T>, neighbour: Extent<T>) -> Separation<T> {
    let half = lit::<T>(0.5);
    let ahead = r.x.abs() - (vehicle.length + neighbour.length) * half;
    let beside = r.y.abs() - (vehicle.width + neighbour.width) * half;
    let (out_x, out_y) = (ahead.max(T::zero()), beside.max(T::zero()));
    let outside = (out_x * out_x + out_y * out_y).sqrt();
    let (distance, normal) = if outside > T::zero() {
        (outside, Vector2::new(out_x / outside * sign(r.x), out_y / outside * sign(r.y)))
    } else if (ahead > beside && r.x != T::zero()) || r.y == T::zero() {
        (ahead, Vector2::new(sign(r.x), T::zero()))
    } else {
        (beside, Vector2::new(T::zero(), sign(r.y)))
    };
    Separation { distance, normal, ahead, beside }
}

impl<T: RealField + Copy> Separation<T> {
    /// Gradient with respect to `r`, of which this is the [`separation`], from those with respect to its parts.
    ///
    /// Where the distance has a kink (a corner seen from inside, an edge between face and corner) it is that of one side.
    #[inline]
    pub(crate) fn vjp(&self, r: Vector2<T>, cotangent: &Self) -> Vector2<T> {
        let mut d = self.normal * cotangent.distance;
        if self.ahead > T::zero() && self.beside > T::zero() {
            // Only at a corner does the normal turn with the position.
            let along = self.normal.dot(&cotangent.normal);
            d += (cotangent.normal - self.normal * along) / self.distance;
        }
        d + Vector2::new(sign(r.x) * cotangent.ahead, sign(r.y) * cotangent.beside)
    }

    /// All parts 0, for a gradient to be added up in.
    #[inline]
    pub(crate) fn zeros() -> Self {
        let zero = T::zero();
        Self { distance: zero, normal: Vector2::zeros(), ahead: zero, beside: zero }
    }
}

/// -1, 0 or 1.
#[inline]
fn sign<T: RealField + Copy>(value: T) -> T {
    if value > T::zero() {
        T::one()
    } else if value < T::zero() {
        -T::one()
    } else {
        T::zero()
    }
}

/// Potential of the repulsion between two boxes, `r_col k exp(-s / r_col)`, in m²/s².
///
/// `r` from neighbour to vehicle in m, `k` in m/s², `r_col > 0` in m.
#[inline]
#[must_use]
pub fn box_potential<T: RealField + Copy>(
    r: Vector2<T>,
    vehicle: Extent<T>,
    neighbour: Extent<T>,
    k: T,
    r_col: T,
) -> T {
    r_col * k * (-separation(r, vehicle, neighbour).distance / r_col).exp()
}

/// Push away from a neighbour, `k exp(-s / r_col) n`, in m/s²: `k` at contact, more when the boxes overlap; arguments as
/// for [`box_potential`].
#[inline]
#[must_use]
pub fn box_force<T: RealField + Copy>(
    r: Vector2<T>,
    vehicle: Extent<T>,
    neighbour: Extent<T>,
    k: T,
    r_col: T,
) -> Vector2<T> {
    let gap = separation(r, vehicle, neighbour);
    gap.normal * (k * (-gap.distance / r_col).exp())
}

/// Gradient of `cotangent · F` for the push `F` between boxes; see [`box_force_vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxForceVjp<T: RealField> {
    /// With respect to `r`: the gradient in the vehicle's position, and minus the one in the neighbour's.
    pub r: Vector2<T>,
    /// With respect to the strength.
    pub k: T,
    /// With respect to the range.
    pub r_col: T,
}

/// Vector-Jacobian product of [`box_force`]: the gradient of `cotangent · F` with respect to `r`, `k` and `r_col`.
///
/// Where `s` has a kink (a corner seen from inside, an edge between face and corner) it is the one of one side.
#[inline]
#[must_use]
pub fn box_force_vjp<T: RealField + Copy>(
    r: Vector2<T>,
    vehicle: Extent<T>,
    neighbour: Extent<T>,
    k: T,
    r_col: T,
    cotangent: Vector2<T>,
) -> BoxForceVjp<T> {
    let gap = separation(r, vehicle, neighbour);
    let decay = (-gap.distance / r_col).exp();
    let along = gap.normal.dot(&cotangent);
    let mut bend = -gap.normal * (along / r_col);
    if gap.ahead > T::zero() && gap.beside > T::zero() {
        // Only at a corner does the normal turn with the position.
        bend += (cotangent - gap.normal * along) / gap.distance;
    }
    BoxForceVjp { r: bend * (k * decay), k: decay * along, r_col: k * decay * along * gap.distance / (r_col * r_col) }
}
