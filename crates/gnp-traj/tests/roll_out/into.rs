//! A roll-out into memory that was used before has the bits of any other.

use candle_core::{Device, Tensor};
use gnp_traj::{
    Integrator, Lines, NeighbourStates, Phase, RollOutBatch, RollOutValues, RollOutWorkspace, TrajConfig, TrajError,
};

use crate::scenes::{Outcome, network, scene, small, values};

/// A scene with a line between lanes at, below and beyond the distance at which it no longer pushes.
fn scene_with_far_lines(windows: usize, goals: usize, seed: u64) -> Outcome<RollOutBatch> {
    const LINES: usize = 4;
    let lines: Vec<f32> = (0..windows)
        .flat_map(|window| {
            let shift = window as f32 * 0.4;
            [-1.8, 1., 1., 3.9 - shift, 0., 0., 4.2 + shift, 0., 0., 7.4 + shift, 1., -1.]
        })
        .collect();
    let lines = Tensor::from_vec(lines, (windows, LINES, 3), &Device::Cpu)?;
    let present = Tensor::ones((windows, LINES), candle_core::DType::F32, &Device::Cpu)?;
    Ok(RollOutBatch { lines: Some(Lines { lines, present }), ..scene(windows, goals, seed)? })
}

pub(crate) fn plain(batch: &RollOutBatch) -> Outcome<RollOutValues> {
    let (windows, t_obs, _) = batch.observed.dims3()?;
    let mut plain = RollOutValues {
        windows,
        t_obs,
        goals_each: batch.goals.dim(1)?,
        steps: batch.steps,
        dt: batch.dt,
        observed: values(&batch.observed)?,
        goals: values(&batch.goals)?,
        ..RollOutValues::default()
    };
    let present = |x: &Tensor| -> Outcome<Vec<bool>> { Ok(values(x)?.into_iter().map(|there| there > 0.).collect()) };
    if let Some(neighbours) = &batch.neighbours {
        let NeighbourStates::Given(states) = &neighbours.states else { return Err("neighbours are given".into()) };
        (plain.slots, plain.neighbours) = (states.dim(2)?, values(states)?);
        plain.neighbour_present = present(&neighbours.present)?;
    }
    if let Some(lines) = &batch.lines {
        (plain.most_lines, plain.lines) = (lines.lines.dim(1)?, values(&lines.lines)?);
        plain.line_present = present(&lines.present)?;
    }
    Ok(plain)
}

#[test]
fn paths_and_forces_have_the_bits_of_a_roll_out() -> Outcome {
    let mut workspace = RollOutWorkspace::default();
    for (integrator, network_period) in [(Integrator::SemiImplicitEuler, 1), (Integrator::ExplicitEuler, 3)] {
        let (network, _) = network(&TrajConfig { integrator, network_period, ..small() }, 7)?;
        let network = network.frozen()?;
        for phase in [Phase::Full, Phase::Attraction] {
            for (windows, goals) in [(9, 2), (3, 4), (9, 1)] {
                for scene in [scene(windows, goals, 11)?, scene_with_far_lines(windows, goals, 12)?] {
                    workspace.values = plain(&scene)?;
                    let wanted = network.roll_out_explained(&scene, phase)?;
                    let found = network.roll_out_into(phase, true, &mut workspace)?;
                    assert_eq!(found.path(), values(&wanted.path)?, "{phase:?}, {windows} windows");
                    assert_eq!(found.terms().count(), wanted.terms.len());
                    for (found, wanted) in found.terms().zip(&wanted.terms) {
                        assert_eq!((found.term, found.sources), (&wanted.term, wanted.forces.dim(3)?));
                        assert_eq!(found.forces, values(&wanted.forces)?, "{}", wanted.term.name);
                    }
                    let path = values(&wanted.path)?;
                    assert_eq!(network.roll_out_into(phase, false, &mut workspace)?.path(), path);
                    assert_eq!(values(&network.roll_out(&scene, phase)?)?, path);
                }
            }
        }
    }
    Ok(())
}

#[test]
fn values_that_do_not_fit_and_networks_that_are_not_packed_are_refused() -> Outcome {
    let (network, _) = network(&small(), 7)?;
    let packed = network.frozen()?;
    assert!(packed.is_packed() && !network.is_packed());
    let good = plain(&scene(3, 2, 11)?)?;
    let refused = |network: &gnp_traj::SocialForce, values: RollOutValues| -> String {
        let mut workspace = RollOutWorkspace::default();
        workspace.values = values;
        network.roll_out_into(Phase::Full, true, &mut workspace).map(|_| ()).unwrap_err().to_string()
    };
    assert!(refused(&network, good.clone()).contains("`frozen`"));
    let cases: [(&str, RollOutValues); 5] = [
        ("`windows`", RollOutValues { windows: 0, ..good.clone() }),
        ("`dt`", RollOutValues { dt: f64::NAN, ..good.clone() }),
        ("`goals`", RollOutValues { goals_each: 3, ..good.clone() }),
        ("`neighbour_present`", RollOutValues { neighbour_present: vec![true], ..good.clone() }),
        ("`lines`", RollOutValues { lines: Vec::new(), ..good }),
    ];
    for (name, values) in cases {
        let message = refused(&packed, values);
        assert!(message.contains(name), "{message}");
    }
    let empty = packed.roll_out_into(Phase::Full, true, &mut RollOutWorkspace::default()).map(|_| ());
    assert!(matches!(empty, Err(TrajError::Batch { .. })));
    Ok(())
}
