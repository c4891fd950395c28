//! The fused roll-out is the graph's: same paths, same forces, same gradients; and the same bits on any
//! number of threads.

use candle_core::{Device, Tensor, Var};
use gnp_nn::Weights;
use gnp_traj::{
    Engine, Integrator, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TrajConfig, TrajError,
};

use crate::scenes::{Gradients, Outcome, assert_close, gradients, network, scene, small, uniform, values};

/// The path and the gradients of a loss that weighs every coordinate differently.
fn outcome(
    (network, weights): &(SocialForce, Weights),
    engine: Engine,
    scene: &RollOutBatch,
    phase: Phase,
) -> Outcome<(Vec<f32>, Gradients)> {
    let path = network.roll_out_on(engine, scene, phase)?;
    let rng = &mut rand::SeedableRng::seed_from_u64(9);
    let pull = uniform(rng, path.dims(), -1., 1.)?;
    let loss = ((path.sqr()? * 0.05)? + (&path * pull)?)?.sum_all()?;
    Ok((values(&path)?, gradients(weights, &loss)?))
}

fn assert_same(cfg: &TrajConfig, scene: &RollOutBatch, phase: Phase) -> Outcome {
    let network = network(cfg, 7)?;
    let (wanted_path, wanted) = outcome(&network, Engine::Graph, scene, phase)?;
    let (path, found) = outcome(&network, Engine::Fused, scene, phase)?;
    assert_close("path", &path, &wanted_path, 1e-5);
    for ((name, wanted), (_, found)) in wanted.into_iter().zip(found) {
        assert_eq!(wanted.is_some(), found.is_some(), "{name} in {phase:?}");
        if let (Some(wanted), Some(found)) = (wanted, found) {
            assert!(wanted.iter().any(|&v| v != 0.), "{name} in {phase:?}: the test does not reach it");
            assert_close(&name, &found, &wanted, 1e-4);
        }
    }
    Ok(())
}

#[test]
fn paths_and_gradients_are_those_of_the_graph() -> Outcome {
    for phase in [Phase::Attraction, Phase::Repulsion, Phase::Full] {
        for (goals, integrator, network_period) in [
            (1, Integrator::SemiImplicitEuler, 1),
            (3, Integrator::ExplicitEuler, 1),
            (2, Integrator::SemiImplicitEuler, 3),
        ] {
            assert_same(&TrajConfig { integrator, network_period, ..small() }, &scene(5, goals, 11)?, phase)?;
        }
    }
    Ok(())
}

#[test]
fn a_path_without_a_gradient_has_the_bits_of_one_with_it() -> Outcome {
    for (goals, network_period) in [(1, 1), (3, 1), (4, 3)] {
        let (force, _) = network(&TrajConfig { network_period, ..small() }, 7)?;
        let scene = scene(5, goals, 11)?;
        for phase in [Phase::Attraction, Phase::Repulsion, Phase::Full] {
            let recorded = values(&force.roll_out_on(Engine::Fused, &scene, phase)?)?;
            assert_eq!(values(&force.predict(&scene, phase)?)?, recorded, "{goals} goals in {phase:?}");
            let explained = force.roll_out_explained_on(Engine::Fused, &scene, phase)?;
            assert_eq!(values(&explained.path)?, recorded, "{goals} goals in {phase:?}, explained");
        }
    }
    Ok(())
}

#[test]
fn a_frozen_network_gives_the_same_bits_whatever_becomes_of_the_weights_it_was_made_from() -> Outcome {
    let (network, weights) = network(&small(), 7)?;
    let frozen = network.frozen()?;
    let scene = scene(20, 2, 11)?;
    let wanted = values(&network.predict(&scene, Phase::Full)?)?;
    for (_, var) in weights.named() {
        var.set(&(var.as_tensor() * 2.)?)?;
    }
    assert_ne!(values(&network.predict(&scene, Phase::Full)?)?, wanted);
    assert_eq!(values(&frozen.predict(&scene, Phase::Full)?)?, wanted);
    assert_eq!(values(&frozen.roll_out_explained(&scene, Phase::Full)?.path)?, wanted);
    assert_close("graph", &values(&frozen.roll_out_on(Engine::Graph, &scene, Phase::Full)?)?, &wanted, 1e-5);
    // Goals may ask for a gradient still.
    let goals = Var::from_tensor(&scene.goals)?;
    let path = frozen.roll_out(&RollOutBatch { goals: goals.as_tensor().clone(), ..scene.clone() }, Phase::Full)?;
    assert_eq!(values(&path)?, wanted);
    assert!(path.sqr()?.sum_all()?.backward()?.get(&goals).is_some());
    Ok(())
}

/// Losses of an epoch of gradient descent on 24 mini-batches, each of windows of its own.
fn epoch(engine: Engine) -> Outcome<Vec<f32>> {
    let (network, weights) = network(&small(), 7)?;
    let mut losses = Vec::new();
    for batch in 0..24 {
        let scene = scene(6, 1, 100 + batch)?;
        let truth = uniform(&mut rand::SeedableRng::seed_from_u64(batch), &[6, 1, scene.steps, 2], -2., 2.)?;
        let loss = (network.roll_out_on(engine, &scene, Phase::Full)? - truth)?.sqr()?.mean_all()?;
        let gradients = loss.backward()?;
        for (name, var) in weights.named() {
            let gradient = gradients.get(&var).ok_or(format!("no gradient for {name}"))?;
            var.set(&(var.as_tensor() - (gradient * 5e-3)?)?)?;
        }
        losses.push(loss.to_scalar()?);
    }
    Ok(losses)
}

/// The gradients of the path in goals and observations.
fn input_gradients(engine: Engine, batch: &RollOutBatch, phase: Phase, cfg: &TrajConfig) -> Outcome<[Vec<f32>; 2]> {
    let (network, _) = network(cfg, 7)?;
    let (goals, observed) = (Var::from_tensor(&batch.goals)?, Var::from_tensor(&batch.observed)?);
    let tracked =
        RollOutBatch { goals: goals.as_tensor().clone(), observed: observed.as_tensor().clone(), ..batch.clone() };
    let path = network.roll_out_on(engine, &tracked, phase)?;
    let pull = uniform(&mut rand::SeedableRng::seed_from_u64(9), path.dims(), -1., 1.)?;
    let gradients = (((path.sqr()? * 0.05)? + (&path * pull)?)?).sum_all()?.backward()?;
    let of = |var: &Var| gradients.get(var).ok_or("no gradient").map(values);
    Ok([of(&goals)??, of(&observed)??])
}

#[test]
fn goals_and_observations_get_the_graphs_gradients() -> Outcome {
    for phase in [Phase::Attraction, Phase::Repulsion, Phase::Full] {
        for (goals, network_period) in [(1, 1), (3, 1), (2, 3)] {
            let (cfg, batch) = (TrajConfig { network_period, ..small() }, scene(21, goals, 31)?);
            let wanted = input_gradients(Engine::Graph, &batch, phase, &cfg)?;
            let found = input_gradients(Engine::Fused, &batch, phase, &cfg)?;
            for (name, (found, wanted)) in ["goals", "observed"].iter().zip(found.iter().zip(&wanted)) {
                assert!(wanted.iter().any(|&v| v != 0.), "{name} in {phase:?}: the test does not reach it");
                assert_close(name, found, wanted, 1e-4);
            }
        }
    }
    Ok(())
}

/// Independent of the graph: the change of a loss for a small change of one number.
#[test]
fn gradients_in_goals_and_observations_are_differences_of_the_path() -> Outcome {
    let (cfg, batch) = (small(), scene(2, 1, 32)?);
    let (network, _) = network(&cfg, 7)?;
    let loss = |batch: &RollOutBatch| -> Outcome<f64> {
        let path = values(&network.roll_out_on(Engine::Fused, batch, Phase::Full)?)?;
        let pull = values(&uniform(&mut rand::SeedableRng::seed_from_u64(9), &[2, 1, batch.steps, 2], -1., 1.)?)?;
        Ok(path.iter().zip(pull).map(|(x, pull)| f64::from(0.05 * x * x + x * pull)).sum())
    };
    let [dgoals, dobserved] = input_gradients(Engine::Fused, &batch, Phase::Full, &cfg)?;
    let step = 1e-2;
    let moved = |x: &Tensor, i: usize, by: f32| -> Outcome<Tensor> {
        let mut numbers = values(x)?;
        numbers[i] += by;
        Ok(Tensor::from_vec(numbers, x.shape(), &Device::Cpu)?)
    };
    // A goal's x and y; the last observed state, and an earlier one.
    for i in [0, 1, 2, 3] {
        let at = |by| loss(&RollOutBatch { goals: moved(&batch.goals, i, by)?, ..batch.clone() });
        let wanted = (at(step)? - at(-step)?) / f64::from(2. * step);
        assert!(
            (f64::from(dgoals[i]) - wanted).abs() < 2e-2 * wanted.abs().max(0.1),
            "goal {i}: {}, {wanted}",
            dgoals[i]
        );
    }
    for i in [4, 7, 12, 13, 14, 15, 28, 31] {
        let at = |by| loss(&RollOutBatch { observed: moved(&batch.observed, i, by)?, ..batch.clone() });
        let (found, wanted) = (f64::from(dobserved[i]), (at(step)? - at(-step)?) / f64::from(2. * step));
        assert!((found - wanted).abs() < 2e-2 * wanted.abs().max(0.1), "observed {i}: {found}, {wanted}");
    }
    Ok(())
}

#[test]
fn a_gradient_that_only_the_graph_has_is_refused_or_left_to_it() -> Outcome {
    let (network, _) = network(&small(), 7)?;
    let mut batch = scene(3, 1, 33)?;
    let Some(Neighbours { states: NeighbourStates::Given(states), .. }) = &mut batch.neighbours else {
        return Err("no neighbours".into());
    };
    let tracked = Var::from_tensor(states)?;
    *states = tracked.as_tensor().clone();
    let refused = network.roll_out_on(Engine::Fused, &batch, Phase::Full);
    assert!(matches!(refused, Err(TrajError::Batch { name: "neighbours.states", .. })), "{refused:?}");
    assert_eq!(network.engine(&batch, Phase::Full), Engine::Graph);
    let gradients = network.roll_out(&batch, Phase::Full)?.sqr()?.sum_all()?.backward()?;
    assert!(gradients.get(&tracked).is_some());
    // Without a gradient nothing is missing.
    assert_eq!(network.engine(&batch, Phase::Attraction), Engine::Fused);
    network.predict(&batch, Phase::Full)?;
    Ok(())
}

#[test]
fn an_epoch_of_training_has_the_graphs_losses() -> Outcome {
    let (fused, graph) = (epoch(Engine::Fused)?, epoch(Engine::Graph)?);
    for (batch, (fused, graph)) in fused.iter().zip(&graph).enumerate() {
        assert!((fused - graph).abs() < 1e-3 * graph, "batch {batch}: {fused} fused, {graph} as a graph");
    }
    // The weights must have moved for the comparison to say something.
    let (network, _) = network(&small(), 7)?;
    let scene = scene(6, 1, 123)?;
    let truth = uniform(&mut rand::SeedableRng::seed_from_u64(23), &[6, 1, scene.steps, 2], -2., 2.)?;
    let untrained: f32 = (network.roll_out(&scene, Phase::Full)? - truth)?.sqr()?.mean_all()?.to_scalar()?;
    assert!((untrained - fused[23]).abs() > 1e-2 * untrained, "{untrained} untrained, {} trained", fused[23]);
    Ok(())
}

#[test]
fn several_chunks_add_up() -> Outcome {
    assert_same(&small(), &scene(75, 1, 12)?, Phase::Full)
}

#[test]
fn heads_of_one_and_two_hidden_layers_work_too() -> Outcome {
    let cfg = TrajConfig { decoder: vec![9], encoder: vec![7], hidden: 17, embedding: 16, latent_dim: 20, ..small() };
    assert_same(&cfg, &scene(3, 2, 13)?, Phase::Full)?;
    assert_same(&TrajConfig { decoder: vec![33, 5], ..cfg }, &scene(3, 2, 13)?, Phase::Full)
}

#[test]
fn windows_without_neighbours_or_lines_go_with_those_that_have_them() -> Outcome {
    let mut scene = scene(4, 2, 14)?;
    let there = Tensor::new(&[[0f32], [1.], [0.], [1.]], &Device::Cpu)?;
    if let Some(neighbours) = &mut scene.neighbours {
        neighbours.present = neighbours.present.broadcast_mul(&there)?;
    }
    if let Some(lines) = &mut scene.lines {
        lines.present = lines.present.broadcast_mul(&(1. - there)?)?;
    }
    assert_same(&small(), &scene, Phase::Full)
}

#[test]
fn a_batch_where_nobody_pushes_is_rolled_out() -> Outcome {
    let mut scene = scene(4, 2, 14)?;
    if let Some(neighbours) = &mut scene.neighbours {
        neighbours.present = neighbours.present.zeros_like()?;
    }
    let cfg = TrajConfig { lines: false, ..small() };
    let (network, _) = network(&cfg, 7)?;
    let wanted = values(&network.roll_out_on(Engine::Graph, &scene, Phase::Full)?)?;
    assert_close("path", &values(&network.roll_out_on(Engine::Fused, &scene, Phase::Full)?)?, &wanted, 1e-5);
    scene.neighbours = None;
    assert_close("path", &values(&network.roll_out_on(Engine::Fused, &scene, Phase::Full)?)?, &wanted, 1e-5);
    Ok(())
}

#[test]
fn the_reported_parts_are_those_of_the_graph() -> Outcome {
    let (network, _) = network(&TrajConfig { network_period: 2, ..small() }, 7)?;
    let scene = scene(35, 2, 15)?;
    let wanted = network.roll_out_explained_on(Engine::Graph, &scene, Phase::Full)?;
    let found = network.roll_out_explained_on(Engine::Fused, &scene, Phase::Full)?;
    let same = |name: &str, found: &Tensor, wanted: &Tensor| -> Outcome {
        assert_eq!(found.dims(), wanted.dims(), "{name}");
        assert_close(name, &values(found)?, &values(wanted)?, 2e-5);
        Ok(())
    };
    same("path", &found.path, &wanted.path)?;
    same("velocity", &found.velocity, &wanted.velocity)?;
    assert_eq!(found.terms.iter().map(|term| &*term.term.name).collect::<Vec<_>>(), ["goal", "neighbours", "lines"]);
    for (found, wanted) in found.terms.iter().zip(&wanted.terms) {
        assert_eq!(found.term, wanted.term);
        same(&found.term.name, &found.forces, &wanted.forces)?;
        assert_eq!((found.parameters.len(), wanted.parameters.len()), (1, 1));
        same(&found.term.name, &found.parameters[0], &wanted.parameters[0])?;
    }
    Ok(())
}

#[test]
fn any_number_of_threads_gives_the_same_bits() -> Outcome {
    // Seven groups of windows: chunks of four, of three and of one.
    for goals in [1, 2] {
        let scene = scene(100, goals, 16)?;
        let on = |threads: usize| -> Outcome<_> {
            let network = network(&small(), 7)?;
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            pool.install(|| outcome(&network, Engine::Fused, &scene, Phase::Full).map_err(|e| e.to_string()))
                .map_err(Into::into)
        };
        let one = on(1)?;
        for threads in [2, 3, 9] {
            assert_eq!(on(threads)?, one, "{threads} threads, {goals} goals");
        }
    }
    Ok(())
}

#[test]
fn memory_that_was_used_before_does_not_show() -> Outcome {
    let network = network(&small(), 7)?;
    let first = outcome(&network, Engine::Fused, &scene(6, 1, 17)?, Phase::Full)?;
    outcome(&network, Engine::Fused, &scene(40, 2, 18)?, Phase::Full)?;
    assert_eq!(outcome(&network, Engine::Fused, &scene(6, 1, 17)?, Phase::Full)?, first);
    Ok(())
}

#[test]
fn predictions_are_the_path_without_a_gradient() -> Outcome {
    let (network, weights) = network(&small(), 7)?;
    let scene = scene(5, 2, 19)?;
    let path = network.predict(&scene, Phase::Full)?;
    assert_eq!(values(&path)?, values(&network.roll_out(&scene, Phase::Full)?)?);
    assert!(gradients(&weights, &path.sum_all()?)?.iter().all(|(_, gradient)| gradient.is_none()));
    Ok(())
}
