//! The three stages of GNP: goals, then attraction, then repulsion (GNP paper, progressive training).

mod goal;
mod path;
mod windows;

pub use goal::{GoalStage, GoalTraining};
pub use path::{PathStage, PathTraining};
pub use windows::Windows;
