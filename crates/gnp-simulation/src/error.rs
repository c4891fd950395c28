//! What can be wrong with a simulation.
use gnp_data::DataError;
use gnp_force::ForceError;

/// Why traffic was not simulated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The physics refuses a number, a place or a road.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// What happened is no recording, or a recording cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// More vehicles or steps than a recording can number.
    #[error("{what} is {value}, but at most {most} can be recorded: shorten the simulation or record fewer frames")]
    TooLarge {
        /// What is too large.
        what: &'static str,
        /// How large.
        value: u64,
        /// The most.
        most: u64,
    },
}
