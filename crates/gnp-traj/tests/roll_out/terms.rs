//! Terms of the force that this crate does not know act in both engines as the networks' own do.

use std::collections::BTreeMap;
use std::sync::Arc;

use candle_core::{Device, Tensor, Var};
use gnp_force::na::{RealField, Vector2};
use gnp_force::{Arity, ForceTerm, Source, State, TermDescriptor, TermParameter, TermVjp};
use gnp_traj::{
    Engine, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TermConfig, TrajConfig, TrajError,
};

use crate::scenes::{Outcome, assert_close, gradients, network, scene, small, uniform, values};

/// A drag against the motion, `-c v`.
#[derive(Debug)]
struct Drag(TermDescriptor);

/// A spring to the velocity of the neighbour in slot 0, `c (v_j - v)`.
#[derive(Debug)]
struct Following(TermDescriptor);

fn drag() -> Arc<dyn ForceTerm<f32>> {
    let c = TermParameter::constant("c", "1/s", "drag per speed");
    Arc::new(Drag(TermDescriptor::new("drag", Arity::One, "#7a5195").with(vec![c])))
}

fn following() -> Arc<dyn ForceTerm<f32>> {
    let c = TermParameter::varying("c", "1/s", "response");
    Arc::new(Following(TermDescriptor::new("following", Arity::PerNeighbour, "#7a5195").with(vec![c])))
}

impl<T: RealField + Copy> ForceTerm<T> for Drag {
    fn descriptor(&self) -> &TermDescriptor {
        &self.0
    }

    fn force(&self, state: &State<T>, _: &Source<T>, parameters: &[T]) -> Vector2<T> {
        let &[c] = parameters else { return Vector2::zeros() };
        -state.velocity * c
    }

    fn vjp(&self, state: &State<T>, _: &Source<T>, parameters: &[T], cotangent: Vector2<T>, d: &mut [T]) -> TermVjp<T> {
        let (&[c], [dc]) = (parameters, d) else { return TermVjp::zeros() };
        *dc = -state.velocity.dot(&cotangent);
        TermVjp { velocity: -cotangent * c, ..TermVjp::zeros() }
    }
}

impl<T: RealField + Copy> ForceTerm<T> for Following {
    fn descriptor(&self) -> &TermDescriptor {
        &self.0
    }

    fn force(&self, state: &State<T>, source: &Source<T>, parameters: &[T]) -> Vector2<T> {
        match (source, parameters) {
            (Source::Vehicle { slot: 0, state: leader }, &[c]) => (leader.velocity - state.velocity) * c,
            _ => Vector2::zeros(),
        }
    }

    fn vjp(
        &self,
        state: &State<T>,
        source: &Source<T>,
        parameters: &[T],
        cotangent: Vector2<T>,
        d: &mut [T],
    ) -> TermVjp<T> {
        match (source, parameters, d) {
            (Source::Vehicle { slot: 0, state: leader }, &[c], [dc]) => {
                *dc = (leader.velocity - state.velocity).dot(&cotangent);
                TermVjp { velocity: -cotangent * c, source_velocity: cotangent * c, ..TermVjp::zeros() }
            }
            _ => TermVjp::zeros(),
        }
    }
}

/// The network with both terms.
fn with_terms(cfg: &TrajConfig) -> Outcome<(SocialForce, gnp_nn::Weights)> {
    let (network, weights) = network(cfg, 7)?;
    Ok((network.with_term(drag(), &[0.3])?.with_term(following(), &[0.4])?, weights))
}

#[test]
fn both_engines_give_one_path_and_the_same_gradients() -> Outcome {
    for phase in [Phase::Attraction, Phase::Repulsion, Phase::Full] {
        let (network, weights) = with_terms(&small())?;
        let batch = scene(19, 2, 41)?;
        let (goals, observed) = (Var::from_tensor(&batch.goals)?, Var::from_tensor(&batch.observed)?);
        let tracked =
            RollOutBatch { goals: goals.as_tensor().clone(), observed: observed.as_tensor().clone(), ..batch };
        let outcome = |engine: Engine| -> Outcome<_> {
            let path = network.roll_out_on(engine, &tracked, phase)?;
            let pull = uniform(&mut rand::SeedableRng::seed_from_u64(9), path.dims(), -1., 1.)?;
            let loss = ((path.sqr()? * 0.05)? + (&path * pull)?)?.sum_all()?;
            let inputs = loss.backward()?;
            let of = |var: &Var| inputs.get(var).ok_or("no gradient").map(values);
            Ok((values(&path)?, gradients(&weights, &loss)?, [of(&goals)??, of(&observed)??]))
        };
        let (wanted_path, wanted, wanted_inputs) = outcome(Engine::Graph)?;
        // One backward pass a roll-out: the fused one passes both gradients back at once, so they are asked for apart.
        let path = values(&network.roll_out_on(Engine::Fused, &tracked, phase)?)?;
        assert_close("path", &path, &wanted_path, 1e-5);
        let pulled = || -> Outcome<Tensor> {
            let path = network.roll_out_on(Engine::Fused, &tracked, phase)?;
            let pull = uniform(&mut rand::SeedableRng::seed_from_u64(9), path.dims(), -1., 1.)?;
            Ok(((path.sqr()? * 0.05)? + (&path * pull)?)?.sum_all()?)
        };
        for ((name, found), (_, wanted)) in gradients(&weights, &pulled()?)?.into_iter().zip(wanted) {
            assert_eq!(found.is_some(), wanted.is_some(), "{name} in {phase:?}");
            if let (Some(found), Some(wanted)) = (found, wanted) {
                assert_close(&name, &found, &wanted, 1e-4);
            }
        }
        let inputs = pulled()?.backward()?;
        for (name, (var, wanted)) in
            ["goals", "observed"].iter().zip([&goals, &observed].into_iter().zip(&wanted_inputs))
        {
            assert_close(name, &values(inputs.get(var).ok_or("no gradient")?)?, wanted, 1e-4);
        }
        // The terms do something.
        let plain = crate::scenes::network(&small(), 7)?.0.roll_out(&tracked, phase)?;
        let change = values(&plain)?.iter().zip(&path).map(|(a, b)| (a - b).abs()).fold(0f32, f32::max);
        assert!(change > 0.05, "{change} m in {phase:?}");
    }
    Ok(())
}

#[test]
fn joint_neighbours_get_the_gradient_of_a_term() -> Outcome {
    let (network, _) = network(&TrajConfig { lines: false, ..small() }, 4)?;
    let network = network.with_term(following(), &[0.4])?;
    let observed = Var::from_tensor(&uniform(&mut rand::SeedableRng::seed_from_u64(3), &[2, 3, 4], 1., 9.)?)?;
    let batch = RollOutBatch {
        observed: observed.as_tensor().clone(),
        goals: Tensor::new(&[[[7f32, 0.]], [[7., 0.]]], &Device::Cpu)?,
        neighbours: Some(Neighbours {
            states: NeighbourStates::Joint {
                index: Tensor::new(&[[1u32], [0]], &Device::Cpu)?,
                offset: Tensor::new(&[[[0f32, 3.]], [[0., -3.]]], &Device::Cpu)?,
            },
            present: Tensor::new(&[[1f32], [0.]], &Device::Cpu)?,
        }),
        lines: None,
        dt: 0.1,
        steps: 4,
    };
    // The first follows the second, and only the first is looked at.
    let path = network.roll_out(&batch, Phase::Attraction)?;
    let gradients = path.narrow(0, 0, 1)?.sum_all()?.backward()?;
    let gradient = values(gradients.get(&observed).ok_or("no gradient")?)?;
    assert!(gradient[12..].iter().any(|&v| v != 0.), "{gradient:?}");
    Ok(())
}

#[test]
fn terms_are_reported_and_add_up_to_the_acceleration() -> Outcome {
    let (network, _) = with_terms(&small())?;
    let batch = scene(3, 2, 42)?;
    let mut all_held = Vec::new();
    for engine in [Engine::Graph, Engine::Fused] {
        let out = network.roll_out_explained_on(engine, &batch, Phase::Full)?;
        let names: Vec<&str> = out.terms.iter().map(|term| &*term.term.name).collect();
        assert_eq!(names, ["goal", "neighbours", "lines", "drag", "following"]);
        assert_eq!(out.terms[3].forces.dims(), [3, 2, 7, 1, 2]);
        assert!(out.terms[3].parameters.is_empty(), "what does not vary is not reported");
        let held = values(out.terms[4].parameter("c").ok_or("no c")?)?;
        assert!(held.iter().all(|&c| c == 0.4 || c == 0.) && held.contains(&0.4), "{held:?}");
        all_held.push(held);
        let mut force = out.path.zeros_like()?;
        for term in &out.terms {
            force = (force + term.forces.sum(3)?)?;
        }
        let start = batch.observed.narrow(1, 3, 1)?.narrow(2, 2, 2)?.unsqueeze(1)?.broadcast_as((3, 2, 1, 2))?;
        let before = Tensor::cat(&[&start.contiguous()?, &out.velocity.narrow(2, 0, 6)?], 2)?;
        let acceleration = ((&out.velocity - before)? / batch.dt)?;
        assert_close("force", &values(&force)?, &values(&acceleration)?, 1e-4);
    }
    assert_eq!(all_held[0], all_held[1], "0 in empty slots");
    Ok(())
}

#[test]
fn a_term_of_gnp_force_acts_by_its_name() -> Outcome {
    let k = |value| TermConfig { name: "lines".to_owned(), parameters: BTreeMap::from([("k".to_owned(), value)]) };
    let cfg = |terms| TrajConfig { lines: false, terms, ..small() };
    let batch = scene(4, 1, 43)?;
    let (network, _) = network(&cfg(vec![k(0.3)]), 7)?;
    let mut paths = Vec::new();
    for engine in [Engine::Graph, Engine::Fused] {
        let out = network.roll_out_explained_on(engine, &batch, Phase::Attraction)?;
        let lines = out.term("lines").ok_or("no lines")?;
        assert!(values(&lines.forces)?.iter().any(|&force| force != 0.));
        paths.push(values(&out.path)?);
    }
    assert_close("path", &paths[0], &paths[1], 1e-5);
    Ok(())
}

#[test]
fn a_term_without_its_sources_and_a_false_published_one_are_refused() -> Outcome {
    let (network, _) = network(&TrajConfig { lines: false, ..small() }, 7)?;
    let batch = RollOutBatch { neighbours: None, lines: None, ..scene(2, 1, 44)? };
    let alone = network.clone().with_term(following(), &[0.4])?;
    let refused = alone.roll_out(&batch, Phase::Full);
    assert!(matches!(refused, Err(TrajError::Batch { name: "neighbours", .. })));
    let c = TermParameter::constant("c", "1/s", "drag per speed");
    let false_lines = Arc::new(Drag(TermDescriptor::new("lines", Arity::One, "#7a5195").with(vec![c])));
    assert!(matches!(network.with_term(false_lines, &[0.1]), Err(TrajError::Term { name, .. }) if name == "lines"));
    Ok(())
}

#[test]
fn terms_that_cannot_act_are_refused_by_name() -> Outcome {
    let term = |name: &str, parameters: &[(&str, f64)]| TermConfig {
        name: name.to_owned(),
        parameters: parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
    };
    let refused = |terms: Vec<TermConfig>| match network(&TrajConfig { terms, ..small() }, 7) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    };
    assert!(refused(vec![term("gravity", &[])]).contains("there are goal, neighbours, lines"));
    assert!(refused(vec![term("lines", &[])]).contains("`k`"));
    assert!(refused(vec![term("lines", &[("k", 1.), ("j", 2.)])]).contains("`j`"));
    let not_finite = refused(vec![term("lines", &[("k", f64::NAN)])]);
    assert!(not_finite.contains("terms.parameters"), "{not_finite}");
    assert!(refused(vec![term("lines", &[("k", 1.)])]).contains("acts already"));
    let (network, _) = network(&small(), 7)?;
    assert!(matches!(network.clone().with_term(drag(), &[]), Err(TrajError::Term { .. })));
    let twice = network.with_term(drag(), &[0.1])?.with_term(drag(), &[0.2]);
    assert!(matches!(twice, Err(TrajError::Term { name, .. }) if name == "drag"));
    Ok(())
}

/// Whatever is switched off: both engines give one path and the same gradients, and list what is left; what is off exerts
/// no force and asks for no weights.
#[test]
fn any_terms_can_be_switched_off() -> Outcome {
    const NAMES: [&str; 5] = ["goal", "neighbours", "lines", "drag", "following"];
    let (all, weights) = with_terms(&small())?;
    let batch = scene(11, 2, 45)?;
    for mask in 0..1 << NAMES.len() {
        let (off, on): (Vec<_>, Vec<_>) =
            NAMES.into_iter().enumerate().partition::<Vec<_>, _>(|(i, _)| mask & (1 << i) != 0);
        let [off, on] = [off, on].map(|names| names.into_iter().map(|(_, name)| name).collect::<Vec<_>>());
        let network = all.clone().without_terms(&off)?;
        let outcome = |engine: Engine| -> Outcome<_> {
            let told = network.roll_out_explained_on(engine, &batch, Phase::Full)?;
            let names: Vec<String> = told.terms.iter().map(|term| term.term.name.to_string()).collect();
            assert_eq!(names, on, "{engine:?}");
            let path = network.roll_out_on(engine, &batch, Phase::Full)?;
            assert_close("explained", &values(&told.path)?, &values(&path)?, 1e-5);
            let loss = ((path.sqr()? * 0.05)? + &path)?.sum_all()?;
            Ok((values(&path)?, gradients(&weights, &loss)?))
        };
        let ((wanted, wanted_gradients), (path, found)) = (outcome(Engine::Graph)?, outcome(Engine::Fused)?);
        assert_close(&format!("path without {off:?}"), &path, &wanted, 1e-5);
        for ((name, found), (_, wanted)) in found.into_iter().zip(wanted_gradients) {
            let zeros = || vec![0.; found.as_ref().or(wanted.as_ref()).map_or(0, Vec::len)];
            let [found, wanted] = [found.clone(), wanted.clone()].map(|gradient| gradient.unwrap_or_else(zeros));
            assert_close(&format!("{name} without {off:?}"), &found, &wanted, 1e-4);
        }
        // With nothing at all the velocity stays.
        if on.is_empty() {
            let start = batch.observed.narrow(1, 3, 1)?.broadcast_as((11, 2, 4))?;
            for step in 1..=batch.steps {
                let along = (start.narrow(2, 2, 2)? * (step as f64 * batch.dt))?;
                let straight = (start.narrow(2, 0, 2)? + along)?;
                let now = network.roll_out(&batch, Phase::Full)?.narrow(2, step - 1, 1)?.squeeze(2)?;
                assert_close("straight", &values(&now)?, &values(&straight)?, 1e-5);
            }
        }
    }
    let twice = all.clone().without_terms(&["goal"])?.without_terms(&["lines"])?;
    let once = all.clone().without_terms(&["lines", "goal"])?;
    let path = |network: &SocialForce| -> Outcome<_> { Ok(values(&network.predict(&batch, Phase::Full)?)?) };
    assert_eq!(path(&twice)?, path(&once)?);
    assert_eq!(twice.term_descriptors().map(|term| &*term.name).collect::<Vec<_>>(), NAMES);
    match all.without_terms(&["drag", "gravity"]) {
        Err(TrajError::Term { name, problem }) => {
            assert!(name == "gravity" && problem.contains("goal, neighbours, lines, drag, following"), "{problem}");
        }
        other => return Err(format!("{other:?}").into()),
    }
    Ok(())
}
