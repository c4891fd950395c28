//! The model that is served.

use gnp_data::WindowShape;
use serde_json::{Value, json};

use crate::error::ServerError;

/// The model that is served, and what is said of it.
#[derive(Debug)]
pub(crate) struct ServedModel {
    pub(crate) model: gnp::Model,
    /// `GET /v1/model`: it does not change.
    pub(crate) described: Value,
}

impl ServedModel {
    /// # Errors
    /// Where its card has no JSON form.
    pub(crate) fn new(model: gnp::Model) -> Result<Self, ServerError> {
        let mut described = serde_json::to_value(model.card()).map_err(gnp::Error::from)?;
        described["k"] = json!(model.card().predict.k);
        Ok(Self { model, described })
    }

    /// The windows that it predicts from and into.
    pub(crate) fn shape(&self) -> WindowShape {
        self.model.gnp().shape()
    }
}
