//! A whole frame: 25 vehicles, from observed tracks to the paths of 6 goals each.

use gnp::Progress as _;
use gnp_cli::Terminal;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use candle_core::{Device, Tensor};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Observation, Predictor as _, Recording, WindowSet, discover, read};
use gnp_goal::GoalNet;
use gnp_model::{Checkpoint, Component, Features, Gnp, Header};
use gnp_modes::Modes;
use gnp_nn::Weights;
use gnp_traj::SocialForce;

use super::clock::{self, Sample};
use super::{load, pool, processor, table};
use crate::project;
use gnp::RunConfig;

const VEHICLES: usize = 25;
const GOALS: usize = 6;
/// Frames are predicted until there are so many, or so much time has passed.
const FRAMES: usize = 500;
const LONGEST: Duration = Duration::from_secs(30);

/// Prints p50 and p99 on `threads` threads, with the sizes of `configs/highd.toml` and the published ones.
///
/// # Errors
/// Those of reading, cutting and predicting.
pub(super) fn run(threads: usize, terminal: &Terminal) -> Result<()> {
    let load = load();
    let mut rows = Vec::new();
    for name in ["configs/highd.toml", "configs/paper/highd.toml"] {
        terminal.note(&format!("bench: frame, {name}"));
        let config = RunConfig::read(&project::root().join(name), &[])?;
        let sample = pool(threads)?.install(|| frames(&config))?;
        let ms = |share| format!("{:.2}", sample.quantile(share) * 1e3);
        rows.push(vec![name.to_owned(), ms(0.5), ms(0.99), ms(1.), sample.len().to_string()]);
    }
    let header = ["sizes of", "p50, ms", "p99, ms", "longest, ms", "frames"].map(str::to_owned).to_vec();
    terminal.result(&format!(
        "A frame of {VEHICLES} vehicles, {GOALS} goals each, {threads} thread(s), untrained weights; load average {load}\n{}.\n{}",
        processor(),
        table(header, rows)
    ));
    Ok(())
}

/// Seconds of each frame.
fn frames(config: &RunConfig) -> Result<Sample> {
    let recordings = recordings(config)?;
    let (set, _) = WindowSet::cut(&recordings, &config.windows)?;
    // Vehicles that are there at about the same time, as those of a frame are.
    let mut windows: Vec<_> = set.iter().map(|window| window.observation()).collect();
    windows.sort_by_key(Observation::frame);
    if windows.len() < VEHICLES {
        bail!("the embedded recordings have {} windows, a frame needs {VEHICLES}", windows.len());
    }
    let model = model(config, &windows)?;
    let (started, mut seconds) = (Instant::now(), Vec::new());
    // The first frame does not count: it fills caches.
    model.predict(&windows[..VEHICLES], GOALS)?;
    for frame in windows.chunks_exact(VEHICLES).cycle().take(FRAMES) {
        seconds.push(clock::once(&|| {
            model.predict(frame, GOALS)?;
            Ok(())
        })?);
        if started.elapsed() > LONGEST {
            break;
        }
    }
    Ok(Sample::new(seconds))
}

/// The first of the embedded recordings.
fn recordings(config: &RunConfig) -> Result<Vec<Recording>> {
    let sources = discover(&project::root().join("fixtures/highd"), Dataset::HIGHD)?;
    let expect = Expectation { dataset: Dataset::HIGHD, rate_hz: Some(config.data.rate_hz) };
    let Some(source) = sources.first() else {
        bail!("the embedded recordings are missing; check out the whole project")
    };
    Ok(read(source, &expect)?.into_iter().map(|(recording, _)| recording).collect())
}

/// A model of the configuration's sizes with random weights.
fn model(config: &RunConfig, windows: &[Observation<'_>]) -> Result<Gnp> {
    let shape = config.windows.shape_for(config.data.rate_hz)?;
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
    let features = Features::fit(&config.features, shape, Some(&platoon), windows.iter().copied())?;
    let weights = [Weights::seeded(1, &Device::Cpu), Weights::seeded(2, &Device::Cpu)];
    GoalNet::new(&config.goal.net, features.goal_shape(), weights[0].builder())?;
    SocialForce::new(&config.traj, weights[1].builder())?;
    let modes = modes(config.modes.modes, shape.t_pred, &features);
    let header = Header {
        part: Component::Goal,
        dataset: config.dataset,
        simulated: true,
        shape,
        features,
        goal: Some(config.goal.net.clone()),
        traj: None,
        seed: 1,
        code_version: env!("CARGO_PKG_VERSION").to_owned(),
        split_hash: String::new(),
        epoch: 0,
        scores: BTreeMap::new(),
        origin: None,
        trust: None,
        trainer: None,
    };
    let force = Header { part: Component::Repulsion, goal: None, traj: Some(config.traj.clone()), ..header.clone() };
    let [goal, force] = [(header, &weights[0]), (force, &weights[1])].map(|(header, weights)| {
        let tensors = weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().detach()));
        Checkpoint { header, tensors: tensors.collect::<BTreeMap<String, Tensor>>() }
    });
    Ok(Gnp::new(modes, &goal, Some(&force), config.predict.neighbours.without_future(), &Device::Cpu)?)
}

/// Modes that end at different places, 30 m/s apart at most.
fn modes(count: usize, t_pred: usize, features: &Features) -> Modes {
    let step = |mode: usize, step: usize| {
        let share = (step + 1) as f32 / t_pred as f32;
        [mode as f32 * share, (mode % 5) as f32 * share]
    };
    Modes {
        centres: (0..count).flat_map(|mode| (0..t_pred).flat_map(move |i| step(mode, i))).collect(),
        t_pred,
        sizes: vec![1; count],
        inertia: 0.,
        converged: true,
        abandoned: 0,
        seed: 0,
        frame: features.mode_frame(),
    }
}
