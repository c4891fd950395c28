//! What stands in an empty slot has no effect, not even if it is not a number.

use candle_core::{Device, Tensor};
use gnp_traj::{Lines, NeighbourStates, Neighbours, Phase, RollOutBatch};

use crate::scenes::{Outcome, gradients, network, scene, small, values};

/// `scene` with `value` in every number of an empty slot or line.
fn padded(scene: &RollOutBatch, value: f32) -> candle_core::Result<RollOutBatch> {
    let fill = |x: &Tensor, there: &Tensor| -> candle_core::Result<Tensor> {
        let there = there.ne(0f64)?.broadcast_as(x.shape())?;
        there.where_cond(x, &Tensor::full(value, x.shape(), &Device::Cpu)?)
    };
    let mut scene = scene.clone();
    if let Some(Neighbours { states: NeighbourStates::Given(states), present }) = &mut scene.neighbours {
        *states = fill(states, &present.unsqueeze(1)?.unsqueeze(3)?)?;
    }
    if let Some(Lines { lines, present }) = &mut scene.lines {
        *lines = fill(lines, &present.unsqueeze(2)?)?;
    }
    Ok(scene)
}

#[test]
fn padding_reaches_neither_path_nor_gradient() -> Outcome {
    let (network, weights) = network(&small(), 5)?;
    let scene = scene(4, 1, 2)?;
    let outcome = |scene: &RollOutBatch| -> Outcome<_> {
        let path = network.roll_out(scene, Phase::Full)?;
        Ok((values(&path)?, gradients(&weights, &path.sqr()?.sum_all()?)?))
    };
    let wanted = outcome(&scene)?;
    for value in [0., 1e6, f32::NAN] {
        assert_eq!(outcome(&padded(&scene, value)?)?, wanted, "padding {value}");
    }
    Ok(())
}

#[test]
fn the_test_scene_has_padding_and_neighbours() -> Outcome {
    let scene = scene(4, 1, 2)?;
    let share = |x: &Tensor| values(x).map(|v| v.iter().sum::<f32>() / v.len() as f32);
    let neighbours = scene.neighbours.as_ref().map(|n| share(&n.present)).transpose()?;
    let lines = scene.lines.as_ref().map(|n| share(&n.present)).transpose()?;
    assert!(neighbours.is_some_and(|s| s > 0.5 && s < 1.) && lines.is_some_and(|s| s > 0.5 && s < 1.));
    Ok(())
}
