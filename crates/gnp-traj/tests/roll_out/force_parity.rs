//! The laws on tensors are those of `gnp_force`: each reported force is what that crate gives for the
//! reported state and parameters, to 1e-5 of 1 m/s² and of the force.

use candle_core::{Device, Tensor};
use gnp_force::na::{Point2, Vector2};
use gnp_force::{MarkingKind, Side, goal_force, line_force, vehicle_force};
use gnp_traj::{Engine, NeighbourStates, Phase};

use crate::scenes::{Outcome, network, scene, small, values};

fn assert_equal(name: &str, found: &[f32], wanted: &[f64]) {
    for (found, wanted) in found.iter().zip(wanted) {
        assert!((f64::from(*found) - wanted).abs() < 1e-5 * (1. + wanted.abs()), "{name}: {found}, wanted {wanted}");
    }
}

#[test]
fn forces_on_tensors_are_those_of_gnp_force() -> Outcome {
    let (windows, steps, slots, line_count) = (6, 7, 5, 3);
    let cfg = small();
    let (network, _) = network(&cfg, 4)?;
    let mut scene = scene(windows, 1, 21)?;
    if let Some(lines) = &mut scene.lines {
        // The first window stands beyond a boundary and within its cap, and far from a line between lanes.
        let far = Tensor::new(&[[[0.3f32, 1., 1.], [-0.2, 1., 1.], [9., 0., 0.]]], &Device::Cpu)?;
        lines.lines = Tensor::cat(&[&far, &lines.lines.narrow(0, 1, windows - 1)?], 0)?;
        lines.present = lines.present.ones_like()?;
    }
    let out = network.roll_out_explained_on(Engine::Graph, &scene, Phase::Full)?;
    let of = |name: &str, parameter: &str| -> Outcome<(Vec<f32>, Vec<f32>)> {
        let term = out.term(name).ok_or("no such term")?;
        Ok((values(&term.forces)?, values(term.parameter(parameter).ok_or("no such parameter")?)?))
    };
    let (path, velocity) = (values(&out.path)?, values(&out.velocity)?);
    let ((pull, tau), (pushes, k), (lateral, k_line)) = (of("goal", "tau")?, of("neighbours", "k")?, of("lines", "k")?);
    let (goals, start) = (values(&scene.goals)?, values(&scene.observed.narrow(1, 3, 1)?)?);
    let Some(NeighbourStates::Given(given)) = scene.neighbours.as_ref().map(|n| &n.states) else {
        return Err("".into());
    };
    let (given, lines) = (values(given)?, values(&scene.lines.as_ref().ok_or("no lines")?.lines)?);
    let wide = |x: f32| f64::from(x);
    for window in 0..windows {
        for step in 0..steps {
            let at = window * steps + step;
            let (p, v) = match step {
                0 => (&start[4 * window..4 * window + 2], &start[4 * window + 2..4 * window + 4]),
                _ => (&path[2 * at - 2..2 * at], &velocity[2 * at - 2..2 * at]),
            };
            let (p, v) = (Point2::new(wide(p[0]), wide(p[1])), Vector2::new(wide(v[0]), wide(v[1])));
            let goal = Point2::new(wide(goals[2 * window]), wide(goals[2 * window + 1]));
            let left = (steps - step) as f64 * scene.dt;
            let wanted = goal_force(p, v, goal, left, wide(tau[at]));
            assert_equal("goal", &pull[2 * at..2 * at + 2], wanted.as_slice());
            for slot in at * slots..(at + 1) * slots {
                let other = Point2::new(wide(given[4 * slot]), wide(given[4 * slot + 1]));
                let wanted = vehicle_force(p - other, wide(k[slot]), cfg.r_col);
                assert_equal("neighbour", &pushes[2 * slot..2 * slot + 2], wanted.as_slice());
            }
            for i in 0..line_count {
                let line = &lines[3 * (window * line_count + i)..][..3];
                let kind = if line[1] == 0. { MarkingKind::LaneDivider } else { MarkingKind::Boundary };
                let side = if line[2] < 0. { Side::Right } else { Side::Left };
                let wanted = line_force(kind, p.y - wide(line[0]), wide(k_line[at * line_count + i]), side);
                assert_equal("line", &lateral[2 * (at * line_count + i)..][..2], &[0., wanted]);
            }
        }
    }
    Ok(())
}
