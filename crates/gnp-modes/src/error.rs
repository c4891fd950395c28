//! What can be wrong with futures, parameters and files of modes.

/// Why modes could not be found, compared, written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModeError {
    /// A parameter outside its range.
    #[error("modes.{key} is {value}: {remedy}")]
    Parameter {
        /// Key in the configuration.
        key: &'static str,
        /// What it is set to.
        value: String,
        /// What to set it to.
        remedy: String,
    },
    /// The futures are not `[n, t_pred, 2]`.
    #[error(
        "{found} values cannot be paths of {t_pred} steps of x and y: give a multiple of {}, and t_pred at least 1",
        2 * t_pred
    )]
    Shape {
        /// Number of values given.
        found: usize,
        /// Steps of a path.
        t_pred: usize,
    },
    /// A coordinate is NaN, infinite or beyond any road.
    #[error(
        "future {sample}, step {step}: {value} is not a position in m below {} km; \
         remove the window or repair its recording",
        crate::params::FARTHEST / 1e3
    )]
    Coordinate {
        /// Index of the future.
        sample: usize,
        /// Step of the future, from 0.
        step: usize,
        /// What stands there.
        value: f32,
    },
    /// More modes asked for than there are different futures.
    #[error(
        "{modes} modes were asked for, but the {samples} futures hold only {distinct} different ones: \
         set modes.modes to {distinct} or less, or cut more windows"
    )]
    TooFewDistinct {
        /// Modes asked for.
        modes: usize,
        /// Futures given.
        samples: usize,
        /// Different ones among them.
        distinct: usize,
    },
    /// Every start ended with a cluster that no future belongs to.
    #[error(
        "all {restarts} starts ended with an empty cluster: ask for fewer than {modes} modes, \
         or set another modes.seed or more modes.restarts"
    )]
    EmptyCluster {
        /// Modes asked for.
        modes: usize,
        /// Starts tried.
        restarts: usize,
    },
    /// A file of modes that cannot be written, read or used.
    #[error(transparent)]
    File(#[from] gnp_file::FileError),
}
