//! What can be wrong with a configuration or a scene.

/// Why a network could not be built or a scene could not be rolled out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrajError {
    /// A value of the configuration is out of its range.
    #[error("traj.{key} is {value}: {remedy}")]
    Config {
        /// Key under `traj`.
        key: &'static str,
        /// The value found.
        value: String,
        /// What it must be.
        remedy: &'static str,
    },
    /// A tensor of the scene has another shape than the others ask for.
    #[error("scene: `{name}` has shape {found:?}, expected {expected}")]
    Shape {
        /// Field of the scene.
        name: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have; named sizes come from the other fields.
        expected: String,
    },
    /// A field of the scene has a value that the roll-out cannot use.
    #[error("scene: `{name}`: {problem}")]
    Scene {
        /// Field of the scene.
        name: &'static str,
        /// What is wrong and what to do.
        problem: String,
    },
    /// candle refused an operation.
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}
