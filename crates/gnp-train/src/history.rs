//! Learning curves: one record an epoch, as JSON.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::TrainError;

/// A named validation score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidationScore {
    /// Its name, as the stage gives it.
    pub name: String,
    /// Mean over the validation windows. An f32, because its JSON reads back to the same bits.
    pub value: f32,
}

/// What one epoch brought. Nothing here depends on the machine's speed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpochRecord {
    /// The epoch, from 1.
    pub epoch: usize,
    /// Steps of the optimiser so far.
    pub steps: u64,
    /// Learning rate of its last step.
    pub learning_rate: f32,
    /// Mean training loss over its windows, each at the weights of its own step.
    pub train_loss: f32,
    /// Validation scores at its end; the first one chooses the best epoch.
    pub validation: Vec<ValidationScore>,
}

/// The learning curves of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History {
    /// Name of the stage.
    pub stage: String,
    /// Epochs in order.
    pub epochs: Vec<EpochRecord>,
}

impl History {
    /// Writes it as JSON, to a temporary name first.
    ///
    /// # Errors
    /// [`TrainError::File`] when the folder cannot be written to.
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let file = |source| TrainError::File { path: path.to_owned(), source };
        let mut text = serde_json::to_vec_pretty(self).map_err(|source| file(source.into()))?;
        text.push(b'\n');
        gnp_file::save(path, &text).map_err(file)
    }

    /// Reads one back.
    ///
    /// # Errors
    /// [`TrainError::File`] when it cannot be read, [`TrainError::History`] when it is no history.
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        let text = fs::read(path).map_err(|source| TrainError::File { path: path.to_owned(), source })?;
        serde_json::from_slice(&text).map_err(|source| TrainError::History { path: path.to_owned(), source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_read_back_to_the_same_bits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("goal.json");
        let record = |epoch: usize| EpochRecord {
            epoch,
            steps: 7 * epoch as u64,
            learning_rate: 1e-4,
            train_loss: (epoch as f32).sqrt() / 3.,
            validation: vec![ValidationScore { name: "loss".into(), value: 1. / (epoch as f32 + 0.1) }],
        };
        let history = History { stage: "goal".into(), epochs: (1..200).map(record).collect() };
        history.save(&path).unwrap();
        assert_eq!(History::load(&path).unwrap(), history);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }

    #[test]
    fn a_foreign_file_and_a_missing_folder_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("h.json");
        fs::write(&path, "[1, 2").unwrap();
        let message = History::load(&path).unwrap_err().to_string();
        assert!(message.contains("h.json") && message.contains("not a history"), "{message}");
        let history = History { stage: "goal".into(), epochs: Vec::new() };
        let error = history.save(&folder.path().join("none/h.json")).unwrap_err();
        assert!(matches!(error, TrainError::File { .. }), "{error}");
    }
}
