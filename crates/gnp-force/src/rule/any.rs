//! Any of the rules, for scenes with drivers of different kinds.
use super::{
    DifferentiableRule, Ego, EgoGradient, Idm, MotorwayRule, Newell, Other, PairRule, Published, PushGradient, Reach,
};
use crate::error::ForceError;
use nalgebra::{RealField, Vector2};

/// One of the four rules of this crate: what a [`Vehicle`](crate::Vehicle) has unless its type says otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Rule<T> {
    /// The paper's law between points. It does not stop anybody: see [`Published`].
    Published(Published<T>),
    /// The social force between boxes.
    Motorway(MotorwayRule<T>),
    /// The intelligent driver model.
    Idm(Idm<T>),
    /// Newell's car following.
    Newell(Newell<T>),
}

macro_rules! each {
    ($self:ident, $rule:ident => $body:expr) => {
        match $self {
            Rule::Published($rule) => $body,
            Rule::Motorway($rule) => $body,
            Rule::Idm($rule) => $body,
            Rule::Newell($rule) => $body,
        }
    };
}

impl<T: RealField + Copy> PairRule<T> for Rule<T> {
    #[inline]
    fn reach(&self) -> Reach {
        each!(self, rule => PairRule::<T>::reach(rule))
    }

    #[inline]
    fn free(&self, me: &Ego<T>) -> T {
        each!(self, rule => rule.free(me))
    }

    #[inline]
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
        each!(self, rule => rule.push(me, other))
    }

    fn check(&self) -> Result<(), ForceError> {
        each!(self, rule => PairRule::<T>::check(rule))
    }
}

/// Names and number of parameters are those of the rule that it is.
impl<T: RealField + Copy> DifferentiableRule<T> for Rule<T> {
    fn names(&self) -> &'static [&'static str] {
        each!(self, rule => DifferentiableRule::<T>::names(rule))
    }

    fn parameters(&self) -> Vec<T> {
        each!(self, rule => rule.parameters())
    }

    fn with_parameters(&self, parameters: &[T]) -> Result<Self, ForceError> {
        each!(self, rule => rule.with_parameters(parameters).map(Self::from))
    }

    #[inline]
    fn free_vjp(&self, me: &Ego<T>, cotangent: T, d: &mut [T]) -> EgoGradient<T> {
        each!(self, rule => rule.free_vjp(me, cotangent, d))
    }

    #[inline]
    fn push_vjp(&self, me: &Ego<T>, other: &Other<T>, cotangent: Vector2<T>, d: &mut [T]) -> PushGradient<T> {
        each!(self, rule => rule.push_vjp(me, other, cotangent, d))
    }
}

impl<T> From<Published<T>> for Rule<T> {
    fn from(rule: Published<T>) -> Self {
        Self::Published(rule)
    }
}

impl<T> From<MotorwayRule<T>> for Rule<T> {
    fn from(rule: MotorwayRule<T>) -> Self {
        Self::Motorway(rule)
    }
}

impl<T> From<Idm<T>> for Rule<T> {
    fn from(rule: Idm<T>) -> Self {
        Self::Idm(rule)
    }
}

impl<T> From<Newell<T>> for Rule<T> {
    fn from(rule: Newell<T>) -> Self {
        Self::Newell(rule)
    }
}
