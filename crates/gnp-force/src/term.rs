//! Terms of the force: what each is called, what it acts from, and its law with the gradient.
//!
//! A term is one file of this crate: a law, a [`TermDescriptor`] and an implementation of [`ForceTerm`], listed once in
//! [`terms`]. Roll-outs, prediction files, figures and the report read the descriptor, so that none of them names a term.
//! A term of one's own is any other type that implements the trait.
use crate::{
    car_following::{CarFollowing, FreeRoad},
    goal::GoalAttraction,
    line::{LineRepulsion, MarkingKind, Side},
    state::State,
    vehicle::VehicleRepulsion,
};
use nalgebra::{Point2, RealField, Vector2};
use std::{borrow::Cow, fmt};

/// What a term of the force is called, how it is drawn, what it acts from, and which parameters it has.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct TermDescriptor {
    /// Name in files and configurations: lower-case letters, digits and `_`.
    pub name: Cow<'static, str>,
    /// Name in figures and the report, short.
    pub label: Cow<'static, str>,
    /// What it is, in a few words.
    pub meaning: Cow<'static, str>,
    /// Unit of the force; `m/s²`, as masses are 1.
    pub unit: Cow<'static, str>,
    /// Colour in figures, `#rrggbb`.
    pub colour: Cow<'static, str>,
    /// What it acts from.
    pub arity: Arity,
    /// Its parameters, in the order in which [`ForceTerm`] takes them.
    pub parameters: Cow<'static, [TermParameter]>,
}

/// A parameter of a term.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct TermParameter {
    /// Name in files and configurations, as of a term.
    pub name: Cow<'static, str>,
    /// What it is, in a few words.
    pub meaning: Cow<'static, str>,
    /// Unit; empty for a plain number.
    pub unit: Cow<'static, str>,
    /// Whether it may differ from step to step and from source to source, as what a network sets does. Such a parameter
    /// is reported with the force; another is one number for a whole roll-out.
    pub varies: bool,
}

/// From how many sources a term acts on one vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Arity {
    /// Once, from a [`Source::Goal`]; a term that needs no goal ignores it.
    One,
    /// From every neighbour, a [`Source::Vehicle`].
    PerNeighbour,
    /// From every line on the road, a [`Source::Line`].
    PerLine,
}

/// What a term acts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source<T: RealField> {
    /// The vehicle's own goal.
    Goal {
        /// Where to be, in m.
        goal: Point2<T>,
        /// Until when, in s from now.
        time_left: T,
    },
    /// Another vehicle.
    Vehicle {
        /// Number of its neighbour slot; 0 is the vehicle ahead in the lane.
        slot: usize,
        /// Where it is and how it moves.
        state: State<T>,
    },
    /// A line along the road.
    Line {
        /// Whether it may be crossed.
        kind: MarkingKind,
        /// Lateral position, in m.
        y: T,
        /// The side on which the road lies; a line between lanes ignores it.
        road: Side,
    },
}

/// Gradient of `cotangent · F` for the force `F` of a term; see [`ForceTerm::vjp`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TermVjp<T: RealField> {
    /// With respect to the vehicle's position.
    pub position: Vector2<T>,
    /// With respect to the vehicle's velocity.
    pub velocity: Vector2<T>,
    /// With respect to the source's position: the goal, the neighbour's centre, or (in y) the line's.
    pub source_position: Vector2<T>,
    /// With respect to the velocity of a neighbour.
    pub source_velocity: Vector2<T>,
}

/// A term of the force: a law that keeps nothing, so that a caller owns state and parameters.
///
/// Both methods are finite for every finite input, and 0 for a source or a number of parameters that the term is not
/// for. The gradient is that of the value.
///
/// ```
/// use gnp_force::na::{RealField, Vector2};
/// use gnp_force::{Arity, ForceTerm, Source, State, TermDescriptor, TermParameter, TermVjp};
///
/// /// A drag against the motion, `-c v`.
/// #[derive(Debug)]
/// struct Drag(TermDescriptor);
///
/// impl Drag {
///     fn new() -> Self {
///         let c = TermParameter::constant("c", "1/s", "drag per speed");
///         Self(TermDescriptor::new("drag", Arity::One, "#7a5195").means("drag", "drag of the air").with(vec![c]))
///     }
/// }
///
/// impl<T: RealField + Copy> ForceTerm<T> for Drag {
///     fn descriptor(&self) -> &TermDescriptor {
///         &self.0
///     }
///
///     fn force(&self, state: &State<T>, _: &Source<T>, parameters: &[T]) -> Vector2<T> {
///         let &[c] = parameters else { return Vector2::zeros() };
///         -state.velocity * c
///     }
///
///     fn vjp(&self, state: &State<T>, _: &Source<T>, parameters: &[T], cotangent: Vector2<T>, d: &mut [T]) -> TermVjp<T> {
///         let (&[c], [dc]) = (parameters, d) else { return TermVjp::zeros() };
///         *dc = -state.velocity.dot(&cotangent);
///         TermVjp { velocity: -cotangent * c, ..TermVjp::zeros() }
///     }
/// }
/// ```
pub trait ForceTerm<T: RealField + Copy>: fmt::Debug + Send + Sync {
    /// What the term is called and which parameters it takes.
    fn descriptor(&self) -> &TermDescriptor;

    /// Force of one source on a vehicle in `state`, in m/s².
    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T>;

    /// Vector-Jacobian product of [`ForceTerm::force`]: the gradient of `cotangent · F` with respect to state and source;
    /// that with respect to the parameters overwrites `dparameters`, which has their number.
    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        dparameters: &mut [T],
    ) -> TermVjp<T>;
}

impl<T: RealField + Copy, L: ForceTerm<T> + ?Sized> ForceTerm<T> for &L {
    fn descriptor(&self) -> &TermDescriptor {
        (**self).descriptor()
    }

    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        (**self).force(state, source, parameters)
    }

    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        dparameters: &mut [T],
    ) -> TermVjp<T> {
        (**self).vjp(state, source, parameters, cotangent, dparameters)
    }
}

/// The term of this crate with that name: `goal`, `neighbours`, `lines`, `free_road` or `car_following`.
#[must_use]
pub fn term<T: RealField + Copy>(name: &str) -> Option<&'static dyn ForceTerm<T>> {
    terms().into_iter().find(|term| term.descriptor().name == name)
}

/// Every term of this crate, in the order in which a roll-out adds them up. A new one has its line here.
#[must_use]
pub fn terms<T: RealField + Copy>() -> [&'static dyn ForceTerm<T>; 5] {
    [&GoalAttraction, &VehicleRepulsion, &LineRepulsion, &FreeRoad, &CarFollowing]
}

impl TermDescriptor {
    /// A term of this name that is called by it everywhere, in m/s², without parameters.
    #[must_use]
    pub fn new(name: impl Into<Cow<'static, str>>, arity: Arity, colour: impl Into<Cow<'static, str>>) -> Self {
        let name = name.into();
        Self {
            label: name.clone(),
            meaning: name.clone(),
            name,
            unit: Cow::Borrowed("m/s²"),
            colour: colour.into(),
            arity,
            parameters: Cow::Borrowed(&[]),
        }
    }

    /// The same term with a label for figures and what it is in a few words.
    #[must_use]
    pub fn means(self, label: impl Into<Cow<'static, str>>, meaning: impl Into<Cow<'static, str>>) -> Self {
        Self { label: label.into(), meaning: meaning.into(), ..self }
    }

    /// The same term with these parameters.
    #[must_use]
    pub fn with(self, parameters: Vec<TermParameter>) -> Self {
        Self { parameters: parameters.into(), ..self }
    }

    /// The parameters that are reported with the force, in their order.
    pub fn varying(&self) -> impl Iterator<Item = &TermParameter> {
        self.parameters.iter().filter(|parameter| parameter.varies)
    }

    /// The same without heap memory, for the terms of this crate.
    pub(crate) const fn fixed(
        [name, label, meaning]: [&'static str; 3],
        colour: &'static str,
        arity: Arity,
        parameters: &'static [TermParameter],
    ) -> Self {
        Self {
            name: Cow::Borrowed(name),
            label: Cow::Borrowed(label),
            meaning: Cow::Borrowed(meaning),
            unit: Cow::Borrowed("m/s²"),
            colour: Cow::Borrowed(colour),
            arity,
            parameters: Cow::Borrowed(parameters),
        }
    }
}

impl TermParameter {
    /// A parameter that is one number for a whole roll-out.
    #[must_use]
    pub const fn constant(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), meaning: Cow::Borrowed(meaning), unit: Cow::Borrowed(unit), varies: false }
    }

    /// A parameter that may differ from step to step and from source to source.
    #[must_use]
    pub const fn varying(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), meaning: Cow::Borrowed(meaning), unit: Cow::Borrowed(unit), varies: true }
    }
}

impl<T: RealField> TermVjp<T> {
    /// No gradient.
    #[must_use]
    pub fn zeros() -> Self {
        Self {
            position: Vector2::zeros(),
            velocity: Vector2::zeros(),
            source_position: Vector2::zeros(),
            source_velocity: Vector2::zeros(),
        }
    }
}
