//! What the force's networks multiply in when they predict.

use std::sync::Arc;

use candle_core::Device;
use gnp_nn::Precision;

use crate::error::ModelError;
use crate::gnp::{Gnp, Trained};
use crate::scene::NeighbourFuture;

impl Gnp {
    /// The same predictor with the products of the force's networks in another precision; the weights it was loaded with stay,
    /// so that this may be called again. In bf16 paths differ by rounding to 8 bits (docs/performance.md says by how much),
    /// and those of [`Gnp::predict_into`] from those of [`predict`](gnp_data::Predictor::predict) by as much: what they round
    /// differs in its last bit. Goals and probabilities are f32 in any case: that network would gain too little.
    ///
    /// # Errors
    /// As [`Gnp::check_precision`], and [`ModelError::Config`] for bf16 without physics: nothing falls back to f32.
    pub fn with_precision(mut self, precision: Precision) -> Result<Self, ModelError> {
        if precision == self.precision() {
            return Ok(self);
        }
        let trained = &*self.trained;
        Self::check_precision(precision, self.neighbours, &trained.device)?;
        let Some((force, phase)) = &trained.force else {
            return Err(refused("is \"bf16\" without physics: the goal network multiplies in f32; take \"f32\""));
        };
        let force = Some((force.frozen_in(precision)?, *phase));
        self.trained = Arc::new(Trained { force, ..trained.clone() });
        Ok(self)
    }

    /// What the force's networks multiply in.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.trained.force.as_ref().map_or(Precision::F32, |(force, _)| force.precision())
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
        match precision {
            Precision::Bf16 if !device.is_cpu() => {
                Err(refused("is \"bf16\" on a GPU: products in bf16 are made on CPUs; take \"f32\""))
            }
            Precision::Bf16 if neighbours == NeighbourFuture::Joint => {
                Err(refused("is \"bf16\" with joint neighbours, which are rolled out in f32; take \"f32\""))
            }
            _ => Ok(()),
        }
    }
}

fn refused(problem: &str) -> ModelError {
    ModelError::config("predict.precision", problem)
}
