//! Prediction files: forecasts as Parquet in long form, one row a step of a mode of a window.
//!
//! [`prediction_columns`] is the schema. Anyone's file can be read and scored as long as it has the
//! required columns: [`Predictions`] is a predictor that answers with what the file holds.

mod forecasts;
mod reader;
mod schema;
mod shares;
mod writer;

use std::collections::BTreeMap;

use gnp_data::{Forecast, Observation, PredictError, Predictor, Window, WindowKey};

pub use crate::predictions::forecasts::{ForecastOf, ForecastWriter, forecast_columns, join_forecasts};
pub use crate::predictions::reader::{Detail, FARTHEST_M, read_predictions};
pub use crate::predictions::schema::{ColumnInfo, Provenance, prediction_columns};
pub use crate::predictions::writer::PredictionWriter;

/// A forecast and the window it is for.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The window.
    pub key: WindowKey,
    /// The window's origin in the road frame, m, where the file gives it.
    pub origin: Option<[f32; 2]>,
    /// The futures, ordered as in a forecast, window frame.
    pub forecast: Forecast,
}

/// A vehicle and the frame of its last observation. Gap-free stretches do not overlap, so this
/// names a window of a recording.
type Instant = (u32, u32);

/// What a prediction file holds: a predictor that answers with it.
#[derive(Clone, Debug)]
pub struct Predictions {
    name: String,
    provenance: BTreeMap<String, String>,
    by_recording: BTreeMap<String, BTreeMap<Instant, Prediction>>,
}

/// How far a prediction file and a set of windows cover each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Windows with a prediction.
    pub matched: usize,
    /// Windows without a prediction.
    pub windows_alone: usize,
    /// Predictions without a window.
    pub predictions_alone: usize,
}

impl Predictions {
    /// Predictions under a model's name. Of several for one window the last stays.
    #[must_use]
    pub fn new(name: &str, predictions: impl IntoIterator<Item = Prediction>) -> Self {
        let mut by_recording: BTreeMap<String, BTreeMap<Instant, Prediction>> = BTreeMap::new();
        for prediction in predictions {
            let WindowKey { recording, vehicle, t0, .. } = &prediction.key;
            by_recording.entry(recording.clone()).or_default().insert((*vehicle, *t0), prediction);
        }
        Self { name: name.to_owned(), provenance: BTreeMap::new(), by_recording }
    }

    /// The file's own words on where it comes from, by key: see [`Provenance`].
    #[must_use]
    pub fn provenance(&self) -> &BTreeMap<String, String> {
        &self.provenance
    }

    /// Number of predictions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.by_recording.values().map(BTreeMap::len).sum()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.by_recording.is_empty()
    }

    /// All predictions, by recording, vehicle and frame.
    pub fn iter(&self) -> impl Iterator<Item = &Prediction> {
        self.by_recording.values().flat_map(BTreeMap::values)
    }

    /// The prediction for a window, by recording, vehicle and frame.
    #[must_use]
    pub fn get(&self, key: &WindowKey) -> Option<&Prediction> {
        self.by_recording.get(&key.recording)?.get(&(key.vehicle, key.t0))
    }

    /// Which of the windows have a prediction, and how many predictions are for none of them.
    /// Windows are taken to be distinct.
    #[must_use]
    pub fn coverage<'a>(&self, windows: impl IntoIterator<Item = Window<'a>>) -> Coverage {
        let (mut matched, mut windows_alone) = (0, 0);
        for window in windows {
            if self.get(&window.key()).is_some() { matched += 1 } else { windows_alone += 1 }
        }
        Coverage { matched, windows_alone, predictions_alone: self.len().saturating_sub(matched) }
    }
}

impl Predictor for Predictions {
    fn name(&self) -> &str {
        &self.name
    }

    /// The first `k` modes of each window's prediction, their probabilities renormalised.
    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let of_window = |seen: &Observation<'_>| {
            let key = seen.key();
            let found = self.get(&key).ok_or_else(|| {
                let WindowKey { recording, vehicle, t0, .. } = &key;
                let reason = format!("no prediction for recording {recording}, vehicle {vehicle}, frame {t0}");
                PredictError::Model { model: self.name.clone(), source: reason.into() }
            })?;
            Ok(first_modes(&found.forecast, k))
        };
        observations.iter().map(of_window).collect()
    }
}

fn first_modes(forecast: &Forecast, k: usize) -> Forecast {
    let mut modes: Vec<_> = forecast.modes.iter().take(k).cloned().collect();
    let total: f32 = modes.iter().map(|mode| mode.probability).sum();
    if modes.len() < forecast.modes.len() && total > 0. {
        modes.iter_mut().for_each(|mode| mode.probability /= total);
    }
    Forecast { modes }
}

#[cfg(test)]
mod tests;
