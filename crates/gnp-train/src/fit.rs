//! The training loop.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use candle_core::{Device, Tensor, Var};
use rand::seq::SliceRandom;
use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tracing::{debug, info, warn};

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::history::{EpochRecord, ValidationScore};
use crate::observer::{BatchReport, EpochReport, Observer, Plan};
use crate::optimiser::{Adam, host, matching};
use crate::parts::{self, Made};
use crate::schedule::Position;
use crate::seed::derive_seed;
use crate::stage::{BatchTotals, Part, Stage};
use crate::state::{Best, CheckpointSlot, Progress, Sink, TrainingState};

/// Trains stages: mini-batches in seeded order, validation after each epoch, early stopping,
/// checkpoints.
///
/// Afterwards the weights are those of the last step. The best ones went to the sink as
/// [`CheckpointSlot::Best`].
#[derive(Debug)]
pub struct Trainer<'a, S, O> {
    /// What to do.
    pub config: &'a TrainConfig,
    /// Where checkpoints go.
    pub sink: S,
    /// Who watches.
    pub observer: O,
    /// Once `true`, the run ends after the mini-batch under way, with a last checkpoint.
    pub stop: &'a AtomicBool,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// All epochs are done.
    Finished,
    /// The validation score has not improved for the configured patience.
    EarlyStopped,
    /// The stop flag was raised; the last checkpoint resumes it.
    Interrupted,
}

/// What a run leaves behind.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub end: End,
    /// Where it stands: history and best epoch.
    pub progress: Progress,
}

impl<S: Sink, O: Observer> Trainer<'_, S, O> {
    /// Trains `stage` from the weights it has.
    ///
    /// # Errors
    /// When the configuration is bad, a part of the split is empty, the loss or a gradient is not
    /// finite, the stage fails, or a checkpoint cannot be written.
    pub fn fit(&mut self, stage: &dyn Stage) -> Result<Outcome, TrainError> {
        let progress = Progress {
            stage: stage.name().to_owned(),
            config: self.config.clone(),
            train_windows: stage.train_len(),
            epoch: 0,
            steps: 0,
            losses: Vec::new(),
            best: None,
            history: Vec::new(),
        };
        Run::new(self.config, stage, progress)?.go(self)
    }

    /// Goes on from `state`, whose weights replace those of `stage`, and ends as if the run had
    /// never stopped. More or fewer epochs and another patience are allowed.
    ///
    /// # Errors
    /// [`TrainError::Resume`] when `state` is of another run; else as [`Trainer::fit`].
    pub fn resume(&mut self, stage: &dyn Stage, state: &TrainingState) -> Result<Outcome, TrainError> {
        let progress = Progress { config: self.config.clone(), ..state.progress.clone() };
        let mut run = Run::new(self.config, stage, progress)?;
        run.restore(state)?;
        info!(stage = stage.name(), epoch = run.progress.epoch, batch = run.progress.losses.len(), "resumed");
        run.go(self)
    }
}

/// A run under way.
struct Run<'a> {
    config: &'a TrainConfig,
    stage: &'a dyn Stage,
    weights: BTreeMap<String, Var>,
    adam: Adam,
    progress: Progress,
    /// Training windows in an epoch.
    windows: usize,
    warned: bool,
}

impl<'a> Run<'a> {
    fn new(config: &'a TrainConfig, stage: &'a dyn Stage, progress: Progress) -> Result<Self, TrainError> {
        config.check()?;
        for (part, windows) in [("training", stage.train_len()), ("validation", stage.validation_len())] {
            if windows == 0 {
                return Err(TrainError::NoWindows { stage: stage.name(), part });
            }
        }
        let weights = stage.trainable();
        if weights.is_empty() {
            return Err(TrainError::NoWeights { stage: stage.name() });
        }
        let adam = Adam::new(weights.clone(), config.weight_decay, config.clip_norm)?;
        let all = stage.train_len();
        let windows = if config.epoch_windows == 0 { all } else { config.epoch_windows.min(all) };
        Ok(Self { config, stage, weights, adam, progress, windows, warned: false })
    }

    fn restore(&mut self, state: &TrainingState) -> Result<(), TrainError> {
        let stage = self.stage.name();
        let refuse = |difference| TrainError::Resume { stage, difference };
        let saved = &state.progress;
        if saved.stage != stage {
            return Err(refuse(format!("the checkpoint is of stage `{}`", saved.stage)));
        }
        if let Some(difference) = self.config.difference(&saved.config) {
            return Err(refuse(difference));
        }
        if saved.train_windows != self.stage.train_len() {
            let now = self.stage.train_len();
            return Err(refuse(format!("there are {now} training windows and were {}", saved.train_windows)));
        }
        if saved.losses.len() > self.batches() || saved.history.len() != saved.epoch {
            return Err(refuse("its place in the epoch cannot be".to_owned()));
        }
        if let Some(name) = state.weights.keys().find(|name| !self.weights.contains_key(*name)) {
            return Err(refuse(format!("weight `{name}` of the checkpoint is not trained now")));
        }
        self.adam.restore(saved.steps, [&state.first, &state.second]).map_err(refuse)?;
        // All are checked before the first one is set.
        let values: Vec<Vec<f32>> = self
            .weights
            .iter()
            .map(|(name, var)| matching(name, var, &state.weights))
            .collect::<Result<_, _>>()
            .map_err(refuse)?;
        for (var, values) in self.weights.values().zip(values) {
            var.set(&Tensor::from_vec(values, var.shape(), var.device())?)?;
        }
        Ok(())
    }

    fn batches(&self) -> usize {
        self.windows.div_ceil(self.config.batch)
    }

    fn go<S: Sink, O: Observer>(mut self, trainer: &mut Trainer<'_, S, O>) -> Result<Outcome, TrainError> {
        let plan = Plan {
            stage: self.stage.name(),
            epochs: self.config.epochs,
            batches: self.batches(),
            windows: self.windows,
            validation_windows: self.stage.validation_len(),
            done: self.progress.steps,
        };
        trainer.observer.on_start(&plan)?;
        let end = loop {
            if self.progress.epoch >= self.config.epochs {
                break End::Finished;
            }
            if self.config.patience > 0 && self.progress.waited() >= self.config.patience {
                info!(stage = plan.stage, epoch = self.progress.epoch, "no better validation score: stopped early");
                break End::EarlyStopped;
            }
            if !self.epoch(trainer)? {
                info!(stage = plan.stage, epoch = self.progress.epoch, "interrupted");
                self.save(CheckpointSlot::Last, &mut trainer.sink)?;
                break End::Interrupted;
            }
        };
        Ok(Outcome { end, progress: self.progress })
    }

    /// The rest of the epoch under way; `false` when the stop flag ended it before its end.
    fn epoch<S: Sink, O: Observer>(&mut self, trainer: &mut Trainer<'_, S, O>) -> Result<bool, TrainError> {
        let begun = Instant::now();
        let order = self.order();
        let (mut seen, mut learning_rate) = (0, self.learning_rate(self.batches() - 1));
        for batch in self.progress.losses.len()..self.batches() {
            if trainer.stop.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let windows = &order[batch * self.config.batch..];
            let windows = &windows[..windows.len().min(self.config.batch)];
            learning_rate = self.learning_rate(batch);
            let report = self.step(batch, windows, learning_rate)?;
            seen += windows.len();
            trainer.observer.on_batch(&report)?;
        }
        let trained = begun.elapsed().as_secs_f64();
        let Some(validation) = self.validate(trainer.stop)? else { return Ok(false) };

        let (record, best) = self.close(learning_rate, validation);
        if best {
            self.save(CheckpointSlot::Best, &mut trainer.sink)?;
        }
        self.save(CheckpointSlot::Last, &mut trainer.sink)?;
        let seconds = begun.elapsed().as_secs_f64();
        info!(
            stage = self.stage.name(),
            epoch = record.epoch,
            train_loss = record.train_loss,
            validation = ?record.validation.iter().map(|s| (s.name.as_str(), s.value)).collect::<Vec<_>>(),
            learning_rate,
            best,
            seconds,
            "epoch"
        );
        let windows_per_second = seen as f64 / trained.max(1e-9);
        trainer.observer.on_epoch(&EpochReport { record: &record, best, seconds, windows_per_second })?;
        Ok(true)
    }

    /// The windows of the epoch under way, in its order.
    fn order(&self) -> Vec<usize> {
        let seed = derive_seed(derive_seed(self.config.seed, 0), self.progress.epoch as u64);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let sites = self.stage.train_sites();
        if self.config.site_sampling_exponent > 0. && !sites.is_empty() {
            let weights = weights(&sites, self.config.site_sampling_exponent);
            let mut total = 0.;
            let ends: Vec<f64> = sites.iter().map(|site| (total += weights[site], total).1).collect();
            let draw = |_| {
                let at = rng.random::<f64>() * total;
                ends.partition_point(|end| *end <= at).min(ends.len() - 1)
            };
            return (0..self.windows).map(draw).collect();
        }
        let mut order: Vec<usize> = (0..self.stage.train_len()).collect();
        order.shuffle(&mut rng);
        order.truncate(self.windows);
        order
    }

    fn learning_rate(&self, batch: usize) -> f64 {
        let (epoch, epochs) = (self.progress.epoch, self.config.epochs);
        let at = Position { epoch, epochs, batch, batches: self.batches() };
        self.config.learning_rate * self.config.schedule.factor(at)
    }

    fn step(&mut self, batch: usize, windows: &[usize], learning_rate: f64) -> Result<BatchReport, TrainError> {
        let seed = derive_seed(derive_seed(self.config.seed, 1), self.progress.steps);
        let Made { loss, gradients } = parts::made(self.stage, Part::whole(windows, seed))?;
        if !loss.is_finite() {
            return Err(self.diverged("the loss".to_owned(), loss.into(), batch));
        }
        let step = self.adam.step(&gradients, learning_rate)?;
        if !step.silent.is_empty() && !self.warned {
            warn!(stage = self.stage.name(), weights = ?step.silent, "the loss does not reach these weights");
            self.warned = true;
        }
        self.progress.losses.push(loss);
        self.progress.steps = self.adam.steps();
        debug!(
            stage = self.stage.name(),
            steps = self.progress.steps,
            loss,
            gradient_norm = step.gradient_norm,
            "batch"
        );
        Ok(BatchReport {
            epoch: self.progress.epoch + 1,
            batch: batch + 1,
            steps: self.progress.steps,
            windows: windows.len(),
            loss,
            gradient_norm: step.gradient_norm,
            learning_rate,
        })
    }

    /// Scores over the whole validation part; nothing when the stop flag ended them.
    fn validate(&self, stop: &AtomicBool) -> Result<Option<Vec<ValidationScore>>, TrainError> {
        let stage = self.stage.name();
        let mut by_site: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        let sites = self.stage.validation_sites();
        let balance = if sites.is_empty() { 0. } else { self.config.site_sampling_exponent };
        for window in 0..self.stage.validation_len() {
            // Without balance all are of one site, so that batches are as large as they can be.
            let site = sites.get(window).copied().filter(|_| balance > 0.);
            by_site.entry(site.unwrap_or(0)).or_default().push(window);
        }
        let mut scored = Vec::with_capacity(by_site.len());
        for windows in by_site.into_values() {
            let weight = (windows.len() as f64).powf(-balance);
            let Some(batches) = parts::scored(self.stage, &windows, self.config.batch, stop) else { return Ok(None) };
            let mut sums = BatchTotals::default();
            for batch in batches {
                if !sums.add(&batch?) {
                    return Err(TrainError::Validation { stage, problem: "validation scores change their names" });
                }
            }
            scored.push((sums, weight));
        }
        let means = BatchTotals::means_of(&scored);
        if means.is_empty() {
            return Err(TrainError::Validation { stage, problem: "there is no validation score to choose by" });
        }
        let score = |(name, value): (&'static str, f64)| {
            let finite = (value as f32).is_finite();
            let error = || self.diverged(format!("validation score `{name}`"), value, self.batches() - 1);
            finite.then(|| ValidationScore { name: name.to_owned(), value: value as f32 }).ok_or_else(error)
        };
        means.into_iter().map(score).collect::<Result<_, _>>().map(Some)
    }

    /// Enters the epoch under way into the history; says whether it is the best one.
    fn close(&mut self, learning_rate: f64, validation: Vec<ValidationScore>) -> (EpochRecord, bool) {
        let losses = std::mem::take(&mut self.progress.losses);
        let size = |batch: usize| self.config.batch.min(self.windows - batch * self.config.batch) as f64;
        let total: f64 = losses.iter().enumerate().map(|(batch, loss)| f64::from(*loss) * size(batch)).sum();
        self.progress.epoch += 1;
        let record = EpochRecord {
            epoch: self.progress.epoch,
            steps: self.progress.steps,
            learning_rate: learning_rate as f32,
            train_loss: (total / self.windows as f64) as f32,
            validation,
        };
        let score = record.validation[0].value;
        let best = self.progress.best.is_none_or(|best| score < best.score);
        if best {
            self.progress.best = Some(Best { epoch: record.epoch, score });
        }
        self.progress.history.push(record.clone());
        (record, best)
    }

    fn save<S: Sink>(&self, kind: CheckpointSlot, sink: &mut S) -> Result<(), TrainError> {
        let copy = |(name, var): (&String, &Var)| {
            let values = host(var.as_tensor())?;
            Ok((name.clone(), Tensor::from_vec(values, var.shape(), &Device::Cpu)?))
        };
        let weights = self.weights.iter().map(copy).collect::<Result<_, TrainError>>()?;
        let [first, second] = self.adam.moments()?;
        let state = TrainingState { weights, first, second, progress: self.progress.clone() };
        sink.save(kind, &state).map_err(|source| TrainError::Save { kind: kind.name(), source })
    }

    fn diverged(&self, what: String, value: f64, batch: usize) -> TrainError {
        let (stage, epoch) = (self.stage.name(), self.progress.epoch + 1);
        TrainError::Diverged { stage, what, value, epoch, batch: batch + 1 }
    }
}

/// Weight of a window by site: the number of the site's windows to the power of minus `balance`.
fn weights(sites: &[u32], balance: f64) -> BTreeMap<u32, f64> {
    let mut counts: BTreeMap<u32, f64> = BTreeMap::new();
    for site in sites {
        *counts.entry(*site).or_default() += 1.;
    }
    counts.into_iter().map(|(site, count)| (site, count.powf(-balance))).collect()
}
