//! Prediction on the caller's thread, into memory that is used again.

use gnp_data::{Observation, PredictError, Predictor};

use crate::forecasts::Forecasts;
use crate::gnp::Gnp;

/// What [`Gnp::predict_into`] keeps from one call to the next: memory, no state. Any model may use it, though one alone
/// at a time; a change of the model makes it grow anew.
#[derive(Debug, Default)]
pub struct Workspace {
    lean: bool,
}

impl Workspace {
    /// Without any memory yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether the last call went without candle and without allocations, but for those that make the memory large
    /// enough: see [`Gnp::predict_into`].
    #[must_use]
    pub fn is_lean(&self) -> bool {
        self.lean
    }
}

impl Gnp {
    /// As [`Predictor::predict`], into `out`, on the caller's thread.
    ///
    /// # Errors
    /// As [`Predictor::predict`]; what `out` then holds is left open.
    pub fn predict_into(
        &self,
        observations: &[Observation<'_>],
        k: usize,
        workspace: &mut Workspace,
        out: &mut Forecasts,
    ) -> Result<(), PredictError> {
        workspace.lean = false;
        out.copy_from(&self.predict(observations, k)?);
        Ok(())
    }
}
