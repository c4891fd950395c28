//! The reference implementation in PyTorch and this one agree on one small scene.
//!
//! `fixtures/golden.safetensors` holds its random weights, inputs, path and gradients of the sum of
//! squares of the path (dt 0.1 s, r_col 26 m, k at most 100 m/s²).

use candle_core::Device;
use gnp_nn::Weights;
use gnp_traj::{Engine, InputScale, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TrajConfig};

use crate::scenes::{Outcome, assert_close, gradients, values};

#[test]
fn path_and_gradients_are_those_of_pytorch() -> Outcome {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/golden.safetensors");
    let golden = candle_core::safetensors::load(file, &Device::Cpu)?;
    let weights = Weights::seeded(0, &Device::Cpu);
    let stored = golden.iter().filter_map(|(name, tensor)| Some((name.strip_prefix("traj.weight.")?, tensor)));
    weights.set(stored)?;
    let count = weights.count();
    let cfg = TrajConfig {
        hidden: 12,
        embedding: 8,
        latent_dim: 6,
        encoder: vec![10, 9],
        decoder: vec![11, 10, 9],
        input_scale: InputScale { position: 1., velocity: 1. },
        ..TrajConfig::published()
    };
    let network = SocialForce::new(&cfg, weights.builder())?;
    assert_eq!(weights.count(), count, "the network asked for a weight that PyTorch does not have");
    let scene = RollOutBatch {
        observed: golden["traj.obs"].clone(),
        goals: golden["traj.goal"].unsqueeze(1)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Given(golden["traj.nei"].clone()),
            present: golden["traj.mask"].clone(),
        }),
        lines: None,
        dt: 0.1,
        steps: 5,
    };
    for engine in [Engine::Graph, Engine::Fused] {
        let path = network.roll_out_on(engine, &scene, Phase::Full)?;
        assert_close("path", &values(&path)?, &values(&golden["traj.path"])?, 1e-4);
        for (name, gradient) in gradients(&weights, &path.sqr()?.sum_all()?)? {
            let gradient = gradient.unwrap_or_else(|| panic!("no gradient for {name}"));
            assert_close(&name, &gradient, &values(&golden[&format!("traj.grad.{name}")])?, 1e-4);
        }
    }
    Ok(())
}
