//! The recurrent parts that all baselines share: an embedded path read by an LSTM, and a code
//! unrolled into a future.

use candle_core::{Result, Tensor};
use candle_nn::{Init, Linear, VarBuilder};
use gnp_nn::linear;

use crate::rows::dense;
use crate::sequence::lstm_states;

/// Slope of a leaky ReLU below 0, in all published networks.
pub(crate) const SLOPE: f32 = 0.1;

/// Leaky ReLU.
pub(crate) fn leaky(x: &Tensor) -> Result<Tensor> {
    candle_nn::ops::leaky_relu(x, SLOPE.into())
}

/// An LSTM layer with PyTorch's names (`weight_ih`, `weight_hh`, `bias_ih`, `bias_hh`), gate order
/// (input, forget, cell, output) and initialisation (uniform in `+-1/sqrt(hidden)`), over whole
/// sequences.
#[derive(Clone, Debug)]
pub(crate) struct Recurrent {
    weight_ih: Tensor,
    weight_hh: Tensor,
    bias_ih: Tensor,
    bias_hh: Tensor,
}

impl Recurrent {
    /// A layer of `hidden` units on `input` values.
    pub(crate) fn new(input: usize, hidden: usize, vb: VarBuilder) -> Result<Self> {
        let bound = 1. / (hidden.max(1) as f64).sqrt();
        let init = Init::Uniform { lo: -bound, up: bound };
        Ok(Self {
            weight_ih: vb.get_with_hints((4 * hidden, input), "weight_ih", init)?,
            weight_hh: vb.get_with_hints((4 * hidden, hidden), "weight_hh", init)?,
            bias_ih: vb.get_with_hints(4 * hidden, "bias_ih", init)?,
            bias_hh: vb.get_with_hints(4 * hidden, "bias_hh", init)?,
        })
    }

    /// The output at every point, `[points, rows, hidden]`, for `x` `[points, rows, input]`; the
    /// start is zero. At least one row.
    pub(crate) fn states(&self, x: &Tensor) -> Result<Tensor> {
        lstm_states(&self.inputs(x)?, &self.weight_hh, &self.bias()?, x.dim(0)?)
    }

    /// The output at each of `points` points, `[points, rows, hidden]`, for the same input `x`
    /// `[rows, input]` at all of them.
    pub(crate) fn repeated(&self, x: &Tensor, points: usize) -> Result<Tensor> {
        lstm_states(&self.inputs(&x.unsqueeze(0)?)?, &self.weight_hh, &self.bias()?, points)
    }

    fn bias(&self) -> Result<Tensor> {
        &self.bias_ih + &self.bias_hh
    }

    /// What the inputs bring to the gates, `[points, rows, 4 * hidden]`.
    fn inputs(&self, x: &Tensor) -> Result<Tensor> {
        let (points, rows, input) = x.dims3()?;
        let flat = x.contiguous()?.reshape((points * rows, input))?;
        let sums = flat.matmul(&self.weight_ih.t()?)?;
        sums.reshape((points, rows, sums.dim(1)?))
    }
}

/// Embeds the points of a path and reads them with an LSTM (Deo and Trivedi 2018): 2 -> 32, leaky
/// ReLU, 32 -> 64.
#[derive(Clone, Debug)]
pub(crate) struct PathEncoder {
    embed: Linear,
    lstm: Recurrent,
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
            lstm: Recurrent::new(EMBEDDED, ENCODED, vb.pp("encoder"))?,
        })
    }

    /// Codes `[rows, 64]` of paths `[points, rows, input]`.
    pub(crate) fn last(&self, paths: &Tensor) -> Result<Tensor> {
        read(&self.embed, &self.lstm, paths)
    }
}

/// Codes `[rows, 64]` of paths `[points, rows, input]`: embedded, then read to the last point.
pub(crate) fn read(embed: &Linear, lstm: &Recurrent, paths: &Tensor) -> Result<Tensor> {
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
    lstm: Recurrent,
    output: Linear,
}

impl Decoder {
    const HIDDEN: usize = 128;

    /// A decoder of codes of `width` values under `decoder` and `output`.
    pub(crate) fn new(width: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            lstm: Recurrent::new(width, Self::HIDDEN, vb.pp("decoder"))?,
            output: linear(Self::HIDDEN, 5, vb.pp("output"))?,
        })
    }

    /// `[rows, points, 5]` from codes `[rows, width]`.
    pub(crate) fn unroll(&self, codes: &Tensor, points: usize) -> Result<Tensor> {
        dense(&self.output, &self.lstm.repeated(codes, points)?, 1.)?.transpose(0, 1)?.contiguous()
    }
}
