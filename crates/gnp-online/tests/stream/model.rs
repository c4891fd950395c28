//! Untrained models: small, and finite wherever they are asked.

use std::collections::BTreeMap;

use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, LaneMarking, Observation, Snapshot, VehicleBody, VehicleClass, WindowShape};
use gnp_goal::{GoalConfig, GoalNet, ProbabilityHead, Regression};
use gnp_model::{
    Checkpoint, Component, Device, FeatureConfig, Features, Gnp, Header, NeighbourFuture, ReferencePath,
    Representation, SeenNeighbours,
};
use gnp_modes::Modes;
use gnp_nn::Weights;
use gnp_traj::{InputScale, Integrator, SocialForce, TrajConfig};

/// Two lanes, 3.7 m wide.
pub(crate) fn lines() -> Vec<LaneMarking> {
    [0., 3.7, 7.4].map(|y| LaneMarking::new(y, y != 3.7)).to_vec()
}

fn features(shape: WindowShape) -> Features {
    let config = FeatureConfig {
        representation: Representation::Deviation,
        reference: ReferencePath::Platoon,
        length_scale: 5.,
        velocity_window_s: 0.5,
        history_block_s: 0.4,
        vehicles_ahead: 2,
        neighbours: SeenNeighbours::All,
        car_following_features: true,
    };
    // Two vehicles, one behind the other, tell sizes and a mean; other windows are about as far from it.
    let mut snapshot = Snapshot::live("live", lines(), shape).unwrap();
    let body = VehicleBody { class: VehicleClass::Car, length: 4.5, width: 1.8, road: 0 };
    for (vehicle, x) in [(0u8, 0.), (1, 30.), (2, 70.)] {
        let path: Vec<[f32; 2]> = (0..snapshot.frames())
            .map(|i| {
                let t = i as f32 / (shape.rate_hz * shape.step as f64) as f32;
                [x + (20. + f32::from(vehicle)) * t - 0.2 * t * t, 1.8 + 0.1 * t]
            })
            .collect();
        snapshot.push(vehicle.into(), body, &path, &[]).unwrap();
    }
    snapshot.finish();
    let windows: Vec<Observation<'_>> = snapshot.vehicles().filter_map(|it| it.observation()).collect();
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    Features::fit(&config, shape, Some(&platoon), windows.into_iter()).unwrap()
}

/// A model of windows of `shape`, explaining.
pub(crate) fn model(shape: WindowShape) -> Gnp {
    let features = features(shape);
    let goal_config = GoalConfig {
        width: 16,
        heads: 2,
        layers: 1,
        feed_forward: 2,
        dropout: 0.,
        probability: ProbabilityHead::Decoder,
        regression: Regression::Residual,
        null_token: true,
        slot_embedding: true,
        zero_start: false,
    };
    let traj_config = TrajConfig {
        hidden: 8,
        embedding: 8,
        latent_dim: 8,
        encoder: vec![8],
        decoder: vec![8],
        tau_max: 1.,
        k_max: 10.,
        k_max_line: 1.,
        k_bias: 0.,
        r_col: 26.,
        lines: true,
        input_scale: InputScale { position: 0.05, velocity: 0.1 },
        integrator: Integrator::SemiImplicitEuler,
        network_period: 1,
        terms: Vec::new(),
    };
    let (goal, force) = (Weights::seeded(1, &Device::Cpu), Weights::seeded(2, &Device::Cpu));
    GoalNet::new(&goal_config, features.goal_shape(), goal.builder()).unwrap();
    SocialForce::new(&traj_config, force.builder()).unwrap();
    // No two goals are equally good: the last bit does not choose between them.
    let count = 12u16;
    let ends = |mode: u16| {
        let [x, y] = [mode * 37 % 23, mode * 17 % 7].map(f32::from);
        [0.9 * (x - 11.) + 0.13 * f32::from(mode), 0.6 * (y - 3.) + 0.03 * f32::from(mode)]
    };
    let steps = || (1..=shape.t_pred).map(|step| step as f32 / shape.t_pred as f32);
    let centre = |mode: u16| steps().flat_map(move |share| ends(mode).map(|end| end * share));
    let modes = Modes {
        centres: (0..count).flat_map(centre).collect(),
        t_pred: shape.t_pred,
        sizes: vec![1; count.into()],
        inertia: 0.,
        converged: true,
        abandoned: 0,
        seed: 0,
        frame: features.mode_frame(),
    };
    let header = Header {
        part: Component::Goal,
        dataset: Dataset::NGSIM,
        simulated: false,
        shape,
        features,
        goal: Some(goal_config),
        traj: None,
        seed: 1,
        code_version: "test".to_owned(),
        split_hash: "abc".to_owned(),
        epoch: 0,
        scores: BTreeMap::new(),
        origin: None,
        trust: None,
        trainer: None,
    };
    let of_force = Header { part: Component::Repulsion, goal: None, traj: Some(traj_config), ..header.clone() };
    let [goal, force] = [(header, goal), (of_force, force)].map(|(header, weights)| Checkpoint {
        header,
        tensors: weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().detach())).collect(),
    });
    Gnp::new(modes, &goal, Some(&force), NeighbourFuture::Platoon, &Device::Cpu).unwrap().explaining(true)
}
