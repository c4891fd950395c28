//! What decides the content of an output: another job does not go on with it.

use gnp_data::{Dataset, TrackOptions};
use gnp_file::sha256;
use gnp_model::Precision;
use serde::{Deserialize, Serialize};

use super::PredictRequest;
use super::moments::At;
use crate::error::Result;
use crate::model::Model;

/// Model and options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Job {
    /// Version of the program.
    version: String,
    /// Name of the model.
    model: String,
    /// SHA-256 of its weights and settings.
    model_sha256: String,
    #[serde(default)]
    precision: Precision,
    at: At,
    k: usize,
    format: Dataset,
    /// SHA-256 of what is said of the road.
    road_sha256: String,
}

impl Job {
    /// The job of a request.
    ///
    /// # Errors
    /// When the settings of the card or the road have no JSON form.
    pub(super) fn new(model: &Model, request: &PredictRequest, k: usize, format: Dataset) -> Result<Self> {
        let card = model.card();
        let TrackOptions { rate_hz, road, lines } = &request.tracks;
        let road = serde_json::to_string(&(rate_hz, road, lines))?;
        let settings = serde_json::to_string(&(&card.predict, &card.files))?;
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            model: card.name.clone(),
            model_sha256: sha256([settings.as_bytes()]),
            precision: model.gnp().precision(),
            at: request.at.clone(),
            k,
            format,
            road_sha256: sha256([road.as_bytes()]),
        })
    }

    /// What is another than in an earlier job, in words; nothing where they are the same.
    pub(super) fn difference(&self, earlier: &Self) -> Option<&'static str> {
        let pairs = [
            (self.model_sha256 == earlier.model_sha256 && self.model == earlier.model, "another model"),
            (self.precision == earlier.precision, "another precision"),
            (self.at == earlier.at, "other times"),
            (self.k == earlier.k, "another number of futures"),
            (self.road_sha256 == earlier.road_sha256, "another road"),
            (self.format == earlier.format, "another format"),
            (self.version == earlier.version, "another version of this program"),
        ];
        pairs.into_iter().find(|(same, _)| !same).map(|(_, what)| what)
    }
}
