//! Why training could not start, go on or be saved.

use std::path::PathBuf;

/// What ends a training run without a result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A key of the configuration has a value that cannot be used.
    #[error("{key} = {value}: {remedy}")]
    Config {
        /// Key, from the stage's table down.
        key: &'static str,
        /// What was given.
        value: String,
        /// What to write instead.
        remedy: String,
    },
    /// A part of the split has no window.
    #[error("{stage}: the {part} part has no window; enlarge its share in the split or shorten the stride")]
    NoWindows {
        /// Name of the stage.
        stage: &'static str,
        /// `training` or `validation`.
        part: &'static str,
    },
    /// There is nothing to train.
    #[error("{stage}: no weight is trainable; build the networks before the stage")]
    NoWeights {
        /// Name of the stage.
        stage: &'static str,
    },
    /// The loss is not a finite number.
    #[error(
        "{stage}: {what} is {value} in epoch {epoch}, batch {batch}; lower the learning rate or set a smaller `clip_norm`"
    )]
    Diverged {
        /// Name of the stage.
        stage: &'static str,
        /// `the loss` or the name of a validation score.
        what: String,
        /// Its value.
        value: f64,
        /// Epoch, from 1.
        epoch: usize,
        /// Mini-batch in the epoch, from 1.
        batch: usize,
    },
    /// A gradient has an infinite or undefined entry; no weight was changed by this step.
    #[error(
        "the gradient of weight `{weight}` is not finite; lower the learning rate or look for a division by 0 in its loss"
    )]
    Gradient {
        /// Name of the first such weight.
        weight: String,
    },
    /// The validation scores of a stage do not fit together.
    #[error("{stage}: {problem}")]
    Validation {
        /// Name of the stage.
        stage: &'static str,
        /// What is wrong with them.
        problem: &'static str,
    },
    /// The state to resume from belongs to another run.
    #[error("cannot resume {stage}: {difference}; resume with the configuration of the first run, or start a new one")]
    Resume {
        /// Name of the stage.
        stage: &'static str,
        /// What differs, with both values.
        difference: String,
    },
    /// A checkpoint could not be written.
    #[error("cannot save the {kind} checkpoint: {source}")]
    Save {
        /// `best` or `last`.
        kind: &'static str,
        /// What failed.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A file could not be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What failed.
        #[source]
        source: std::io::Error,
    },
    /// A history file is not one.
    #[error("{path}: not a history of training: {source}", path = path.display())]
    History {
        /// The file.
        path: PathBuf,
        /// What failed.
        #[source]
        source: serde_json::Error,
    },
    /// The parts of a stage do not fit each other.
    #[error("{stage}: {problem}")]
    Mismatch {
        /// Name of the stage.
        stage: &'static str,
        /// What does not fit, and what to do.
        problem: &'static str,
    },
    /// A window that the recordings do not hold.
    #[error("window {index} of {windows} is not in the recordings; make the split again from these recordings")]
    Window {
        /// Its index in the part.
        index: usize,
        /// Windows in the part.
        windows: usize,
    },
    /// From windows to tensors.
    #[error(transparent)]
    Model(#[from] gnp_model::ModelError),
    /// From the goal network.
    #[error(transparent)]
    Goal(#[from] gnp_goal::GoalError),
    /// From the neural social force.
    #[error(transparent)]
    Traj(#[from] gnp_traj::TrajError),
    /// A tensor operation failed.
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}
