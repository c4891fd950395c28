//! What can go wrong between windows and forecasts.

use std::path::PathBuf;

use gnp_data::WindowShape;

use crate::checkpoint::Component;

/// Why a model could not be made, loaded or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A configuration value that cannot work.
    #[error("`{key}` {problem}")]
    Config {
        /// Key of the configuration.
        key: &'static str,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A term of the force that the model does not have.
    #[error("`{name}` is no term of this model's force; there are {}", if known.is_empty() { "none".to_owned() } else { known.join(", ") })]
    UnknownTerm {
        /// The name asked for.
        name: String,
        /// Names of those that there are.
        known: Vec<String>,
    },
    /// Windows of another shape than the model's.
    #[error(
        "the model was made for {} observed and {} predicted frames at {} Hz, the windows have {} and {} at {} Hz: \
         set windows.rate_hz, observed_s and predicted_s to the model's, or train one for this rate",
        needs.t_obs, needs.t_pred, needs.rate_hz, found.t_obs, found.t_pred, found.rate_hz
    )]
    Shape {
        /// What the model was made for.
        needs: WindowShape,
        /// What came.
        found: WindowShape,
    },
    /// Nothing that could be a model.
    #[error(
        "there is no model at {}: {seen}. A model folder has card.json, modes.safetensors, goal.safetensors and \
         repulsion.safetensors, a run folder run.json and the same weights; `gnp export --run RUN --out DIR` makes a model \
         folder of a trained run", path.display()
    )]
    NoModel {
        /// Where it was looked for.
        path: PathBuf,
        /// What is there instead.
        seen: String,
    },
    /// A model folder of another version of its layout.
    #[error(
        "{} has format {found}, this version reads {reads}: take a version of this program that is as new as the one that \
         wrote it, or export the model again", path.display()
    )]
    CardFormat {
        /// The card.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// The format that is read.
        reads: u32,
    },
    /// A file of a model folder that is not what was written.
    #[error("{} {problem}: copy the model folder again, or export it again", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A checkpoint that cannot be read or does not fit.
    #[error("{}: {problem}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// Weights that are not those of the network that their header describes.
    #[error("the weights of `{}` do not fit its network ({problem}): train again", part.name())]
    Weights {
        /// Whose they are.
        part: Component,
        /// Which weight is missing or has another shape.
        problem: String,
    },
    /// Threads that the system does not give.
    #[error("cannot start {threads} threads; ask for fewer")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the system said.
        source: rayon::ThreadPoolBuildError,
    },
    /// Traffic ahead that cannot be rolled out.
    #[error("the traffic of a window cannot be rolled out: {0}")]
    Traffic(#[from] gnp_force::ForceError),
    /// A forecast that no trained model gives.
    #[error(
        "the forecast of window {window} of the batch is not finite: modes or weights are of no trained model; train again"
    )]
    NotFinite {
        /// Place of the window in the batch, from 0.
        window: usize,
    },
    /// The processor does not multiply in the precision asked for.
    #[error(transparent)]
    Precision(#[from] gnp_nn::PrecisionError),
    /// From the recordings and windows.
    #[error(transparent)]
    Data(#[from] gnp_data::DataError),
    /// From the intention modes.
    #[error(transparent)]
    Modes(#[from] gnp_modes::ModeError),
    /// From the goal network.
    #[error(transparent)]
    Goal(#[from] gnp_goal::GoalError),
    /// From the neural social force.
    #[error(transparent)]
    Traj(#[from] gnp_traj::TrajError),
    /// From candle.
    #[error(transparent)]
    Candle(#[from] candle_core::Error),
}

impl From<gnp_file::FileError> for ModelError {
    fn from(error: gnp_file::FileError) -> Self {
        Self::Checkpoint { path: error.path, problem: error.problem }
    }
}

impl ModelError {
    pub(crate) fn config(key: &'static str, problem: &str) -> Self {
        Self::Config { key, problem: problem.to_owned() }
    }

    pub(crate) fn weights(part: Component, error: &dyn std::error::Error) -> Self {
        Self::Weights { part, problem: chain(error) }
    }

    pub(crate) fn changed(path: &std::path::Path, problem: String) -> Self {
        Self::Changed { path: path.to_owned(), problem }
    }

    pub(crate) fn checkpoint(path: &std::path::Path, problem: impl Into<String>) -> Self {
        Self::Checkpoint { path: path.to_owned(), problem: problem.into() }
    }
}

/// An error with its causes, each said once, in one line.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text += &format!(": {more}");
        }
        cause = error.source();
    }
    text
}
