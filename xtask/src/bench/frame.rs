//! A whole frame: 25 vehicles, from observed tracks to the paths of 6 goals each.

use gnp::Progress as _;
use gnp_cli::Terminal;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use candle_core::{DType, Device, Tensor};
use candle_nn::VarBuilder;
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Mode, Observation, Predictor as _, Recording, WindowSet, discover, read};
use gnp_goal::GoalNet;
use gnp_model::{AugmentedView, Checkpoint, Component, Features, Gnp, GoalInputs, Header, NeighbourFuture};
use gnp_modes::Modes;
use gnp_nn::{Precision, Weights};
use gnp_traj::{Phase, SocialForce};

use super::clock::{self, Sample};
use super::{load, pool, processor, table};
use crate::project;
use gnp::RunConfig;

const VEHICLES: usize = 25;
const GOALS: usize = 6;
/// What stands for a fitted trust where nothing was fitted.
const TRUST: f64 = 0.5;
/// Frames are predicted until there are so many, or so much time has passed.
const FRAMES: usize = 500;
const LONGEST: Duration = Duration::from_secs(30);

/// What a frame consists of, in its order; before `goals` the goal network, before `paths` the roll-out.
const STAGES: [&str; 7] = ["platoon", "inputs", "goal network", "goals", "scene", "roll-out", "paths"];

/// Prints p50 and p99 on `threads` threads, and the time of each stage, with the sizes of `configs/highd.toml` and the
/// published ones, in that precision.
///
/// # Errors
/// Those of reading, cutting and predicting.
pub(super) fn run(threads: usize, precision: Precision, terminal: &Terminal) -> Result<()> {
    let load = load();
    let (mut rows, mut stages) = (Vec::new(), Vec::new());
    for name in ["configs/highd.toml", "configs/paper/highd.toml"] {
        terminal.note(&format!("bench: frame, {name}"));
        let config = RunConfig::read(&project::root().join(name), &[])?;
        let (sample, medians) = pool(threads)?.install(|| frames(&config, precision))?;
        let ms = |seconds: f64| format!("{:.2}", seconds * 1e3);
        let of = |share| ms(sample.quantile(share));
        rows.push(vec![name.to_owned(), of(0.5), of(0.99), of(1.), sample.len().to_string()]);
        stages.push([vec![name.to_owned()], medians.map(ms).to_vec()].concat());
    }
    let header = ["sizes of", "p50, ms", "p99, ms", "longest, ms", "frames"].map(str::to_owned).to_vec();
    let parts = [&["medians, ms"], &STAGES[..]].concat().into_iter().map(str::to_owned).collect();
    terminal.result(&format!(
        "A frame of {VEHICLES} vehicles, {GOALS} goals each, {threads} thread(s), {precision}, untrained weights; load average {load}
{}.
{}
{}",
        processor(),
        table(header, rows),
        table(parts, stages)
    ));
    Ok(())
}

/// Seconds of each frame, and the median of each of the [`STAGES`].
fn frames(config: &RunConfig, precision: Precision) -> Result<(Sample, [f64; STAGES.len()])> {
    let recordings = recordings(config)?;
    let (set, _) = WindowSet::cut(&recordings, &config.windows)?;
    // Vehicles that are there at about the same time, as those of a frame are.
    let mut windows: Vec<_> = set.iter().map(|window| window.observation()).collect();
    windows.sort_by_key(Observation::frame);
    if windows.len() < VEHICLES {
        bail!("the embedded recordings have {} windows, a frame needs {VEHICLES}", windows.len());
    }
    let parts = Parts::new(config, &windows, precision)?;
    let (started, mut seconds) = (Instant::now(), Vec::new());
    // The first frame does not count: it fills caches.
    parts.gnp.predict(&windows[..VEHICLES], GOALS)?;
    for frame in windows.chunks_exact(VEHICLES).cycle().take(FRAMES) {
        seconds.push(clock::once(&|| {
            parts.gnp.predict(frame, GOALS)?;
            Ok(())
        })?);
        if started.elapsed() > LONGEST {
            break;
        }
    }
    let mut stages = [(); STAGES.len()].map(|()| Vec::new());
    for frame in windows.chunks_exact(VEHICLES).cycle().take(seconds.len().div_ceil(5)) {
        stages.iter_mut().zip(parts.stages(frame)?).for_each(|(all, one)| all.push(one));
    }
    Ok((Sample::new(seconds), stages.map(|seconds| Sample::new(seconds).median())))
}

/// A predictor, and the parts it is made of.
struct Parts {
    gnp: Gnp,
    features: Features,
    centres: Tensor,
    goal: GoalNet,
    force: SocialForce,
    neighbours: NeighbourFuture,
}

impl Parts {
    /// Seconds of each of the [`STAGES`] of a frame. What cannot be called by itself is a difference of two times.
    fn stages(&self, frame: &[Observation<'_>]) -> Result<[f64; STAGES.len()]> {
        let (features, device) = (&self.features, Device::Cpu);
        let (seen, situations) = timed(|| {
            Ok(frame.iter().map(|o| features.situation(AugmentedView::recorded(*o))).collect::<Result<Vec<_>, _>>()?)
        })?;
        let (inputs, GoalInputs { observed, neighbours, mask }) =
            timed(|| Ok(features.goal_inputs(&situations, &device)?))?;
        let modes = self.centres.dim(0)?;
        let (network, _) = timed(|| Ok(self.goal.predict(&observed, &neighbours, &mask, &self.centres, modes)?))?;
        let (chosen, goals) = timed(|| Ok(self.gnp.goal_head().predict(frame, GOALS)?))?;
        let end = |mode: &Mode| mode.path.last().copied().unwrap_or_default();
        let ends: Vec<Vec<_>> = goals.iter().map(|forecast| forecast.modes.iter().map(end).collect()).collect();
        let (driven, _) = timed(|| Ok(self.gnp.predict_towards(frame, &ends)?))?;
        let flat = ends.concat().into_flattened();
        let ends = Tensor::from_vec(flat, (frame.len(), GOALS, 2), &device)?;
        let (scene, batch) = timed(|| Ok(features.scene(&situations, ends, self.neighbours, None, &device)?))?;
        let (roll_out, _) = timed(|| Ok(self.force.roll_out(&batch, Phase::Full)?))?;
        Ok([seen, inputs, network, chosen - seen - inputs - network, scene, roll_out, driven - seen - scene - roll_out])
    }
}

/// What `work` gives, after the seconds it took.
fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(f64, T)> {
    let start = Instant::now();
    let done = work()?;
    Ok((start.elapsed().as_secs_f64(), done))
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

impl Parts {
    /// A model of the configuration's sizes with random weights.
    fn new(config: &RunConfig, windows: &[Observation<'_>], precision: Precision) -> Result<Self> {
        let shape = config.windows.shape_for(config.data.rate_hz)?;
        let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
        let features = Features::fit(&config.features, shape, Some(&platoon), windows.iter().copied())?;
        let weights = [Weights::seeded(1, &Device::Cpu), Weights::seeded(2, &Device::Cpu)];
        GoalNet::new(&config.goal.net, features.goal_shape(), weights[0].builder())?;
        SocialForce::new(&config.traj, weights[1].builder())?;
        // As constants, which a prediction keeps no record for.
        let tensors = weights.map(|weights| {
            let named = weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().detach()));
            named.collect::<BTreeMap<String, Tensor>>()
        });
        let [of_goal, of_force] = tensors
            .each_ref()
            .map(|tensors| VarBuilder::from_tensors(tensors.clone().into_iter().collect(), DType::F32, &Device::Cpu));
        let modes = modes(config.modes.modes, shape.t_pred, &features);
        let header = Header {
            part: Component::Goal,
            dataset: config.dataset,
            simulated: true,
            shape,
            features: features.clone(),
            goal: Some(config.goal.net.clone()),
            traj: None,
            seed: 1,
            code_version: env!("CARGO_PKG_VERSION").to_owned(),
            split_hash: String::new(),
            epoch: 0,
            scores: BTreeMap::new(),
            origin: None,
            trust: Some(TRUST),
            trainer: None,
        };
        let traj = Some(config.traj.clone());
        let force = Header { part: Component::Repulsion, goal: None, traj, ..header.clone() };
        let goal_net = GoalNet::new(&config.goal.net, features.goal_shape(), of_goal)?;
        let social_force = SocialForce::new(&config.traj, of_force)?.frozen_in(precision)?;
        let [goal, repulsion] = tensors;
        let goal = Checkpoint { header, tensors: goal };
        let force = Checkpoint { header: force, tensors: repulsion };
        let neighbours = config.predict.neighbours.without_future();
        let centres = features.centres(&modes, &Device::Cpu)?;
        let gnp = Gnp::new(modes, &goal, Some(&force), neighbours, &Device::Cpu)?;
        let gnp = gnp.selecting(config.predict.selection).trusting(config.predict.trust)?.with_precision(precision)?;
        Ok(Self { gnp, features, centres, goal: goal_net, force: social_force, neighbours })
    }
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
