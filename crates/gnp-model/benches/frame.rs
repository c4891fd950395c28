//! A whole frame, from observed tracks to paths with their forces: 1, 25 and 100 vehicles, 6 goals each, with the sizes of
//! `configs/highd.toml` (5 Hz) and `configs/ngsim.toml` (10 Hz), untrained; by `predict`, and by `predict_into`.
//!
//! `RAYON_NUM_THREADS=1` gives the time on one core; `cargo xtask bench --frame` gives p50 and p99 of `predict`, and the
//! published sizes.

#![allow(missing_docs)] // criterion's macros write functions without

use std::collections::BTreeMap;
use std::error::Error;
use std::hint::black_box;
use std::path::Path;

use candle_core::Device;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Observation, Predictor, WindowConfig, WindowSet, discover, read};
use gnp_goal::{GoalConfig, GoalNet, ProbabilityHead, Regression};
use gnp_model::{
    Checkpoint, Component, FeatureConfig, Features, Forecasts, Gnp, Header, NeighbourFuture, ReferencePath,
    Representation, SeenNeighbours, Selection, Trust, Workspace,
};
use gnp_modes::Modes;
use gnp_nn::Weights;
use gnp_traj::{InputScale, SocialForce, TrajConfig};

const VEHICLES: [usize; 3] = [1, 25, 100];
const GOALS: usize = 6;

struct Sizes {
    name: &'static str,
    dataset: Dataset,
    recording_hz: f64,
    rate_hz: f64,
    modes: usize,
    neighbours: SeenNeighbours,
    goal: GoalConfig,
    traj: TrajConfig,
}

/// As in `configs/highd.toml`.
fn highd() -> Sizes {
    Sizes {
        name: "highd",
        dataset: Dataset::HIGHD,
        recording_hz: 25.,
        rate_hz: 5.,
        modes: 60,
        neighbours: SeenNeighbours::All,
        goal: GoalConfig {
            width: 64,
            heads: 4,
            layers: 2,
            feed_forward: 2,
            dropout: 0.1,
            probability: ProbabilityHead::Decoder,
            regression: Regression::Residual,
            null_token: true,
            slot_embedding: true,
            zero_start: false,
        },
        traj: TrajConfig {
            hidden: 64,
            embedding: 32,
            encoder: vec![32, 64],
            decoder: vec![64, 64],
            lines: true,
            input_scale: InputScale { position: 0.05, velocity: 0.1 },
            network_period: 2,
            ..TrajConfig::published()
        },
    }
}

/// As in `configs/ngsim.toml`.
fn ngsim() -> Sizes {
    let highd = highd();
    Sizes {
        name: "ngsim",
        dataset: Dataset::NGSIM,
        recording_hz: 10.,
        rate_hz: 10.,
        modes: 40,
        neighbours: SeenNeighbours::Ahead,
        goal: GoalConfig { width: 32, layers: 1, ..highd.goal },
        traj: TrajConfig { tau_max: 3., network_period: 1, ..highd.traj },
    }
}

fn model(sizes: &Sizes, features: Features) -> Result<Gnp, Box<dyn Error>> {
    let shape = features.shape();
    let (goal, force) = (Weights::seeded(1, &Device::Cpu), Weights::seeded(2, &Device::Cpu));
    GoalNet::new(&sizes.goal, features.goal_shape(), goal.builder())?;
    SocialForce::new(&sizes.traj, force.builder())?;
    let step = |i: usize| ((i / 2 % shape.t_pred + 1) * (i / (2 * shape.t_pred))) as f32 * 0.01;
    let modes = Modes {
        centres: (0..sizes.modes * shape.t_pred * 2).map(step).collect(),
        t_pred: shape.t_pred,
        sizes: vec![1; sizes.modes],
        inertia: 0.,
        converged: true,
        abandoned: 0,
        seed: 0,
        frame: features.mode_frame(),
    };
    let header = Header {
        part: Component::Goal,
        dataset: sizes.dataset,
        simulated: true,
        shape,
        features,
        goal: Some(sizes.goal.clone()),
        traj: None,
        seed: 1,
        code_version: String::new(),
        split_hash: String::new(),
        epoch: 0,
        scores: BTreeMap::new(),
        origin: None,
        trust: None,
        trainer: None,
    };
    let of_force = Header { part: Component::Repulsion, goal: None, traj: Some(sizes.traj.clone()), ..header.clone() };
    let [goal, force] = [(header, goal), (of_force, force)].map(|(header, weights)| Checkpoint {
        header,
        tensors: weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().detach())).collect(),
    });
    let gnp = Gnp::new(modes, &goal, Some(&force), NeighbourFuture::Platoon, &Device::Cpu)?;
    Ok(gnp.selecting(Selection::Central).trusting(Trust::Share(0.5))?.explaining(true))
}

fn frame(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(10);
    for sizes in [highd(), ngsim()] {
        let Sizes { name, modes, rate_hz, .. } = sizes;
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(name);
        let source = discover(&fixtures, sizes.dataset)?.swap_remove(0);
        let expect = Expectation { dataset: sizes.dataset, rate_hz: Some(sizes.recording_hz) };
        let recordings: Vec<_> = read(&source, &expect)?.into_iter().map(|(recording, _)| recording).collect();
        let site_stride_s = BTreeMap::new();
        let config = WindowConfig { observed_s: 3., predicted_s: 5., rate_hz, stride_s: 1., site_stride_s };
        let (set, _) = WindowSet::cut(&recordings, &config)?;
        // Vehicles that are there at about the same time, as those of a frame are.
        let mut windows: Vec<_> = set.iter().map(|window| window.observation()).collect();
        windows.sort_by_key(Observation::frame);
        let features = FeatureConfig {
            representation: Representation::Deviation,
            reference: ReferencePath::Platoon,
            length_scale: 5.,
            velocity_window_s: 0.5,
            history_block_s: 0.,
            vehicles_ahead: 2,
            neighbours: sizes.neighbours,
            car_following_features: true,
        };
        let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
        let features = Features::fit(&features, set.shape(), Some(&platoon), windows.iter().copied())?;
        let model = model(&sizes, features)?;
        let (mut workspace, mut forecasts) = (Workspace::new(), Forecasts::default());
        for vehicles in VEHICLES {
            let frame = &windows[..vehicles.min(windows.len())];
            group.throughput(Throughput::Elements(vehicles as u64));
            let id = format!("{name}/{vehicles}_vehicles/{GOALS}_goals/{modes}_modes/{rate_hz}_hz");
            group.bench_function(format!("predict/{id}"), |bencher| {
                bencher.iter(|| black_box(model.predict(frame, GOALS)).is_ok());
            });
            group.bench_function(format!("predict_into/{id}"), |bencher| {
                bencher.iter(|| model.predict_into(frame, GOALS, &mut workspace, &mut forecasts).is_ok());
            });
        }
    }
    group.finish();
    Ok(())
}

fn run(criterion: &mut Criterion) {
    if let Err(error) = frame(criterion) {
        eprintln!("{error}");
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
