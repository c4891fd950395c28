//! Who keeps away from whom, and how strongly: the rule of a driver towards each other vehicle.
//!
//! A rule is a small value that belongs to one vehicle and holds its driver's parameters, so that every driver may
//! differ. It answers two questions: how the driver accelerates on an empty road, and what the presence of one other
//! vehicle changes. A [`Simulator`](crate::Simulator) adds the answers up; forces remain apart by source.
//!
//! Four rules are here: [`Published`], [`MotorwayRule`], [`Idm`] and [`Newell`]; [`Rule`] is any of them, for scenes
//! with drivers of different kinds. A rule of one's own implements [`PairRule`], and for gradients
//! [`DifferentiableRule`].
mod any;
mod following;
mod gradient;
mod motorway;
mod newell;
mod published;

pub use self::{
    any::Rule,
    following::Idm,
    gradient::{DifferentiableRule, EgoGradient, PushGradient},
    motorway::MotorwayRule,
    newell::Newell,
    published::Published,
};
use crate::{
    boxes::{Extent, Separation, separation},
    error::{ForceError, require_positive},
    scalar::lit,
    state::State,
};
use nalgebra::{RealField, Vector2};
use std::fmt;

/// Lateral gap in m at which a vehicle ahead that is in another lane counts only 1/e of one in the path, for the rules
/// of car following.
pub const PATH_MARGIN: f64 = 0.5;

/// Exponents below this count as minus infinity: `exp` is 0 there, not a subnormal number, on which processors are slow.
const NEGLIGIBLE: f64 = -40.0;

/// `exp(exponent)`, and exactly 0 from -40 down.
#[inline(always)]
pub(crate) fn fading<T: RealField + Copy>(exponent: T) -> T {
    if exponent > lit(NEGLIGIBLE) { exponent.exp() } else { T::zero() }
}

/// The most that a vehicle can accelerate, whatever draws and pushes it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Limits<T> {
    /// Forward, in m/s².
    pub acceleration: T,
    /// Braking, a positive number, in m/s².
    pub braking: T,
    /// To either side, in m/s².
    pub lateral: T,
}

impl<T: RealField + Copy> Limits<T> {
    /// A passenger car on a dry road: 4 m/s² forward, 9 m/s² braking, 5 m/s² to the side.
    #[must_use]
    pub fn car() -> Self {
        Self { acceleration: lit(4.0), braking: lit(9.0), lateral: lit(5.0) }
    }

    /// An articulated lorry: 1.5 m/s² forward, 7 m/s² braking, 3 m/s² to the side.
    #[must_use]
    pub fn truck() -> Self {
        Self { acceleration: lit(1.5), braking: lit(7.0), lateral: lit(3.0) }
    }

    /// `wanted` acceleration in m/s² of a vehicle that moves with `velocity` m/s, each part within the limits; one that
    /// moves against x brakes with a positive one.
    #[inline]
    #[must_use]
    pub fn hold(&self, wanted: Vector2<T>, velocity: Vector2<T>) -> Vector2<T> {
        let along = if velocity.x < T::zero() { -self.along(-wanted.x) } else { self.along(wanted.x) };
        Vector2::new(along, wanted.y.max(-self.lateral).min(self.lateral))
    }

    /// `wanted` acceleration along the road in m/s² of a vehicle that moves forward, within the limits.
    #[inline]
    #[must_use]
    pub fn along(&self, wanted: T) -> T {
        wanted.max(-self.braking).min(self.acceleration)
    }

    pub(crate) fn check(&self) -> Result<(), ForceError> {
        require_positive("limits.acceleration", self.acceleration)?;
        require_positive("limits.braking", self.braking)?;
        require_positive("limits.lateral", self.lateral)
    }
}

/// What a rule knows of the vehicle that it drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ego<T: RealField> {
    /// Where it is and how it moves.
    pub state: State<T>,
    /// How large it is.
    pub extent: Extent<T>,
    /// Speed that the driver wishes, in m/s.
    pub wish: T,
    /// Relaxation time, in s.
    pub tau: T,
    /// What it can do.
    pub limits: Limits<T>,
}

impl<T: RealField + Copy> Ego<T> {
    /// How another vehicle lies to this one.
    #[inline]
    #[must_use]
    pub fn separation_from(&self, other: &Other<T>) -> Separation<T> {
        separation(self.state.position - other.state.position, self.extent, other.extent)
    }
}

/// What a rule knows of another vehicle, or of the place where a lane ends, which stands still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Other<T: RealField> {
    /// Where it is and how it moves; on a ring, as seen from the vehicle.
    pub state: State<T>,
    /// How large it is.
    pub extent: Extent<T>,
    /// Where it is among the others.
    pub place: Place,
}

/// Where another vehicle is among those around.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Whether its centre is ahead.
    pub ahead: bool,
    /// Lanes to the left: -1 right, 0 the own lane, 1 left.
    pub lane: i8,
    /// How many vehicles of that lane are nearer on that side.
    pub rank: usize,
    /// Whether one of the two is changing into the lane of the other.
    pub merging: bool,
}

impl Place {
    /// The vehicle directly ahead.
    pub const LEADER: Self = Self { ahead: true, lane: 0, rank: 0, merging: false };

    /// Whether both are in one lane, or about to be.
    #[inline]
    #[must_use]
    pub fn shares_lane(&self) -> bool {
        self.lane == 0 || self.merging
    }
}

/// How many vehicles a driver pays attention to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// Ahead in the own lane.
    pub ahead: usize,
    /// Behind in the own lane.
    pub behind: usize,
    /// Ahead in each lane beside.
    pub beside_ahead: usize,
    /// Behind in each lane beside.
    pub beside_behind: usize,
}

/// How a driver moves on an empty road, and what another vehicle changes about that.
///
/// The value holds the driver's parameters. Both answers must be finite for finite input.
///
/// ```
/// use gnp_force::na::{RealField, Vector2};
/// use gnp_force::{Ego, Other, PairRule, Reach};
///
/// /// Brakes at once for whoever is less than a second ahead.
/// #[derive(Clone, Debug)]
/// struct Nervous;
///
/// impl<T: RealField + Copy> PairRule<T> for Nervous {
///     fn reach(&self) -> Reach {
///         Reach { ahead: 1, behind: 0, beside_ahead: 0, beside_behind: 0 }
///     }
///
///     fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
///         let near = me.separation_from(other).ahead < me.state.velocity.x;
///         // What the push adds to the free acceleration makes a full braking.
///         let free = PairRule::<T>::free(self, me);
///         Vector2::new(if near { -me.limits.braking - free } else { T::zero() }, T::zero())
///     }
/// }
/// ```
pub trait PairRule<T: RealField + Copy>: Clone + fmt::Debug + Send + Sync {
    /// Who is asked about.
    fn reach(&self) -> Reach;

    /// Acceleration along the road with nobody around, in m/s². By default `(wish - v) / tau`, within the limits.
    #[inline]
    fn free(&self, me: &Ego<T>) -> T {
        me.limits.along((me.wish - me.state.velocity.x) / me.tau)
    }

    /// What the presence of `other` adds to the acceleration on an empty road, in m/s².
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T>;

    /// Acceleration along the road behind `leader`, or behind nobody, in m/s², within the limits: what a decision to
    /// change lanes weighs.
    #[inline]
    fn behind(&self, me: &Ego<T>, leader: Option<&Other<T>>) -> T {
        let push = leader.map_or_else(T::zero, |leader| self.push(me, leader).x);
        me.limits.along(self.free(me) + push)
    }

    /// Whether the physics allows these parameters.
    ///
    /// # Errors
    /// Names the first one out of range and what it must be.
    fn check(&self) -> Result<(), ForceError> {
        Ok(())
    }
}

/// How much a vehicle ahead counts: 1 in the same lane, elsewhere less the more there is room to pass it.
#[inline]
pub(crate) fn in_path<T: RealField + Copy>(place: Place, beside: T) -> T {
    if place.shares_lane() {
        return T::one();
    }
    let aside = beside.max(T::zero()) / lit(PATH_MARGIN);
    fading(-aside * aside)
}
