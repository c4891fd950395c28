//! What predicts, and what it gives.

use crate::explanation::Explanation;
use crate::window::{Observation, Window};
use crate::window_shape::WindowShape;

/// Anything that turns observed windows into futures: GNP, constant velocity, Kalman, IDM.
///
/// An [`Observation`] has no way to the recorded future, so neither has a `Predictor`.
pub trait Predictor: Send + Sync {
    /// Name in tables and files, such as `gnp` or `constant velocity`.
    fn name(&self) -> &str;

    /// One forecast a window, each with at most `k` modes, ordered as [`Forecast::modes`].
    ///
    /// # Errors
    /// When a window does not have the shape the predictor was made for, or the predictor fails.
    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError>;
}

/// A predictor that is handed recorded futures (GNP with oracle neighbours, PiP with the true
/// plan). Every number made with one is marked.
pub trait OraclePredictor: Send + Sync {
    /// Name in tables and files; says what it is informed of.
    fn name(&self) -> &str;

    /// As [`Predictor::predict`], with the recorded future in reach.
    ///
    /// # Errors
    /// As [`Predictor::predict`].
    fn predict_with_future(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError>;
}

/// The futures of one window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecast {
    /// The first is the prediction where one is asked for; the others follow by falling probability. It is often the
    /// likeliest, and need not be: where the squared error counts, the middle of what is likely is better than the
    /// likeliest of a few. Probabilities sum to 1.
    pub modes: Vec<Mode>,
}

/// One possible future.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mode {
    /// Probability, 0 to 1.
    pub probability: f32,
    /// Centre in each predicted frame, m, window frame.
    pub path: Vec<[f32; 2]>,
    /// The forces that made the path, for predictors that have them.
    pub explanation: Option<Explanation>,
}

/// Index of the future that ends nearest to the mean of all, the first of equals: of several futures the *prediction*,
/// because the squared error expected of it is the least. `ends` are positions in the last frame, m; `None` of none.
#[must_use]
pub fn nearest_to_mean(ends: &[[f32; 2]], probabilities: &[f32]) -> Option<usize> {
    let mean = ends.iter().zip(probabilities).fold([0f32; 2], |m, (end, p)| [m[0] + p * end[0], m[1] + p * end[1]]);
    let distance = |end: &[f32; 2]| (end[0] - mean[0]).hypot(end[1] - mean[1]);
    (0..ends.len()).min_by(|a, b| distance(&ends[*a]).total_cmp(&distance(&ends[*b])))
}

/// Why a predictor gave no forecast.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// The windows are not what the predictor was made for.
    #[error("{model} was made for {needs}, these windows have {found}")]
    Shape {
        /// Name of the predictor.
        model: String,
        /// What it needs: rate, frames.
        needs: String,
        /// What came.
        found: String,
    },
    /// The predictor's own failure.
    #[error("{model}: {source}")]
    Model {
        /// Name of the predictor.
        model: String,
        /// What failed.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl PredictError {
    /// Refuses windows that do not fit those that `model` was made for.
    ///
    /// # Errors
    /// [`PredictError::Shape`] with both shapes.
    pub fn check_shapes(model: &str, needs: WindowShape, observations: &[Observation<'_>]) -> Result<(), PredictError> {
        match observations.iter().map(Observation::shape).find(|shape| !needs.fits(shape)) {
            Some(found) => Err(Self::shape(model, needs, found)),
            None => Ok(()),
        }
    }

    /// Windows of the shape `found` where `model` needs another one.
    #[must_use]
    pub fn shape(model: &str, needs: WindowShape, found: WindowShape) -> Self {
        Self::Shape { model: model.to_owned(), needs: needs.to_string(), found: found.to_string() }
    }
}
