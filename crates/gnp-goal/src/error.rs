//! What can be wrong with a configuration or with inputs.

/// Why goals could not be predicted or learned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GoalError {
    /// A setting outside its range.
    #[error("goal.{key} is {value}: {remedy}")]
    Setting {
        /// Key in the configuration.
        key: &'static str,
        /// What it is set to.
        value: String,
        /// What to set it to.
        remedy: String,
    },
    /// A tensor of another shape than the network was made for.
    #[error("`{name}` has shape {found:?}, the goal network needs {needed}")]
    Shape {
        /// Name of the argument.
        name: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// What it should be.
        needed: String,
    },
    /// A mode that does not exist was picked.
    #[error("mode {index} was picked, but there are only {modes}: pick from 0 to {}", modes - 1)]
    Mode {
        /// The mode picked.
        index: u32,
        /// How many there are.
        modes: usize,
    },
    /// candle's own failure.
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}
