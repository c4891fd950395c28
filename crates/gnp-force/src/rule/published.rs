//! The paper's repulsion between points, with one strength.
use super::{Ego, Other, PairRule, Reach};
use crate::{
    error::{ForceError, require_not_negative, require_positive},
    scalar::lit,
    vehicle::vehicle_force,
};
use nalgebra::{RealField, Vector2};

/// The law between points, [`vehicle_force`], with one strength towards everybody.
///
/// **It does not stop anybody.** In the paper a network chooses `k` for every neighbour and moment. With one `k` the law
/// knows neither speeds nor sizes: a vehicle that follows a leader at 30 m/s drives through him when he brakes with 4 or
/// 8 m/s². That is a [`Event::Contact`](crate::Event::Contact), and takes its course. In dense traffic in several lanes
/// it also pushes vehicles beside each other off the road. It suits comparisons, joint roll-outs of a few seconds and
/// symmetric test scenes. In one lane, cars that close in at up to 10 m/s from 20 m or more, and wish to go no faster, do
/// not touch. Drivers who must stop take another rule.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Published<T> {
    /// Strength, in m/s².
    pub k: T,
    /// Distance over which the push falls to 1/e, in m.
    pub r_col: T,
}

impl<T: RealField + Copy> Published<T> {
    /// k = 9 m/s² and r_col = 26 m, the range of the published code.
    #[must_use]
    pub fn standard() -> Self {
        Self { k: lit(9.0), r_col: lit(26.0) }
    }
}

impl<T: RealField + Copy> PairRule<T> for Published<T> {
    fn reach(&self) -> Reach {
        Reach { ahead: 2, behind: 2, beside_ahead: 2, beside_behind: 2 }
    }

    #[inline]
    fn push(&self, me: &Ego<T>, other: &Other<T>) -> Vector2<T> {
        vehicle_force(me.state.position - other.state.position, self.k, self.r_col)
    }

    fn check(&self) -> Result<(), ForceError> {
        require_not_negative("published.k", self.k)?;
        require_positive("published.r_col", self.r_col)
    }
}
