//! The goal network, its labels, its loss and its dropout.

use candle_core::{DType, Device, Tensor};
use gnp_goal::{
    GoalConfig, GoalNet, GoalShape, LabelConfig, LabelDistance, LossWeights, Pick, ProbabilityHead, Regression,
    goal_loss, labels,
};
use gnp_nn::{Dropout, DropoutMask, Weights};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::scenes::uniform;
use crate::{all_close, close, gpu, gradients, on, values};

const SHAPE: GoalShape = GoalShape { observed: 60, neighbour: 60, slots: 8, t_pred: 20 };

fn configs() -> [GoalConfig; 2] {
    let published = GoalConfig {
        width: 32,
        heads: 4,
        layers: 2,
        feed_forward: 2,
        dropout: 0.1,
        probability: ProbabilityHead::Encoder,
        regression: Regression::Absolute,
        null_token: false,
        slot_embedding: false,
        zero_start: false,
    };
    let ours = GoalConfig {
        probability: ProbabilityHead::Decoder,
        regression: Regression::Residual,
        null_token: true,
        slot_embedding: true,
        ..published.clone()
    };
    [published, ours]
}

/// Observed, neighbours, mask, centres of 50 modes and truth of `windows` windows.
fn batch(windows: usize) -> [Tensor; 5] {
    let rng = &mut ChaCha8Rng::seed_from_u64(4);
    let mut draw = |shape: &[usize]| uniform(rng, shape, -1., 1.).unwrap();
    let mask = draw(&[windows, SHAPE.slots]).gt(-0.3).unwrap().to_dtype(DType::F32).unwrap();
    [
        draw(&[windows, SHAPE.observed]),
        draw(&[windows, SHAPE.slots, SHAPE.neighbour]),
        mask,
        draw(&[50, SHAPE.t_pred, 2]),
        draw(&[windows, SHAPE.t_pred, 2]),
    ]
}

fn moved(tensors: &[Tensor; 5], device: &Device) -> [Tensor; 5] {
    tensors.each_ref().map(|tensor| tensor.to_device(device).unwrap())
}

#[test]
fn goals_and_every_gradient_are_those_of_the_cpu() {
    for (config, mean) in configs().iter().zip([0., 0.3]) {
        let weights = Weights::seeded(5, &Device::Cpu);
        GoalNet::new(config, SHAPE, weights.builder()).unwrap();
        let tensors = batch(70);
        let run = |device: &Device| {
            let weights = on(device, &weights);
            let net = GoalNet::new(config, SHAPE, weights.builder()).unwrap();
            let [observed, neighbours, mask, modes, truth] = moved(&tensors, device);
            let label = LabelConfig { distance: LabelDistance::MeanDisplacement, temperature: 0.2 };
            let labels = labels(&truth, &modes, &label).unwrap();
            let pick = if mean > 0. { Pick::All } else { Pick::Indices(labels.nearest.clone()) };
            let output = net.forward(&observed, &neighbours, &mask, &modes, &pick, None).unwrap();
            let loss = goal_loss(&output, &truth, &labels, LossWeights { alpha: 0.2, mean }).unwrap();
            let goals = net.predict(&observed, &neighbours, &mask, &modes, 6).unwrap();
            let nearest = labels.nearest.flatten_all().unwrap().to_vec1::<u32>().unwrap();
            let picked = goals.indices.flatten_all().unwrap().to_vec1::<u32>().unwrap();
            let given =
                [&labels.soft, &output.logits, &output.futures, &loss.total, &goals.futures, &goals.probabilities];
            (given.map(values), (nearest, picked), gradients(&weights, &loss.total))
        };
        let ((found, picks, found_gradients), (wanted, wanted_picks, wanted_gradients)) =
            (run(gpu()), run(&Device::Cpu));
        assert_eq!(picks, wanted_picks);
        let names = ["labels", "logits", "futures", "loss", "goals", "probabilities"];
        for (name, (found, wanted)) in names.iter().zip(found.iter().zip(&wanted)) {
            close(name, found, wanted, 1e-4);
        }
        // A key's bias has a gradient of 0 but for rounding, which `close` measures against 1e-3.
        all_close(&found_gradients, &wanted_gradients, 1e-3);
    }
}

#[test]
fn distances_of_labels_are_those_of_the_cpu() {
    let [.., modes, truth] = batch(33);
    for distance in [LabelDistance::SquaredSum, LabelDistance::Euclidean, LabelDistance::MeanDisplacement] {
        let run = |device: &Device| {
            let (truth, modes) = (truth.to_device(device).unwrap(), modes.to_device(device).unwrap());
            values(&gnp_goal::label_distances(&truth, &modes, distance).unwrap())
        };
        close("distances", &run(gpu()), &run(&Device::Cpu), 1e-5);
    }
}

#[test]
fn masks_of_dropout_repeat_with_the_seed_and_drop_their_share() {
    let x = Tensor::ones((500, 3, 64), DType::F32, gpu()).unwrap();
    let once = values(&Dropout::new(0.1, 3).apply(&x).unwrap());
    assert_eq!(once, values(&Dropout::new(0.1, 3).apply(&x).unwrap()));
    let other = values(&Dropout::new(0.1, 4).apply(&x).unwrap());
    let dropped = |values: &[f32]| values.iter().filter(|x| **x == 0.).count() as f64 / values.len() as f64;
    assert!((dropped(&once) - 0.1).abs() < 0.005 && (dropped(&other) - 0.1).abs() < 0.005);
    let both = once.iter().zip(&other).filter(|(a, b)| **a == 0. && **b == 0.).count() as f64 / once.len() as f64;
    assert!((both - 0.01).abs() < 0.002, "{both}");
    assert_eq!(values(&DropoutMask::NONE.apply(&x).unwrap()), values(&x));
}
