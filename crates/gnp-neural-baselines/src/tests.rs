//! What must be true of every learned baseline, on a made-up road.

mod road;

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use candle_core::{Device, Tensor};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Forecast, OraclePredictor, Predictor, Recording, Window, WindowId, WindowSet};
use gnp_nn::Weights;
use gnp_train::{BatchReport, Observer, Part, Schedule, Stage, TrainError};

use crate::checkpoint::{Checkpoint, Header};
use crate::learned::inputs;
use crate::net::Net;
use crate::network::{Ask, Output};
use crate::oriented_view::{OrientedView, Variation};
use crate::stage::{RecipeStage, is_statistic};
use crate::{ClassLoss, NeuralBaseline, NeuralBaselineError, OutputForm, Recipe, TrainedBaseline, Training};

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
        steps: 30,
        warm_up: 0.34,
        batch: 7,
        site_sampling_exponent: 0.,
        learning_rate: 1e-3,
        schedule: Schedule::Constant {},
        weight_decay: 0.,
        clip_norm: 10.,
        mirror: 0.,
        longitudinal_scale: 1.,
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
    Net::new(kind, &recipe, None, inputs(shape, 1.).unwrap(), &weights.builder()).unwrap();
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
    with_reference(None, kind, recipe, epochs, check)
}

fn with_reference<T>(
    reference: Option<PlatoonRule>,
    kind: NeuralBaseline,
    recipe: &Recipe,
    epochs: usize,
    check: impl Fn(&RecipeStage<'_>) -> T,
) -> T {
    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let weights = Weights::seeded(recipe.seed, &Device::Cpu);
    let net =
        Net::new(kind, recipe, reference, inputs(set.shape(), recipe.unit_m).unwrap(), &weights.builder()).unwrap();
    let epoch = AtomicUsize::new(epochs);
    let (train, validation) = (set.ids(), set.ids());
    let (net, weights, set, epoch) = (&net, &weights, &set, &epoch);
    check(&RecipeStage { kind, net, weights, recipe, set, train, validation, epoch })
}

#[test]
fn gradients_are_differences_and_reach_every_weight() {
    for kind in TRAINED {
        with_stage(kind, &recipe(), 100, |stage| {
            let batch = [0, 11, 23];
            let loss = || f64::from(stage.loss(Part::whole(&batch, 0)).unwrap().to_scalar::<f32>().unwrap());
            let grads = stage.loss(Part::whole(&batch, 0)).unwrap().backward().unwrap();
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
        let loss =
            |stage: &RecipeStage<'_>| stage.loss(Part::whole(&[0, 11, 23], 0)).unwrap().to_scalar::<f32>().unwrap();
        with_stage(NeuralBaseline::Stdan, &recipe, epochs, loss)
    };
    let classes = |epochs, unit_m| loss(epochs, ClassLoss::Categorical, unit_m) - loss(epochs, ClassLoss::None, unit_m);
    let (warm_up, likelihood) = (classes(0, 3.048), classes(1, 3.048));
    assert!(likelihood > 1., "two cross-entropies of three classes: {likelihood}");
    assert!((warm_up - 0.01 * likelihood).abs() < 1e-4, "{warm_up} {likelihood}");
    let (warm_up, likelihood) = (classes(0, 0.3048), classes(1, 0.3048));
    assert!((warm_up - likelihood).abs() < 1e-2, "{warm_up} {likelihood}");
}

fn platoon() -> PlatoonRule {
    PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap()
}

#[test]
fn a_varied_window_is_a_window_of_the_varied_road() {
    let plain = road::plain();
    let (mirror, stretch) = (Variation { mirrored: true, along: 1. }, Variation { mirrored: false, along: 1.2 });
    for (variation, varied) in [(mirror, road::mirrored()), (stretch, road::stretched(1.2))] {
        let window = |recording| Window::new(recording, road::shape(), 4, 4 * 70 + 30).unwrap();
        let (plain, varied) = (window(&plain), window(&varied));
        let turned = OrientedView { observation: plain.observation(), variation };
        let recorded = OrientedView::recorded(&varied.observation());
        let kinds = TRAINED.into_iter().chain([NeuralBaseline::Stdan]);
        for (kind, reference) in kinds.flat_map(|kind| [(kind, None), (kind, Some(platoon()))]) {
            with_reference(reference, kind, &recipe(), 0, |stage| {
                // In the second form a prediction is close to the reference path, which is tens of units long.
                let means = |seen: OrientedView<'_>, window: Window<'_>| {
                    let truths = kind.uses_future().then(|| [window.truth()]);
                    let truths = truths.as_ref().map(|truths| truths.as_slice());
                    let output = stage.net.forward(&[seen], truths, Ask::Predict).unwrap();
                    output.gaussians.mean.flatten_all().unwrap().to_vec1::<f32>().unwrap()
                };
                let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3);
                let (turned, recorded) = (means(turned, plain), means(recorded, varied));
                assert!(close(&turned, &recorded), "{kind:?} {variation:?}: {turned:?} {recorded:?}");
                let differs = turned.iter().zip(means(OrientedView::recorded(&plain.observation()), plain));
                assert!(differs.into_iter().any(|(a, b)| (a - b).abs() > 1e-5), "{kind:?}");
                let inputs = stage.net.inputs;
                let futures = |window: Window<'_>, variation| {
                    let futures = inputs.futures([(window.truth(), variation)].into_iter(), &Device::Cpu).unwrap();
                    futures.flatten_all().unwrap().to_vec1::<f32>().unwrap()
                };
                assert!(close(&futures(plain, variation), &futures(varied, Variation::RECORDED)));
            });
        }
    }
    assert_eq!([0, 1, 2].map(|class| mirror.lateral(class)), [0, 2, 1]);
}

/// Untrained deviations are small: what the platoon says is what is predicted, and a loss knows it.
#[test]
fn deviations_are_counted_from_the_platoon() {
    for kind in TRAINED {
        with_reference(Some(platoon()), kind, &recipe(), 0, |stage| {
            let window = stage.set.get(stage.train[11]).unwrap();
            let seen = OrientedView::recorded(&window.observation());
            let truths = kind.uses_future().then(|| [window.truth()]);
            let truths = truths.as_ref().map(|truths| truths.as_slice());
            let output = stage.net.forward(&[seen], truths, Ask::Predict).unwrap();
            let reference = output.reference.as_ref().unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
            let path = platoon().path(&window.observation(), 1.).unwrap();
            let end = [-path[9][1] / 0.3048, path[9][0] / 0.3048];
            assert!(reference[8..].iter().zip(end).all(|(a, b)| (a - b).abs() < 1e-3), "{kind:?}");
            let off = |output: &Output| -> Vec<f32> {
                let mean = output.mixture_mean().unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
                mean.iter().zip(&reference).map(|(mean, reference)| mean - reference).collect()
            };
            let whole = off(&output);
            let half = off(&output.trusting(0.5).unwrap());
            assert!(whole.iter().any(|off| off.abs() > 1e-4), "{kind:?}");
            assert!(whole.iter().zip(half).all(|(whole, half)| (whole / 2. - half).abs() < 1e-4), "{kind:?}");
        });
    }
}

/// What is believed of a deviation has the least squared error: neither more nor less is better.
#[test]
fn the_share_that_is_believed_is_the_best_one() {
    let recordings = [road::plain()];
    let (set, _) = WindowSet::cut(&recordings, &road::config()).unwrap();
    let (train, validation) = parts(&set);
    let rule = platoon();
    let data = Training { set: &set, train: &train, validation: &validation, split_hash: "s", reference: Some(&rule) };
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let kind = NeuralBaseline::CsLstm;
    let learned = TrainedBaseline::train(kind, &recipe(), &data, folder.path(), &Device::Cpu, (), &stop).unwrap();
    let trust = learned.header().trust.expect("it is fitted");
    assert_eq!((learned.name(), learned.form()), ("CS-LSTM + platoon", OutputForm::Deviation));
    let windows: Vec<_> = validation.iter().map(|id| set.get(*id).unwrap()).collect();
    let error = |trust: f64| -> f64 {
        let seen: Vec<_> = windows.iter().map(|window| OrientedView::recorded(&window.observation())).collect();
        let output = learned.net().forward(&seen, None, Ask::Predict).unwrap().trusting(trust).unwrap();
        let truths = windows.iter().map(|window| (window.truth(), Variation::RECORDED));
        let truths = learned.net().inputs.futures(truths, &Device::Cpu).unwrap();
        let off = (truths - output.mixture_mean().unwrap()).unwrap();
        f64::from(off.sqr().unwrap().mean_all().unwrap().to_scalar::<f32>().unwrap())
    };
    for other in [trust - 0.1, trust + 0.1].into_iter().filter(|other| (0. ..=1.).contains(other)) {
        assert!(error(trust) <= error(other), "{trust}: {}; {other}: {}", error(trust), error(other));
    }
    // The file knows it, and a second call trains nothing.
    let path = TrainedBaseline::path(folder.path(), kind, OutputForm::Deviation);
    assert_eq!(TrainedBaseline::load(&path, &Device::Cpu).unwrap().header().trust, Some(trust));
    let other = PlatoonRule::of_drivers(Drivers { time_gap: 2., ..Drivers::TYPICAL }).unwrap();
    let data = Training { reference: Some(&other), ..data };
    let refused = TrainedBaseline::train(kind, &recipe(), &data, folder.path(), &Device::Cpu, (), &stop).unwrap_err();
    assert!(refused.to_string().contains("another reference rule"), "{refused}");
}

#[test]
fn windows_are_varied_as_the_recipe_says() {
    let differs = |recipe: Recipe| {
        with_stage(NeuralBaseline::CsLstm, &recipe, 0, |stage| {
            let loss = |seed| stage.loss(Part::whole(&[5], seed)).unwrap().to_scalar::<f32>().unwrap();
            let recorded = with_stage(NeuralBaseline::CsLstm, &self::recipe(), 0, |plain| {
                plain.loss(Part::whole(&[5], 0)).unwrap().to_scalar::<f32>().unwrap()
            });
            (0..60).filter(|seed| loss(*seed) != recorded).count()
        })
    };
    let mirror = |mirror: f64| differs(Recipe { mirror, ..recipe() });
    assert_eq!((mirror(0.), mirror(1.)), (0, 60));
    assert!((10..30).contains(&mirror(0.3)), "{}", mirror(0.3));
    assert_eq!(differs(Recipe { longitudinal_scale: 1.2, ..recipe() }), 60);
}

/// A network that was not trained, as a predictor.
fn untrained(kind: NeuralBaseline, set: &WindowSet<'_>, reference: Option<&PlatoonRule>) -> TrainedBaseline {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { steps: 1, learning_rate: 1e-12, ..recipe() };
    let (train, validation) = (&set.ids()[..3], &set.ids()[..2]);
    let data = Training { set, train, validation, split_hash: "h", reference };
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
    let kinds = TRAINED.into_iter().chain([NeuralBaseline::PipSurrogate]);
    let rule = platoon();
    for (kind, reference) in kinds.flat_map(|kind| [(kind, None), (kind, Some(&rule))]) {
        let learned = untrained(kind, &set, reference);
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
        let learned = untrained(kind, &set, None);
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
        let learned = untrained(kind, &set, None);
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
    let rule = platoon();
    for (kind, reference) in
        [(NeuralBaseline::CsLstmM, None), (NeuralBaseline::CsLstmM, Some(&rule)), (NeuralBaseline::PipSurrogate, None)]
    {
        let data = Training { set: &set, train: &train, validation: &validation, split_hash: "split", reference };
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
        assert!(straight.header().epoch > recipe().warm_up_epochs(train.len()), "chosen in the phase of likelihood");
        assert!(straight.header().simulated && straight.header().split_hash == "split");

        let mut loaded =
            TrainedBaseline::load(&TrainedBaseline::path(whole.path(), kind, straight.form()), &Device::Cpu).unwrap();
        if kind == NeuralBaseline::PipSurrogate {
            let refused = loaded.predict(&observations, 6).unwrap_err().to_string();
            assert!(refused.contains("PiP (ego future known)"), "{refused}");
            loaded = loaded.with_surrogate_plan().unwrap();
        }
        assert_eq!(loaded.predict(&observations, 6).unwrap(), forecasts);
        // Six futures whose probabilities sum to 1, behind the prediction the likeliest first, one point a frame.
        let modes = &forecasts[0].modes;
        assert_eq!((modes.len(), modes[0].path.len()), (6, 10));
        assert!((modes.iter().map(|mode| mode.probability).sum::<f32>() - 1.).abs() < 1e-5);
        assert!(modes[1..].is_sorted_by(|a, b| a.probability >= b.probability));
        let windows: Vec<_> = validation.iter().map(|id| set.get(*id).unwrap()).collect();
        assert!(loaded.nll(&windows).unwrap().iter().all(|nll| nll.is_finite()));

        // Stopped between the last epoch and the share that is believed, and with its best weights gone.
        let path = TrainedBaseline::path(whole.path(), kind, straight.form());
        let Checkpoint { header, tensors } = Checkpoint::load(&path).unwrap();
        assert_eq!(header.trust.is_some(), reference.is_some());
        Checkpoint { header: Header { trust: None, ..header.clone() }, tensors }.save(&path).unwrap();
        assert_eq!(go(whole.path(), u64::MAX).unwrap().header(), &header);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(go(whole.path(), u64::MAX).unwrap().header(), &header, "trained again, to the same end");
        // Cut off, or of another training of the same epoch.
        let bytes = std::fs::read(&path).unwrap();
        let Checkpoint { header: mine, tensors } = Checkpoint::load(&path).unwrap();
        let scores = mine.scores.iter().map(|(name, score)| (name.clone(), score + 0.5)).collect();
        Checkpoint { header: Header { scores, ..mine }, tensors }.save(&path).unwrap();
        let foreign = std::fs::read(&path).unwrap();
        assert_ne!(foreign, bytes);
        let damages = [&bytes[..bytes.len() / 2], &foreign];
        for damaged in damages.into_iter().filter(|_| kind == NeuralBaseline::CsLstmM && reference.is_none()) {
            std::fs::write(&path, damaged).unwrap();
            go(whole.path(), u64::MAX).unwrap();
            assert!(std::fs::read(&path).unwrap() == bytes, "{kind:?}");
        }

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
    let data = Training { set: &set, train: set.ids(), validation: set.ids(), split_hash: "split", reference: None };
    let recipe = Recipe { steps: 40, warm_up: 1., batch: 9, learning_rate: 5e-3, fused_targets: 0, ..recipe() };
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
    let learned = untrained(NeuralBaseline::CsLstm, &set, None);
    let longer = gnp_data::WindowConfig { predicted_s: 2., ..road::config() };
    let (other, _) = WindowSet::cut(&recordings, &longer).unwrap();
    let observation = other.get(other.ids()[0]).unwrap().observation();
    let message = learned.predict(&[observation], 1).unwrap_err().to_string();
    assert!(message.contains("10 frames") && message.contains("20 frames"), "{message}");
    assert!(learned.with_surrogate_plan().unwrap_err().to_string().contains("takes no plan"));
}
