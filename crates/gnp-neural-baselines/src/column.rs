//! A small network that sees the column of leaders over time: the learned rule to beat.

mod fit;
mod inputs;
mod recipe;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use candle_core::{DType, Device, Tensor};
use candle_nn::VarBuilder;
use gnp_baselines::PlatoonRule;
use gnp_data::{Dataset, Forecast, Mode, Observation, PredictError, Predictor, Window, WindowId, WindowShape};
use gnp_file::FileHeader;
use gnp_train::{Observer, derive_seed};
use serde::{Deserialize, Serialize};

use self::fit::{Cases, Network};
use self::inputs::{Horizons, Seen, UNIT_M, width};
pub use self::recipe::ColumnRecipe;
use crate::error::NeuralBaselineError;
use crate::train::Training;

const NAME: &str = ColumnNetwork::NAME;
const STEM: &str = ColumnNetwork::STEM;
/// What displacements are learned as differences from.
const REFERENCES: [&str; 2] = ["constant-velocity", "platoon"];

type Checkpoint = gnp_nn::Checkpoint<ColumnHeader>;

/// What the weights of a [`ColumnNetwork`] are, and what they were trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnHeader {
    /// Data family trained on.
    pub dataset: Dataset,
    /// Whether any training recording was simulated.
    pub simulated: bool,
    /// Window shape, with the rate in Hz.
    pub shape: WindowShape,
    /// How it was trained, its seed included.
    pub recipe: ColumnRecipe,
    /// The rule of which it learns the difference, and which is averaged with it.
    pub platoon: PlatoonRule,
    /// Mean of each input over the training windows.
    pub mean: Vec<f32>,
    /// Standard deviation of each input.
    pub deviation: Vec<f32>,
    /// Hash of the split trained on.
    pub split_hash: String,
    /// Version of the code that trained.
    pub code_version: String,
}

impl FileHeader for ColumnHeader {
    const KEY: &'static str = "gnp-column-network";
    const FORMAT: u32 = 1;
    const WHAT: &'static str = "a column network";
    const REMEDY: &'static str = "train again";
}

/// Where a vehicle will be along the road, from its own speeds and those of three leaders over the past seconds.
///
/// Networks of two layers learn how far it gets in each whole second, some as a difference from constant velocity and as
/// many as a difference from the platoon. The prediction is the mean of both kinds and the platoon itself, one future;
/// between the seconds a smooth curve is added to the platoon's path, across the road it is that path.
#[derive(Debug)]
pub struct ColumnNetwork {
    header: ColumnHeader,
    horizons: Horizons,
    networks: Vec<Network>,
    device: Device,
}

impl ColumnNetwork {
    /// Its name in tables.
    pub const NAME: &str = "column network";
    /// Stem of its file, and its table in a file of recipes.
    pub const STEM: &str = "column_network";

    /// Its file in a run folder, once it is trained.
    #[must_use]
    pub fn path(folder: &Path) -> PathBuf {
        folder.join(format!("{STEM}.safetensors"))
    }

    /// Trains in `folder`, which exists, beside the reference rule of `data`, a platoon; or only reads what
    /// was trained there before. The validation part chooses nothing: weights are those of the last epoch. `observer` sees
    /// the trainings of all networks, one after another.
    ///
    /// # Errors
    /// When the recipe cannot be used, there is no reference rule, the folder holds another training, training diverges, or `stop` was raised
    /// ([`NeuralBaselineError::Interrupted`]; the next call starts over).
    pub fn train(
        recipe: &ColumnRecipe,
        data: &Training<'_>,
        folder: &Path,
        device: &Device,
        mut observer: impl Observer,
        stop: &AtomicBool,
    ) -> Result<Self, NeuralBaselineError> {
        recipe.check()?;
        let platoon = data.reference.ok_or(NeuralBaselineError::NeedsReference { name: NAME })?;
        let path = Self::path(folder);
        let recordings = data.set.recordings();
        let none = || NeuralBaselineError::Windows { problem: "there are none".to_owned() };
        let mut header = ColumnHeader {
            dataset: recordings.first().ok_or_else(none)?.meta().dataset,
            simulated: recordings.iter().any(|recording| recording.meta().simulated),
            shape: data.set.shape(),
            recipe: recipe.clone(),
            platoon: platoon.clone(),
            mean: Vec::new(),
            deviation: Vec::new(),
            split_hash: data.split_hash.to_owned(),
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        if path.exists() {
            let kept = Self::load(&path, device)?;
            kept.expect(&path, &header)?;
            return Ok(kept);
        }
        let horizons = Horizons::of(header.shape);
        let parts = [part(data, data.train, platoon, &horizons)?, part(data, data.validation, platoon, &horizons)?];
        [header.mean, header.deviation] = statistics(&parts[0].rows, width(&horizons));
        let mut tensors = BTreeMap::new();
        for (which, reference) in REFERENCES.into_iter().enumerate() {
            let [train, validation] = [&parts[0], &parts[1]].map(|part| part.cases(which, &header, device));
            let (train, validation) = (train?, validation?);
            for number in 0..recipe.networks {
                let seed = derive_seed(recipe.seed, (which * recipe.networks + number) as u64);
                let trained = fit::train(recipe, seed, [&train, &validation], device, &mut observer, stop)?;
                tensors.extend(trained.into_iter().map(|(name, it)| (format!("{reference}.{number}.{name}"), it)));
            }
        }
        Checkpoint { header, tensors }.save(&path)?;
        Self::load(&path, device)
    }

    /// Reads a file that [`ColumnNetwork::train`] wrote.
    ///
    /// # Errors
    /// [`NeuralBaselineError::Checkpoint`] for a file that is missing, damaged, of another program or lacks a weight.
    pub fn load(path: &Path, device: &Device) -> Result<Self, NeuralBaselineError> {
        let Checkpoint { header, tensors } = Checkpoint::load(path)?;
        let refused =
            |e| NeuralBaselineError::checkpoint(path, format!("has a recipe that cannot be ({e}): train again"));
        header.recipe.check().map_err(refused)?;
        let horizons = Horizons::of(header.shape);
        let inputs = width(&horizons);
        if header.mean.len() != inputs || header.deviation.len() != inputs {
            return Err(NeuralBaselineError::checkpoint(path, "has statistics of other inputs: train again"));
        }
        let on_device = |(name, tensor): (String, Tensor)| Ok((name, tensor.to_device(device)?));
        let tensors = tensors.into_iter().map(on_device).collect::<candle_core::Result<_>>()?;
        let vb = VarBuilder::from_tensors(tensors, DType::F32, device);
        let sizes = [inputs, header.recipe.hidden, horizons.0.len()];
        let names = REFERENCES
            .into_iter()
            .flat_map(|reference| (0..header.recipe.networks).map(move |number| format!("{reference}.{number}")));
        let networks = names.map(|name| Network::new(sizes, &vb.pp(name))).collect::<candle_core::Result<_>>();
        let networks = networks.map_err(|e| {
            NeuralBaselineError::checkpoint(path, format!("does not hold these networks ({e}): train again"))
        })?;
        Ok(Self { header, horizons, networks, device: device.clone() })
    }

    /// What it was trained on, and how.
    #[must_use]
    pub fn header(&self) -> &ColumnHeader {
        &self.header
    }

    fn expect(&self, path: &Path, asked: &ColumnHeader) -> Result<(), NeuralBaselineError> {
        let kept = &self.header;
        let pairs = [
            ("split", kept.split_hash == asked.split_hash),
            ("window shape", kept.shape.fits(&asked.shape)),
            ("recipe", kept.recipe == asked.recipe),
        ];
        match pairs.iter().find(|(_, same)| !same) {
            Some((what, _)) => {
                let problem = format!("was trained with another {what}; take another folder or remove this file");
                Err(NeuralBaselineError::checkpoint(path, problem))
            }
            None => Ok(()),
        }
    }

    fn fail(source: impl std::error::Error + Send + Sync + 'static) -> PredictError {
        PredictError::Model { model: NAME.to_owned(), source: Box::new(source) }
    }

    /// How far the vehicles get ahead of the platoon at each horizon, m, by window.
    fn ahead(&self, seen: &[Seen]) -> candle_core::Result<Vec<Vec<f64>>> {
        let x = standardised(seen, &self.header, &self.device)?;
        let mut sum = Tensor::zeros((seen.len(), self.horizons.0.len()), DType::F32, &self.device)?;
        for network in &self.networks {
            sum = (sum + network.forward(&x, None)?)?;
        }
        let each = 1. / self.header.recipe.networks as f64;
        // Both kinds of networks and the platoon count alike; only those from constant velocity start elsewhere.
        let third = |row: Vec<f32>, ahead: &[f64]| {
            let learned = row.into_iter().map(|value| f64::from(value) * each * UNIT_M);
            learned.zip(ahead).map(|(learned, velocity)| (learned + velocity) / 3.).collect()
        };
        Ok(sum.to_vec2::<f32>()?.into_iter().zip(seen).map(|(row, seen)| third(row, &seen.ahead)).collect())
    }
}

impl Predictor for ColumnNetwork {
    fn name(&self) -> &str {
        NAME
    }

    fn predict(&self, observations: &[Observation<'_>], k: usize) -> Result<Vec<Forecast>, PredictError> {
        PredictError::check_shapes(NAME, self.header.shape, observations)?;
        if observations.is_empty() {
            return Ok(Vec::new());
        }
        let mut paths: Vec<Vec<[f32; 2]>> = paths(&self.header.platoon, observations, k)?;
        let see = |(seen, path): (&Observation<'_>, &Vec<[f32; 2]>)| Seen::of(seen, path, &self.horizons);
        let seen: Vec<Seen> = observations.iter().zip(&paths).map(see).collect();
        let ahead = self.ahead(&seen).map_err(Self::fail)?;
        for (path, ahead) in paths.iter_mut().zip(ahead) {
            for (point, more) in path.iter_mut().zip(self.horizons.curve(&ahead)) {
                point[0] += more as f32;
            }
        }
        let forecast = |path| Forecast { modes: vec![Mode { probability: 1., path, explanation: None }] };
        Ok(paths.into_iter().map(forecast).collect())
    }
}

/// Where the platoon takes the targets, m.
fn paths(
    platoon: &PlatoonRule,
    observations: &[Observation<'_>],
    k: usize,
) -> Result<Vec<Vec<[f32; 2]>>, PredictError> {
    let forecasts = platoon.predict(observations, k)?;
    Ok(forecasts.into_iter().flat_map(|forecast| forecast.modes).map(|mode| mode.path).collect())
}

/// Windows of one part.
struct Part {
    rows: Vec<Seen>,
    /// How far the vehicles really got ahead of the platoon at each horizon, m.
    beyond: Vec<Vec<f64>>,
    weights: Vec<f32>,
}

fn part(
    data: &Training<'_>,
    ids: &[WindowId],
    platoon: &PlatoonRule,
    horizons: &Horizons,
) -> Result<Part, NeuralBaselineError> {
    let windows: Vec<Window<'_>> = ids.iter().filter_map(|id| data.set.get(*id)).collect();
    let observations: Vec<Observation<'_>> = windows.iter().map(Window::observation).collect();
    let paths = paths(platoon, &observations, 1)
        .map_err(|error| NeuralBaselineError::Windows { problem: format!("the platoon fails on them: {error}") })?;
    let rows = observations.iter().zip(&paths).map(|(seen, path)| Seen::of(seen, path, horizons)).collect();
    let beyond = |(window, path): (&Window<'_>, &Vec<[f32; 2]>)| {
        let truth = window.truth();
        horizons.0.iter().map(|step| f64::from(truth.target(step - 1).x - path[step - 1][0])).collect()
    };
    let keys: Vec<_> = windows.iter().map(|window| (window.key(), window.observation().site().to_owned())).collect();
    Ok(Part { rows, beyond: windows.iter().zip(&paths).map(beyond).collect(), weights: fit::weights(&keys) })
}

impl Part {
    /// To learn the difference from the reference of this number.
    fn cases(&self, reference: usize, header: &ColumnHeader, device: &Device) -> candle_core::Result<Cases> {
        let windows = self.rows.len();
        let target = |(beyond, seen): (&Vec<f64>, &Seen)| -> Vec<f32> {
            // From constant velocity, what that gets ahead of the platoon is no longer to be learned.
            let from = |i: usize| if reference == 0 { seen.ahead[i] } else { 0. };
            beyond.iter().enumerate().map(|(i, beyond)| ((beyond - from(i)) / UNIT_M) as f32).collect()
        };
        let targets: Vec<f32> = self.beyond.iter().zip(&self.rows).flat_map(target).collect();
        let horizons = targets.len() / windows.max(1);
        Ok(Cases {
            inputs: standardised(&self.rows, header, device)?,
            targets: Tensor::from_vec(targets, (windows, horizons), device)?,
            weights: Tensor::from_slice(&self.weights, (windows, 1), device)?,
        })
    }
}

/// Least standard deviation of an input: one that never changes says nothing.
const LEAST_DEVIATION: f64 = 1e-3;

/// Mean and standard deviation of each of `width` inputs.
fn statistics(rows: &[Seen], width: usize) -> [Vec<f32>; 2] {
    let count = rows.len().max(1) as f64;
    let mean_of = |of: &dyn Fn(&Seen) -> f64| rows.iter().map(of).sum::<f64>() / count;
    let mean: Vec<f64> = (0..width).map(|i| mean_of(&|seen| f64::from(seen.row[i]))).collect();
    let deviation = (0..width).map(|i| mean_of(&|seen| (f64::from(seen.row[i]) - mean[i]).powi(2)).sqrt());
    let deviation = deviation.map(|it| (it + LEAST_DEVIATION) as f32).collect();
    [mean.iter().map(|mean| *mean as f32).collect(), deviation]
}

/// `[windows, inputs]`.
fn standardised(seen: &[Seen], header: &ColumnHeader, device: &Device) -> candle_core::Result<Tensor> {
    let scale = |(value, (mean, deviation)): (&f32, (&f32, &f32))| (value - mean) / deviation;
    let row = |seen: &Seen| -> Vec<f32> {
        seen.row.iter().zip(header.mean.iter().zip(&header.deviation)).map(scale).collect()
    };
    let values: Vec<f32> = seen.iter().flat_map(row).collect();
    Tensor::from_vec(values, (seen.len(), header.mean.len()), device)
}
