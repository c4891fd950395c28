//! The training of every learned baseline: mean squared error first, then likelihood.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use candle_core::{D, Tensor, Var};
use gnp_data::{Truth, Window, WindowId, WindowSet};
use gnp_nn::Weights;
use gnp_train::{BatchTotals, EpochReport, Observer, Plan, Stage, TrainError, derive_seed};

use crate::gauss::mixture_nll;
use crate::kind::NeuralBaseline;
use crate::manoeuvre::{LATERAL, Manoeuvre};
use crate::net::Net;
use crate::network::{Ask, Classes, Output, one_hot};
use crate::oriented_view::{Orientation, OrientedView};
use crate::recipe::{ClassLoss, Recipe};

/// Trains a network by its [`Recipe`].
///
/// Its validation scores, of the likeliest future, are `mse` in m² over all points, `fde` in m, and
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

    /// The windows at the indices `batch` of `ids`, as the network is to see them.
    fn seen(&self, windows: &[Window<'a>], sides: &[Orientation]) -> Vec<OrientedView<'a>> {
        let seen = |(window, side): (&Window<'a>, &Orientation)| OrientedView {
            observation: window.observation(),
            side: *side,
        };
        windows.iter().zip(sides).map(seen).collect()
    }

    fn forward(&self, windows: &[Window<'_>], sides: &[Orientation], ask: Ask<'_>) -> candle_core::Result<Output> {
        let truths: Option<Vec<Truth<'_>>> =
            self.kind.uses_future().then(|| windows.iter().map(Window::truth).collect());
        self.net.forward(&self.seen(windows, sides), truths.as_deref(), ask)
    }

    /// Where the windows really went, `[windows, 1, points, 2]`.
    fn futures(&self, windows: &[Window<'_>], sides: &[Orientation]) -> candle_core::Result<Tensor> {
        let truths = windows.iter().map(Window::truth).zip(sides.iter().copied());
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

/// Which side is left in a training window, mirrored with probability `share`; `seed` is its own.
fn drawn(share: f64, seed: u64) -> Orientation {
    // The upper 53 bits are a number from 0 to below 1.
    let uniform = (seed >> 11) as f64 / (1u64 << 53) as f64;
    if uniform < share { Orientation::Mirrored } else { Orientation::Recorded }
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

    fn loss(&self, batch: &[usize], step_seed: u64) -> Result<Tensor, TrainError> {
        let windows = self.windows(self.train, batch)?;
        let sides: Vec<Orientation> =
            (0..batch.len()).map(|i| drawn(self.recipe.mirror, derive_seed(step_seed, i as u64))).collect();
        let clock = self.net.inputs.clock;
        let manoeuvre = |(window, side): (&Window<'_>, &Orientation)| {
            let recorded = Manoeuvre::of(window, clock);
            Manoeuvre { lateral: side.lateral(recorded.lateral), ..recorded }
        };
        let manoeuvres: Vec<Manoeuvre> = windows.iter().zip(&sides).map(manoeuvre).collect();
        let output = self.forward(&windows, &sides, Ask::Train(&manoeuvres))?;
        let truth = self.futures(&windows, &sides)?;
        let warm_up = self.epoch.load(Ordering::Relaxed) < self.recipe.warm_up_epochs;
        let points = if warm_up { output.gaussians.squared_error(&truth)? } else { output.gaussians.nll(&truth)? };
        let mut loss = points.mean_all()?;
        if let Some(classes) = output.classes.as_ref().filter(|_| !warm_up || self.recipe.class_loss_in_warm_up)
            && let Some(more) = self.class_loss(classes, &manoeuvres)?
        {
            let weight = if warm_up { self.class_weight() } else { 1. };
            loss = (loss + (more * weight)?)?;
        } else if let Some(classes) = &output.classes {
            // The class heads wait with a gradient of 0, which is not the same as none.
            loss = (loss + (classes.lateral.sum_all()? * 0.)? + (classes.longitudinal.sum_all()? * 0.)?)?;
        }
        Ok(loss)
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        let windows = self.windows(self.validation, batch)?;
        let sides = vec![Orientation::Recorded; windows.len()];
        let output = self.forward(&windows, &sides, Ask::Predict)?;
        let truth = self.futures(&windows, &sides)?;
        let unit = f64::from(self.net.inputs.unit_m);
        let squares = output.gaussians.squared_error(&truth)?.to_vec3::<f32>()?;
        let log_p = output.log_probability.to_vec2::<f32>()?;
        let nll = mixture_nll(&output.gaussians.nll(&truth)?, &output.log_probability)?;
        let nll = nll.mean(D::Minus1)?.to_vec1::<f32>()?;
        let (mut mse, mut fde) = (0., 0.);
        for (modes, log_p) in squares.iter().zip(&log_p) {
            let squares = &modes[likeliest(log_p)];
            mse += squares.iter().map(|square| f64::from(*square)).sum::<f64>() / squares.len() as f64 * unit * unit;
            fde += squares.last().map_or(0., |square| f64::from(*square).sqrt()) * unit;
        }
        let nll = nll.iter().map(|value| f64::from(*value) + 2. * unit.ln()).sum();
        Ok(BatchTotals::new(batch.len(), [("mse", mse), ("fde", fde), ("nll", nll)]))
    }
}

/// Index of the largest value, the first of equal ones.
pub(crate) fn likeliest(log_p: &[f32]) -> usize {
    (1..log_p.len()).fold(0, |best, mode| if log_p[mode] > log_p[best] { mode } else { best })
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
