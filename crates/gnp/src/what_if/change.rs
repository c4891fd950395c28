//! What can be changed in a moment, and what may be wrong with that.

use gnp_data::{NewVehicle, SceneEdit, SceneEditError};
use gnp_model::ModelError;

use super::names::UnknownVehicle;

/// A change of a moment or of the forces in it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Change {
    /// Of the vehicles.
    Scene(SceneEdit),
    /// A vehicle is drawn to a place instead of where the network expects it.
    Goal {
        /// Its number.
        vehicle: u32,
        /// Forward and left of where it is at the moment, m.
        at: [f32; 2],
    },
    /// A term of the force does not act, by its name, such as `neighbours`.
    WithoutTerm(String),
}

/// A change as one asks for it before the moment is known: vehicles by what the data calls them. [`Names`](super::Names) knows who that is.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum NamedChange {
    /// A vehicle is not there.
    Remove {
        /// What it is called.
        vehicle: String,
    },
    /// A vehicle is elsewhere, its whole past with it.
    Move {
        /// What it is called.
        vehicle: String,
        /// Forward and to the left, m.
        by: [f32; 2],
    },
    /// A vehicle arrives at its place with another speed.
    Speed {
        /// What it is called.
        vehicle: String,
        /// The speed along the road, m/s.
        speed_mps: f32,
    },
    /// A vehicle is drawn to a place instead of where the network expects it.
    Goal {
        /// What it is called.
        vehicle: String,
        /// Forward and left of where it is at the moment, m.
        at: [f32; 2],
    },
    /// A term of the force does not act, by its name.
    WithoutTerm(String),
}

impl From<SceneEdit> for Change {
    fn from(edit: SceneEdit) -> Self {
        Self::Scene(edit)
    }
}

impl Change {
    /// In words, such as `without vehicle 34`; `name` says what a vehicle is called.
    #[must_use]
    pub fn words(&self, name: impl Fn(u32) -> String) -> String {
        match self {
            Self::Scene(SceneEdit::Remove { vehicle }) => format!("without vehicle {}", name(*vehicle)),
            Self::Scene(SceneEdit::Move { vehicle, by }) => format!("with vehicle {} {}", name(*vehicle), moved(*by)),
            Self::Scene(SceneEdit::Speed { vehicle, speed_mps }) => {
                format!("with vehicle {} at {speed_mps} m/s", name(*vehicle))
            }
            Self::Scene(SceneEdit::Add(NewVehicle { vehicle, speed_mps, .. })) => {
                format!("with a vehicle {} added at {speed_mps} m/s", name(*vehicle))
            }
            Self::Goal { vehicle, at: [x, y] } => {
                format!("with vehicle {} drawn to {x} m ahead and {y} m to the left", name(*vehicle))
            }
            Self::WithoutTerm(term) => format!("without the force of {term}"),
        }
    }

    /// The vehicle that is changed, where it is one.
    #[must_use]
    pub fn vehicle(&self) -> Option<u32> {
        match self {
            Self::Scene(edit) => Some(edit.vehicle()),
            Self::Goal { vehicle, .. } => Some(*vehicle),
            Self::WithoutTerm(_) => None,
        }
    }
}

/// Such as `moved 10 m back and 3.5 m to the left`.
fn moved([forward, left]: [f32; 2]) -> String {
    let part = |length: f32, positive: &str, negative: &str| {
        (length != 0.).then(|| format!("{} m {}", length.abs(), if length > 0. { positive } else { negative }))
    };
    let parts: Vec<String> =
        [part(forward, "forward", "back"), part(left, "to the left", "to the right")].into_iter().flatten().collect();
    if parts.is_empty() { "moved by nothing".to_owned() } else { format!("moved {}", parts.join(" and ")) }
}

/// A change that cannot be made. Those before it can.
#[derive(Debug, thiserror::Error)]
#[error("change {}: {problem}", index + 1)]
#[non_exhaustive]
pub struct ChangeError {
    /// Which of the changes, from 0.
    pub index: usize,
    /// What is wrong with it.
    pub problem: ChangeProblem,
}

/// What is wrong with a change.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeProblem {
    /// Nobody is called so.
    #[error(transparent)]
    Unknown(#[from] UnknownVehicle),
    /// A vehicle that is not there, or no longer.
    #[error("{said}; there are {there}")]
    Absent {
        /// Which one.
        source: SceneEditError,
        /// The same by the names of the data.
        said: String,
        /// Those that are there, in words.
        there: String,
    },
    /// The scene does not take it.
    #[error("{said}")]
    Scene {
        /// Why.
        source: SceneEditError,
        /// The same by the names of the data.
        said: String,
    },
    /// The vehicle whose forecast is asked for is to be removed.
    #[error("vehicle {name} is the one that is explained and cannot be removed")]
    Explained {
        /// What the vehicle is called.
        name: String,
    },
    /// A goal that is no place.
    #[error("a goal at {x}, {y} m is not within {} m of the vehicle", gnp_data::limits::MAX_POSITION)]
    Goal {
        /// Forward, m.
        x: f32,
        /// To the left, m.
        y: f32,
    },
    /// The model has no such term of the force.
    #[error(transparent)]
    Term(Box<ModelError>),
}

impl ChangeProblem {
    /// The same in which the vehicle has its name instead of its number.
    pub(super) fn by_name(mut self, named: Option<(u32, String)>) -> Self {
        if let (Self::Absent { said, .. } | Self::Scene { said, .. }, Some((vehicle, name))) = (&mut self, named) {
            *said = said.replacen(&format!("vehicle {vehicle}"), &format!("vehicle {name}"), 1);
        }
        self
    }
}

/// The part of a change that a [`ChangeProblem`] is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ChangeField {
    /// Which vehicle.
    Vehicle,
    /// How far it is moved.
    By,
    /// A speed.
    Speed,
    /// A place.
    At,
    /// Length and width.
    Size,
    /// The name of a term.
    Term,
}

impl ChangeError {
    /// The part of the change that the problem is about.
    #[must_use]
    pub fn field(&self) -> ChangeField {
        match &self.problem {
            ChangeProblem::Scene { source, .. } => match source {
                SceneEditError::Speed { .. } => ChangeField::Speed,
                SceneEditError::Move { .. } => ChangeField::By,
                SceneEditError::Place { .. } => ChangeField::At,
                SceneEditError::Size { .. } => ChangeField::Size,
                _ => ChangeField::Vehicle,
            },
            ChangeProblem::Goal { .. } => ChangeField::At,
            ChangeProblem::Term(_) => ChangeField::Term,
            ChangeProblem::Unknown(_) | ChangeProblem::Absent { .. } | ChangeProblem::Explained { .. } => {
                ChangeField::Vehicle
            }
        }
    }
}
