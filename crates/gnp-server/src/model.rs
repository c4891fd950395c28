//! The model that is served.

use gnp::{Model, ScenePredictor};
use gnp_data::WindowShape;
use serde_json::{Value, json};

use crate::error::ServerError;
use crate::problem::{Problem, ProblemKind};

/// The model that is served, and what is said of it.
#[derive(Debug)]
pub(crate) struct ServedModel {
    model: Model,
    pub(crate) predictor: ScenePredictor,
    /// `GET /v1/model`: it does not change.
    pub(crate) described: Value,
}

impl ServedModel {
    /// # Errors
    /// Where its card has no JSON form.
    pub(crate) fn new(model: Model, max_vehicles: usize) -> Result<Self, ServerError> {
        let mut described = serde_json::to_value(model.card())?;
        let predictor = ScenePredictor::new(&model);
        let terms: Vec<Value> = predictor
            .gnp()
            .term_descriptors()
            .iter()
            .map(|term| {
                json!({
                    "name": term.name,
                    "label": term.label,
                    "meaning": term.meaning,
                    "unit": term.unit,
                    "colour": term.colour,
                    "arity": term.arity,
                })
            })
            .collect();
        described["terms"] = Value::Array(terms);
        described["k"] = json!(model.card().predict.k);
        described["max_vehicles"] = json!(max_vehicles);
        Ok(Self { model, predictor, described })
    }

    /// Its name.
    pub(crate) fn name(&self) -> &str {
        &self.model.card().name
    }

    /// Whether it was trained on simulated recordings.
    pub(crate) fn is_simulated(&self) -> bool {
        self.model.card().data.simulated
    }

    /// The windows that it predicts from and into.
    pub(crate) fn shape(&self) -> WindowShape {
        self.model.gnp().shape()
    }

    /// How many futures are asked for; as many as the card says where nothing is.
    ///
    /// # Errors
    /// A problem for none, and for more than the model has.
    pub(crate) fn futures(&self, k: Option<usize>) -> Result<usize, Problem> {
        let (k, most) = (k.unwrap_or(self.model.card().predict.k), self.model.gnp().modes().len());
        if (1..=most).contains(&k) {
            return Ok(k);
        }
        Err(Problem::at(ProblemKind::InvalidRequest, "k", format!("the model has {most} futures; ask for 1 to {most}")))
    }

    /// Predicted frames from one point that is given to the next, which are about `every_s` seconds apart.
    ///
    /// # Errors
    /// A problem in `field` for a time that is none or longer than a forecast.
    pub(crate) fn points_every(&self, every_s: f64, field: &str) -> Result<usize, Problem> {
        let (dt, steps) = (self.shape().dt(), self.shape().t_pred);
        let every = (every_s / dt).round();
        if every_s > 0. && every <= steps as f64 {
            return Ok((every as usize).max(1));
        }
        let detail = format!("give seconds above 0 and up to {}", steps as f64 * dt);
        Err(Problem::at(ProblemKind::InvalidRequest, field, detail))
    }
}
