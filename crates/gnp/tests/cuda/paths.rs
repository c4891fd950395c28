//! The roll-out: paths, forces and gradients.

use candle_core::{Device, Tensor};
use gnp_nn::Weights;
use gnp_traj::{Lines, NeighbourStates, Neighbours, Phase, RollOutBatch, SocialForce, TermConfig, TrajConfig};

use crate::scenes::{scene, small};
use crate::{all_close, close, gpu, gradients, on, values};

pub(crate) fn moved(batch: &RollOutBatch, device: &Device) -> RollOutBatch {
    let to = |tensor: &Tensor| tensor.to_device(device).unwrap();
    let neighbours = batch.neighbours.as_ref().map(|neighbours| Neighbours {
        states: match &neighbours.states {
            NeighbourStates::Given(states) => NeighbourStates::Given(to(states)),
            NeighbourStates::Joint { index, offset } => NeighbourStates::Joint { index: to(index), offset: to(offset) },
        },
        present: to(&neighbours.present),
    });
    let lines = batch.lines.as_ref().map(|lines| Lines { lines: to(&lines.lines), present: to(&lines.present) });
    RollOutBatch { observed: to(&batch.observed), goals: to(&batch.goals), neighbours, lines, ..*batch }
}

/// Compares everything that a roll-out of `batch` gives.
fn compare(cfg: &TrajConfig, batch: &RollOutBatch, phase: Phase) {
    let weights = Weights::seeded(7, &Device::Cpu);
    SocialForce::new(cfg, weights.builder()).unwrap();
    let run = |device: &Device| {
        let (weights, batch) = (on(device, &weights), moved(batch, device));
        let network = SocialForce::new(cfg, weights.builder()).unwrap();
        let learn = || {
            let path = network.roll_out(&batch, phase).unwrap();
            let found = gradients(&weights, &path.sqr().unwrap().mean_all().unwrap());
            (path, found)
        };
        // The second time a GPU launches what it recorded.
        let (first, (path, found)) = (learn(), learn());
        assert_eq!(values(&first.0), values(&path));
        assert_eq!(first.1, found);
        let trained: Vec<String> = found.keys().filter(|name| network.trains(phase, name)).cloned().collect();
        let explained = network.roll_out_explained(&batch, phase).unwrap();
        let mut given = vec![("path".to_owned(), values(&path)), ("velocity".to_owned(), values(&explained.velocity))];
        for term in &explained.terms {
            given.push((term.term.name.to_string(), values(&term.forces)));
            given.extend(term.parameters.iter().map(|parameter| (format!("of {}", term.term.name), values(parameter))));
        }
        let found = trained.into_iter().map(|name| (name.clone(), found[&name].clone())).collect();
        (given, values(&network.predict(&batch, phase).unwrap()), found)
    };
    let ((found, predicted, gradients), (wanted, _, wanted_gradients)) = (run(gpu()), run(&Device::Cpu));
    assert_eq!(predicted, found[0].1, "without gradients the path is another");
    for ((name, found), (_, wanted)) in found.iter().zip(&wanted) {
        close(name, found, wanted, 1e-4);
    }
    all_close(&gradients, &wanted_gradients, 1e-3);
}

#[test]
fn paths_forces_and_gradients_are_those_of_the_cpu() {
    for phase in [Phase::Attraction, Phase::Repulsion, Phase::Full] {
        compare(&small(), &scene(37, 1, 3).unwrap(), phase);
    }
}

#[test]
fn so_are_they_with_several_goals_and_networks_that_rest() {
    compare(&TrajConfig { network_period: 3, ..small() }, &scene(9, 4, 5).unwrap(), Phase::Full);
}

#[test]
fn so_are_they_at_the_published_sizes() {
    let batch = RollOutBatch { lines: None, ..scene(64, 1, 6).unwrap() };
    compare(&TrajConfig::published(), &batch, Phase::Full);
}

#[test]
fn so_are_those_of_windows_that_are_rolled_out_together() {
    let mut batch = scene(12, 2, 8).unwrap();
    let index: Vec<u32> = (0..12 * 5).map(|i| (i * 7 % 12) as u32).collect();
    let neighbours = batch.neighbours.as_mut().unwrap();
    let offset = crate::scenes::uniform(&mut rand::SeedableRng::seed_from_u64(9), &[12, 5, 2], -20., 20.).unwrap();
    neighbours.states =
        NeighbourStates::Joint { index: Tensor::from_vec(index, (12, 5), &Device::Cpu).unwrap(), offset };
    compare(&small(), &batch, Phase::Full);
}

#[test]
fn so_is_a_term_that_acts_on_the_host() {
    let term = TermConfig { name: "lines".to_owned(), parameters: [("k".to_owned(), 0.3)].into() };
    let cfg = TrajConfig { lines: false, terms: vec![term], ..small() };
    compare(&cfg, &scene(6, 1, 4).unwrap(), Phase::Full);
}
