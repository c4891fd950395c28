//! Who watches a run: progress bars, logs, event files.

use crate::error::TrainError;
use crate::history::EpochRecord;

/// What a run is about to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Name of the stage.
    pub stage: &'static str,
    /// Epochs in all.
    pub epochs: usize,
    /// Mini-batches in an epoch.
    pub batches: usize,
    /// Training windows in an epoch.
    pub windows: usize,
    /// Validation windows.
    pub validation_windows: usize,
    /// Mini-batches already behind it, over all epochs: more than 0 when it was resumed.
    pub done: u64,
}

/// What one mini-batch brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchReport {
    /// The epoch, from 1.
    pub epoch: usize,
    /// The mini-batch in the epoch, from 1.
    pub batch: usize,
    /// Steps of the optimiser so far.
    pub steps: u64,
    /// Windows in it.
    pub windows: usize,
    /// Mean loss.
    pub loss: f32,
    /// Norm of the gradient before it was shortened.
    pub gradient_norm: f64,
    /// Learning rate of the step.
    pub learning_rate: f64,
}

/// What one epoch brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpochReport<'a> {
    /// The part that depends on nothing but the seed.
    pub record: &'a EpochRecord,
    /// Whether its first validation score is the lowest so far.
    pub best: bool,
    /// Time that its training and validation took in this process, s.
    pub seconds: f64,
    /// Training windows a second, validation left out.
    pub windows_per_second: f64,
}

/// Watches a run. Whatever it returns ends the run, so a lost event file is not lost silently.
pub trait Observer {
    /// Before the first mini-batch.
    ///
    /// # Errors
    /// Whatever must end the run.
    fn on_start(&mut self, _plan: &Plan) -> Result<(), TrainError> {
        Ok(())
    }

    /// After each mini-batch.
    ///
    /// # Errors
    /// Whatever must end the run.
    fn on_batch(&mut self, _report: &BatchReport) -> Result<(), TrainError> {
        Ok(())
    }

    /// After each epoch, its checkpoints written.
    ///
    /// # Errors
    /// Whatever must end the run.
    fn on_epoch(&mut self, _report: &EpochReport<'_>) -> Result<(), TrainError> {
        Ok(())
    }
}

/// Nobody watches.
impl Observer for () {}

impl<O: Observer + ?Sized> Observer for &mut O {
    fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
        (**self).on_start(plan)
    }

    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        (**self).on_batch(report)
    }

    fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
        (**self).on_epoch(report)
    }
}

/// Both watch, the first one first.
impl<A: Observer, B: Observer> Observer for (A, B) {
    fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
        self.0.on_start(plan)?;
        self.1.on_start(plan)
    }

    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        self.0.on_batch(report)?;
        self.1.on_batch(report)
    }

    fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
        self.0.on_epoch(report)?;
        self.1.on_epoch(report)
    }
}
