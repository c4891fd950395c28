//! What all learned baselines have in common: one call from the past to Gaussians.

use std::fmt::Debug;

use candle_core::{D, DType, Device, Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};
use gnp_nn::linear;

use crate::encoder::Decoder;
use crate::gauss::Gaussians;
use crate::manoeuvre::{LATERAL, Manoeuvre};

/// What a network is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Ask<'a> {
    /// The future given the true manoeuvres, one of each window: to learn from.
    Train(&'a [Manoeuvre]),
    /// Every manoeuvre's future and its probability.
    Predict,
}

/// What a network gives.
#[derive(Clone, Debug)]
pub(crate) struct Output {
    /// `[windows, modes, points]`.
    pub(crate) gaussians: Gaussians,
    /// Logarithms of the modes' probabilities, `[windows, modes]`.
    pub(crate) log_probability: Tensor,
    /// Probabilities of the manoeuvre classes, for networks that have them.
    pub(crate) classes: Option<Classes>,
    /// The path that means are counted from, which they contain, `[windows, points, 2]`; `None` in the published form.
    pub(crate) reference: Option<Tensor>,
}

impl Output {
    /// Mean of all modes, `[windows, points, 2]`.
    pub(crate) fn mixture_mean(&self) -> Result<Tensor> {
        let probability = self.log_probability.exp()?.unsqueeze(2)?.unsqueeze(3)?;
        self.gaussians.mean.broadcast_mul(&probability)?.sum(1)
    }

    /// The same with the share `trust` of the mean deviation from the reference left of it, modes as far apart as they were.
    pub(crate) fn trusting(mut self, trust: f64) -> Result<Self> {
        if let Some(reference) = self.reference.as_ref().filter(|_| trust < 1.) {
            let taken = ((self.mixture_mean()? - reference)? * (1. - trust))?;
            self.gaussians.mean = self.gaussians.mean.broadcast_sub(&taken.unsqueeze(1)?)?;
        }
        Ok(self)
    }
}

/// Probabilities of manoeuvre classes.
#[derive(Clone, Debug)]
pub(crate) struct Classes {
    /// Keep, left, right: `[windows, 3]`.
    pub(crate) lateral: Tensor,
    /// Normal, brake and, with three, accelerate: `[windows, 2 or 3]`.
    pub(crate) longitudinal: Tensor,
}

/// A network from `I` to Gaussians.
pub(crate) trait Network<I>: Send + Sync + Debug {
    /// The futures of all windows of `past`.
    ///
    /// # Errors
    /// When a tensor operation fails.
    fn forward(&self, past: &I, ask: Ask<'_>) -> Result<Output>;
}

/// Manoeuvre heads of CS-LSTM(M) and PiP: softmax over three lateral and two longitudinal classes.
#[derive(Clone, Debug)]
pub(crate) struct ManoeuvreHeads {
    lateral: Linear,
    longitudinal: Linear,
}

/// Longitudinal classes of those heads.
const LONGITUDINAL: usize = 2;
/// Width of a manoeuvre as a decoder sees it, one-hot.
pub(crate) const MANOEUVRE: usize = LATERAL + LONGITUDINAL;

impl ManoeuvreHeads {
    /// Heads on codes of `width` values.
    pub(crate) fn new(width: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            lateral: linear(width, LATERAL, vb.pp("lateral"))?,
            longitudinal: linear(width, LONGITUDINAL, vb.pp("longitudinal"))?,
        })
    }

    fn classes(&self, codes: &Tensor) -> Result<Classes> {
        let softmax = |head: &Linear| candle_nn::ops::softmax(&head.forward(codes)?, D::Minus1);
        Ok(Classes { lateral: softmax(&self.lateral)?, longitudinal: softmax(&self.longitudinal)? })
    }
}

impl Classes {
    /// Logarithm of the probability of each pair, lateral class by lateral class.
    pub(crate) fn log_probability(&self) -> Result<Tensor> {
        // A class that has died out keeps a finite logarithm.
        let log = |p: &Tensor| p.clamp(1e-12, 1.)?.log();
        let (lateral, longitudinal) = (log(&self.lateral)?.unsqueeze(2)?, log(&self.longitudinal)?.unsqueeze(1)?);
        lateral.broadcast_add(&longitudinal)?.flatten(1, 2)
    }
}

/// Rows `[windows, classes]` that are 1 at each label and 0 elsewhere.
pub(crate) fn one_hot(labels: impl Iterator<Item = usize>, classes: usize, device: &Device) -> Result<Tensor> {
    let values: Vec<f32> =
        labels.flat_map(|label| (0..classes).map(move |class| if class == label { 1. } else { 0. })).collect();
    let rows = values.len() / classes.max(1);
    Tensor::from_vec(values, (rows, classes), device)
}

/// How the decoder's means are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Means {
    /// Positions.
    Positions,
    /// Steps from point to point.
    Steps,
}

/// Codes `[windows, width]` to futures of `points`, one without `heads`, with them one a manoeuvre.
pub(crate) fn decode(
    codes: &Tensor,
    decoder: &Decoder,
    heads: Option<&ManoeuvreHeads>,
    points: usize,
    means: Means,
    ask: Ask<'_>,
) -> Result<Output> {
    let (windows, width) = codes.dims2()?;
    let classes = heads.map(|heads| heads.classes(codes)).transpose()?;
    let (inputs, modes) = match (&classes, ask) {
        (None, _) => (codes.clone(), 1),
        (Some(_), Ask::Train(manoeuvres)) => {
            let lateral = one_hot(manoeuvres.iter().map(|m| m.lateral), LATERAL, codes.device())?;
            let longitudinal = manoeuvres.iter().map(|m| m.longitudinal_of(LONGITUDINAL));
            let longitudinal = one_hot(longitudinal, LONGITUDINAL, codes.device())?;
            (Tensor::cat(&[codes, &lateral, &longitudinal], 1)?, 1)
        }
        (Some(_), Ask::Predict) => {
            let modes = LATERAL * LONGITUDINAL;
            let lateral = one_hot((0..modes).map(|mode| mode / LONGITUDINAL), LATERAL, codes.device())?;
            let longitudinal = one_hot((0..modes).map(|mode| mode % LONGITUDINAL), LONGITUDINAL, codes.device())?;
            let pairs = Tensor::cat(&[lateral, longitudinal], 1)?.unsqueeze(0)?;
            let pairs = pairs.broadcast_as((windows, modes, MANOEUVRE))?;
            let codes = codes.unsqueeze(1)?.broadcast_as((windows, modes, width))?;
            (Tensor::cat(&[codes, pairs], 2)?.flatten(0, 1)?, modes)
        }
    };
    let raw = decoder.unroll(&inputs, points)?;
    let gaussians = match means {
        Means::Positions => Gaussians::from_head(&raw)?,
        Means::Steps => Gaussians::from_steps(&raw)?,
    };
    let log_probability = match &classes {
        Some(classes) if modes > 1 => classes.log_probability()?,
        _ => Tensor::zeros((windows, 1), DType::F32, codes.device())?,
    };
    Ok(Output { gaussians: gaussians.reshape(&[windows, modes, points])?, log_probability, classes, reference: None })
}
