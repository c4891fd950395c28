//! What can be wrong with what a simulator or a platoon is given.
use crate::simulator::VehicleId;
use nalgebra::RealField;
use std::fmt;

/// Why parameters, a road, a driver or a vehicle were refused.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ForceError {
    /// A number outside what the physics allows.
    Value {
        /// The field, as in the structure: `cruise.preview`.
        key: &'static str,
        /// What it was.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// No vehicle of that number is in the scene: it arrived, was removed, or never was.
    UnknownVehicle {
        /// The number asked for.
        id: VehicleId,
    },
    /// A vehicle was to be put where another one is.
    Occupied {
        /// The vehicle that is there.
        id: VehicleId,
    },
    /// A vehicle was to be put where its lane is closed, or beyond the end of the road.
    Closed {
        /// Its place along the road, in m.
        x: f64,
        /// The lane, 0 the rightmost.
        lane: usize,
    },
    /// A vehicle was to be put beside the road.
    OffRoad {
        /// Its lateral position, in m.
        y: f64,
    },
    /// A vehicle of a platoon follows one that is not there, or itself.
    Leader {
        /// Number of the vehicle.
        vehicle: usize,
        /// Number of its leader.
        leader: usize,
        /// How many vehicles there are.
        vehicles: usize,
    },
    /// Vehicles of a platoon follow each other in a circle.
    Circle {
        /// Number of one of them.
        vehicle: usize,
    },
}

impl fmt::Display for ForceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value { key, value, must } => write!(f, "`{key}` is {value}, but must be {must}"),
            Self::UnknownVehicle { id } => {
                write!(f, "no vehicle {id} in the scene: take numbers from `Simulator::add` or `Simulator::vehicles`")
            }
            Self::Occupied { id } => {
                write!(f, "vehicle {id} is there: add it elsewhere, or by `Simulator::place` if it was recorded so")
            }
            Self::Closed { x, lane } => {
                write!(f, "at {x} m lane {lane} is closed or the road has ended: add the vehicle elsewhere")
            }
            Self::OffRoad { y } => {
                write!(f, "y = {y} m is beside the road: add it between the outermost lines, or by `Simulator::place`")
            }
            Self::Leader { vehicle, leader, vehicles } => {
                write!(
                    f,
                    "vehicle {vehicle} follows {leader}, but must follow another of the {vehicles} vehicles or none"
                )
            }
            Self::Circle { vehicle } => {
                write!(f, "vehicle {vehicle} follows itself through its leaders: one of them must follow nobody")
            }
        }
    }
}

impl std::error::Error for ForceError {}

/// Refuses `value` under the name `key` unless `good`.
pub(crate) fn require<T: RealField + Copy>(
    good: bool,
    key: &'static str,
    value: T,
    must: &'static str,
) -> Result<(), ForceError> {
    if good { Ok(()) } else { Err(ForceError::Value { key, value: value.to_subset_unchecked(), must }) }
}

/// Refuses what is not a finite number above 0.
pub(crate) fn require_positive<T: RealField + Copy>(key: &'static str, value: T) -> Result<(), ForceError> {
    require(value > T::zero() && value.is_finite(), key, value, "above 0 and finite")
}

/// Refuses what is not a finite number of at least 0.
pub(crate) fn require_not_negative<T: RealField + Copy>(key: &'static str, value: T) -> Result<(), ForceError> {
    require(value >= T::zero() && value.is_finite(), key, value, "0 or more and finite")
}
