//! Each phase trains the weights it says it trains, and the gradients are those of the path.

use gnp_traj::{NeighbourStates, Phase};

use crate::scenes::{Outcome, gradients, network, scene, small, values};

const PHI_1: [&str; 5] = ["emb1", "cell1", "out1", "enc_goal", "tau"];

/// The names of the weights that get a gradient which is not zero throughout.
fn trained(phase: Phase) -> Outcome<(Vec<String>, Vec<String>)> {
    let (network, weights) = network(&small(), 3)?;
    let path = network.roll_out(&scene(3, 2, 8)?, phase)?;
    let all = gradients(&weights, &path.sqr()?.sum_all()?)?;
    let moves = |g: &Option<Vec<f32>>| g.as_ref().is_some_and(|g| g.iter().any(|&v| v != 0.));
    Ok((
        all.iter().filter(|(_, g)| moves(g)).map(|(n, _)| n.clone()).collect(),
        all.into_iter().map(|(n, _)| n).collect(),
    ))
}

fn in_phi_1(name: &str) -> bool {
    PHI_1.contains(&name.split('.').next().unwrap_or_default())
}

#[test]
fn the_full_phase_trains_every_weight() -> Outcome {
    let (trained, all) = trained(Phase::Full)?;
    assert_eq!(trained, all);
    Ok(())
}

#[test]
fn the_repulsion_phase_leaves_phi_1_alone() -> Outcome {
    let (trained, all) = trained(Phase::Repulsion)?;
    assert_eq!(trained, all.into_iter().filter(|name| !in_phi_1(name)).collect::<Vec<_>>());
    Ok(())
}

#[test]
fn the_attraction_phase_trains_phi_1_alone() -> Outcome {
    let (trained, all) = trained(Phase::Attraction)?;
    assert_eq!(trained, all.into_iter().filter(|name| in_phi_1(name)).collect::<Vec<_>>());
    Ok(())
}

#[test]
fn gradients_are_finite_with_a_neighbour_and_a_line_at_no_distance() -> Outcome {
    let mut scene = scene(3, 1, 8)?;
    let start = scene.observed.narrow(1, 3, 1)?.unsqueeze(1)?;
    if let Some(neighbours) = &mut scene.neighbours {
        neighbours.states = NeighbourStates::Given(start.broadcast_as((3, 7, 5, 4))?.contiguous()?);
    }
    if let Some(lines) = &mut scene.lines {
        let y = scene.observed.narrow(1, 3, 1)?.narrow(2, 1, 1)?.broadcast_as((3, 3, 1))?;
        lines.lines = candle_core::Tensor::cat(&[y, lines.lines.narrow(2, 1, 2)?], 2)?;
    }
    scene.goals = scene.goals.zeros_like()?;
    let (network, weights) = network(&small(), 3)?;
    let path = network.roll_out(&scene, Phase::Full)?;
    assert!(values(&path)?.iter().all(|v| v.is_finite()));
    for (name, gradient) in gradients(&weights, &path.sqr()?.sum_all()?)? {
        assert!(gradient.is_some_and(|g| g.iter().all(|v| v.is_finite())), "{name}");
    }
    Ok(())
}
