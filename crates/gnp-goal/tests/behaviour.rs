//! What must hold for every form of the network.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use candle_core::{DType, Device, Tensor};
use gnp_goal::{
    GoalConfig, GoalError, GoalNet, GoalOutput, GoalShape, GoalWorkspace, LabelConfig, LabelDistance, Labels,
    LossWeights, Pick, ProbabilityHead, Regression, goal_loss, labels,
};
use gnp_nn::{Dropout, Weights};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SHAPE: GoalShape = GoalShape { observed: 13, neighbour: 11, slots: 5, t_pred: 6 };
const BATCH: usize = 4;
const MODES: usize = 9;

fn published() -> GoalConfig {
    GoalConfig {
        width: 12,
        heads: 3,
        layers: 2,
        feed_forward: 2,
        dropout: 0.2,
        probability: ProbabilityHead::Encoder,
        regression: Regression::Absolute,
        null_token: false,
        slot_embedding: false,
        zero_start: false,
    }
}

fn ours() -> GoalConfig {
    GoalConfig {
        probability: ProbabilityHead::Decoder,
        regression: Regression::Residual,
        null_token: true,
        slot_embedding: true,
        zero_start: false,
        ..published()
    }
}

fn random(shape: &[usize], seed: u64) -> Tensor {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1. ..1.)).collect();
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// Window 0 has neighbours in slots 0 and 2, 1 in slot 3, 2 everywhere, 3 none.
fn mask() -> Tensor {
    let rows = [[1f32, 0., 1., 0., 0.], [0., 0., 0., 1., 0.], [1.; 5], [0.; 5]];
    Tensor::new(&rows, &Device::Cpu).unwrap()
}

struct Case {
    net: GoalNet,
    weights: Weights,
    observed: Tensor,
    neighbours: Tensor,
    mask: Tensor,
    modes: Tensor,
}

impl Case {
    fn new(config: &GoalConfig) -> Self {
        let weights = Weights::seeded(5, &Device::Cpu);
        Self {
            net: GoalNet::new(config, SHAPE, weights.builder()).unwrap(),
            weights,
            observed: random(&[BATCH, SHAPE.observed], 1),
            neighbours: random(&[BATCH, SHAPE.slots, SHAPE.neighbour], 2),
            mask: mask(),
            modes: random(&[MODES, SHAPE.t_pred, 2], 3),
        }
    }

    fn run(&self, pick: &Pick) -> GoalOutput {
        self.net.forward(&self.observed, &self.neighbours, &self.mask, &self.modes, pick, None).unwrap()
    }
}

fn values(x: &Tensor) -> Vec<f32> {
    x.flatten_all().unwrap().to_vec1().unwrap()
}

fn close(a: &Tensor, b: &Tensor) -> bool {
    a.dims() == b.dims() && values(a).iter().zip(values(b)).all(|(a, b)| (a - b).abs() < 1e-5)
}

#[test]
fn shapes_are_as_documented() {
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let output = case.run(&Pick::MostProbable(7));
        assert_eq!(output.logits.dims(), [BATCH, MODES]);
        assert_eq!(output.futures.dims(), [BATCH, 7, SHAPE.t_pred, 2]);
        assert_eq!(output.indices.dims(), [BATCH, 7]);
    }
}

#[test]
fn goals_come_likeliest_first_and_sum_to_one() {
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let goals = case.net.predict(&case.observed, &case.neighbours, &case.mask, &case.modes, 4).unwrap();
        let logits = case.run(&Pick::MostProbable(1)).logits.to_vec2::<f32>().unwrap();
        let indices = goals.indices.to_vec2::<u32>().unwrap();
        for (row, probabilities) in goals.probabilities.to_vec2::<f32>().unwrap().iter().enumerate() {
            assert!((probabilities.iter().sum::<f32>() - 1.).abs() < 1e-6);
            assert!(probabilities.is_sorted_by(|a, b| a >= b), "{probabilities:?}");
            let ratio = (logits[row][indices[row][0] as usize] - logits[row][indices[row][3] as usize]).exp();
            assert!((probabilities[0] / probabilities[3] - ratio).abs() < 1e-4 * ratio);
            let least = logits[row][indices[row][3] as usize];
            assert_eq!(logits[row].iter().filter(|logit| **logit > least).count(), 3);
        }
    }
}

/// Windows with some neighbours, all and none, and two networks, in one memory.
#[test]
fn a_packed_network_ends_where_the_network_does() {
    let mut work = GoalWorkspace::default();
    for config in [published(), ours(), GoalConfig { probability: ProbabilityHead::Encoder, ..ours() }] {
        let case = Case::new(&config);
        let packed = case.net.packed(&case.modes).unwrap();
        assert_eq!((packed.modes(), packed.shape()), (MODES, SHAPE));
        let goals = case.net.predict(&case.observed, &case.neighbours, &case.mask, &case.modes, MODES).unwrap();
        let ends = goals.futures.narrow(2, SHAPE.t_pred - 1, 1).unwrap();
        for window in 0..BATCH {
            let [observed, mut neighbours, mask, ends, probabilities] =
                [&case.observed, &case.neighbours, &case.mask, &ends, &goals.probabilities]
                    .map(|of_all| values(&of_all.get(window).unwrap()));
            let present: Vec<bool> = mask.iter().map(|there| *there > 0.).collect();
            for (row, _) in neighbours.chunks_exact_mut(SHAPE.neighbour).zip(&present).filter(|(_, there)| !**there) {
                row.fill(f32::NAN);
            }
            let found = packed.predict(&observed, &neighbours, &present, &mut work).unwrap();
            let all = found.points.as_flattened().iter().chain(found.probabilities);
            for (found, wanted) in all.zip(ends.iter().chain(&probabilities)) {
                assert!((found - wanted).abs() < 1e-5, "window {window}: {found} {wanted}");
            }
            assert_eq!((found.points.len(), found.probabilities.len()), (MODES, MODES));
        }
    }
}

#[test]
fn a_packed_network_names_what_does_not_fit() {
    let case = Case::new(&ours());
    let refused = case.net.packed(&random(&[MODES, SHAPE.t_pred + 1, 2], 3)).unwrap_err();
    assert!(matches!(refused, GoalError::Shape { name: "modes", .. }), "{refused}");
    let packed = case.net.packed(&case.modes).unwrap();
    let neighbours = SHAPE.slots * SHAPE.neighbour;
    for (observed, neighbours, slots, name) in [
        (SHAPE.observed + 1, neighbours, SHAPE.slots, "observed"),
        (SHAPE.observed, neighbours - 1, SHAPE.slots, "neighbours"),
        (SHAPE.observed, neighbours, 0, "present"),
    ] {
        let (observed, neighbours, present) = (vec![0.; observed], vec![0.; neighbours], vec![true; slots]);
        let error = packed.predict(&observed, &neighbours, &present, &mut GoalWorkspace::default()).unwrap_err();
        assert!(matches!(&error, GoalError::Shape { name: found, .. } if *found == name), "{error}");
    }
}

#[test]
fn picked_futures_do_not_depend_on_the_company() {
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let four = case.run(&Pick::MostProbable(4));
        let third = four.indices.narrow(1, 2, 1).unwrap().contiguous().unwrap();
        let alone = case.run(&Pick::Indices(third));
        assert!(close(&alone.futures, &four.futures.narrow(1, 2, 1).unwrap()));
    }
}

#[test]
fn windows_do_not_see_each_other() {
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let all = case.run(&Pick::MostProbable(3));
        for window in 0..BATCH {
            let one = |x: &Tensor| x.narrow(0, window, 1).unwrap().contiguous().unwrap();
            let (observed, neighbours, mask) = (one(&case.observed), one(&case.neighbours), one(&case.mask));
            let single =
                case.net.forward(&observed, &neighbours, &mask, &case.modes, &Pick::MostProbable(3), None).unwrap();
            assert!(close(&single.logits, &one(&all.logits)) && close(&single.futures, &one(&all.futures)));
        }
    }
}

#[test]
fn absent_neighbours_do_not_matter() {
    for config in [published(), ours(), GoalConfig { null_token: false, ..ours() }] {
        let mut case = Case::new(&config);
        let before = case.run(&Pick::MostProbable(3));
        let absent = (1. - mask()).unwrap().unsqueeze(2).unwrap();
        let noise = random(&[BATCH, SHAPE.slots, SHAPE.neighbour], 9).affine(1e3, 0.).unwrap();
        case.neighbours = (&case.neighbours + noise.broadcast_mul(&absent).unwrap()).unwrap();
        let after = case.run(&Pick::MostProbable(3));
        assert_eq!(values(&before.logits), values(&after.logits));
        assert_eq!(values(&before.futures), values(&after.futures));
    }
}

#[test]
fn present_neighbours_do_matter() {
    for config in [published(), ours()] {
        let mut case = Case::new(&config);
        let before = case.run(&Pick::MostProbable(2));
        case.neighbours = (&case.neighbours + 1.).unwrap();
        let after = case.run(&Pick::Indices(before.indices.clone()));
        let moved = |i: usize| !close(&before.futures.get(i).unwrap(), &after.futures.get(i).unwrap());
        assert_eq!([moved(0), moved(1), moved(2), moved(3)], [true, true, true, false]);
        // Only a probability head after the decoder sees them.
        assert_eq!(close(&before.logits, &after.logits), config.probability == ProbabilityHead::Encoder);
    }
}

#[test]
fn order_matters_only_with_a_slot_code() {
    for slot_embedding in [false, true] {
        let mut case = Case::new(&GoalConfig { slot_embedding, ..ours() });
        let before = case.run(&Pick::MostProbable(3));
        let order = Tensor::new(&[3u32, 0, 4, 2, 1], &Device::Cpu).unwrap();
        case.neighbours = case.neighbours.index_select(&order, 1).unwrap();
        case.mask = case.mask.index_select(&order, 1).unwrap();
        let after = case.run(&Pick::Indices(before.indices.clone()));
        assert_eq!(close(&before.futures, &after.futures), !slot_embedding);
        assert_eq!(close(&before.logits, &after.logits), !slot_embedding);
    }
}

#[test]
fn a_residual_is_added_to_the_centre() {
    let absolute = Case::new(&published());
    let residual = Case::new(&GoalConfig { regression: Regression::Residual, ..published() });
    let pick = Pick::Indices(Tensor::new(&[[8u32, 0], [1, 1], [2, 5], [4, 3]], &Device::Cpu).unwrap());
    let difference = (residual.run(&pick).futures - absolute.run(&pick).futures).unwrap();
    let centre = residual.modes.get(5).unwrap();
    assert!(close(&difference.get(2).unwrap().get(1).unwrap(), &centre));
}

#[test]
fn every_weight_gets_a_gradient_in_one_step() {
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let truth = random(&[BATCH, SHAPE.t_pred, 2], 8);
        let config = LabelConfig { distance: LabelDistance::MeanDisplacement, temperature: 0.5 };
        let labels = labels(&truth, &case.modes, &config).unwrap();
        let mut dropout = Dropout::new(0.2, 4);
        let pick = Pick::Indices(labels.nearest.clone());
        let output = case
            .net
            .forward(&case.observed, &case.neighbours, &case.mask, &case.modes, &pick, Some(&mut dropout))
            .unwrap();
        let loss = goal_loss(&output, &truth, &labels, LossWeights { alpha: 0.2, mean: 0. }).unwrap();
        let grads = loss.total.backward().unwrap();
        for (name, var) in case.weights.named() {
            let gradient = values(grads.get(&var).unwrap_or_else(|| panic!("no gradient for {name}")));
            assert!(gradient.iter().all(|g| g.is_finite()), "{name}: {gradient:?}");
            // These shift all scores of a query, or all logits of a window, alike: the true gradient is zero.
            assert!(
                name.ends_with("k.bias") || name == "prob.bias" || gradient.iter().any(|g| *g != 0.),
                "{name} stays as it is"
            );
        }
    }
}

#[test]
fn a_network_that_starts_at_nothing_says_the_modes_alike() {
    let case = Case::new(&GoalConfig { zero_start: true, ..ours() });
    let output = case.run(&Pick::All);
    assert!(values(&output.logits).iter().all(|logit| *logit == 0.));
    let modes = values(&case.modes);
    for window in values(&output.futures).chunks_exact(modes.len()) {
        assert_eq!(window, modes);
    }
}

#[test]
fn both_forms_agree_in_a_training_step() {
    for (config, mean) in [(published(), 0.), (ours(), 0.), (ours(), 1.)] {
        let (fused, graph) = (Case::new(&config), Case::new(&config));
        let graph = Case { net: graph.net.as_graph(), ..graph };
        let losses = |case: &Case| {
            let nearest = Tensor::new(&[[8u32], [1], [2], [4]], &Device::Cpu).unwrap();
            let pick = if mean > 0. { Pick::All } else { Pick::Indices(nearest.clone()) };
            let mut dropout = Dropout::new(0.2, 4);
            let output = case
                .net
                .forward(&case.observed, &case.neighbours, &case.mask, &case.modes, &pick, Some(&mut dropout))
                .unwrap();
            let truth = random(&[BATCH, SHAPE.t_pred, 2], 8);
            let soft = gnp_goal::soft_labels(&random(&[BATCH, MODES], 6), 0.5).unwrap();
            let labels = Labels { soft, nearest };
            let loss = goal_loss(&output, &truth, &labels, LossWeights { alpha: 0.2, mean }).unwrap();
            let grads = loss.total.backward().unwrap();
            let named = case.weights.named();
            let grads: Vec<Tensor> = named.values().map(|var| grads.get(var).unwrap().clone()).collect();
            (output, grads)
        };
        let ((a, a_grads), (b, b_grads)) = (losses(&fused), losses(&graph));
        assert!(close(&a.logits, &b.logits) && close(&a.futures, &b.futures));
        assert!(a_grads.iter().zip(&b_grads).all(|(a, b)| close(a, b)));
    }
}

#[test]
fn dropout_is_on_in_training_and_repeats_with_its_seed() {
    let case = Case::new(&ours());
    let with = |dropout: Option<&mut Dropout>| {
        let pick = Pick::Indices(Tensor::zeros((BATCH, 1), DType::U32, &Device::Cpu).unwrap());
        values(
            &case
                .net
                .forward(&case.observed, &case.neighbours, &case.mask, &case.modes, &pick, dropout)
                .unwrap()
                .futures,
        )
    };
    assert_eq!(with(Some(&mut Dropout::new(0.2, 7))), with(Some(&mut Dropout::new(0.2, 7))));
    assert_ne!(with(Some(&mut Dropout::new(0.2, 7))), with(Some(&mut Dropout::new(0.2, 8))));
    assert_eq!(with(Some(&mut Dropout::new(0., 7))), with(None));
}

#[test]
fn wrong_shapes_are_named() {
    let case = Case::new(&ours());
    let zeros = |shape: &[usize]| Tensor::zeros(shape, DType::F32, &Device::Cpu).unwrap();
    let all = Pick::MostProbable(1);
    for (observed, neighbours, mask, modes, name) in [
        (zeros(&[4, 12]), zeros(&[4, 5, 11]), zeros(&[4, 5]), zeros(&[9, 6, 2]), "observed"),
        (zeros(&[4, 13]), zeros(&[4, 5, 10]), zeros(&[4, 5]), zeros(&[9, 6, 2]), "neighbours"),
        (zeros(&[4, 13]), zeros(&[3, 5, 11]), zeros(&[4, 5]), zeros(&[9, 6, 2]), "neighbours"),
        (zeros(&[4, 13]), zeros(&[4, 5, 11]), zeros(&[4, 4]), zeros(&[9, 6, 2]), "mask"),
        (zeros(&[4, 13]), zeros(&[4, 5, 11]), zeros(&[4, 5]), zeros(&[9, 5, 2]), "modes"),
        (zeros(&[4, 13]), zeros(&[4, 5, 11]), zeros(&[4, 5]), zeros(&[0, 6, 2]), "modes"),
    ] {
        let error = case.net.forward(&observed, &neighbours, &mask, &modes, &all, None).unwrap_err();
        assert!(matches!(&error, GoalError::Shape { name: found, .. } if *found == name), "{error}");
    }
    let index = |modes: &[u32]| Pick::Indices(Tensor::new(modes, &Device::Cpu).unwrap().unsqueeze(1).unwrap());
    for config in [published(), ours()] {
        let case = Case::new(&config);
        let with = |pick: &Pick| {
            case.net
                .forward(&case.observed, &case.neighbours, &case.mask, &case.modes, pick, None)
                .unwrap_err()
                .to_string()
        };
        assert!(with(&index(&[0, 0, 0])).contains("pick"));
        assert!(with(&Pick::MostProbable(0)).contains("pick"));
        assert!(with(&index(&[9, 0, 0, 0])).contains("mode 9"));
    }
    let none = case.net.forward(
        &zeros(&[0, 13]),
        &zeros(&[0, 5, 11]),
        &zeros(&[0, 5]),
        &zeros(&[9, 6, 2]),
        &Pick::MostProbable(1),
        None,
    );
    assert!(none.unwrap_err().to_string().contains("at least one window"));
}
