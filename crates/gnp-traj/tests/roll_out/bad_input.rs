//! A scene that does not fit is refused with the field's name and both shapes.

use candle_core::{DType, Device, Tensor};
use gnp_traj::{NeighbourStates, Phase, RollOutBatch, TrajError};

use crate::scenes::{Outcome, network, scene, small};

fn refusal(change: impl FnOnce(&mut RollOutBatch)) -> Outcome<String> {
    let (network, _) = network(&small(), 1)?;
    let mut scene = scene(3, 2, 1)?;
    change(&mut scene);
    match network.roll_out(&scene, Phase::Full) {
        Err(error @ (TrajError::Shape { .. } | TrajError::Batch { .. })) => Ok(error.to_string()),
        other => Err(format!("{other:?}").into()),
    }
}

fn zeros(shape: &[usize]) -> candle_core::Result<Tensor> {
    Tensor::zeros(shape, DType::F32, &Device::Cpu)
}

fn states(scene: &mut RollOutBatch, states: NeighbourStates) {
    if let Some(neighbours) = &mut scene.neighbours {
        neighbours.states = states;
    }
}

#[test]
fn shapes_are_checked_and_named() -> Outcome {
    let (narrow, many, none) = (zeros(&[3, 4, 2])?, zeros(&[4, 2, 2])?, zeros(&[3, 0, 4])?);
    let message = refusal(|s| s.observed = narrow)?;
    assert!(message.contains("observed") && message.contains("[3, 4, 2]") && message.contains("[batch, t_obs, 4]"));
    assert!(refusal(|s| s.goals = many)?.contains("batch = 3"));
    assert!(refusal(|s| s.steps = 6)?.contains("steps = 6"));
    assert!(refusal(|s| s.steps = 0)?.contains("steps"));
    assert!(refusal(|s| s.dt = f64::NAN)?.contains("dt"));
    assert!(refusal(|s| s.observed = none)?.contains("observed"));
    assert!(refusal(|s| s.lines = None)?.contains("traj.lines"));
    Ok(())
}

#[test]
fn joint_neighbours_must_be_rows_of_the_batch() -> Outcome {
    let offset = zeros(&[3, 5, 2])?;
    let joint = |index: Tensor| NeighbourStates::Joint { index, offset: offset.clone() };
    let (beyond, not_whole) = (Tensor::full(3u32, (3, 5), &Device::Cpu)?, zeros(&[3, 5])?);
    assert!(refusal(|s| states(s, joint(beyond)))?.contains("row 3 of a batch of 3"));
    assert!(refusal(|s| states(s, joint(not_whole)))?.contains("u32"));
    Ok(())
}
