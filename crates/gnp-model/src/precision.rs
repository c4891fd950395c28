//! What the networks multiply in when they predict.

use std::sync::Arc;

use candle_core::Device;
use gnp_nn::Precision;

use crate::error::ModelError;
use crate::gnp::{Gnp, Trained};
use crate::scene::NeighbourFuture;

impl Gnp {
    /// The same predictor with the products of its networks in another precision; the weights it was loaded with stay, so that
    /// this may be called again. In bf16 forecasts differ by rounding to 8 bits (docs/performance.md says by how much), and
    /// those of [`Gnp::predict_into`] from those of [`predict`](gnp_data::Predictor::predict) by as much: what they round
    /// differs in its last bit.
    ///
    /// # Errors
    /// As [`Gnp::check_precision`]: nothing falls back to f32.
    pub fn with_precision(mut self, precision: Precision) -> Result<Self, ModelError> {
        if precision == self.precision() {
            return Ok(self);
        }
        let trained = &*self.trained;
        Self::check_precision(precision, self.neighbours, &trained.device)?;
        let goal = trained.goal.clone().in_precision(precision)?;
        let force = match &trained.force {
            Some((force, phase)) => Some((force.frozen_in(precision)?, *phase)),
            None => None,
        };
        let packed = match &trained.packed {
            Some(_) => Some(Arc::new(goal.packed(&trained.centres)?)),
            None => None,
        };
        self.trained = Arc::new(Trained { goal, force, packed, ..trained.clone() });
        Ok(self)
    }

    /// What its networks multiply in.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.trained.goal.precision()
    }

    /// Whether a model on `device`, with such neighbours, can predict in that precision here.
    ///
    /// # Errors
    /// [`ModelError::Precision`] where the processor does not multiply in it; [`ModelError::Config`] for bf16 on a GPU, or with
    /// joint neighbours, which candle rolls out.
    pub fn check_precision(
        precision: Precision,
        neighbours: NeighbourFuture,
        device: &Device,
    ) -> Result<(), ModelError> {
        precision.check()?;
        let refused = |problem| Err(ModelError::config("predict.precision", problem));
        match precision {
            Precision::Bf16 if !device.is_cpu() => {
                refused("is \"bf16\" on a GPU: products in bf16 are made on CPUs; take \"f32\"")
            }
            Precision::Bf16 if neighbours == NeighbourFuture::Joint => {
                refused("is \"bf16\" with joint neighbours, which are rolled out in f32; take \"f32\"")
            }
            _ => Ok(()),
        }
    }
}
