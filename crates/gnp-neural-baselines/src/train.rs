//! Training a baseline in a folder: resumed where it stopped, read where it is done.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize};

use candle_core::{Device, Tensor};
use gnp_data::{WindowId, WindowSet};
use gnp_nn::Weights;
use gnp_train::{CheckpointSlot, End, Observer, Progress, Sink, Trainer, TrainingState};

use crate::checkpoint::{Checkpoint, Header};
use crate::error::NeuralBaselineError;
use crate::kind::NeuralBaseline;
use crate::learned::{TrainedBaseline, inputs};
use crate::net::Net;
use crate::recipe::Recipe;
use crate::stage::{Epochs, RecipeStage, is_statistic};

/// What a baseline is trained on.
#[derive(Clone, Copy, Debug)]
pub struct Training<'a> {
    /// Windows that the ids are of.
    pub set: &'a WindowSet<'a>,
    /// To learn from.
    pub train: &'a [WindowId],
    /// To choose the epoch by.
    pub validation: &'a [WindowId],
    /// Hash of the split that they come from.
    pub split_hash: &'a str,
}

impl TrainedBaseline {
    /// The file of a baseline in a run folder, once it is trained.
    #[must_use]
    pub fn path(folder: &Path, kind: NeuralBaseline) -> PathBuf {
        folder.join(format!("{}.safetensors", kind.stem()))
    }

    /// Trains `kind` by `recipe` in `folder`, which exists; goes on where an earlier run of the same
    /// training stopped, and only reads the result of one that ended.
    ///
    /// The epoch is chosen by the mean squared error of the likeliest future on the validation part,
    /// among those of the likelihood phase where there is one. [`NeuralBaseline::PipSurrogate`] is
    /// trained as [`NeuralBaseline::PipInformed`] and shares its file.
    ///
    /// # Errors
    /// When the recipe or the windows do not suit the network, the folder holds another training under
    /// the same name, training diverges, or `stop` was raised ([`NeuralBaselineError::Interrupted`]).
    pub fn train(
        kind: NeuralBaseline,
        recipe: &Recipe,
        data: &Training<'_>,
        folder: &Path,
        device: &Device,
        observer: impl Observer,
        stop: &AtomicBool,
    ) -> Result<Self, NeuralBaselineError> {
        recipe.check()?;
        let trained = kind.trained_as();
        let weights = Weights::seeded(recipe.seed, device);
        let net = Net::new(trained, recipe, inputs(data.set.shape(), recipe.unit_m)?, &weights.builder())?;
        let mut files = Files::new(folder, trained, recipe, data, &weights)?;
        let epoch = AtomicUsize::new(0);
        let (set, train, validation) = (data.set, data.train, data.validation);
        let stage =
            RecipeStage { kind: trained, net: &net, weights: &weights, recipe, set, train, validation, epoch: &epoch };
        let resumed = files.resume()?;
        let config = recipe.training();
        let watchers = (Epochs(&epoch), observer);
        let mut trainer = Trainer { config: &config, sink: &mut files, observer: watchers, stop };
        let outcome = match &resumed {
            Some(state) => trainer.resume(&stage, state),
            None => trainer.fit(&stage),
        };
        let outcome = outcome.map_err(|error| NeuralBaselineError::Train(Box::new(error)))?;
        if outcome.end == End::Interrupted {
            return Err(NeuralBaselineError::Interrupted { kind: kind.name(), epoch: outcome.progress.epoch });
        }
        let learned = Self::load(&Self::path(folder, kind), device)?;
        if kind == NeuralBaseline::PipSurrogate { learned.with_surrogate_plan() } else { Ok(learned) }
    }
}

/// Best and last checkpoint of a training.
#[derive(Debug)]
struct Files<'a> {
    best: PathBuf,
    last: PathBuf,
    header: Header,
    weights: &'a Weights,
}

impl<'a> Files<'a> {
    fn new(
        folder: &Path,
        kind: NeuralBaseline,
        recipe: &Recipe,
        data: &Training<'_>,
        weights: &'a Weights,
    ) -> Result<Self, NeuralBaselineError> {
        let recordings = data.set.recordings();
        let first =
            recordings.first().ok_or_else(|| NeuralBaselineError::Windows { problem: "there are none".to_owned() })?;
        let header = Header {
            kind,
            dataset: first.meta().dataset,
            simulated: recordings.iter().any(|recording| recording.meta().simulated),
            shape: data.set.shape(),
            recipe: recipe.clone(),
            split_hash: data.split_hash.to_owned(),
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            epoch: 0,
            scores: Default::default(),
            trainer: None,
        };
        let last = folder.join(format!("{}.last.safetensors", kind.stem()));
        Ok(Self { best: TrainedBaseline::path(folder, kind), last, header, weights })
    }

    /// Where an earlier run stopped. Statistics that no gradient trains are put into the network.
    fn resume(&self) -> Result<Option<TrainingState>, NeuralBaselineError> {
        if !self.last.exists() {
            return Ok(None);
        }
        let checkpoint = Checkpoint::load(&self.last)?;
        let (now, then) = (&self.header, &checkpoint.header);
        let pairs = [
            ("kind", now.kind == then.kind),
            ("split", now.split_hash == then.split_hash),
            ("window shape", now.shape.fits(&then.shape)),
            ("recipe", now.recipe == then.recipe),
        ];
        let fail = |problem: String| NeuralBaselineError::checkpoint(&self.last, problem);
        if let Some((what, _)) = pairs.iter().find(|(_, same)| !same) {
            return Err(fail(format!("was trained with another {what}; take another folder or remove this file")));
        }
        let text = then.trainer.as_deref().unwrap_or_default();
        let progress: Progress =
            serde_json::from_str(text).map_err(|e| fail(format!("does not say where training stood ({e})")))?;
        let statistics = checkpoint.tensors.iter().filter(|(name, _)| is_statistic(name));
        self.weights.set(statistics.map(|(name, tensor)| (name.as_str(), tensor)))?;
        Ok(Some(TrainingState::from_tensors(&checkpoint.tensors, progress)))
    }

    fn header_at(&self, progress: &Progress, trainer: Option<String>) -> Header {
        let scores = progress.history.last().map(|record| record.validation.as_slice()).unwrap_or_default();
        Header {
            epoch: progress.epoch,
            scores: scores.iter().map(|score| (score.name.clone(), f64::from(score.value))).collect(),
            trainer,
            ..self.header.clone()
        }
    }
}

/// Whether `progress` stands at the end of the best epoch among those that may be chosen.
fn is_best(progress: &Progress, recipe: &Recipe) -> bool {
    // Warm-up trains neither spreads nor, as a rule, manoeuvres.
    let first = if recipe.likelihood_epochs == 0 { 0 } else { recipe.warm_up_epochs };
    let score =
        |epoch: usize| progress.history.get(epoch).and_then(|record| record.validation.first()).map(|s| s.value);
    let Some(now) = progress.epoch.checked_sub(1).filter(|now| *now >= first && progress.losses.is_empty()) else {
        return false;
    };
    (first..now).all(|epoch| score(epoch) > score(now))
}

impl Sink for Files<'_> {
    fn save(&mut self, kind: CheckpointSlot, state: &TrainingState) -> Result<(), Box<dyn Error + Send + Sync>> {
        // Which epoch is best depends on its phase, so that it is decided here and not by the loop.
        if kind == CheckpointSlot::Best {
            return Ok(());
        }
        let all = |tensors: &mut std::collections::BTreeMap<String, Tensor>| {
            for (name, var) in self.weights.named().into_iter().filter(|(name, _)| is_statistic(name)) {
                tensors.insert(name, var.as_tensor().clone());
            }
        };
        if is_best(&state.progress, &self.header.recipe) {
            let mut tensors = state.weights.clone();
            all(&mut tensors);
            Checkpoint { header: self.header_at(&state.progress, None), tensors }.save(&self.best)?;
        }
        let mut tensors = state.tensors();
        all(&mut tensors);
        let trainer = serde_json::to_string(&state.progress)?;
        Ok(Checkpoint { header: self.header_at(&state.progress, Some(trainer)), tensors }.save(&self.last)?)
    }
}
