//! The systems of a table, ready to be scored, and one evaluation of them all.

use std::sync::atomic::Ordering;

use anyhow::Result;
use gnp_data::{Forecast, InformedPredictor, Observation, PredictError, Predictor, Window, WindowId, WindowSet};
use gnp_eval::{Entrant, EvalConfig, EvalError, Evaluation, evaluate};

use crate::stop::{Interrupted, STOP};
use crate::terminal::Terminal;

/// A system under the name of its row.
pub(crate) struct System {
    name: String,
    model: Model,
}

enum Model {
    Blind(Box<dyn Predictor>),
    Told(Box<dyn InformedPredictor>),
}

impl System {
    /// A system that sees the past alone.
    pub(crate) fn blind(name: impl Into<String>, model: impl Predictor + 'static) -> Self {
        Self { name: name.into(), model: Model::Blind(Box::new(model)) }
    }

    /// A system that is handed recorded futures.
    pub(crate) fn told(name: impl Into<String>, model: impl InformedPredictor + 'static) -> Self {
        Self { name: name.into(), model: Model::Told(Box::new(model)) }
    }

    /// Its row.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is handed recorded futures.
    pub(crate) fn is_told(&self) -> bool {
        matches!(self.model, Model::Told(_))
    }

    fn entrant(&self) -> Entrant<'_> {
        if self.is_told() { Entrant::Informed(self) } else { Entrant::Predictor(self) }
    }
}

impl Predictor for System {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        match &self.model {
            Model::Blind(model) => model.predict(observations, k),
            Model::Told(_) => {
                let problem = "is handed recorded futures and cannot go without";
                Err(PredictError::Model { model: self.name.clone(), source: problem.into() })
            }
        }
    }
}

impl InformedPredictor for System {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict_informed(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        match &self.model {
            Model::Blind(model) => {
                let seen: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
                model.predict(&seen, k)
            }
            Model::Told(model) => model.predict_informed(windows, k),
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
    let blind: Vec<Entrant<'_>> = systems.iter().filter(|system| !system.is_told()).map(System::entrant).collect();
    let told: Vec<Entrant<'_>> = systems.iter().filter(|system| system.is_told()).map(System::entrant).collect();
    let allowing = config.protocols.iter().copied().filter(|protocol| protocol.allows_future_input()).collect();
    let allowing = EvalConfig { protocols: allowing, ..config.clone() };
    let run = |entrants: &[Entrant<'_>], config: &EvalConfig| -> Result<Evaluation> {
        let mut work = None;
        let evaluation = evaluate(set, ids, entrants, config, &mut |batch| {
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
    if told.is_empty() || allowing.protocols.is_empty() {
        return Ok(evaluation);
    }
    Ok(evaluation.joined(run(&told, &allowing)?)?)
}
