//! The operation beside the graph.

use candle_core::{DType, Device, Result, Tensor, Var};
use gnp_nn::{Dropout, DropoutMask, Weights};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::FusedTransformer;
use crate::block::BlockMasks;
use crate::{GoalConfig, GoalNet, GoalShape, Pick, ProbabilityHead, Regression};

fn random(shape: &[usize], seed: u64) -> Var {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1. ..1.)).collect();
    Var::from_tensor(&Tensor::from_vec(values, shape, &Device::Cpu).unwrap()).unwrap()
}

fn values(x: &Tensor) -> Vec<f32> {
    x.flatten_all().unwrap().to_vec1().unwrap()
}

/// Sizes and form of a network and a batch for it.
#[derive(Clone, Copy, Debug)]
struct Form {
    batch: usize,
    modes: usize,
    slots: usize,
    width: usize,
    heads: usize,
    layers: usize,
    probability: ProbabilityHead,
    rate: f32,
}

const FORM: Form = Form {
    batch: 3,
    modes: 7,
    slots: 5,
    width: 12,
    heads: 3,
    layers: 2,
    probability: ProbabilityHead::Encoder,
    rate: 0.,
};

struct Case {
    net: GoalNet,
    weights: Weights,
    /// Observations, neighbours and modes.
    inputs: [Var; 3],
    mask: Tensor,
    rate: f32,
}

impl Case {
    /// With weights of which none is at its start value.
    fn new(form: Form) -> Self {
        let Form { batch, modes, slots, width, heads, layers, probability, rate } = form;
        let config = GoalConfig {
            width,
            heads,
            layers,
            feed_forward: 3,
            dropout: rate,
            probability,
            regression: Regression::Absolute,
            null_token: false,
            slot_embedding: false,
            zero_start: false,
        };
        let shape = GoalShape { observed: 4, neighbour: 3, slots, t_pred: 2 };
        let weights = Weights::seeded(3, &Device::Cpu);
        let net = GoalNet::new(&config, shape, weights.builder()).unwrap();
        for (i, (_, var)) in weights.named().iter().enumerate() {
            let moved = (var.as_tensor() + (random(var.dims(), i as u64).as_tensor() * 0.3).unwrap()).unwrap();
            var.set(&moved).unwrap();
        }
        let mask = random(&[batch, slots], 5).gt(0.).unwrap().to_dtype(DType::F32).unwrap();
        // The last window has nobody.
        let some = Tensor::arange(0u32, batch as u32, &Device::Cpu).unwrap().lt((batch - 1) as u32).unwrap();
        let mask = mask.broadcast_mul(&some.to_dtype(DType::F32).unwrap().unsqueeze(1).unwrap()).unwrap();
        let inputs = [random(&[batch, 4], 6), random(&[batch, slots, 3], 7), random(&[modes, 2, 2], 8)];
        Self { net, weights, inputs, mask, rate }
    }

    /// Logits, futures, and the gradients of all that has one, by name, in a loss of both.
    fn run(&self, net: &GoalNet, pick: &Pick) -> Vec<(String, Vec<f32>)> {
        let [observed, neighbours, modes] = &self.inputs;
        let mut dropout = Dropout::new(self.rate, 9);
        let out = net.forward(observed, neighbours, &self.mask, modes, pick, Some(&mut dropout)).unwrap();
        let weighed = |x: &Tensor| (x * random(x.dims(), 8).as_tensor())?.sum_all();
        let loss = (weighed(&out.logits).unwrap() + weighed(&out.futures).unwrap()).unwrap();
        let grads = loss.backward().unwrap();
        let mut vars: Vec<(String, Var)> = self.weights.named().into_iter().collect();
        let names = ["observed", "neighbours", "modes"].map(str::to_owned);
        vars.extend(names.into_iter().zip(self.inputs.clone()));
        let mut all = vec![("logits".to_owned(), values(&out.logits)), ("futures".to_owned(), values(&out.futures))];
        all.extend(vars.iter().map(|(name, var)| (name.clone(), values(grads.get(var).unwrap()))));
        all
    }
}

/// One mode of each window, and two in another order than theirs.
fn given(form: &Form) -> Pick {
    let first = (0..form.batch as u32).map(|window| [(window * 5 + 4) % form.modes as u32, window % form.modes as u32]);
    Pick::Indices(Tensor::from_vec(first.flatten().collect(), (form.batch, 2), &Device::Cpu).unwrap())
}

#[test]
fn one_operation_gives_what_the_graph_gives() {
    let forms = [
        FORM,
        Form { batch: 18, modes: 9, slots: 4, width: 16, heads: 4, layers: 1, ..FORM },
        Form { batch: 2, modes: 37, slots: 19, width: 32, heads: 2, ..FORM },
        Form { batch: 2, modes: 1, slots: 1, width: 6, heads: 1, layers: 0, ..FORM },
    ];
    for probability in [ProbabilityHead::Encoder, ProbabilityHead::Decoder] {
        for (form, rate) in forms.iter().flat_map(|form| [(form, 0.), (form, 0.3)]) {
            let form = Form { probability, rate, ..*form };
            let case = Case::new(form);
            for pick in [given(&form), Pick::MostProbable(3), Pick::All] {
                let (fused, graph) = (case.run(&case.net, &pick), case.run(&case.net.clone().as_graph(), &pick));
                for ((name, fused), (_, graph)) in fused.iter().zip(&graph) {
                    let scale = graph.iter().fold(0.1f32, |scale, x| scale.max(x.abs()));
                    let worst = fused.iter().zip(graph).fold(0f32, |worst, (f, g)| worst.max((f - g).abs()));
                    assert!(
                        fused.len() == graph.len() && worst < 5e-5 * scale,
                        "{form:?} {pick:?} {name}: {worst} of {scale}"
                    );
                }
            }
        }
    }
}

#[test]
fn threads_do_not_reach_the_result() {
    for probability in [ProbabilityHead::Encoder, ProbabilityHead::Decoder] {
        let form = Form { batch: 37, modes: 11, slots: 6, width: 16, heads: 4, probability, rate: 0.2, ..FORM };
        let (case, pick) = (Case::new(form), given(&form));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| case.run(&case.net, &pick))
        };
        let one = on(1);
        assert_eq!(one, on(2));
        assert_eq!(one, on(5));
    }
}

#[test]
fn what_is_not_kept_is_made_again_to_the_last_bit() {
    for probability in [ProbabilityHead::Encoder, ProbabilityHead::Decoder] {
        let form = Form { batch: 20, probability, rate: 0.2, ..FORM };
        let (mut case, pick) = (Case::new(form), given(&form));
        let kept = case.run(&case.net, &pick);
        assert_eq!(case.run(&case.net, &pick), kept, "with memory that was in use before");
        // Room for a part of the windows, and for none.
        for values in [20_000, 0] {
            case.net.memory.kept_values = values;
            assert_eq!(case.run(&case.net, &pick), kept);
        }
        // One group of windows at a time instead of all.
        case.net.memory.shared_values = 0;
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| case.run(&case.net, &pick)), kept);
    }
}

#[test]
fn a_gradient_is_passed_back_twice() {
    let case = Case::new(FORM);
    let [observed, neighbours, modes] = &case.inputs;
    let out = case.net.forward(observed, neighbours, &case.mask, modes, &given(&FORM), None).unwrap();
    let gradients = || {
        let grads = out.futures.sqr().unwrap().sum_all().unwrap().backward().unwrap();
        case.weights.named().values().map(|var| values(grads.get(var).unwrap())).collect::<Vec<_>>()
    };
    assert_eq!(gradients(), gradients());
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let net = Case::new(FORM).net;
    let [modes, observed, keys, mask] = [&[7, 12][..], &[3, 12], &[3, 5, 12], &[3, 5]].map(|shape| random(shape, 1));
    let weights = random(&[3 * (4 * 156 + 2 * 24 + 36 * 13 + 12 * 37) + 13], 2);
    let apply = |tokens: [&Tensor; 4], weights: &Tensor| -> Result<(Tensor, Tensor)> {
        let transformer = FusedTransformer {
            memory: net.memory.clone(),
            layers: 2,
            heads: 3,
            hidden: 36,
            probability: ProbabilityHead::Encoder,
            picked: Pick::All.of_windows(3, 7, &candle_core::Device::Cpu).unwrap(),
            masks: vec![BlockMasks { attention: DropoutMask::NONE, feed_forward: DropoutMask::NONE }; 3],
        };
        transformer.apply(tokens, &[weights])
    };
    assert!(apply([&modes, &observed, &keys, &mask], &weights).is_ok());
    let narrow = |x: &Var, dim: usize| x.narrow(dim, 0, x.dims()[dim] - 1).unwrap();
    assert!(apply([&narrow(&modes, 1), &observed, &keys, &mask], &weights).is_err());
    assert!(apply([&modes, &narrow(&observed, 0), &keys, &mask], &weights).is_err());
    assert!(apply([&modes, &observed, &narrow(&keys, 2), &mask], &weights).is_err());
    assert!(apply([&modes, &observed, &keys, &narrow(&mask, 1)], &weights).is_err());
    assert!(apply([&modes, &observed, &keys, &mask], &narrow(&weights, 0)).is_err());
}
