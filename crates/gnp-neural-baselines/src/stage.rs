//! The training of every learned baseline: mean squared error first, then likelihood.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use candle_core::{D, Tensor, Var};
use gnp_data::{Truth, Window, WindowId, WindowSet, nearest_to_mean};
use gnp_nn::Weights;
use gnp_train::{BatchTotals, EpochReport, Observer, Part, Plan, Stage, TrainError, Windows, derive_seed};

use crate::gauss::mixture_nll;
use crate::kind::NeuralBaseline;
use crate::manoeuvre::{LATERAL, Manoeuvre};
use crate::net::Net;
use crate::network::{Ask, Classes, Output, one_hot};
use crate::oriented_view::{OrientedView, Variation};
use crate::recipe::{ClassLoss, Recipe};

/// Trains a network by its [`Recipe`].
///
/// Its validation scores, of the prediction, are `mse` in m² over all points, `fde` in m, and
/// `nll`, of a density in 1/m² over all futures.
#[derive(Debug)]
pub(crate) struct RecipeStage<'a> {
    pub(crate) kind: NeuralBaseline,
    pub(crate) net: &'a Net,
    pub(crate) weights: &'a Weights,
    pub(crate) recipe: &'a Recipe,
    pub(crate) set: &'a WindowSet<'a>,
    pub(crate) train: &'a [WindowId],
    pub(crate) validation: &'a [WindowId],
    /// Finished epochs, kept up to date by [`Epochs`].
    pub(crate) epoch: &'a AtomicUsize,
}

/// Tells a [`RecipeStage`] which epoch it is in.
#[derive(Debug)]
pub(crate) struct Epochs<'a>(pub(crate) &'a AtomicUsize);

impl Observer for Epochs<'_> {
    fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
        self.0.store((plan.done / plan.batches.max(1) as u64) as usize, Ordering::Relaxed);
        Ok(())
    }

    fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
        self.0.store(report.record.epoch, Ordering::Relaxed);
        Ok(())
    }
}

/// Statistics of batch normalisation: set by training, not by gradients.
pub(crate) fn is_statistic(name: &str) -> bool {
    name.ends_with("running_mean") || name.ends_with("running_var")
}

impl<'a> RecipeStage<'a> {
    fn windows(&self, ids: &[WindowId], batch: &[usize]) -> Result<Vec<Window<'a>>, TrainError> {
        let view = |index: &usize| {
            let window = ids.get(*index).and_then(|id| self.set.get(*id));
            window.ok_or(TrainError::Window { index: *index, windows: ids.len() })
        };
        batch.iter().map(view).collect()
    }

    /// `windows` as the network is to see them.
    fn seen(&self, windows: &[Window<'a>], variations: &[Variation]) -> Vec<OrientedView<'a>> {
        let seen = |(window, variation): (&Window<'a>, &Variation)| OrientedView {
            observation: window.observation(),
            variation: *variation,
        };
        windows.iter().zip(variations).map(seen).collect()
    }

    fn forward(&self, windows: &[Window<'_>], variations: &[Variation], ask: Ask<'_>) -> candle_core::Result<Output> {
        let truths: Option<Vec<Truth<'_>>> =
            self.kind.uses_future().then(|| windows.iter().map(Window::truth).collect());
        self.net.forward(&self.seen(windows, variations), truths.as_deref(), ask)
    }

    /// Where the windows really went, `[windows, 1, points, 2]`.
    fn futures(&self, windows: &[Window<'_>], variations: &[Variation]) -> candle_core::Result<Tensor> {
        let truths = windows.iter().map(Window::truth).zip(variations.iter().copied());
        self.net.inputs.futures(truths, self.net.device())?.unsqueeze(1)
    }

    /// What the class loss counts beside a squared error in the networks' unit: as much as it does beside
    /// one in square feet, in which the networks were published. Without it, a longer unit makes the
    /// squared error small and the encoder learns classes instead of futures. A likelihood needs no such
    /// weight: another unit only adds a constant to it.
    fn class_weight(&self) -> f64 {
        (FOOT / f64::from(self.net.inputs.unit_m)).powi(2)
    }

    fn class_loss(&self, classes: &Classes, manoeuvres: &[Manoeuvre]) -> candle_core::Result<Option<Tensor>> {
        let lateral = manoeuvres.iter().map(|m| m.lateral);
        let count = classes.longitudinal.dim(D::Minus1)?;
        let longitudinal = manoeuvres.iter().map(|m| m.longitudinal_of(count));
        let device = classes.lateral.device();
        let pairs = [
            (&classes.lateral, one_hot(lateral, LATERAL, device)?),
            (&classes.longitudinal, one_hot(longitudinal, count, device)?),
        ];
        let loss = match self.recipe.class_loss {
            ClassLoss::None => return Ok(None),
            ClassLoss::Binary => binary,
            ClassLoss::Categorical => categorical,
        };
        let [lateral, longitudinal] = pairs.map(|(p, labels)| loss(p, &labels));
        Ok(Some((lateral? + longitudinal?)?))
    }
}

/// Length of a foot, m: the unit of the published networks.
const FOOT: f64 = 0.3048;

/// How a training window is varied by `recipe`; `seed` is its own.
fn drawn(recipe: &Recipe, seed: u64) -> Variation {
    // The upper 53 bits are a number from 0 to below 1.
    let uniform = |which| (derive_seed(seed, which) >> 11) as f64 / (1u64 << 53) as f64;
    let along = recipe.longitudinal_scale.powf(2. * uniform(1) - 1.) as f32;
    Variation { mirrored: uniform(0) < recipe.mirror, along }
}

/// Keeps logarithms of probabilities finite, and gradients where a class has died out.
fn log(p: &Tensor) -> candle_core::Result<Tensor> {
    p.clamp(1e-7, 1.)?.log()
}

/// Mean over windows and classes of the binary cross-entropy of each class.
fn binary(p: &Tensor, labels: &Tensor) -> candle_core::Result<Tensor> {
    let (yes, no) = ((labels * log(p)?)?, ((1. - labels)? * log(&(1. - p)?)?)?);
    (yes + no)?.mean_all()?.neg()
}

/// Mean over windows of the cross-entropy.
fn categorical(p: &Tensor, labels: &Tensor) -> candle_core::Result<Tensor> {
    (labels * log(p)?)?.sum(D::Minus1)?.mean_all()?.neg()
}

impl Stage for RecipeStage<'_> {
    fn name(&self) -> &'static str {
        self.kind.stem()
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        self.weights.named().into_iter().filter(|(name, _)| !is_statistic(name)).collect()
    }

    fn train_len(&self) -> usize {
        self.train.len()
    }

    fn validation_len(&self) -> usize {
        self.validation.len()
    }

    fn train_sites(&self) -> Vec<u32> {
        Windows::new(self.set, self.train).sites()
    }

    fn validation_sites(&self) -> Vec<u32> {
        Windows::new(self.set, self.validation).sites()
    }

    fn loss(&self, part: Part<'_>) -> Result<Tensor, TrainError> {
        let windows = self.windows(self.train, part.windows)?;
        let variations: Vec<Variation> =
            (0..windows.len()).map(|i| drawn(self.recipe, derive_seed(part.seed, i as u64))).collect();
        let clock = self.net.inputs.clock;
        let manoeuvre = |(window, variation): (&Window<'_>, &Variation)| {
            let recorded = Manoeuvre::of(window, clock);
            Manoeuvre { lateral: variation.lateral(recorded.lateral), ..recorded }
        };
        let manoeuvres: Vec<Manoeuvre> = windows.iter().zip(&variations).map(manoeuvre).collect();
        let output = self.forward(&windows, &variations, Ask::Train(&manoeuvres))?;
        let truth = self.futures(&windows, &variations)?;
        let warm_up = self.epoch.load(Ordering::Relaxed) < self.recipe.warm_up_epochs(self.train.len());
        let points = if warm_up { output.gaussians.squared_error(&truth)? } else { output.gaussians.nll(&truth)? };
        let mut loss = points.mean_all()?;
        if let Some(classes) = output.classes.as_ref().filter(|_| !warm_up || self.recipe.class_loss_in_warm_up)
            && let Some(more) = self.class_loss(classes, &manoeuvres)?
        {
            let weight = if warm_up { self.class_weight() } else { 1. };
            loss = (loss + (more * weight)?)?;
        } else if let Some(classes) = &output.classes {
            // The class heads wait with a gradient of 0, which is not the same as none. (candle follows no product with
            // the number 0.)
            for head in [&classes.lateral, &classes.longitudinal] {
                loss = (loss + (head * head.zeros_like()?)?.sum_all()?)?;
            }
        }
        Ok(loss)
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        let windows = self.windows(self.validation, batch)?;
        let recorded = vec![Variation::RECORDED; windows.len()];
        let output = self.forward(&windows, &recorded, Ask::Predict)?;
        let truth = self.futures(&windows, &recorded)?;
        let unit = f64::from(self.net.inputs.unit_m);
        let squares = output.gaussians.squared_error(&truth)?.to_vec3::<f32>()?;
        let nll = mixture_nll(&output.gaussians.nll(&truth)?, &output.log_probability)?;
        let nll = nll.mean(D::Minus1)?.to_vec1::<f32>()?;
        let (mut mse, mut fde) = (0., 0.);
        let predictions = predictions(&output)?;
        for (modes, prediction) in squares.iter().zip(predictions) {
            let squares = &modes[prediction];
            mse += squares.iter().map(|square| f64::from(*square)).sum::<f64>() / squares.len() as f64 * unit * unit;
            fde += squares.last().map_or(0., |square| f64::from(*square).sqrt()) * unit;
        }
        let nll = nll.iter().map(|value| f64::from(*value) + 2. * unit.ln()).sum();
        Ok(BatchTotals::new(batch.len(), [("mse", mse), ("fde", fde), ("nll", nll)]))
    }
}

/// Which mode is the prediction of each window: the one that ends nearest to the mean of all.
pub(crate) fn predictions(output: &Output) -> candle_core::Result<Vec<usize>> {
    let points = output.gaussians.mean.dim(2)?;
    let ends = output.gaussians.mean.narrow(2, points - 1, 1)?.squeeze(2)?.contiguous()?.to_vec3::<f32>()?;
    let probabilities = output.log_probability.exp()?.to_vec2::<f32>()?;
    let of_window = |(ends, probabilities): (Vec<Vec<f32>>, Vec<f32>)| {
        let ends: Vec<[f32; 2]> = ends.iter().map(|end| [end[0], end[1]]).collect();
        nearest_to_mean(&ends, &probabilities).unwrap_or_default()
    };
    Ok(ends.into_iter().zip(probabilities).map(of_window).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn class_losses_are_those_worked_out_by_hand() {
        let p = Tensor::new(&[[0.7f32, 0.2, 0.1], [0.25, 0.25, 0.5]], &Device::Cpu).unwrap();
        let labels = one_hot([0, 2].into_iter(), 3, &Device::Cpu).unwrap();
        let ln = |p: f32| -p.ln();
        let expected = (ln(0.7) + ln(0.8) + ln(0.9) + ln(0.75) + ln(0.75) + ln(0.5)) / 6.;
        assert!((binary(&p, &labels).unwrap().to_scalar::<f32>().unwrap() - expected).abs() < 1e-6);
        let expected = (ln(0.7) + ln(0.5)) / 2.;
        assert!((categorical(&p, &labels).unwrap().to_scalar::<f32>().unwrap() - expected).abs() < 1e-6);
    }
}
