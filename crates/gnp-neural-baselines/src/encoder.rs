//! The recurrent parts that all baselines share: an embedded path read by an LSTM, and a code
//! unrolled into a future.

use candle_core::{Result, Tensor};
use candle_nn::{Linear, VarBuilder};
use gnp_nn::{Lstm, linear};

use crate::rows::dense;

/// Slope of a leaky ReLU below 0, in all published networks.
pub(crate) const SLOPE: f32 = 0.1;

/// Leaky ReLU.
pub(crate) fn leaky(x: &Tensor) -> Result<Tensor> {
    candle_nn::ops::leaky_relu(x, SLOPE.into())
}

/// Embeds the points of a path and reads them with an LSTM (Deo and Trivedi 2018): 2 -> 32, leaky
/// ReLU, 32 -> 64.
#[derive(Clone, Debug)]
pub(crate) struct PathEncoder {
    embed: Linear,
    lstm: Lstm,
}

/// Width of an embedded point.
pub(crate) const EMBEDDED: usize = 32;
/// Width of an encoded path.
pub(crate) const ENCODED: usize = 64;
/// Width of the target's own code.
pub(crate) const DYNAMICS: usize = 32;

impl PathEncoder {
    /// An encoder of points of `input` values under `embed` and `encoder`.
    pub(crate) fn new(input: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            embed: linear(input, EMBEDDED, vb.pp("embed"))?,
            lstm: Lstm::new(EMBEDDED, ENCODED, vb.pp("encoder"))?,
        })
    }

    /// Codes `[rows, 64]` of paths `[points, rows, input]`.
    pub(crate) fn last(&self, paths: &Tensor) -> Result<Tensor> {
        read(&self.embed, &self.lstm, paths)
    }
}

/// Codes `[rows, 64]` of paths `[points, rows, input]`: embedded, then read to the last point.
pub(crate) fn read(embed: &Linear, lstm: &Lstm, paths: &Tensor) -> Result<Tensor> {
    let (points, rows, _) = paths.dims3()?;
    if rows == 0 {
        return Tensor::zeros((0, ENCODED), paths.dtype(), paths.device());
    }
    lstm.states(&dense(embed, paths, SLOPE)?)?.get(points - 1)
}

/// Unrolls a code into the parameters of a Gaussian at every point of the future: LSTM of 128 units
/// on the same input at each point, then 128 -> 5.
#[derive(Clone, Debug)]
pub(crate) struct Decoder {
    lstm: Lstm,
    output: Linear,
}

impl Decoder {
    const HIDDEN: usize = 128;

    /// A decoder of codes of `width` values under `decoder` and `output`.
    pub(crate) fn new(width: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            lstm: Lstm::new(width, Self::HIDDEN, vb.pp("decoder"))?,
            output: linear(Self::HIDDEN, 5, vb.pp("output"))?,
        })
    }

    /// `[rows, points, 5]` from codes `[rows, width]`.
    pub(crate) fn unroll(&self, codes: &Tensor, points: usize) -> Result<Tensor> {
        dense(&self.output, &self.lstm.repeated(codes, points)?, 1.)?.transpose(0, 1)?.contiguous()
    }
}
