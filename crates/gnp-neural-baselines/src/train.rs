//! Training a baseline in a folder: resumed where it stopped, read where it is done.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize};

use candle_core::{Device, Tensor};
use gnp_baselines::PlatoonRule;
use gnp_data::{WindowId, WindowSet};
use gnp_nn::Weights;
use gnp_train::{CheckpointSlot, End, Observer, Progress, Sink, Trainer, TrainingState, Windows};

use crate::checkpoint::{Checkpoint, Header};
use crate::error::NeuralBaselineError;
use crate::kind::NeuralBaseline;
use crate::learned::{TrainedBaseline, inputs};
use crate::net::Net;
use crate::recipe::{OutputForm, Recipe};
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
    /// The rule, fitted to the same training windows, whose path points are counted from: then the output form is
    /// [`OutputForm::Deviation`].
    pub reference: Option<&'a PlatoonRule>,
}

impl Training<'_> {
    fn form(&self) -> OutputForm {
        if self.reference.is_some() { OutputForm::Deviation } else { OutputForm::Published }
    }
}

impl TrainedBaseline {
    /// The file of a baseline in a run folder, once it is trained.
    #[must_use]
    pub fn path(folder: &Path, kind: NeuralBaseline, form: OutputForm) -> PathBuf {
        folder.join(format!("{}.safetensors", kind.stem_in(form)))
    }

    /// Trains `kind` by `recipe` in `folder`, which exists; goes on where an earlier run of the same
    /// training stopped, and only reads the result of one that ended.
    ///
    /// The epoch is chosen by the mean squared error of the prediction on the validation part, sites weighted as in
    /// training, among those of the likelihood phase where there is one; so is, where points are counted from a
    /// reference path, how much of the deviation is believed. [`NeuralBaseline::PipSurrogate`] is
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
        let points = inputs(data.set.shape(), recipe.unit_m)?;
        let net = Net::new(trained, recipe, data.reference.cloned(), points, &weights.builder())?;
        let mut files = Files::new(folder, trained, recipe, data, &weights)?;
        let epoch = AtomicUsize::new(0);
        let (set, train, validation) = (data.set, data.train, data.validation);
        let stage =
            RecipeStage { kind: trained, net: &net, weights: &weights, recipe, set, train, validation, epoch: &epoch };
        let resumed = files.resume()?;
        let config = recipe.training(train.len());
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
        files.close(&outcome.progress)?;
        let learned = Self::believed(&Self::path(folder, kind, data.form()), data, device)?;
        if kind == NeuralBaseline::PipSurrogate { learned.with_surrogate_plan() } else { Ok(learned) }
    }
}

impl TrainedBaseline {
    /// The best network of a training that has ended, which knows from then on how much of it is believed.
    fn believed(path: &Path, data: &Training<'_>, device: &Device) -> Result<Self, NeuralBaselineError> {
        let learned = Self::load(path, device)?;
        if learned.form() == OutputForm::Published || learned.header().trust.is_some() {
            return Ok(learned);
        }
        let sites = Windows::new(data.set, data.validation).sites();
        let mut counts = BTreeMap::<u32, f64>::new();
        sites.iter().for_each(|site| *counts.entry(*site).or_default() += 1.);
        let balance = learned.header().recipe.site_sampling_exponent;
        let weight = |site: &u32| counts.get(site).map_or(1., |count| count.powf(-balance));
        let windows = data.validation.iter().zip(&sites);
        let windows: Vec<_> = windows.filter_map(|(id, site)| Some((data.set.get(*id)?, weight(site)))).collect();
        let trust = learned.fitted_trust(&windows)?;
        let Checkpoint { header, tensors } = Checkpoint::load(path)?;
        Checkpoint { header: Header { trust, ..header }, tensors }.save(path)?;
        Self::load(path, device)
    }
}

/// Best and last checkpoint of a training.
#[derive(Debug)]
struct Files<'a> {
    best: PathBuf,
    last: PathBuf,
    /// The first epoch, from 0, that may be chosen.
    first: usize,
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
            reference: data.reference.cloned(),
            trust: None,
            split_hash: data.split_hash.to_owned(),
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            epoch: 0,
            scores: Default::default(),
            trainer: None,
        };
        let last = folder.join(format!("{}.last.safetensors", kind.stem_in(data.form())));
        let warm_up = recipe.warm_up_epochs(data.train.len());
        // Warm-up trains neither spreads nor, as a rule, manoeuvres.
        let first = if warm_up < recipe.epochs(data.train.len()) { warm_up } else { 0 };
        Ok(Self { best: TrainedBaseline::path(folder, kind, data.form()), last, first, header, weights })
    }

    /// Where an earlier run stopped; nowhere where its file is damaged or the best weights are not there, of which is
    /// warned. Statistics that no gradient trains are put into the network.
    fn resume(&self) -> Result<Option<TrainingState>, NeuralBaselineError> {
        if !self.last.exists() {
            return Ok(None);
        }
        let anew = |error: &dyn std::fmt::Display| {
            tracing::warn!("{error}; the training of {} starts anew", self.header.kind.name());
            Ok(None)
        };
        let checkpoint = match Checkpoint::load(&self.last) {
            Ok(checkpoint) => checkpoint,
            Err(error) => return anew(&error),
        };
        let (now, then) = (&self.header, &checkpoint.header);
        let pairs = [
            ("kind", now.kind == then.kind),
            ("split", now.split_hash == then.split_hash),
            ("window shape", now.shape.fits(&then.shape)),
            ("recipe", now.recipe == then.recipe),
            ("reference rule", now.reference == then.reference),
        ];
        let fail = |problem: String| NeuralBaselineError::checkpoint(&self.last, problem);
        if let Some((what, _)) = pairs.iter().find(|(_, same)| !same) {
            return Err(fail(format!("was trained with another {what}; take another folder or remove this file")));
        }
        let text = then.trainer.as_deref().unwrap_or_default();
        let progress: Progress =
            serde_json::from_str(text).map_err(|e| fail(format!("does not say where training stood ({e})")))?;
        // Killed between the two saves it leaves the best weights of the epoch that comes next: it comes again.
        if let Err(error) = self.fitting_best(&progress)
            && !self.own_best().is_ok_and(|found| found.epoch == progress.epoch + 1)
        {
            return anew(&error);
        }
        let statistics = checkpoint.tensors.iter().filter(|(name, _)| is_statistic(name));
        self.weights.set(statistics.map(|(name, tensor)| (name.as_str(), tensor)))?;
        Ok(Some(TrainingState::from_tensors(&checkpoint.tensors, progress)))
    }

    /// Makes sure that the best weights are those of the training which ended at `progress`; where they are not, it starts
    /// anew when it is asked for again.
    fn close(&self, progress: &Progress) -> Result<(), NeuralBaselineError> {
        let fitting = self.fitting_best(progress);
        if fitting.is_err() {
            fs::remove_file(&self.last)
                .map_err(|error| NeuralBaselineError::checkpoint(&self.last, format!("cannot be removed: {error}")))?;
        }
        fitting
    }

    /// Refuses a file of the best weights that are not those of the best epoch of `progress`.
    fn fitting_best(&self, progress: &Progress) -> Result<(), NeuralBaselineError> {
        let Some(best) = best_epoch(progress, self.first) else { return Ok(()) };
        let found = self.own_best()?;
        if found.epoch == best && progress.scored(best, &found.scores) {
            return Ok(());
        }
        let problem = format!("is not of epoch {best}, the best of this training: train again");
        Err(NeuralBaselineError::checkpoint(&self.best, problem))
    }

    /// What the file of the best weights says of itself, when it is whole and of this split and recipe.
    fn own_best(&self) -> Result<Header, NeuralBaselineError> {
        let found = Checkpoint::load(&self.best)?.header;
        let now = &self.header;
        if (found.kind, &found.split_hash, &found.recipe) == (now.kind, &now.split_hash, &now.recipe) {
            return Ok(found);
        }
        Err(NeuralBaselineError::checkpoint(&self.best, "is of another training: train again"))
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

/// The best finished epoch, from 1, among those after the `first` ones; the earliest of equals.
fn best_epoch(progress: &Progress, first: usize) -> Option<usize> {
    let scored =
        progress.history.iter().skip(first).filter_map(|record| Some((record.epoch, record.validation.first()?)));
    scored.reduce(|best, now| if best.1.value > now.1.value { now } else { best }).map(|(epoch, _)| epoch)
}

impl Sink for Files<'_> {
    fn save(&mut self, kind: CheckpointSlot, state: &TrainingState) -> Result<(), Box<dyn Error + Send + Sync>> {
        // Which epoch is best depends on its phase, so that it is decided here and not by the loop.
        if kind == CheckpointSlot::Best {
            return Ok(());
        }
        let all = |tensors: &mut BTreeMap<String, Tensor>| {
            for (name, var) in self.weights.named().into_iter().filter(|(name, _)| is_statistic(name)) {
                tensors.insert(name, var.as_tensor().clone());
            }
        };
        let between_epochs = state.progress.losses.is_empty();
        if between_epochs && best_epoch(&state.progress, self.first) == Some(state.progress.epoch) {
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
