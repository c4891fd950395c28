//! A trained baseline behind the predictor traits.

use std::collections::HashMap;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use candle_nn::VarBuilder;
use gnp_data::{Forecast, Mode, Observation, OraclePredictor, PredictError, Predictor, Truth, Window, WindowShape};
use gnp_nn::DeviceThread;

use crate::checkpoint::{Checkpoint, Header};
use crate::error::NeuralBaselineError;
use crate::gauss::mixture_nll;
use crate::inputs::Inputs;
use crate::kind::NeuralBaseline;
use crate::net::Net;
use crate::network::{Ask, Output};
use crate::oriented_view::{OrientedView, Variation};
use crate::recipe::OutputForm;
use crate::stage::predictions;
use crate::time_grid::TimeGrid;

/// Windows that go through a network at once.
const BATCH: usize = 128;

/// A trained baseline.
///
/// The networks see and predict points at 5 Hz; between them a forecast is linear in time. Every kind
/// but [`NeuralBaseline::PipInformed`] is a [`Predictor`]; that one predicts through
/// [`TrainedBaseline::with_future`] alone.
#[derive(Debug)]
pub struct TrainedBaseline {
    kind: NeuralBaseline,
    header: Header,
    net: Net,
    thread: DeviceThread,
}

impl TrainedBaseline {
    /// Reads a checkpoint that [`TrainedBaseline::train`] wrote.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Checkpoint`] for a file that is missing, damaged, of another program or lacks a
    /// weight.
    pub fn load(path: &Path, device: &Device) -> Result<Self, NeuralBaselineError> {
        let Checkpoint { header, tensors } = Checkpoint::load(path)?;
        let mut constants = HashMap::with_capacity(tensors.len());
        for (name, tensor) in tensors {
            constants.insert(name, tensor.to_device(device)?);
        }
        let vb = VarBuilder::from_tensors(constants, DType::F32, device);
        let inputs = inputs(header.shape, header.recipe.unit_m)?;
        let net = Net::new(header.kind, &header.recipe, header.reference.clone(), inputs, &vb).map_err(|e| {
            NeuralBaselineError::checkpoint(path, format!("does not hold this network ({e}): train again"))
        })?;
        Ok(Self { kind: header.kind, header, net, thread: DeviceThread::of(device)? })
    }

    /// The same PiP network with plans of constant velocity instead of recorded ones.
    ///
    /// # Errors
    /// [`NeuralBaselineError::NoPlan`] for a network that takes no plan.
    pub fn with_surrogate_plan(mut self) -> Result<Self, NeuralBaselineError> {
        if self.kind.trained_as() != NeuralBaseline::PipInformed {
            return Err(NeuralBaselineError::NoPlan { kind: self.kind.name() });
        }
        self.net.plan_constant_velocity();
        self.kind = NeuralBaseline::PipSurrogate;
        Ok(self)
    }

    /// Which baseline it is.
    #[must_use]
    pub fn kind(&self) -> NeuralBaseline {
        self.kind
    }

    /// What its points are counted from.
    #[must_use]
    pub fn form(&self) -> OutputForm {
        self.header.form()
    }

    /// What it was trained on, and how.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The form that is handed recorded futures, for the one kind that is.
    #[must_use]
    pub fn with_future(&self) -> Option<WithFuture<'_>> {
        self.kind.uses_future().then_some(WithFuture(self))
    }

    /// Mean negative log-likelihood of recorded positions, by window, over the points of the future:
    /// of a density in 1/m².
    ///
    /// # Errors
    /// When the windows have another shape, or the network fails.
    pub fn nll(&self, windows: &[Window<'_>]) -> Result<Vec<f64>, PredictError> {
        self.thread.run(|| self.nll_in_batches(windows))
    }

    fn nll_in_batches(&self, windows: &[Window<'_>]) -> Result<Vec<f64>, PredictError> {
        let mut all = Vec::with_capacity(windows.len());
        for windows in windows.chunks(BATCH) {
            let observations: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
            self.check(&observations)?;
            let truths: Vec<Truth<'_>> = windows.iter().map(Window::truth).collect();
            let output = self.forward(&observations, self.kind.uses_future().then_some(&truths))?;
            let values = || {
                let truths = windows.iter().map(|window| (window.truth(), Variation::RECORDED));
                let truth = self.net.inputs.futures(truths, self.net.device())?.unsqueeze(1)?;
                mixture_nll(&output.gaussians.nll(&truth)?, &output.log_probability)?.mean(1)?.to_vec1::<f32>()
            };
            let unit = 2. * f64::from(self.net.inputs.unit_m).ln();
            all.extend(values().map_err(|e| self.fail(e))?.into_iter().map(|value| f64::from(value) + unit));
        }
        Ok(all)
    }

    #[cfg(test)]
    pub(crate) fn net(&self) -> &Net {
        &self.net
    }

    fn forward(
        &self,
        observations: &[Observation<'_>],
        truths: Option<&Vec<Truth<'_>>>,
    ) -> Result<Output, PredictError> {
        let seen: Vec<OrientedView<'_>> = observations.iter().map(OrientedView::recorded).collect();
        let output = self.net.forward(&seen, truths.map(Vec::as_slice), Ask::Predict);
        output.and_then(|output| output.trusting(self.header.trust.unwrap_or(1.))).map_err(|e| self.fail(e))
    }

    /// The share of the mean deviation from the reference path with the least squared error over `windows`, each counted
    /// with its weight; `None` in the published form. It may only be asked before there is one.
    pub(crate) fn fitted_trust(&self, windows: &[(Window<'_>, f64)]) -> Result<Option<f64>, NeuralBaselineError> {
        self.thread.run(|| self.least_squares_trust(windows))
    }

    fn least_squares_trust(&self, windows: &[(Window<'_>, f64)]) -> Result<Option<f64>, NeuralBaselineError> {
        let (mut product, mut square) = (0., 0.);
        for windows in windows.chunks(BATCH) {
            let seen: Vec<OrientedView<'_>> =
                windows.iter().map(|(window, _)| OrientedView::recorded(&window.observation())).collect();
            let truths: Vec<Truth<'_>> = windows.iter().map(|(window, _)| window.truth()).collect();
            let output = self.net.forward(&seen, self.kind.uses_future().then_some(&truths[..]), Ask::Predict)?;
            let Some(reference) = &output.reference else { return Ok(None) };
            let recorded = truths.iter().map(|truth| (*truth, Variation::RECORDED));
            let recorded = (self.net.inputs.futures(recorded, self.net.device())? - reference)?;
            let learned = (output.mixture_mean()? - reference)?;
            let sums = |x: Tensor| x.flatten_from(1)?.sum(1)?.to_vec1::<f32>();
            let (products, squares) = (sums((&learned * &recorded)?)?, sums(learned.sqr()?)?);
            for ((_, weight), (p, s)) in windows.iter().zip(products.iter().zip(&squares)) {
                product += weight * f64::from(*p);
                square += weight * f64::from(*s);
            }
        }
        Ok(Some(if square > 0. { (product / square).clamp(0., 1.) } else { 0. }))
    }

    fn fail(&self, source: impl std::error::Error + Send + Sync + 'static) -> PredictError {
        PredictError::Model { model: self.name().to_owned(), source: Box::new(source) }
    }

    fn check(&self, observations: &[Observation<'_>]) -> Result<(), PredictError> {
        PredictError::check_shapes(self.name(), self.header.shape, observations)
    }

    fn predict_with(
        &self,
        observations: &[Observation<'_>],
        truths: Option<&[Truth<'_>]>,
        k: usize,
    ) -> Result<Vec<Forecast>, PredictError> {
        self.thread.run(|| self.in_batches(observations, truths, k))
    }

    fn in_batches(
        &self,
        observations: &[Observation<'_>],
        truths: Option<&[Truth<'_>]>,
        k: usize,
    ) -> Result<Vec<Forecast>, PredictError> {
        self.check(observations)?;
        let mut forecasts = Vec::with_capacity(observations.len());
        for (i, observations) in observations.chunks(BATCH).enumerate() {
            let truths = truths.map(|truths| truths[i * BATCH..][..observations.len()].to_vec());
            let output = self.forward(observations, truths.as_ref())?;
            forecasts.extend(self.forecasts(&output, k).map_err(|e| self.fail(e))?);
        }
        Ok(forecasts)
    }

    /// The prediction and the `k - 1` likeliest other futures of each window, with probabilities that sum to 1.
    fn forecasts(&self, output: &Output, k: usize) -> candle_core::Result<Vec<Forecast>> {
        let log_p = output.log_probability.to_vec2::<f32>()?;
        let inputs = self.net.inputs;
        let (windows, modes, points, _) = output.gaussians.mean.dims4()?;
        let means = output.gaussians.mean.flatten_all()?.to_vec1::<f32>()?;
        let (means, _) = means.as_chunks::<2>();
        let predictions = predictions(output)?;
        let window = |w: usize| {
            let mut order: Vec<usize> = (0..modes).collect();
            order.sort_by(|a, b| {
                let first = |mode: usize| mode != predictions[w];
                first(*a).cmp(&first(*b)).then(log_p[w][*b].total_cmp(&log_p[w][*a]))
            });
            order.truncate(k.max(1));
            let sum: f32 = order.iter().map(|mode| log_p[w][*mode].exp()).sum();
            let mode = |mode: usize| {
                let points: Vec<[f32; 2]> =
                    means[(w * modes + mode) * points..][..points].iter().map(|p| inputs.metres(*p)).collect();
                let path = inputs.clock.to_frames(&points);
                Mode { probability: log_p[w][mode].exp() / sum, path, explanation: None }
            };
            Forecast { modes: order.into_iter().map(mode).collect() }
        };
        Ok((0..windows).map(window).collect())
    }
}

/// The networks' view of windows of `shape`.
pub(crate) fn inputs(shape: WindowShape, unit_m: f64) -> Result<Inputs, NeuralBaselineError> {
    Ok(Inputs { clock: TimeGrid::new(shape)?, unit_m: unit_m as f32 })
}

impl Predictor for TrainedBaseline {
    fn name(&self) -> &str {
        self.kind.name_in(self.form())
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        if self.kind.uses_future() {
            return Err(self.fail(NeuralBaselineError::NeedsFuture { kind: self.kind.name() }));
        }
        self.predict_with(observations, None, k)
    }
}

/// A baseline that is handed the recorded future of a neighbour: everything made with it is marked.
#[derive(Clone, Copy, Debug)]
pub struct WithFuture<'a>(&'a TrainedBaseline);

impl OraclePredictor for WithFuture<'_> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn predict_with_future(&self, windows: &[Window<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        let observations: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
        let truths: Vec<Truth<'_>> = windows.iter().map(Window::truth).collect();
        self.0.predict_with(&observations, Some(&truths), k)
    }
}
