//! Outputs and every gradient against a PyTorch program of the published structure.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::HashMap;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use gnp_goal::{GoalConfig, GoalNet, GoalShape, Pick, ProbabilityHead, Regression};
use gnp_nn::Weights;

fn close(name: &str, found: &Tensor, expected: &Tensor) {
    assert_eq!(found.dims(), expected.dims(), "{name}");
    let values = |x: &Tensor| x.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let (found, expected) = (values(found), values(expected));
    let scale = expected.iter().fold(0f32, |scale, x| scale.max(x.abs()));
    // Relative to the tensor's largest value: some gradients (a key's bias) are zero but for rounding.
    let worst = found.iter().zip(&expected).fold(0f32, |worst, (f, e)| worst.max((f - e).abs()));
    assert!(worst <= 1e-4 * scale.max(1e-1), "{name}: off by {worst} at a scale of {scale}");
}

#[test]
fn outputs_and_gradients_are_those_of_pytorch() {
    compare(|net| net);
}

#[test]
fn so_are_those_of_the_graph() {
    compare(GoalNet::as_graph);
}

fn compare(form: impl Fn(GoalNet) -> GoalNet) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/golden.safetensors");
    let golden: HashMap<String, Tensor> = candle_core::safetensors::load(path, &Device::Cpu).unwrap();
    let of = |prefix: &str| -> Vec<(&str, &Tensor)> {
        golden.iter().filter_map(|(name, tensor)| Some((name.strip_prefix(prefix)?, tensor))).collect()
    };
    let get = |name: &str| &golden[&format!("goal.{name}")];
    let weights = Weights::seeded(0, &Device::Cpu);
    weights.set(of("goal.weight.")).unwrap();
    let config = GoalConfig {
        width: 16,
        heads: 4,
        layers: 2,
        feed_forward: 2,
        dropout: 0.,
        probability: ProbabilityHead::Encoder,
        regression: Regression::Absolute,
        null_token: false,
        slot_embedding: false,
        zero_start: false,
    };
    let shape = GoalShape { observed: 24, neighbour: 24, slots: 4, t_pred: 5 };
    let net = form(GoalNet::new(&config, shape, weights.builder()).unwrap());
    assert_eq!(weights.named().len(), of("goal.weight.").len(), "a weight the reference does not have");

    let pick = Pick::Indices(get("pick").to_dtype(DType::U32).unwrap());
    let observed = get("obs").flatten_from(1).unwrap();
    let neighbours = get("nei").flatten_from(2).unwrap();
    let output = net.forward(&observed, &neighbours, get("mask"), get("modes"), &pick, None).unwrap();
    close("logits", &output.logits, get("logits"));
    close("trajectories", &output.futures, get("traj"));

    let squares = |x: &Tensor| x.sqr().unwrap().sum_all().unwrap();
    let grads = (squares(&output.logits) + squares(&output.futures)).unwrap().backward().unwrap();
    let named = weights.named();
    let expected = of("goal.grad.");
    assert_eq!(expected.len(), named.len());
    for (name, gradient) in expected {
        close(name, grads.get(&named[name]).unwrap_or_else(|| panic!("no gradient for {name}")), gradient);
    }
}
