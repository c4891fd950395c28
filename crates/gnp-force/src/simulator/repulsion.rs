//! Who pushes whom how strongly, without a network.
//!
//! In GNP a network sets the strength of every neighbour at every moment. A simulation needs a rule in its place:
//!
//! - [`Repulsion::Published`]: the law between points with one strength and range for all.
//! - [`Repulsion::Motorway`]: the law between boxes, with the strength set so that the push balances the driver's wish
//!   to accelerate at the desired gap. The form, an exponential around a gap that grows with the speed, is that of the
//!   generalised force model (Helbing and Tilch, Physical Review E 58, 1998); the desired gap is that of the intelligent
//!   driver model (Treiber, Hennecke and Helbing, Physical Review E 62, 2000).
use crate::{
    boxes::{Extent, separation},
    error::{ForceError, require_not_negative, require_positive},
    scalar::lit,
    simulator::params::SimulatorParams,
    state::State,
    vehicle::vehicle_force,
};
use nalgebra::{RealField, Vector2};

/// How one vehicle pushes another.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Repulsion<T> {
    /// [`vehicle_force`] between centres, from ahead, beside and behind alike.
    Published {
        /// Strength, in m/s².
        k: T,
        /// Distance over which the push falls to 1/e, in m.
        r_col: T,
    },
    /// Between boxes, for traffic that runs to larger x; see [`MotorwayRule`].
    Motorway(MotorwayRule<T>),
}

/// Strengths for motorway traffic. A driver looks ahead and to the sides, not behind.
///
/// With the gaps of [`separation`], the normal `n`, own forward speed `v`, closing speed `w`, the forward pull `a` of
/// [`CruiseParams`](crate::CruiseParams) and the limit `grip`:
///
/// ```text
/// desired gap   g = standstill_gap + max(0, v headway + v w / (2 sqrt(a braking)))
/// from ahead    F = min(grip, k exp(-s / r_col)) exp(-(gap_y / path_margin)²) n_x² n
///               r_col = g / stiffness        k = a exp(stiffness), so that F = a at s = g
/// from beside   F = min(grip, beside exp(-s / beside_range)) n_y² n
/// ```
///
/// **Range.** With [`MotorwayRule::standard`] and [`SimulatorParams::motorway`], steps up to 0.2 s, speeds up to 50 m/s
/// and a wish up to 20 m/s above the present speed, a vehicle that closes in on another in its lane with `w` m/s does
/// not touch it when it starts at least `2 m + w² / (2 (grip - a)) + w dt` away, that is, when braking with 7.5 m/s² from
/// the first step on suffices; it comes to rest 1.9 m behind a standing one. Nearer than that, no driver could stop, and
/// the boxes overlap. A platoon 43 m apart at 30 m/s outlives a leader that brakes with 8 m/s² to a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct MotorwayRule<T> {
    /// Gap from bumper to bumper at standstill, in m.
    pub standstill_gap: T,
    /// Time gap kept to the vehicle ahead, in s.
    pub headway: T,
    /// Deceleration with which a slower vehicle is approached, in m/s².
    pub braking: T,
    /// How many times the push from ahead falls to 1/e over the desired gap: more keeps that gap more tightly.
    pub stiffness: T,
    /// Lateral gap at which a vehicle ahead pushes only 1/e of one in the path, in m.
    pub path_margin: T,
    /// Push of a vehicle beside at contact, in m/s².
    pub beside: T,
    /// Distance over which the push from beside falls to 1/e, in m.
    pub beside_range: T,
}

impl<T: RealField + Copy> MotorwayRule<T> {
    /// Drivers who keep 1.2 s and brake with 2.5 m/s².
    #[must_use]
    pub fn standard() -> Self {
        Self {
            standstill_gap: lit(2.0),
            headway: lit(1.2),
            braking: lit(2.5),
            stiffness: lit(3.0),
            path_margin: lit(0.5),
            beside: lit(3.0),
            beside_range: lit(0.5),
        }
    }

    fn push(&self, me: Body<T>, other: Body<T>, params: &SimulatorParams<T>) -> Vector2<T> {
        let gap = separation(me.state.position - other.state.position, me.extent, other.extent);
        let (nx, ny) = (gap.normal.x, gap.normal.y);
        let mut push = T::zero();
        if nx < T::zero() {
            let v = me.state.velocity.x;
            let closing = v - other.state.velocity.x;
            let a = params.cruise.acceleration;
            let dynamic = v * (self.headway + closing / (lit::<T>(2.0) * (a * self.braking).sqrt()));
            let desired = self.standstill_gap + dynamic.max(T::zero());
            let aside = gap.beside.max(T::zero()) / self.path_margin;
            let strength = (a * (self.stiffness * (T::one() - gap.distance / desired)).exp()).min(params.grip);
            push += strength * (-aside * aside).exp() * nx * nx;
        }
        if ny != T::zero() {
            push += (self.beside * (-gap.distance / self.beside_range).exp()).min(params.grip) * ny * ny;
        }
        gap.normal * push
    }
}

/// What of a vehicle others feel.
#[derive(Clone, Copy)]
pub(crate) struct Body<T: RealField> {
    pub(crate) state: State<T>,
    pub(crate) extent: Extent<T>,
}

impl<T: RealField + Copy> Repulsion<T> {
    /// Push of `other` on `me`, in m/s².
    #[inline]
    pub(crate) fn push(&self, me: Body<T>, other: Body<T>, params: &SimulatorParams<T>) -> Vector2<T> {
        match self {
            Self::Published { k, r_col } => vehicle_force(me.state.position - other.state.position, *k, *r_col),
            Self::Motorway(rule) => rule.push(me, other, params),
        }
    }

    pub(crate) fn check(&self) -> Result<(), ForceError> {
        match self {
            Self::Published { k, r_col } => {
                require_not_negative("repulsion.k", *k)?;
                require_positive("repulsion.r_col", *r_col)
            }
            Self::Motorway(rule) => {
                require_positive("repulsion.standstill_gap", rule.standstill_gap)?;
                require_not_negative("repulsion.headway", rule.headway)?;
                require_positive("repulsion.braking", rule.braking)?;
                require_positive("repulsion.stiffness", rule.stiffness)?;
                require_positive("repulsion.path_margin", rule.path_margin)?;
                require_not_negative("repulsion.beside", rule.beside)?;
                require_positive("repulsion.beside_range", rule.beside_range)
            }
        }
    }
}
