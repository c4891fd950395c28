//! The systems of an evaluation, each under the name of its row.

use gnp_data::{Forecast, Observation, OraclePredictor, PredictError, Predictor, Window};
use gnp_eval::{EvaluatedModel, Spreads};
use gnp_model::Gnp;

/// A system under the name of its row.
pub(crate) struct System {
    name: String,
    model: Model,
    /// The same predictor with its forecasts explained, where it can do so.
    explaining: Option<Box<dyn Predictor>>,
}

enum Model {
    Blind(Box<dyn Predictor>),
    Oracle(Box<dyn OraclePredictor>),
}

impl System {
    /// A system that sees the past alone.
    pub(crate) fn predictor(name: impl Into<String>, model: impl Predictor + 'static) -> Self {
        Self::boxed(name, Box::new(model))
    }

    /// The same of a predictor on the heap.
    pub(crate) fn boxed(name: impl Into<String>, model: Box<dyn Predictor>) -> Self {
        Self { name: name.into(), model: Model::Blind(model), explaining: None }
    }

    /// The same under another name.
    pub(crate) fn named(self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self }
    }

    /// A system that is handed recorded futures.
    pub(crate) fn oracle(name: impl Into<String>, model: impl OraclePredictor + 'static) -> Self {
        Self { name: name.into(), model: Model::Oracle(Box::new(model)), explaining: None }
    }

    /// GNP, which explains itself.
    pub(crate) fn gnp(name: impl Into<String>, model: Gnp) -> Self {
        let explaining: Box<dyn Predictor> = Box::new(model.clone().explaining(true));
        Self { explaining: Some(explaining), ..Self::predictor(name, model) }
    }

    /// The predictor with its forecasts explained; `None` for one that does not explain itself.
    pub(crate) fn explaining(&self) -> Option<&dyn Predictor> {
        self.explaining.as_deref()
    }

    /// Its row.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is handed recorded futures.
    pub(crate) fn uses_future(&self) -> bool {
        matches!(self.model, Model::Oracle(_))
    }

    /// As it is scored; spreads are for systems that see the past alone.
    pub(crate) fn model<'a>(&'a self, spreads: Option<&'a Spreads>) -> EvaluatedModel<'a> {
        match spreads {
            _ if self.uses_future() => EvaluatedModel::Oracle(self),
            Some(spreads) => EvaluatedModel::WithSpreads(self, spreads),
            None => EvaluatedModel::Predictor(self),
        }
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
