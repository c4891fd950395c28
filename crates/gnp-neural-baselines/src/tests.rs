//! What must be true of every learned baseline, on a made-up road.

mod road;

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use candle_core::{Device, Tensor};
use gnp_data::{Forecast, OraclePredictor, Predictor, Recording, Window, WindowId, WindowSet};
use gnp_nn::Weights;
use gnp_train::{BatchReport, Observer, Stage, TrainError};

use crate::learned::inputs;
use crate::net::Net;
use crate::network::Ask;
use crate::oriented_view::{Orientation, OrientedView};
use crate::stage::{RecipeStage, is_statistic};
use crate::{ClassLoss, NeuralBaseline, NeuralBaselineError, Recipe, TrainedBaseline, Training};

/// Kinds that have a network of their own.
const TRAINED: [NeuralBaseline; 5] = [
    NeuralBaseline::SLstm,
    NeuralBaseline::CsLstm,
    NeuralBaseline::CsLstmM,
    NeuralBaseline::PipNoPlan,
    NeuralBaseline::PipInformed,
];

fn recipe() -> Recipe {
    Recipe {
        warm_up_epochs: 1,
        likelihood_epochs: 2,
        batch: 7,
        epoch_windows: 21,
        learning_rate: 1e-3,
        decay: 0.9,
        weight_decay: 0.,
        clip_norm: 10.,
        mirror: 0.,
        class_loss: ClassLoss::Binary,
        class_loss_in_warm_up: false,
        unit_m: 0.3048,
        fused_targets: 3,
        seed: 5,
    }
}

fn count(kind: NeuralBaseline, fused_targets: usize) -> usize {
    let weights = Weights::seeded(1, &Device::Cpu);
    let shape = gnp_data::WindowShape { t_obs: 31, t_pred: 50, step: 1, rate_hz: 10. };
    let recipe = Recipe { fused_targets, ..recipe() };
    Net::new(kind, &recipe, inputs(shape, 1.).unwrap(), &weights.builder()).unwrap();
    let trained = weights.named().into_iter().filter(|(name, _)| !is_statistic(name));
    trained.map(|(_, var)| var.elem_count()).sum()
}

#[test]
fn networks_have_as_many_weights_as_the_published_ones() {
    assert_eq!(count(NeuralBaseline::SLstm, 0), 351_573);
    assert_eq!(count(NeuralBaseline::CsLstm, 0), 191_829);
    assert_eq!(count(NeuralBaseline::CsLstmM, 0), 194_954);
    assert_eq!(count(NeuralBaseline::PipInformed, 8), 2_579_034);
    assert_eq!(count(NeuralBaseline::PipSurrogate, 8), 2_579_034);
    assert_eq!(count(NeuralBaseline::PipNoPlan, 8), 2_513_930);
    assert_eq!(count(NeuralBaseline::PipInformed, 0), 260_186);
    assert_eq!(count(NeuralBaseline::PipNoPlan, 0), 195_082);
}

/// A network that was not trained, after `epochs` epochs of `recipe`.
fn with_stage<T>(kind: NeuralBaseline, recipe: &Recipe, epochs: usize, check: impl Fn(&RecipeStage<'_>) -> T) -> T {
    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let weights = Weights::seeded(recipe.seed, &Device::Cpu);
    let net = Net::new(kind, recipe, inputs(set.shape(), recipe.unit_m).unwrap(), &weights.builder()).unwrap();
    let epoch = AtomicUsize::new(epochs);
    let (train, validation) = (set.ids(), set.ids());
    let (net, weights, set, epoch) = (&net, &weights, &set, &epoch);
    check(&RecipeStage { kind, net, weights, recipe, set, train, validation, epoch })
}

#[test]
fn gradients_are_differences_and_reach_every_weight() {
    for kind in TRAINED {
        with_stage(kind, &recipe(), recipe().warm_up_epochs, |stage| {
            let batch = [0, 11, 23];
            let loss = || f64::from(stage.loss(&batch, 0).unwrap().to_scalar::<f32>().unwrap());
            let grads = stage.loss(&batch, 0).unwrap().backward().unwrap();
            for (name, var) in stage.trainable() {
                let grad = grads.get(&var).unwrap_or_else(|| panic!("{kind:?}: no gradient for {name}"));
                let grad = grad.flatten_all().unwrap().to_vec1::<f32>().unwrap();
                let (largest, size) = grad
                    .iter()
                    .enumerate()
                    .fold((0, 0f32), |(best, size), (i, g)| if g.abs() > size { (i, g.abs()) } else { (best, size) });
                assert!(size > 0., "{kind:?}: the gradient of {name} is 0 everywhere");
                if size < 2e-2 {
                    continue; // too small for differences of f32
                }
                let values = var.flatten_all().unwrap().to_vec1::<f32>().unwrap();
                let at = |delta: f32| {
                    let mut moved = values.clone();
                    moved[largest] += delta;
                    var.set(&Tensor::from_vec(moved, var.shape(), &Device::Cpu).unwrap()).unwrap();
                    loss()
                };
                // A maximum or a rectifier may change sides within one step, hardly within both.
                let found = [0.02, 0.004].map(|rise| {
                    let step = (rise / size).clamp(1e-6, 4e-3);
                    (at(step) - at(-step)) / f64::from(2. * step)
                });
                at(0.);
                let wanted = f64::from(grad[largest]);
                assert!(
                    found.iter().any(|found| (found - wanted).abs() < 0.04 * (0.1 + wanted.abs())),
                    "{kind:?} {name}[{largest}]: {wanted} by backward, {found:?} by differences",
                );
            }
        });
    }
}

#[test]
fn classes_count_beside_a_squared_error_as_they_do_in_feet() {
    let loss = |epochs: usize, class_loss, unit_m| {
        let recipe = Recipe { class_loss, class_loss_in_warm_up: true, unit_m, ..recipe() };
        let loss = |stage: &RecipeStage<'_>| stage.loss(&[0, 11, 23], 0).unwrap().to_scalar::<f32>().unwrap();
        with_stage(NeuralBaseline::Stdan, &recipe, epochs, loss)
    };
    let classes = |epochs, unit_m| loss(epochs, ClassLoss::Categorical, unit_m) - loss(epochs, ClassLoss::None, unit_m);
    let (warm_up, likelihood) = (classes(0, 3.048), classes(1, 3.048));
    assert!(likelihood > 1., "two cross-entropies of three classes: {likelihood}");
    assert!((warm_up - 0.01 * likelihood).abs() < 1e-4, "{warm_up} {likelihood}");
    let (warm_up, likelihood) = (classes(0, 0.3048), classes(1, 0.3048));
    assert!((warm_up - likelihood).abs() < 1e-2, "{warm_up} {likelihood}");
}

#[test]
fn a_mirrored_window_is_a_window_of_the_mirrored_road() {
    let (plain, mirrored) = (road::plain(), road::mirrored());
    let window = |recording| Window::new(recording, road::shape(), 4, 4 * 70 + 30).unwrap();
    let (plain, mirrored) = (window(&plain), window(&mirrored));
    let turned = OrientedView { observation: plain.observation(), side: Orientation::Mirrored };
    let recorded = OrientedView::recorded(&mirrored.observation());
    for kind in TRAINED.into_iter().chain([NeuralBaseline::Stdan]) {
        with_stage(kind, &recipe(), 0, |stage| {
            let means = |seen: OrientedView<'_>, window: Window<'_>| {
                let truths = kind.uses_future().then(|| [window.truth()]);
                let truths = truths.as_ref().map(|truths| truths.as_slice());
                let output = stage.net.forward(&[seen], truths, Ask::Predict).unwrap();
                output.gaussians.mean.flatten_all().unwrap().to_vec1::<f32>().unwrap()
            };
            let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
            let (turned, recorded) = (means(turned, plain), means(recorded, mirrored));
            assert!(close(&turned, &recorded), "{kind:?}");
            assert!(!close(&turned, &means(OrientedView::recorded(&plain.observation()), plain)), "{kind:?}");
            let inputs = stage.net.inputs;
            let futures = |window: Window<'_>, side| {
                let futures = inputs.futures([(window.truth(), side)].into_iter(), &Device::Cpu).unwrap();
                futures.flatten_all().unwrap().to_vec1::<f32>().unwrap()
            };
            assert!(close(&futures(plain, Orientation::Mirrored), &futures(mirrored, Orientation::Recorded)));
        });
    }
    assert_eq!([0, 1, 2].map(|class| Orientation::Mirrored.lateral(class)), [0, 2, 1]);
}

#[test]
fn the_share_of_mirrored_windows_is_that_of_the_recipe() {
    let differs = |mirror: f64| {
        let recipe = Recipe { mirror, ..recipe() };
        with_stage(NeuralBaseline::CsLstm, &recipe, 0, |stage| {
            let loss = |seed| stage.loss(&[5], seed).unwrap().to_scalar::<f32>().unwrap();
            let recorded = with_stage(NeuralBaseline::CsLstm, &self::recipe(), 0, |plain| {
                plain.loss(&[5], 0).unwrap().to_scalar::<f32>().unwrap()
            });
            (0..60).filter(|seed| loss(*seed) != recorded).count()
        })
    };
    assert_eq!((differs(0.), differs(1.)), (0, 60));
    assert!((10..30).contains(&differs(0.3)), "{}", differs(0.3));
}

/// A network that was not trained, as a predictor.
fn untrained(kind: NeuralBaseline, set: &WindowSet<'_>) -> TrainedBaseline {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { warm_up_epochs: 0, likelihood_epochs: 1, learning_rate: 1e-12, ..recipe() };
    let data = Training { set, train: &set.ids()[..3], validation: &set.ids()[..2], split_hash: "h" };
    let stop = AtomicBool::new(false);
    TrainedBaseline::train(kind, &recipe, &data, folder.path(), &Device::Cpu, (), &stop).unwrap()
}

fn predict(learned: &TrainedBaseline, recording: &Recording, targets: [u32; 3]) -> Vec<Forecast> {
    let recordings = std::slice::from_ref(recording);
    let (set, _) = WindowSet::cut(recordings, &road::config()).unwrap();
    let windows: Vec<Window<'_>> = targets
        .iter()
        .map(|vehicle| set.iter().filter(|window| window.key().vehicle == *vehicle).nth(2).unwrap())
        .collect();
    match learned.with_future() {
        Some(informed) => informed.predict_with_future(&windows, 6).unwrap(),
        None => {
            let observations: Vec<_> = windows.iter().map(Window::observation).collect();
            learned.predict(&observations, 6).unwrap()
        }
    }
}

/// Last observed frame (from 0) of the third window of a vehicle.
const LAST_OBSERVED: usize = 12 + 2 * 7;

#[test]
fn a_scrambled_future_changes_nothing_but_what_is_informed() {
    let plain = road::plain();
    let scrambled = road::recording(
        |vehicle| 1 + vehicle as u32,
        |vehicle, frame| if frame > LAST_OBSERVED { [(frame * (vehicle + 2) % 7) as f32, 0.4] } else { [0.; 2] },
    );
    let recordings = [plain.clone()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    for kind in TRAINED.into_iter().chain([NeuralBaseline::PipSurrogate]) {
        let learned = untrained(kind, &set);
        let (before, after) = (predict(&learned, &plain, [1, 5, 8]), predict(&learned, &scrambled, [1, 5, 8]));
        assert_eq!(before == after, !kind.uses_future(), "{kind:?}");
    }
}

#[test]
fn the_order_of_neighbours_does_not_matter() {
    let (plain, turned) = (road::plain(), road::recording(|vehicle| 9 - vehicle as u32, |_, _| [0.; 2]));
    let recordings = [plain.clone()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    for kind in TRAINED {
        let learned = untrained(kind, &set);
        assert_eq!(predict(&learned, &plain, [1, 5, 8]), predict(&learned, &turned, [9, 5, 2]), "{kind:?}");
    }
}

#[test]
fn neighbours_do_matter() {
    let plain = road::plain();
    // The third vehicle, behind the first one in its lane, has come closer.
    let closer = road::recording(|vehicle| 1 + vehicle as u32, |vehicle, _| [if vehicle == 2 { 6. } else { 0. }, 0.]);
    let recordings = [plain.clone()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    for kind in TRAINED {
        let learned = untrained(kind, &set);
        assert_ne!(predict(&learned, &plain, [1, 5, 8])[0], predict(&learned, &closer, [1, 5, 8])[0], "{kind:?}");
    }
}

fn parts<'a>(set: &'a WindowSet<'a>) -> (Vec<WindowId>, Vec<WindowId>) {
    let ids = set.ids();
    (ids[..ids.len() - 9].to_vec(), ids[ids.len() - 9..].to_vec())
}

/// Raises the stop flag after a number of batches.
struct StopAfter<'a>(u64, &'a AtomicBool);

impl Observer for StopAfter<'_> {
    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        self.1.store(report.steps >= self.0, Ordering::Relaxed);
        Ok(())
    }
}

#[test]
fn a_stopped_training_ends_like_one_that_never_stopped_and_reads_back() {
    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let (train, validation) = parts(&set);
    let data = Training { set: &set, train: &train, validation: &validation, split_hash: "split" };
    for kind in [NeuralBaseline::CsLstmM, NeuralBaseline::PipSurrogate] {
        let (whole, broken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let go = |folder: &std::path::Path, after: u64| {
            let stop = AtomicBool::new(false);
            let observer = StopAfter(after, &stop);
            TrainedBaseline::train(kind, &recipe(), &data, folder, &Device::Cpu, observer, &stop)
        };
        let straight = go(whole.path(), u64::MAX).unwrap();
        let error = go(broken.path(), 5).unwrap_err();
        assert!(matches!(error, NeuralBaselineError::Interrupted { .. }), "{error}");
        let resumed = go(broken.path(), u64::MAX).unwrap();
        let observations: Vec<_> = validation.iter().map(|id| set.get(*id).unwrap().observation()).collect();
        let forecasts = straight.predict(&observations, 6).unwrap();
        assert_eq!(forecasts, resumed.predict(&observations, 6).unwrap(), "{kind:?}");
        assert_eq!(straight.kind(), kind);
        assert!(straight.header().epoch > recipe().warm_up_epochs, "chosen in the phase of likelihood");
        assert!(straight.header().simulated && straight.header().split_hash == "split");

        let mut loaded = TrainedBaseline::load(&TrainedBaseline::path(whole.path(), kind), &Device::Cpu).unwrap();
        if kind == NeuralBaseline::PipSurrogate {
            let refused = loaded.predict(&observations, 6).unwrap_err().to_string();
            assert!(refused.contains("PiP (ego future known)"), "{refused}");
            loaded = loaded.with_surrogate_plan().unwrap();
        }
        assert_eq!(loaded.predict(&observations, 6).unwrap(), forecasts);
        // Six futures whose probabilities sum to 1, likeliest first, one point a frame.
        let modes = &forecasts[0].modes;
        assert_eq!((modes.len(), modes[0].path.len()), (6, 10));
        assert!((modes.iter().map(|mode| mode.probability).sum::<f32>() - 1.).abs() < 1e-5);
        assert!(modes.is_sorted_by(|a, b| a.probability >= b.probability));
        let windows: Vec<_> = validation.iter().map(|id| set.get(*id).unwrap()).collect();
        assert!(loaded.nll(&windows).unwrap().iter().all(|nll| nll.is_finite()));

        let other = Recipe { learning_rate: 1e-4, ..recipe() };
        let stop = AtomicBool::new(false);
        let refused = TrainedBaseline::train(kind, &other, &data, whole.path(), &Device::Cpu, (), &stop).unwrap_err();
        assert!(refused.to_string().contains("another recipe"), "{refused}");
    }
}

#[test]
fn training_lowers_the_error_of_every_network() {
    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let data = Training { set: &set, train: set.ids(), validation: set.ids(), split_hash: "split" };
    let recipe = Recipe {
        warm_up_epochs: 5,
        likelihood_epochs: 0,
        batch: 9,
        epoch_windows: 0,
        learning_rate: 5e-3,
        decay: 1.,
        fused_targets: 0,
        ..recipe()
    };
    for kind in TRAINED {
        let folder = tempfile::tempdir().unwrap();
        let stop = AtomicBool::new(false);
        let learned = TrainedBaseline::train(kind, &recipe, &data, folder.path(), &Device::Cpu, (), &stop).unwrap();
        // A vehicle covers some 12 m.
        assert!(learned.header().scores["fde"] < 6., "{kind:?}: {:?}", learned.header().scores);
    }
}

#[test]
fn foreign_files_and_foreign_windows_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.safetensors");
    let load = || TrainedBaseline::load(&path, &Device::Cpu).unwrap_err().to_string();
    assert!(load().contains("cannot be read"));
    std::fs::write(&path, b"no safetensors").unwrap();
    assert!(load().contains("not a whole safetensors file"));

    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let learned = untrained(NeuralBaseline::CsLstm, &set);
    let longer = gnp_data::WindowConfig { predicted_s: 2., ..road::config() };
    let (other, _) = WindowSet::cut(&recordings, &longer).unwrap();
    let observation = other.get(other.ids()[0]).unwrap().observation();
    let message = learned.predict(&[observation], 1).unwrap_err().to_string();
    assert!(message.contains("10 frames") && message.contains("20 frames"), "{message}");
    assert!(learned.with_surrogate_plan().unwrap_err().to_string().contains("takes no plan"));
}
