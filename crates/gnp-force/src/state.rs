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
