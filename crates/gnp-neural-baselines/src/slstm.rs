//! S-LSTM as the tables of the literature have it: CS-LSTM's ablation with a fully connected pooling
//! (Deo and Trivedi 2018), not the pedestrian network of Alahi et al. 2016, which pools at every step.

use candle_core::{DType, Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::linear;

use crate::encoder::{DYNAMICS, Decoder, ENCODED, PathEncoder, leaky};
use crate::grid::LANE_CELLS;
use crate::inputs::Past;
use crate::network::{Ask, Means, Network, Output, decode};

/// Width of a pooled neighbourhood.
pub(crate) const SOCIAL: usize = 80;

/// The network: 351,573 weights.
#[derive(Clone, Debug)]
pub(crate) struct SLstm {
    encoder: PathEncoder,
    dynamics: Linear,
    pool: Linear,
    decoder: Decoder,
    points: usize,
}

impl SLstm {
    /// A network that predicts `points` points.
    pub(crate) fn new(points: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            encoder: PathEncoder::new(2, vb)?,
            dynamics: linear(ENCODED, DYNAMICS, vb.pp("dynamics"))?,
            pool: linear(LANE_CELLS * ENCODED, SOCIAL, vb.pp("pool"))?,
            decoder: Decoder::new(SOCIAL + DYNAMICS, vb)?,
            points,
        })
    }
}

impl Network<Past> for SLstm {
    fn forward(&self, past: &Past, ask: Ask<'_>) -> Result<Output> {
        let windows = past.windows()?;
        let (target, neighbours) = encode(&self.encoder, past)?;
        let mut grid = Tensor::zeros((windows * LANE_CELLS, ENCODED), DType::F32, target.device())?;
        if !past.cells.is_empty() {
            let cells = Tensor::new(past.cells.as_slice(), target.device())?;
            grid = grid.index_add(&cells, &neighbours, 0)?;
        }
        let social = leaky(&self.pool.forward(&grid.reshape((windows, LANE_CELLS * ENCODED))?)?)?;
        let target = leaky(&self.dynamics.forward(&target)?)?;
        let codes = Tensor::cat(&[social, target], 1)?;
        decode(&codes, &self.decoder, None, self.points, Means::Positions, ask)
    }
}

/// Codes of targets `[windows, 64]` and of neighbours `[occupied, 64]`, from one pass of the encoder.
pub(crate) fn encode(encoder: &PathEncoder, past: &Past) -> Result<(Tensor, Tensor)> {
    let windows = past.windows()?;
    let codes = encoder.last(&Tensor::cat(&[&past.history, &past.neighbours], 1)?)?;
    Ok((codes.narrow(0, 0, windows)?, codes.narrow(0, windows, past.cells.len())?))
}
