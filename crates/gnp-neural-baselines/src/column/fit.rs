//! One small network, and the stage that trains it.

use std::collections::{BTreeMap, HashMap};
use std::error::Error;
use std::sync::atomic::AtomicBool;

use candle_core::{Device, Module as _, Result, Tensor, Var};
use candle_nn::{Linear, VarBuilder};
use gnp_data::WindowKey;
use gnp_nn::{Dropout, Weights, linear};
use gnp_train::{
    BatchTotals, CheckpointSlot, End, Observer, Part, Sink, Stage, TrainError, Trainer, TrainingState, derive_seed,
};

use super::inputs::UNIT_M;
use super::recipe::ColumnRecipe;
use crate::error::NeuralBaselineError;

/// Two hidden layers with GELU.
#[derive(Clone, Debug)]
pub(super) struct Network {
    hidden: [Linear; 2],
    last: Linear,
}

impl Network {
    /// From so many inputs over so many hidden units to so many outputs.
    pub(super) fn new([inputs, hidden, outputs]: [usize; 3], vb: &VarBuilder<'_>) -> Result<Self> {
        let first = linear(inputs, hidden, vb.pp("hidden.0"))?;
        let second = linear(hidden, hidden, vb.pp("hidden.1"))?;
        Ok(Self { hidden: [first, second], last: linear(hidden, outputs, vb.pp("last"))? })
    }

    /// `[windows, outputs]` from `[windows, inputs]`.
    pub(super) fn forward(&self, x: &Tensor, mut dropout: Option<Dropout>) -> Result<Tensor> {
        let mut x = x.clone();
        for layer in &self.hidden {
            x = layer.forward(&x)?.gelu_erf()?;
            if let Some(dropout) = &mut dropout {
                x = dropout.apply(&x)?;
            }
        }
        self.last.forward(&x)
    }
}

/// Windows of a part, as numbers.
#[derive(Clone, Debug)]
pub(super) struct Cases {
    /// Standardised, `[windows, inputs]`.
    pub(super) inputs: Tensor,
    /// What the network is to give, `[windows, outputs]`.
    pub(super) targets: Tensor,
    /// `[windows, 1]`, with a mean of 1.
    pub(super) weights: Tensor,
}

impl Cases {
    fn at(&self, batch: &[usize]) -> Result<[Tensor; 3]> {
        let index: Vec<u32> = batch.iter().map(|index| *index as u32).collect();
        let index = Tensor::new(index, self.inputs.device())?;
        let select = |of: &Tensor| of.index_select(&index, 0);
        Ok([select(&self.inputs)?, select(&self.targets)?, select(&self.weights)?])
    }
}

/// Weight of each window, with a mean of 1: many windows of one driver, and many of one site, count as the square root of
/// their number.
pub(super) fn weights(windows: &[(WindowKey, String)]) -> Vec<f32> {
    let driver = |key: &WindowKey| (key.recording.clone(), key.vehicle);
    let mut drivers: HashMap<_, f64> = HashMap::new();
    for (key, _) in windows {
        *drivers.entry(driver(key)).or_default() += 1.;
    }
    let mut weights: Vec<f64> = windows.iter().map(|(key, _)| drivers[&driver(key)].powf(-0.5)).collect();
    let mut sites: HashMap<&str, f64> = HashMap::new();
    for ((_, site), weight) in windows.iter().zip(&weights) {
        *sites.entry(site).or_default() += weight;
    }
    for ((_, site), weight) in windows.iter().zip(&mut weights) {
        *weight *= sites[site.as_str()].powf(-0.5);
    }
    let mean = weights.iter().sum::<f64>() / windows.len().max(1) as f64;
    weights.into_iter().map(|weight| (weight / mean) as f32).collect()
}

/// A network being trained.
struct Fitting<'a> {
    network: Network,
    weights: &'a Weights,
    dropout: f32,
    train: &'a Cases,
    validation: &'a Cases,
}

impl Stage for Fitting<'_> {
    fn name(&self) -> &'static str {
        super::STEM
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        self.weights.named()
    }

    fn train_len(&self) -> usize {
        self.train.inputs.dims().first().copied().unwrap_or_default()
    }

    fn validation_len(&self) -> usize {
        self.validation.inputs.dims().first().copied().unwrap_or_default()
    }

    fn loss(&self, part: Part<'_>) -> std::result::Result<Tensor, TrainError> {
        let [inputs, targets, weights] = self.train.at(part.windows)?;
        let found = self.network.forward(&inputs, Some(Dropout::new(self.dropout, part.seed)))?;
        Ok((found - targets)?.sqr()?.broadcast_mul(&weights)?.mean_all()?)
    }

    fn validate(&self, batch: &[usize]) -> std::result::Result<BatchTotals, TrainError> {
        let [inputs, targets, _] = self.validation.at(batch)?;
        let squares = (self.network.forward(&inputs, None)? - targets)?.sqr()?.mean(1)?.to_vec1::<f32>()?;
        let sum: f64 = squares.into_iter().map(f64::from).sum();
        Ok(BatchTotals::new(batch.len(), [("mse", sum * UNIT_M * UNIT_M)]))
    }
}

/// The networks are small: whoever is stopped begins anew.
struct Nowhere;

impl Sink for Nowhere {
    fn save(&mut self, _: CheckpointSlot, _: &TrainingState) -> std::result::Result<(), Box<dyn Error + Send + Sync>> {
        Ok(())
    }
}

/// Trains one network; its weights by name, as they are after the last epoch.
///
/// # Errors
/// When the training fails or `stop` was raised.
pub(super) fn train(
    recipe: &ColumnRecipe,
    seed: u64,
    [train, validation]: [&Cases; 2],
    device: &Device,
    observer: impl Observer,
    stop: &AtomicBool,
) -> std::result::Result<BTreeMap<String, Tensor>, NeuralBaselineError> {
    let weights = Weights::seeded(derive_seed(seed, 0), device);
    let sizes = [train.inputs.dim(1)?, recipe.hidden, train.targets.dim(1)?];
    let network = Network::new(sizes, &weights.builder())?;
    // A network begins as the reference itself, and leaves it where the windows say so.
    let zeros = [Tensor::zeros((sizes[2], sizes[1]), candle_core::DType::F32, device)?, {
        Tensor::zeros(sizes[2], candle_core::DType::F32, device)?
    }];
    weights.set(["last.weight", "last.bias"].into_iter().zip(&zeros))?;
    let stage = Fitting { network, weights: &weights, dropout: recipe.dropout as f32, train, validation };
    let config = recipe.training(derive_seed(seed, 1));
    let mut trainer = Trainer { config: &config, sink: Nowhere, observer, stop };
    let outcome = trainer.fit(&stage).map_err(|error| NeuralBaselineError::Train(Box::new(error)))?;
    if outcome.end == End::Interrupted {
        return Err(NeuralBaselineError::Interrupted { kind: super::NAME, epoch: 0 });
    }
    Ok(weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().clone())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_windows_count_as_the_root_of_their_number() {
        let window = |site: &str, vehicle| {
            (WindowKey { recording: format!("{site} 1"), vehicle, segment: 0, t0: 0 }, site.to_owned())
        };
        // One site has a driver of four windows and one of one, the other nine drivers of one.
        let mut windows = vec![window("a", 1); 4];
        windows.push(window("a", 2));
        windows.extend((0..9).map(|vehicle| window("b", vehicle)));
        let found = weights(&windows);
        assert!((found.iter().sum::<f32>() - 14.).abs() < 1e-5);
        assert!((found[4] / found[0] - 2.).abs() < 1e-6);
        let [a, b] = [&found[..5], &found[5..]].map(|site| site.iter().sum::<f32>());
        assert!((b / a - (9f32 / 3.).sqrt()).abs() < 1e-5, "{a} {b}");
    }
}
