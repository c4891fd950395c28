//! Everything that can go wrong in a run.

use std::path::PathBuf;

/// Result of the functions of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why something could not be done. Commands in messages are those of the program `gnp`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// [`Stop`](crate::Stop) was requested.
    #[error("interrupted; {}", kept.as_ref().map_or_else(|| "nothing was written".to_owned(), |folder| format!("what is done is kept in {}", folder.display())))]
    Stopped {
        /// Folder of what was done, from which the work can go on.
        kept: Option<PathBuf>,
    },
    /// A configuration, a setting or a recipe cannot be used.
    #[error("{0}")]
    Config(String),
    /// A folder is no run, is not finished, is in use, or belongs to something else.
    #[error("{0}")]
    Folder(String),
    /// Recordings do not fit what is asked for.
    #[error("{0}")]
    Recordings(String),
    /// A change of a moment cannot be made.
    #[error(transparent)]
    Change(#[from] crate::what_if::ChangeError),
    /// A file of predictions does not fit the windows.
    #[error("{0}")]
    Predictions(String),
    /// This build or this computer cannot do it.
    #[error("{0}")]
    Unavailable(String),
    /// Some jobs of a table failed; all others are done.
    #[error("{} failed, the others are done:{}", if failed.len() == 1 { "one job".to_owned() } else { format!("{} jobs", failed.len()) }, failed.iter().map(|(id, error)| format!("\n  {id}: {}", error.chain())).collect::<String>())]
    Jobs {
        /// Names of jobs, each with what went wrong.
        failed: Vec<(String, Error)>,
    },
    /// What was being done, and what stopped it.
    #[error("{what}")]
    While {
        /// What was being done, or the file it was done to.
        what: String,
        /// Why it could not be done.
        #[source]
        source: Box<Error>,
    },
    /// The file system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A JSON file.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A value that has no TOML form.
    #[error(transparent)]
    Toml(#[from] toml::ser::Error),
    /// Recordings, windows, splits.
    #[error(transparent)]
    Data(#[from] gnp_data::DataError),
    /// A file of a road.
    #[error(transparent)]
    Road(#[from] gnp_road::RoadFileError),
    /// Lane lines that make no lanes.
    #[error(transparent)]
    LaneLines(#[from] gnp_road::LaneLinesError),
    /// A prediction.
    #[error(transparent)]
    Predict(#[from] gnp_data::PredictError),
    /// The rule-based predictors.
    #[error(transparent)]
    Rule(#[from] gnp_baselines::BaselineError),
    /// The intention modes.
    #[error(transparent)]
    Modes(#[from] gnp_modes::ModeError),
    /// A file of weights cannot be read.
    #[error(transparent)]
    File(#[from] gnp_file::FileError),
    /// A lock cannot be had.
    #[error(transparent)]
    Lock(#[from] gnp_file::LockError),
    /// The goal network.
    #[error(transparent)]
    Goal(#[from] gnp_goal::GoalError),
    /// The neural social force.
    #[error(transparent)]
    Force(#[from] gnp_traj::TrajError),
    /// The trained model.
    #[error(transparent)]
    Model(#[from] gnp_model::ModelError),
    /// A simulation.
    #[error(transparent)]
    Simulation(#[from] gnp_simulation::SimulationError),
    /// What is measured of traffic.
    #[error(transparent)]
    Measure(#[from] gnp_measures::MeasureError),
    /// A training.
    #[error(transparent)]
    Train(#[from] gnp_train::TrainError),
    /// The neural baselines.
    #[error(transparent)]
    Baseline(#[from] gnp_neural_baselines::NeuralBaselineError),
    /// An evaluation.
    #[error(transparent)]
    Evaluate(#[from] gnp_eval::EvalError),
    /// A picture.
    #[error(transparent)]
    Paint(#[from] gnp_plot::PaintError),
    /// The fit of drivers to recordings.
    #[error(transparent)]
    Drivers(#[from] gnp_simulation::drivers::DriverError),
    /// A file for the Rerun viewer.
    #[error(transparent)]
    Replay(#[from] gnp_replay::ReplayError),
}

impl Error {
    /// Whether the work ended because [`Stop`](crate::Stop) was requested.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.kept().is_some()
    }

    /// Whether the disk, or the share of it that the user has, is full.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        let full = |error: &std::io::Error| {
            matches!(error.kind(), std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded)
        };
        match self {
            Self::Io(error) => full(error),
            Self::While { source, .. } => source.is_disk_full(),
            Self::Jobs { failed } => failed.iter().any(|(_, error)| error.is_disk_full()),
            other => {
                let causes = std::iter::successors(std::error::Error::source(other), |cause| cause.source());
                causes.filter_map(|cause| cause.downcast_ref::<std::io::Error>()).any(full)
            }
        }
    }

    /// The message with its causes, in one line.
    #[must_use]
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = std::error::Error::source(self);
        while let Some(error) = cause {
            text += &format!(": {error}");
            cause = error.source();
        }
        text
    }

    /// Where the work was stopped: the folder, if any, from which it can go on; `None` for other errors.
    #[must_use]
    pub fn kept(&self) -> Option<Option<&PathBuf>> {
        match self {
            Self::Stopped { kept } => Some(kept.as_ref()),
            Self::While { source, .. } => source.kept(),
            _ => None,
        }
    }
}

/// Adds what was being done to an error.
pub(crate) trait Context<T> {
    /// Adds a text.
    fn context(self, what: impl Into<String>) -> Result<T>;
    /// Adds a text that is made when needed.
    fn with_context<S: Into<String>>(self, what: impl FnOnce() -> S) -> Result<T>;
}

impl<T, E: Into<Error>> Context<T> for Result<T, E> {
    fn context(self, what: impl Into<String>) -> Result<T> {
        self.with_context(|| what)
    }

    fn with_context<S: Into<String>>(self, what: impl FnOnce() -> S) -> Result<T> {
        self.map_err(|error| match error.into() {
            // Who stops the work asks for no reasons.
            stopped if stopped.is_stopped() => stopped,
            source => Error::While { what: what().into(), source: Box::new(source) },
        })
    }
}

/// Leaves the function with an error of a kind that takes a text.
macro_rules! bail {
    ($kind:ident, $($text:tt)+) => {
        return Err($crate::Error::$kind(format!($($text)+)))
    };
}
pub(crate) use bail;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_stays_a_stop_and_other_errors_say_what_was_done() {
        let stopped: Result<()> = Err(Error::Stopped { kept: Some("runs/a".into()) });
        let error = stopped.context("goal failed").unwrap_err();
        assert_eq!(error.to_string(), "interrupted; what is done is kept in runs/a");
        let failed: Result<(), std::io::Error> = Err(std::io::ErrorKind::NotFound.into());
        let error = failed.context("cannot read a").unwrap_err();
        assert_eq!(error.to_string(), "cannot read a");
        assert!(!error.is_stopped() && std::error::Error::source(&error).is_some());
    }

    #[test]
    fn a_full_disk_is_found_behind_what_was_done() {
        let full = || std::io::Error::from(std::io::ErrorKind::StorageFull);
        let plain: Result<()> = Err(full()).context("cannot write a").context("goal failed");
        let inner = gnp_eval::EvalError::Io { path: "p".into(), source: full() };
        let wrapped: Result<()> = Err(inner).context("evaluate failed");
        assert!(plain.unwrap_err().is_disk_full() && wrapped.unwrap_err().is_disk_full());
        assert!(!Error::Io(std::io::ErrorKind::NotFound.into()).is_disk_full());
    }
}
