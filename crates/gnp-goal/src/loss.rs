//! What the network learns: soft labels over modes, and the loss.

use candle_core::{D, Tensor};
use serde::{Deserialize, Serialize};

use crate::error::GoalError;
use crate::net::GoalOutput;
use crate::pick::rows;

/// How a future's label over the modes is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelConfig {
    /// How far a future is from a mode.
    pub distance: LabelDistance,
    /// Distance over which a label falls to 1/e, in the unit of the distance; 1 in the paper.
    pub temperature: f64,
}

/// How far a future is from a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LabelDistance {
    /// Sum of squared displacements, m²: the paper's.
    SquaredSum,
    /// Its square root, m: the published code's.
    Euclidean,
    /// Mean displacement over the steps, m.
    MeanDisplacement,
}

impl LabelConfig {
    /// Every number: key, least, most, unit.
    pub const RANGES: [(&'static str, f64, f64, &'static str); 1] =
        [("temperature", 1e-3, 1e6, "m (m² for squared_sum)")];

    /// # Errors
    /// When the temperature is out of range.
    pub fn check(&self) -> Result<(), GoalError> {
        let [(_, least, most, unit)] = Self::RANGES;
        if (least..=most).contains(&self.temperature) {
            return Ok(());
        }
        let remedy = format!("give a number from {least} to {most} {unit}");
        Err(GoalError::Setting { key: "labels.temperature", value: self.temperature.to_string(), remedy })
    }
}

/// Labels of a batch.
#[derive(Clone, Debug)]
pub struct Labels {
    /// Probability that the network should give each mode, `[batch, modes]`.
    pub soft: Tensor,
    /// The mode nearest to the truth, `[batch, 1]` of `u32`: the one to decode in training.
    pub nearest: Tensor,
}

/// Labels for `truth` `[batch, t_pred, 2]` over `modes` `[modes, t_pred, 2]`, both in m and in the
/// frame of the modes.
///
/// # Errors
/// When the temperature is out of range or the shapes do not fit.
pub fn labels(truth: &Tensor, modes: &Tensor, config: &LabelConfig) -> Result<Labels, GoalError> {
    config.check()?;
    let distances = label_distances(truth, modes, config.distance)?;
    let nearest = distances.argmin_keepdim(1)?;
    Ok(Labels { soft: soft_labels(&distances, config.temperature)?, nearest })
}

/// Distances `[batch, modes]` of `truth` `[batch, t_pred, 2]` to `modes` `[modes, t_pred, 2]`, both
/// in m and in one frame. No gradient flows back: labels are given.
///
/// # Errors
/// When the shapes do not fit.
pub fn label_distances(truth: &Tensor, modes: &Tensor, distance: LabelDistance) -> Result<Tensor, GoalError> {
    let (batch, t_pred, two) = truth.dims3()?;
    let count = modes.dims()[0];
    if two != 2 || modes.dims() != [count, t_pred, 2] {
        return Err(GoalError::Shape {
            name: "truth",
            found: truth.dims().to_vec(),
            needed: format!("[batch, t_pred, 2] beside modes of shape {:?}", modes.dims()),
        });
    }
    if !truth.device().is_cpu() {
        return Ok(distances_on_device(&truth.detach(), &modes.detach(), distance)?);
    }
    let values = |x: &Tensor| x.flatten_all()?.to_vec1::<f32>();
    let (paths, centres) = (values(truth)?, values(modes)?);
    let between = |path: &[f32], centre: &[f32]| {
        let squares = path.as_chunks::<2>().0.iter().zip(centre.as_chunks::<2>().0).map(|(a, b)| {
            let (x, y) = (a[0] - b[0], a[1] - b[1]);
            x * x + y * y
        });
        match distance {
            LabelDistance::SquaredSum => squares.sum::<f32>(),
            LabelDistance::Euclidean => squares.sum::<f32>().sqrt(),
            LabelDistance::MeanDisplacement => squares.map(f32::sqrt).sum::<f32>() / t_pred as f32,
        }
    };
    let steps = (2 * t_pred).max(1);
    let distances: Vec<f32> = paths
        .chunks_exact(steps)
        .flat_map(|path| centres.chunks_exact(steps).map(move |centre| between(path, centre)))
        .collect();
    Ok(Tensor::from_vec(distances, (batch, count), truth.device())?)
}

/// As [`label_distances`] where `truth` lives, without waiting for it.
fn distances_on_device(truth: &Tensor, modes: &Tensor, distance: LabelDistance) -> candle_core::Result<Tensor> {
    let squares = truth.unsqueeze(1)?.broadcast_sub(&modes.unsqueeze(0)?)?.sqr()?;
    match distance {
        LabelDistance::SquaredSum => squares.flatten_from(2)?.sum(2),
        LabelDistance::Euclidean => squares.flatten_from(2)?.sum(2)?.sqrt(),
        LabelDistance::MeanDisplacement => squares.sum(3)?.sqrt()?.mean(2),
    }
}

/// `softmax(-distance / temperature)` over the modes, `[batch, modes]`.
///
/// # Errors
/// When candle cannot.
pub fn soft_labels(distance: &Tensor, temperature: f64) -> Result<Tensor, GoalError> {
    Ok(candle_nn::ops::softmax(&(distance * (-1. / temperature))?, D::Minus1)?)
}

/// The loss and its parts, each a scalar tensor.
#[derive(Clone, Debug)]
pub struct GoalLoss {
    /// `(1 - alpha) * regression + alpha * classification + mean_weight * mean`.
    pub total: Tensor,
    /// Smooth L1 (quadratic below 1 m) of the nearest mode's future, mean over steps and coordinates.
    pub regression: Tensor,
    /// Cross-entropy of the modes' probabilities against the soft labels, mean over the batch.
    pub classification: Tensor,
    /// Squared error of the mean of all modes, weighted by probability, mean over steps and coordinates; 0 where only
    /// the nearest mode was decoded.
    pub mean: Tensor,
}

/// What the parts of the loss weigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Of the probabilities against the future; 0.2 in the paper.
    pub alpha: f64,
    /// Of the mean of all modes; 0 in the paper. Above 0 all modes must be decoded ([`Pick::All`](crate::Pick::All)).
    pub mean: f64,
}

/// The loss of the paper: the future of the mode [nearest](Labels::nearest) to `truth` `[batch, t_pred, 2]`, in m and in
/// the frame of the modes, against it, and the probabilities against the soft labels. Not of the paper: the squared error
/// of the mean of all modes beside them, because a choice between modes is learned from few windows worse than a mean.
///
/// # Errors
/// When the shapes do not fit, or the mean is asked for and not all modes were decoded.
pub fn goal_loss(
    output: &GoalOutput,
    truth: &Tensor,
    labels: &Labels,
    weights: LossWeights,
) -> Result<GoalLoss, GoalError> {
    let (batch, t_pred, _) = truth.dims3()?;
    let (_, modes) = output.logits.dims2()?;
    let decoded = if weights.mean > 0. { modes } else { 1 };
    if output.futures.dims() != [batch, decoded, t_pred, 2] {
        let needed = format!(
            "[{batch}, {decoded}, {t_pred}, 2]: in training, pick the nearest mode alone, or all for their mean"
        );
        return Err(GoalError::Shape { name: "futures", found: output.futures.dims().to_vec(), needed });
    }
    let flat = output.futures.flatten_from(2)?;
    let near = if decoded > 1 { rows(&flat, &labels.nearest)? } else { flat.clone() };
    let off = (near.reshape((batch, t_pred, 2))? - truth)?.abs()?;
    // With c = min(off, 1): c (off - c / 2) is off²/2 below 1 and off - 1/2 above.
    let capped = off.minimum(1f64)?;
    let regression = (&capped * (&off - (&capped * 0.5)?)?)?.mean_all()?;
    let log_probability = candle_nn::ops::log_softmax(&output.logits, D::Minus1)?;
    let classification = (&labels.soft * &log_probability)?.sum(D::Minus1)?.mean_all()?.neg()?;
    let paper = ((&regression * (1. - weights.alpha))? + (&classification * weights.alpha)?)?;
    if weights.mean == 0. {
        let mean = Tensor::zeros((), truth.dtype(), truth.device())?;
        return Ok(GoalLoss { total: paper, regression, classification, mean });
    }
    let probability = log_probability.exp()?.unsqueeze(1)?;
    let mean = probability.matmul(&flat)?.reshape((batch, t_pred, 2))?;
    let mean = (mean - truth)?.sqr()?.mean_all()?;
    Ok(GoalLoss { total: (paper + (&mean * weights.mean)?)?, regression, classification, mean })
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    fn close(found: &Tensor, expected: &[f32]) {
        let found = found.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-5 * (1. + e.abs()), "{found:?} instead of {expected:?}");
        }
    }

    #[test]
    fn distances_are_known() {
        let truth = Tensor::new(&[[[0f32, 0.], [3., 4.]]], &Device::Cpu).unwrap();
        let modes = Tensor::new(&[[[0f32, 0.], [0., 0.]], [[0., 1.], [3., 4.]], [[0., 3.], [3., 0.]]], &Device::Cpu);
        for (distance, expected) in [
            (LabelDistance::SquaredSum, [25., 1., 25.]),
            (LabelDistance::Euclidean, [5., 1., 5.]),
            (LabelDistance::MeanDisplacement, [2.5, 0.5, 3.5]),
        ] {
            close(&label_distances(&truth, modes.as_ref().unwrap(), distance).unwrap(), &expected);
            close(&distances_on_device(&truth, modes.as_ref().unwrap(), distance).unwrap(), &expected);
        }
    }

    #[test]
    fn labels_sum_to_one_and_sharpen() {
        let truth = Tensor::new(&[[[1f32, 0.]], [[5., 0.]]], &Device::Cpu).unwrap();
        let modes = Tensor::new(&[[[0f32, 0.]], [[2., 0.]], [[6., 0.]]], &Device::Cpu).unwrap();
        let with = |temperature| {
            labels(&truth, &modes, &LabelConfig { distance: LabelDistance::MeanDisplacement, temperature }).unwrap()
        };
        // Distances 1, 1, 5 and 5, 3, 1.
        let e = |x: f32| x.exp();
        let sums = [2. * e(-1.) + e(-5.), e(-5.) + e(-3.) + e(-1.)];
        let soft = [e(-1.) / sums[0], e(-1.) / sums[0], e(-5.) / sums[0]];
        close(&with(1.).soft, &[&soft[..], &[e(-5.) / sums[1], e(-3.) / sums[1], e(-1.) / sums[1]]].concat());
        assert_eq!(with(1.).nearest.to_vec2::<u32>().unwrap(), [[0], [2]]);
        close(&with(0.01).soft, &[0.5, 0.5, 0., 0., 0., 1.]);
        let cold = LabelConfig { distance: LabelDistance::SquaredSum, temperature: 0. };
        assert!(labels(&truth, &modes, &cold).unwrap_err().to_string().contains("temperature"));
    }

    #[test]
    fn the_loss_is_that_of_the_formula() {
        let output = |futures: &Tensor, logits: &Tensor| GoalOutput {
            futures: futures.clone(),
            logits: logits.clone(),
            indices: Tensor::zeros((1, 1), candle_core::DType::U32, &Device::Cpu).unwrap(),
        };
        let futures = Var::new(&[[[[0.5f32, 0.], [3., -1.]]]], &Device::Cpu).unwrap();
        let logits = Var::new(&[[0f32, 0., 0., 0.]], &Device::Cpu).unwrap();
        let truth = Tensor::new(&[[[0f32, 0.], [1., 0.]]], &Device::Cpu).unwrap();
        let soft = Tensor::new(&[[0.7f32, 0.1, 0.1, 0.1]], &Device::Cpu).unwrap();
        let labels = Labels { soft, nearest: Tensor::new(&[[0u32]], &Device::Cpu).unwrap() };
        let weights = LossWeights { alpha: 0.2, mean: 0. };
        let loss = goal_loss(&output(&futures, &logits), &truth, &labels, weights).unwrap();
        let regression = (0.125 + 0. + 1.5 + 0.5) / 4.;
        close(&loss.regression, &[regression]);
        close(&loss.classification, &[4f32.ln()]);
        close(&loss.total, &[0.8 * regression + 0.2 * 4f32.ln()]);
        let grads = loss.total.backward().unwrap();
        close(grads.get(&futures).unwrap(), &[0.8 * 0.5 / 4., 0., 0.8 / 4., -0.8 / 4.]);
        close(grads.get(&logits).unwrap(), &[0.25 - 0.7, 0.15, 0.15, 0.15].map(|g| 0.2 * g));
        let two = futures.broadcast_as((1, 2, 2, 2)).unwrap();
        assert!(
            goal_loss(&output(&two, &logits), &truth, &labels, weights).unwrap_err().to_string().contains("nearest")
        );
    }
    #[test]
    fn the_mean_of_the_modes_is_learned_by_future_and_by_probability() {
        // Two modes with a step each, at 1 and at 4 m, as likely as each other; the truth is at 2 m.
        let futures = Var::new(&[[[[1f32, 0.]], [[4., 0.]]]], &Device::Cpu).unwrap();
        let logits = Var::new(&[[0f32, 0.]], &Device::Cpu).unwrap();
        let truth = Tensor::new(&[[[2f32, 0.]]], &Device::Cpu).unwrap();
        let labels = Labels {
            soft: Tensor::new(&[[0.5f32, 0.5]], &Device::Cpu).unwrap(),
            nearest: Tensor::new(&[[0u32]], &Device::Cpu).unwrap(),
        };
        let indices = Tensor::new(&[[0u32, 1]], &Device::Cpu).unwrap();
        let output = GoalOutput { futures: futures.as_tensor().clone(), logits: logits.as_tensor().clone(), indices };
        let loss = goal_loss(&output, &truth, &labels, LossWeights { alpha: 0., mean: 2. }).unwrap();
        close(&loss.mean, &[0.25 / 2.]);
        close(&loss.regression, &[0.5 / 2.]);
        let grads = loss.mean.backward().unwrap();
        close(grads.get(&futures).unwrap(), &[0.25, 0., 0.25, 0.]);
        // d mean / d logit = (m - truth) (f - m) p, with m = 2.5.
        close(grads.get(&logits).unwrap(), &[-0.375, 0.375]);
        let one = GoalOutput { futures: output.futures.narrow(1, 0, 1).unwrap(), ..output };
        let message = goal_loss(&one, &truth, &labels, LossWeights { alpha: 0., mean: 2. }).unwrap_err().to_string();
        assert!(message.contains("all for their mean"), "{message}");
    }
}
