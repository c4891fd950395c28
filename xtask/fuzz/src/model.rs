//! A tiny model with weights as drawn, for what is read of models and written by them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use candle_core::{Device, Tensor};
use gnp::RunConfig;
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Observation, Recording, WindowSet};
use gnp_goal::GoalNet;
use gnp_model::{Checkpoint, Component, Features, Gnp, Header, NeighbourFuture};
use gnp_nn::Weights;
use gnp_traj::SocialForce;

use crate::made::{road, windows};
use crate::{Finding, Scratch};

/// Files of a model, in the order in which they are read.
pub(crate) const FILES: [&str; 3] = ["modes.safetensors", "goal.safetensors", "repulsion.safetensors"];

/// What makes `smoke.toml` tiny.
const SMALLER: [&str; 12] = [
    "modes.modes=3",
    "features.velocity_window_s=0.1",
    "goal.width=4",
    "goal.heads=1",
    "goal.layers=1",
    "goal.feed_forward=1",
    "traj.hidden=2",
    "traj.embedding=2",
    "traj.latent_dim=2",
    "traj.encoder=[2]",
    "traj.decoder=[2]",
    "features.vehicles_ahead=1",
];

/// The model's files among what is made in the scratch folder, written at the first call.
pub(crate) fn saved(scratch: &Scratch) -> Result<[PathBuf; 3], Finding> {
    let files = FILES.map(|name| scratch.made(name));
    if !files.iter().all(|file| file.exists()) {
        save(&files)?;
    }
    Ok(files)
}

fn save(files: &[PathBuf; 3]) -> Result<(), Finding> {
    let settings: Vec<_> =
        SMALLER.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(Finding::case)?;
    let config = RunConfig::embedded("smoke", &settings).map_err(Finding::case)?;
    let recordings = [road("case")?];
    let (set, _) = WindowSet::cut(&recordings, &windows()).map_err(Finding::case)?;
    let seen: Vec<Observation<'_>> = set.iter().map(|window| window.observation()).collect();
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL).map_err(Finding::case)?;
    let shape = set.shape();
    let features =
        Features::fit(&config.features, shape, Some(&platoon), seen.iter().copied()).map_err(Finding::case)?;
    let futures: Vec<f32> = (0..8 * 2 * shape.t_pred).map(|i| ((i * 37 % 23) as f32 - 11.) * 0.1).collect();
    let modes = gnp_modes::fit(&futures, shape.t_pred, features.mode_frame(), &config.modes).map_err(Finding::case)?;
    modes.save(&files[0]).map_err(Finding::case)?;

    let (goal, force) = (Weights::seeded(1, &Device::Cpu), Weights::seeded(2, &Device::Cpu));
    GoalNet::new(&config.goal.net, features.goal_shape(), goal.builder()).map_err(Finding::case)?;
    SocialForce::new(&config.traj, force.builder()).map_err(Finding::case)?;
    let header = Header {
        part: Component::Goal,
        dataset: config.dataset,
        simulated: false,
        shape,
        features,
        goal: Some(config.goal.net.clone()),
        traj: None,
        seed: 1,
        code_version: "fuzz".to_owned(),
        split_hash: "0".to_owned(),
        origin: None,
        trust: None,
        epoch: 1,
        scores: BTreeMap::from([("loss".to_owned(), 0.5)]),
        trainer: None,
    };
    let repulsion =
        Header { part: Component::Repulsion, goal: None, traj: Some(config.traj.clone()), ..header.clone() };
    for (header, weights, file) in [(header, &goal, &files[1]), (repulsion, &force, &files[2])] {
        let tensors: BTreeMap<String, Tensor> =
            weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().clone())).collect();
        Checkpoint { header, tensors }.save(file).map_err(Finding::case)?;
    }
    let folder = files[0].parent().unwrap_or(Path::new("."));
    load(folder).map(drop).map_err(Finding::case)
}

/// The model in a folder.
pub(crate) fn load(folder: &Path) -> Result<Gnp, gnp_model::ModelError> {
    Gnp::load(folder, NeighbourFuture::Platoon, &Device::Cpu)
}

/// Observations of a recording as [`windows`] cuts it.
pub(crate) fn seen(recordings: &[Recording]) -> Result<Vec<Observation<'_>>, Finding> {
    let (set, _) = WindowSet::cut(recordings, &windows()).map_err(Finding::case)?;
    Ok(set.iter().map(|window| window.observation()).collect())
}
