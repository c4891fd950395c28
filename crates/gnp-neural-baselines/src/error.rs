//! Why a learned baseline could not be made, trained or read.

use std::path::{Path, PathBuf};

use gnp_train::TrainError;

/// What keeps a learned baseline from being used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NeuralBaselineError {
    /// A key of the recipe has a value that cannot be used.
    #[error("{key} = {value}: {remedy}")]
    Recipe {
        /// Key.
        key: &'static str,
        /// What was given.
        value: String,
        /// What to write instead.
        remedy: String,
    },
    /// The windows do not suit the networks.
    #[error("these windows cannot be brought to the networks' frames: {problem}")]
    Windows {
        /// What is wrong, and what to do.
        problem: String,
    },
    /// A checkpoint cannot be used.
    #[error("{path}: {problem}", path = path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// Training was stopped before its end.
    #[error("{kind}: training was stopped after epoch {epoch}; start it again to go on")]
    Interrupted {
        /// Name of the baseline.
        kind: &'static str,
        /// Finished epochs.
        epoch: usize,
    },
    /// A network was asked for a future that depends on one it was not given.
    #[error("{kind} needs the recorded future of a neighbour; ask its informed form, and mark what it gives")]
    NeedsFuture {
        /// Name of the baseline.
        kind: &'static str,
    },
    /// A network that learns what is left of a rule was to be trained without it.
    #[error(
        "{name} learns what a rule leaves; give the platoon, fitted to the training windows, as `Training::reference`"
    )]
    NeedsReference {
        /// Its name.
        name: &'static str,
    },
    /// A network that takes no plan was to be given one.
    #[error("{kind} takes no plan; only PiP does")]
    NoPlan {
        /// Name of the baseline.
        kind: &'static str,
    },
    /// The training loop failed.
    #[error(transparent)]
    Train(#[from] Box<TrainError>),
    /// A tensor operation failed.
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}

impl From<gnp_file::FileError> for NeuralBaselineError {
    fn from(error: gnp_file::FileError) -> Self {
        Self::Checkpoint { path: error.path, problem: error.problem }
    }
}

impl NeuralBaselineError {
    pub(crate) fn checkpoint(path: &Path, problem: impl Into<String>) -> Self {
        Self::Checkpoint { path: path.to_owned(), problem: problem.into() }
    }
}
