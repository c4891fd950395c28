//! Best and last checkpoint of a stage in a run folder.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use candle_core::{Tensor, Var};
use gnp_model::{Checkpoint, Header, ModelError};
use gnp_nn::Weights;

use crate::error::TrainError;
use crate::state::{CheckpointSlot, Progress, Sink, TrainingState};

/// Keeps a stage's checkpoints as `PART.safetensors` (best: what is predicted with) and
/// `PART.last.safetensors` (last: what training goes on from) in a folder.
///
/// Both hold the whole network, frozen weights included; the last one also the moments of Adam and
/// the place in the training.
#[derive(Debug)]
pub struct Checkpoints {
    folder: PathBuf,
    header: Header,
    weights: Weights,
}

impl Checkpoints {
    /// Checkpoints in `folder` of the network on `weights`. Epoch, scores and trainer of `header`
    /// are filled in with each file.
    #[must_use]
    pub fn new(folder: &Path, header: Header, weights: &Weights) -> Self {
        Self { folder: folder.to_owned(), header, weights: weights.clone() }
    }

    /// Where the checkpoint of a kind is, once it is.
    #[must_use]
    pub fn path(&self, kind: CheckpointSlot) -> PathBuf {
        let part = self.header.part.name();
        self.folder.join(match kind {
            CheckpointSlot::Best => format!("{part}.safetensors"),
            CheckpointSlot::Last => format!("{part}.last.safetensors"),
        })
    }

    /// The state to resume from; `None` when there is no last checkpoint yet, or it or the best one is damaged or the best
    /// one is not that of this training, of which is warned: then the training starts anew.
    ///
    /// # Errors
    /// [`TrainError::Resume`] when it was trained on other windows, features or sizes.
    pub fn last(&self) -> Result<Option<TrainingState>, TrainError> {
        let path = self.path(CheckpointSlot::Last);
        if !path.exists() {
            return Ok(None);
        }
        let stage = self.header.part.name();
        let checkpoint = match self.whole(&path) {
            Ok(checkpoint) => checkpoint,
            Err(error) => {
                tracing::warn!("{error}; the training of {stage} starts anew");
                return Ok(None);
            }
        };
        let then = &checkpoint.header;
        let features = (self.header.features != then.features).then_some("the features");
        if let Some(what) = features.or_else(|| self.difference(then)) {
            return Err(TrainError::Resume { stage, difference: format!("{what} is not that of {}", path.display()) });
        }
        let damaged = |problem: String| ModelError::Checkpoint { path: path.clone(), problem };
        let text = then.trainer.as_deref().ok_or_else(|| damaged("does not say where training stood".to_owned()))?;
        let progress: Progress =
            serde_json::from_str(text).map_err(|e| damaged(format!("does not say where training stood: {e}")))?;
        if let Err(error) = self.fitting_best(&progress)
            && !self.is_ahead(&progress)
        {
            tracing::warn!("{error}; the training of {stage} starts anew");
            return Ok(None);
        }
        Ok(Some(TrainingState::from_tensors(&checkpoint.tensors, progress)))
    }

    /// Makes sure that the best checkpoint is that of the training which ended at `progress`. Where it is not, the last one
    /// is removed, so that the training starts anew when it is asked for again.
    ///
    /// # Errors
    /// [`TrainError::Model`] when the best checkpoint is missing, damaged or of another training; [`TrainError::File`] when
    /// the last one cannot be removed.
    pub fn close(&self, progress: &Progress) -> Result<(), TrainError> {
        let fitting = self.fitting_best(progress);
        if fitting.is_err() {
            let path = self.path(CheckpointSlot::Last);
            fs::remove_file(&path).map_err(|source| TrainError::File { path, source })?;
        }
        fitting
    }

    /// Refuses a best checkpoint that does not hold the best epoch of `progress`, where there is one yet. Until a stage is
    /// finished nothing else vouches for that file.
    fn fitting_best(&self, progress: &Progress) -> Result<(), TrainError> {
        let Some(best) = progress.best else { return Ok(()) };
        let found = self.own_best()?;
        if found.epoch == best.epoch && progress.scored(best.epoch, &found.scores) {
            return Ok(());
        }
        let problem = format!("is not of epoch {}, the best of this training: train again", best.epoch);
        Err(ModelError::Checkpoint { path: self.path(CheckpointSlot::Best), problem }.into())
    }

    /// Whether the best checkpoint is of the epoch that comes after `progress`: so a training leaves it that is killed
    /// between its two saves. The epoch comes again with the same bits and is the best again; where it is not,
    /// [`Checkpoints::close`] says so.
    fn is_ahead(&self, progress: &Progress) -> bool {
        self.own_best().is_ok_and(|found| found.epoch == progress.epoch + 1)
    }

    /// What the best checkpoint says of itself, when it is whole and its training was set up as this one.
    fn own_best(&self) -> Result<Header, TrainError> {
        let path = self.path(CheckpointSlot::Best);
        let header = self.whole(&path)?.header;
        match self.difference(&header) {
            Some(what) => {
                let problem = format!("is of another training, as {what} shows: train again");
                Err(ModelError::Checkpoint { path, problem }.into())
            }
            None => Ok(header),
        }
    }

    /// In what the training of `then` was set up otherwise than this one.
    fn difference(&self, then: &Header) -> Option<&'static str> {
        let now = &self.header;
        let pairs = [
            ("the split", now.split_hash == then.split_hash),
            ("the goal network", now.goal == then.goal),
            ("the social force", now.traj == then.traj),
            ("the seed", now.seed == then.seed),
            ("the run to start from", now.origin == then.origin),
        ];
        pairs.into_iter().find_map(|(what, same)| (!same).then_some(what))
    }

    /// Puts the weights of the checkpoint at `path`, of the same part in another run, into those of `trained`, which the
    /// network was built on: where a training starts from another one.
    ///
    /// # Errors
    /// [`TrainError::Model`] when the file is damaged, of another part or shape, or lacks one of the weights.
    pub fn start_from(&self, path: &Path, trained: &BTreeMap<String, Var>) -> Result<(), TrainError> {
        let Checkpoint { header, tensors } = Checkpoint::load(path).map_err(ModelError::from)?;
        header.expect(path, self.header.part, Some(self.header.shape))?;
        if let Some(name) = trained.keys().find(|name| !tensors.contains_key(*name)) {
            let problem = format!("has no weight `{name}`: it is of a network of another form");
            return Err(ModelError::Checkpoint { path: path.to_owned(), problem }.into());
        }
        let taken = tensors.iter().filter(|(name, _)| trained.contains_key(*name));
        self.put(path, taken)
    }

    /// Puts the weights of the best epoch into the network.
    ///
    /// # Errors
    /// [`TrainError::Model`] when there is no such file, or it is damaged, of another split, or lacks one of the weights.
    pub fn restore_best(&self) -> Result<(), TrainError> {
        let path = self.path(CheckpointSlot::Best);
        let checkpoint = self.whole(&path)?;
        if checkpoint.header.split_hash != self.header.split_hash {
            let problem = "was trained on another split: train it again".to_owned();
            return Err(ModelError::Checkpoint { path, problem }.into());
        }
        self.put(&path, &checkpoint.tensors)
    }

    /// The checkpoint at `path`, of this part and shape, with every weight that the network has so far.
    fn whole(&self, path: &Path) -> Result<Checkpoint, TrainError> {
        let checkpoint = Checkpoint::load(path).map_err(ModelError::from)?;
        checkpoint.header.expect(path, self.header.part, Some(self.header.shape))?;
        match self.weights.named().into_keys().find(|name| !checkpoint.tensors.contains_key(name)) {
            Some(name) => {
                let problem = format!("has no weight `{name}`: train again");
                Err(ModelError::Checkpoint { path: path.to_owned(), problem }.into())
            }
            None => Ok(checkpoint),
        }
    }

    /// Puts the tensors of the file at `path` into the network.
    fn put<'a>(
        &self,
        path: &Path,
        tensors: impl IntoIterator<Item = (&'a String, &'a Tensor)>,
    ) -> Result<(), TrainError> {
        self.weights.set(tensors.into_iter().map(|(name, tensor)| (name.as_str(), tensor))).map_err(|error| {
            let problem = format!("does not hold this network ({error}): train again");
            ModelError::Checkpoint { path: path.to_owned(), problem }.into()
        })
    }
}

impl Sink for Checkpoints {
    fn save(&mut self, kind: CheckpointSlot, state: &TrainingState) -> Result<(), Box<dyn Error + Send + Sync>> {
        let mut tensors: BTreeMap<String, Tensor> =
            self.weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().clone())).collect();
        tensors.extend(match kind {
            CheckpointSlot::Best => state.weights.clone(),
            CheckpointSlot::Last => state.tensors(),
        });
        let progress = &state.progress;
        let scores = progress.history.last().map(|record| record.validation.as_slice()).unwrap_or_default();
        let trainer = match kind {
            CheckpointSlot::Best => None,
            CheckpointSlot::Last => Some(serde_json::to_string(progress)?),
        };
        let header = Header {
            epoch: progress.epoch,
            scores: scores.iter().map(|score| (score.name.clone(), f64::from(score.value))).collect(),
            trainer,
            ..self.header.clone()
        };
        Ok(Checkpoint { header, tensors }.save(&self.path(kind))?)
    }
}
