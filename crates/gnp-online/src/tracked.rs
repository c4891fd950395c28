//! What is known of a vehicle in a frame.

use gnp_data::VehicleClass;

/// A vehicle that was detected, at the time of its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Tracked {
    /// Who it is: the same number from frame to frame.
    pub id: u64,
    /// Centre of its box, m, in the coordinates of the stream.
    pub position: [f64; 2],
    /// Velocity, m/s, in the directions of these coordinates, from measurements up to now; `None` where not measured.
    pub velocity: Option<[f32; 2]>,
    /// Length and width, m; `None` where not known: see [`VehicleClass::default_size`].
    pub size: Option<[f32; 2]>,
    /// Kind of vehicle.
    pub class: VehicleClass,
}

impl Tracked {
    /// A car of which only the position is known; the other fields may be set afterwards.
    #[must_use]
    pub fn new(id: u64, position: [f64; 2]) -> Self {
        Self { id, position, velocity: None, size: None, class: VehicleClass::Car }
    }

    /// The same with a measured velocity, m/s.
    #[must_use]
    pub fn with_velocity(self, velocity: [f32; 2]) -> Self {
        Self { velocity: Some(velocity), ..self }
    }

    /// The same with length and width, m.
    #[must_use]
    pub fn with_size(self, size: [f32; 2]) -> Self {
        Self { size: Some(size), ..self }
    }

    /// The same of another kind.
    #[must_use]
    pub fn with_class(self, class: VehicleClass) -> Self {
        Self { class, ..self }
    }
}
