//! A whole frame, from observed tracks to paths: 25 vehicles at 25 Hz or 5 Hz, 6 goals each, with the
//! sizes of `configs/highd.toml` and the published ones, untrained.
//!
//! `RAYON_NUM_THREADS=1` gives the time on one core; `cargo xtask bench --frame` gives its p50 and p99.

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
    Checkpoint, Component, FeatureConfig, Features, Gnp, Header, NeighbourFuture, ReferencePath, Representation,
    SeenNeighbours,
};
use gnp_modes::Modes;
use gnp_nn::Weights;
use gnp_traj::{InputScale, SocialForce, TrajConfig};

const VEHICLES: usize = 25;
const GOALS: usize = 6;

struct Sizes {
    name: &'static str,
    rate_hz: f64,
    modes: usize,
    representation: Representation,
    reference: ReferencePath,
    vehicles_ahead: usize,
    goal: GoalConfig,
    traj: TrajConfig,
}

/// As in `configs/highd.toml`.
fn small() -> Sizes {
    Sizes {
        name: "small",
        rate_hz: 5.,
        modes: 60,
        representation: Representation::Deviation,
        reference: ReferencePath::Platoon,
        vehicles_ahead: 2,
        goal: GoalConfig {
            probability: ProbabilityHead::Decoder,
            regression: Regression::Residual,
            null_token: true,
            slot_embedding: true,
            zero_start: false,
            ..published().goal
        },
        traj: TrajConfig {
            hidden: 64,
            embedding: 32,
            encoder: vec![32, 64],
            decoder: vec![64, 64],
            lines: true,
            input_scale: InputScale { position: 0.05, velocity: 0.1 },
            ..TrajConfig::published()
        },
    }
}

fn published() -> Sizes {
    Sizes {
        name: "published",
        rate_hz: 25.,
        modes: 200,
        representation: Representation::Position,
        reference: ReferencePath::ConstantVelocity,
        vehicles_ahead: 1,
        goal: GoalConfig {
            width: 64,
            heads: 4,
            layers: 2,
            feed_forward: 2,
            dropout: 0.1,
            probability: ProbabilityHead::Encoder,
            regression: Regression::Absolute,
            null_token: false,
            slot_embedding: false,
            zero_start: false,
        },
        traj: TrajConfig::published(),
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
        dataset: Dataset::HIGHD,
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
    Ok(Gnp::new(modes, &goal, Some(&force), NeighbourFuture::ConstantVelocity, &Device::Cpu)?)
}

fn frame(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/highd");
    let source = discover(&fixtures, Dataset::HIGHD)?.swap_remove(0);
    let expect = Expectation { dataset: Dataset::HIGHD, rate_hz: Some(25.) };
    let recordings: Vec<_> = read(&source, &expect)?.into_iter().map(|(recording, _)| recording).collect();
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(10).throughput(Throughput::Elements(VEHICLES as u64));
    for sizes in [small(), published()] {
        let (rate_hz, site_stride_s) = (sizes.rate_hz, BTreeMap::new());
        let config = WindowConfig { observed_s: 3., predicted_s: 5., rate_hz, stride_s: 1., site_stride_s };
        let (set, _) = WindowSet::cut(&recordings, &config)?;
        // Vehicles that are there at about the same time, as those of a frame are.
        let mut windows: Vec<_> = set.iter().map(|window| window.observation()).collect();
        windows.sort_by_key(Observation::frame);
        let features = FeatureConfig {
            representation: sizes.representation,
            reference: sizes.reference,
            length_scale: 5.,
            velocity_window_s: 0.5,
            history_block_s: 0.,
            vehicles_ahead: sizes.vehicles_ahead,
            neighbours: SeenNeighbours::All,
            car_following_features: false,
        };
        let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
        let features = Features::fit(&features, set.shape(), Some(&platoon), windows.iter().copied())?;
        let model = model(&sizes, features)?;
        let (name, modes) = (sizes.name, sizes.modes);
        let id = format!("{name}/{VEHICLES}_vehicles/{GOALS}_goals/{modes}_modes/{rate_hz}_hz");
        let frame = &windows[..VEHICLES.min(windows.len())];
        group.bench_function(id, |bencher| bencher.iter(|| black_box(model.predict(frame, GOALS)).is_ok()));
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
