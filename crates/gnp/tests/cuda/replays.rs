//! Computations that are recorded once.

use candle_core::{Result, Tensor};
use gnp_nn::{Replay, Weights};
use gnp_traj::{NeighbourStates, Phase, RollOutBatch, SocialForce};

use crate::paths::moved;
use crate::scenes::{scene, small};
use crate::{gpu, values};

#[test]
fn a_recorded_step_gives_the_bits_of_one_that_is_not() {
    let weights = Weights::seeded(7, gpu());
    let network = SocialForce::new(&small(), weights.builder()).unwrap();
    let named = weights.named();
    let [first, second] = [3, 4].map(|seed| moved(&scene(21, 1, seed).unwrap(), gpu()));
    let inputs = |batch: &RollOutBatch| {
        let Some(NeighbourStates::Given(states)) = batch.neighbours.as_ref().map(|it| it.states.clone()) else {
            panic!("neighbours are given")
        };
        [batch.observed.clone(), batch.goals.clone(), states]
    };
    let step = |given: &[Tensor]| -> Result<Vec<Tensor>> {
        let mut batch = first.clone();
        (batch.observed, batch.goals) = (given[0].clone(), given[1].clone());
        batch.neighbours.as_mut().unwrap().states = NeighbourStates::Given(given[2].clone());
        let path = network.roll_out(&batch, Phase::Full).map_err(candle_core::Error::wrap)?;
        let loss = path.sqr()?.mean_all()?;
        let gradients = loss.backward()?;
        let mut all = vec![loss, path];
        all.extend(named.values().filter_map(|var| gradients.get(var).cloned()));
        Ok(all)
    };
    let recorded = Replay::record(gpu(), &inputs(&first), step).unwrap();
    for batch in [&second, &first, &second] {
        let found: Vec<Vec<f32>> = recorded.run(&inputs(batch)).unwrap().iter().map(values).collect();
        let wanted: Vec<Vec<f32>> = step(&inputs(batch)).unwrap().iter().map(values).collect();
        assert!(found == wanted);
        assert_eq!(found.len(), 2 + named.len());
        // Weights are used where they are.
        let weight = named.values().next().unwrap();
        weight.set(&(weight.as_tensor() * 1.01).unwrap()).unwrap();
    }
}
