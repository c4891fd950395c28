//! What runs on a GPU against the same on the CPU; empty without the feature `cuda`. Not part of the checks, for want of a
//! GPU there: `cargo test --package gnp --features cuda --test cuda -- --test-threads 1`.
//!
//! Products of f32 are summed in full precision on both sides (candle leaves TF32 off), in another order: what is
//! compared agrees to about 1e-5 of its tensor's largest value, and the tolerances leave one digit more.
#![cfg(feature = "cuda")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod goals;
mod optimiser;
mod paths;
mod replays;
mod runs;
#[path = "../../../gnp-traj/tests/roll_out/scenes.rs"]
#[allow(dead_code, reason = "shared with other tests")]
mod scenes;

use std::collections::BTreeMap;
use std::sync::OnceLock;

use candle_core::{DType, Device, Tensor};
use gnp_nn::Weights;

/// The first GPU; one device for all tests, as tensors of two do not meet.
fn gpu() -> &'static Device {
    static GPU: OnceLock<Device> = OnceLock::new();
    GPU.get_or_init(|| Device::new_cuda(0).unwrap())
}

fn values(x: &Tensor) -> Vec<f32> {
    x.to_dtype(DType::F32).unwrap().flatten_all().unwrap().to_vec1().unwrap()
}

/// Fails unless `found` is within `tolerance` of `wanted`, relative to the largest wanted value.
fn close(name: &str, found: &[f32], wanted: &[f32], tolerance: f32) {
    assert_eq!(found.len(), wanted.len(), "{name}");
    let largest = wanted.iter().fold(1e-3f32, |largest, x| largest.max(x.abs()));
    let off = found.iter().zip(wanted).fold(0f32, |off, (a, b)| off.max((a - b).abs()));
    println!("{name}: off by {:.1e} of the largest", off / largest);
    assert!(off <= tolerance * largest, "{name}: off by {off} at a largest of {largest}");
    assert!(found.iter().all(|x| x.is_finite()), "{name} is not finite");
}

/// The same weights on a device.
fn on(device: &Device, weights: &Weights) -> Weights {
    let moved = Weights::seeded(0, device);
    let tensors: Vec<(String, Tensor)> =
        weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().copy().unwrap())).collect();
    moved.set(tensors.iter().map(|(name, tensor)| (name.as_str(), tensor))).unwrap();
    moved
}

/// The gradient of every weight that `loss` reaches.
fn gradients(weights: &Weights, loss: &Tensor) -> BTreeMap<String, Vec<f32>> {
    let store = loss.backward().unwrap();
    let of = |(name, var): (String, candle_core::Var)| Some((name, values(store.get(&var)?)));
    weights.named().into_iter().filter_map(of).collect()
}

fn all_close(found: &BTreeMap<String, Vec<f32>>, wanted: &BTreeMap<String, Vec<f32>>, tolerance: f32) {
    assert_eq!(found.keys().collect::<Vec<_>>(), wanted.keys().collect::<Vec<_>>());
    assert!(!wanted.is_empty());
    for (name, wanted) in wanted {
        close(name, &found[name], wanted, tolerance);
    }
}
