//! What moves: a point with a velocity.
use nalgebra::{Point2, RealField, Vector2};

/// Position and velocity of one vehicle in the road frame: x forward along the road, y to the left.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct State<T: RealField> {
    /// Centre of the vehicle, in m.
    pub position: Point2<T>,
    /// Velocity, in m/s.
    pub velocity: Vector2<T>,
}

impl<T: RealField + Copy> State<T> {
    /// The state at (`x`, `y`) m with velocity (`vx`, `vy`) m/s.
    #[must_use]
    pub fn new(x: T, y: T, vx: T, vy: T) -> Self {
        Self { position: Point2::new(x, y), velocity: Vector2::new(vx, vy) }
    }

    /// Whether all four numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.iter().chain(self.velocity.iter()).all(|value| value.is_finite())
    }
}

/// Gradient of a number with respect to a [`State`], per m and per m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateGradient<T: RealField> {
    /// With respect to the position.
    pub position: Vector2<T>,
    /// With respect to the velocity.
    pub velocity: Vector2<T>,
}

impl<T: RealField + Copy> StateGradient<T> {
    /// That of a number which does not depend on the state.
    #[inline]
    #[must_use]
    pub fn zeros() -> Self {
        Self { position: Vector2::zeros(), velocity: Vector2::zeros() }
    }
}

impl<T: RealField + Copy> std::ops::AddAssign for StateGradient<T> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.position += other.position;
        self.velocity += other.velocity;
    }
}
