//! The path follows from the forces that are reported, and several goals, joint scenes and a slower
//! network mean what they say.

use candle_core::{Device, Tensor};
use gnp_traj::{Integrator, NeighbourStates, Neighbours, Phase, RollOutBatch, TrajConfig};

use crate::scenes::{Outcome, assert_close, network, scene, small, values};

#[test]
fn the_path_is_the_sum_of_the_reported_forces() -> Outcome {
    let (windows, goals, steps) = (3, 2, 7);
    for integrator in [Integrator::ExplicitEuler, Integrator::SemiImplicitEuler] {
        let (network, _) = network(&TrajConfig { integrator, ..small() }, 4)?;
        let scene = scene(windows, goals, 6)?;
        let out = network.roll_out_explained(&scene, Phase::Full)?;
        let mut force = out.path.zeros_like()?;
        for term in &out.terms {
            force = (force + term.forces.sum(3)?)?;
        }
        let force = values(&force)?;
        let (path, velocity) = (values(&out.path)?, values(&out.velocity)?);
        let observed = scene.observed.narrow(1, 3, 1)?.squeeze(1)?.to_vec2::<f32>()?;
        for row in 0..windows * goals {
            for axis in 0..2 {
                let (mut p, mut v) = (observed[row / goals][axis], observed[row / goals][2 + axis]);
                for step in 0..steps {
                    let at = (row * steps + step) * 2 + axis;
                    let faster = v + 0.1 * force[at];
                    p += 0.1 * if integrator == Integrator::ExplicitEuler { v } else { faster };
                    v = faster;
                    assert!((p - path[at]).abs() < 1e-4 && (v - velocity[at]).abs() < 1e-4, "step {step}");
                }
            }
        }
    }
    Ok(())
}

#[test]
fn each_goal_of_a_window_gives_the_path_it_gives_alone() -> Outcome {
    let (network, _) = network(&small(), 4)?;
    let together = scene(3, 4, 6)?;
    let path = network.roll_out(&together, Phase::Full)?;
    for goal in 0..4 {
        let alone = RollOutBatch { goals: together.goals.narrow(1, goal, 1)?.contiguous()?, ..together.clone() };
        let alone = network.roll_out(&alone, Phase::Full)?;
        assert_close("path", &values(&path.narrow(1, goal, 1)?)?, &values(&alone)?, 1e-5);
    }
    Ok(())
}

#[test]
fn joint_windows_see_each_other_where_they_are() -> Outcome {
    // Two vehicles abreast, 3 m apart, each the only neighbour of the other.
    let cfg = TrajConfig { lines: false, ..small() };
    let (network, _) = network(&cfg, 4)?;
    let history = Tensor::new(&[[-2f32, 0., 10., 0.], [-1., 0., 10., 0.], [0., 0., 10., 0.]], &Device::Cpu)?;
    let joint = RollOutBatch {
        observed: history.unsqueeze(0)?.repeat((2, 1, 1))?,
        goals: Tensor::new(&[[[7f32, 0.]], [[7., 0.]]], &Device::Cpu)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Joint {
                index: Tensor::new(&[[1u32], [0]], &Device::Cpu)?,
                offset: Tensor::new(&[[[0f32, 3.]], [[0., -3.]]], &Device::Cpu)?,
            },
            present: Tensor::ones((2, 1), candle_core::DType::F32, &Device::Cpu)?,
        }),
        lines: None,
        dt: 0.1,
        steps: 6,
    };
    let out = network.roll_out_explained(&joint, Phase::Full)?;
    let path = values(&out.path)?;
    let (right, left) = (path[6 * 2 - 1], path[2 * 6 * 2 - 1]);
    assert!(right < -0.01 && left > 0.01, "the right one drifts to {right}, the left one to {left}");

    // The left one's states, fed to the right one as given, lead to the same path.
    let states = Tensor::cat(&[out.path.squeeze(1)?, out.velocity.squeeze(1)?], 2)?;
    let start = joint.observed.narrow(1, 2, 1)?;
    let before = Tensor::cat(&[start, states.narrow(1, 0, 5)?], 1)?;
    let left = before.narrow(0, 1, 1)?.broadcast_add(&Tensor::new(&[0f32, 3., 0., 0.], &Device::Cpu)?)?;
    let given = RollOutBatch {
        observed: joint.observed.narrow(0, 0, 1)?,
        goals: joint.goals.narrow(0, 0, 1)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Given(left.unsqueeze(2)?),
            present: Tensor::ones((1, 1), candle_core::DType::F32, &Device::Cpu)?,
        }),
        ..joint
    };
    let alone = values(&network.roll_out(&given, Phase::Full)?)?;
    assert_close("path", &alone, &path[..12], 1e-5);
    Ok(())
}

#[test]
fn a_slower_network_holds_its_parameters_between_its_frames() -> Outcome {
    let (network, _) = network(&TrajConfig { network_period: 3, ..small() }, 4)?;
    let out = network.roll_out_explained(&scene(2, 1, 6)?, Phase::Full)?;
    for (name, parameter) in [("goal", "tau"), ("neighbours", "k"), ("lines", "k")] {
        let parameter = out.term(name).and_then(|term| term.parameter(parameter)).ok_or(name)?;
        let at = |step: usize| values(&parameter.narrow(2, step, 1)?);
        assert_eq!(at(0)?, at(2)?, "{name}");
        assert_ne!(at(2)?, at(3)?, "{name}");
        assert_eq!(at(3)?, at(5)?, "{name}");
        assert_ne!(at(5)?, at(6)?, "{name}");
    }
    Ok(())
}

#[test]
fn strengths_start_where_the_configuration_says() -> Outcome {
    let (network, _) = network(&TrajConfig { k_bias: -8., ..small() }, 4)?;
    let out = network.roll_out_explained(&scene(2, 1, 6)?, Phase::Full)?;
    for name in ["neighbours", "lines"] {
        let k = values(out.term(name).and_then(|term| term.parameter("k")).ok_or(name)?)?;
        assert!(k.iter().all(|&k| (0. ..0.02).contains(&k)) && k.iter().any(|&k| k > 0.), "{k:?}");
    }
    Ok(())
}
