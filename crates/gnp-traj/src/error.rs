//! What can be wrong with a configuration or a batch.

/// Why a network could not be built or a batch could not be rolled out.
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
        remedy: String,
    },
    /// A tensor of the batch has another shape than the others ask for.
    #[error("roll-out: `{name}` has shape {found:?}, expected {expected}")]
    Shape {
        /// Field of the batch.
        name: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have; named sizes come from the other fields.
        expected: String,
    },
    /// A field of the batch has a value that the roll-out cannot use.
    #[error("roll-out: `{name}`: {problem}")]
    Batch {
        /// Field of the batch.
        name: &'static str,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A term of the force cannot act as it is asked to.
    #[error("force term `{name}`: {problem}")]
    Term {
        /// Name of the term.
        name: String,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The processor does not multiply in the precision asked for.
    #[error(transparent)]
    Precision(#[from] gnp_nn::PrecisionError),
    /// candle refused an operation.
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}
