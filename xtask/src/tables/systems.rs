//! The systems of a table, ready to be scored, and one evaluation of them all.

use std::sync::atomic::Ordering;

use anyhow::Result;
use gnp_data::{Forecast, Observation, OraclePredictor, PredictError, Predictor, Window, WindowId, WindowSet};
use gnp_eval::{EvalConfig, EvalError, EvaluatedModel, Evaluation, evaluate};

use crate::stop::{Interrupted, STOP};
use crate::terminal::Terminal;

/// A system under the name of its row.
pub(crate) struct System {
    name: String,
    model: Model,
}

enum Model {
    Blind(Box<dyn Predictor>),
    Oracle(Box<dyn OraclePredictor>),
}

impl System {
    /// A system that sees the past alone.
    pub(crate) fn predictor(name: impl Into<String>, model: impl Predictor + 'static) -> Self {
        Self { name: name.into(), model: Model::Blind(Box::new(model)) }
    }

    /// A system that is handed recorded futures.
    pub(crate) fn oracle(name: impl Into<String>, model: impl OraclePredictor + 'static) -> Self {
        Self { name: name.into(), model: Model::Oracle(Box::new(model)) }
    }

    /// Its row.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is handed recorded futures.
    pub(crate) fn uses_future(&self) -> bool {
        matches!(self.model, Model::Oracle(_))
    }

    fn model(&self) -> EvaluatedModel<'_> {
        if self.uses_future() { EvaluatedModel::Oracle(self) } else { EvaluatedModel::Predictor(self) }
    }
}

impl Predictor for System {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        match &self.model {
            Model::Blind(model) => model.predict(observations, k),
            Model::Oracle(_) => {
                let problem = "is handed recorded futures and cannot go without";
                Err(PredictError::Model { model: self.name.clone(), source: problem.into() })
            }
        }
    }
}

impl OraclePredictor for System {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict_with_future(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        match &self.model {
            Model::Blind(model) => {
                let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
                model.predict(&seen, k)
            }
            Model::Oracle(model) => model.predict_with_future(windows, k),
        }
    }
}

/// Scores every system on the same windows: those that are handed recorded futures only under the
/// protocols that allow it.
///
/// # Errors
/// When a system fails; [`Interrupted`].
pub(crate) fn score(
    set: &WindowSet<'_>,
    ids: &[WindowId],
    systems: &[System],
    config: &EvalConfig,
    terminal: &Terminal,
) -> Result<Evaluation> {
    let blind: Vec<EvaluatedModel<'_>> =
        systems.iter().filter(|system| !system.uses_future()).map(System::model).collect();
    let uses_future: Vec<EvaluatedModel<'_>> =
        systems.iter().filter(|system| system.uses_future()).map(System::model).collect();
    let allowing = config.protocols.iter().copied().filter(|protocol| protocol.allows_future()).collect();
    let allowing = EvalConfig { protocols: allowing, ..config.clone() };
    let run = |models: &[EvaluatedModel<'_>], config: &EvalConfig| -> Result<Evaluation> {
        let mut work = None;
        let evaluation = evaluate(set, ids, models, config, &mut |batch| {
            let work = work.get_or_insert_with(|| terminal.work("score", batch.total as u64, "forecasts"));
            work.at(batch.done as u64, batch.model);
            if STOP.load(Ordering::SeqCst) { Err(EvalError::Stopped) } else { Ok(()) }
        });
        match evaluation {
            Err(EvalError::Stopped) => Err(Interrupted.into()),
            other => Ok(other?),
        }
    };
    let evaluation = run(&blind, config)?;
    if uses_future.is_empty() || allowing.protocols.is_empty() {
        return Ok(evaluation);
    }
    Ok(evaluation.joined(run(&uses_future, &allowing)?)?)
}
