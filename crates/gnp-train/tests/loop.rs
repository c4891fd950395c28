//! The training loop on a toy: a line is fitted to points, with noise drawn from the step's seed so
//! that a step with another seed, order or moment would be seen.

// clippy.toml allows these inside test functions alone; the toy and its files stand outside.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use candle_core::{Device, Tensor, Var};
use gnp_train::{
    BatchReport, BatchTotals, CheckpointSlot, End, EpochReport, Observer, Part, Plan, Progress, Schedule, Sink, Stage,
    TrainConfig, TrainError, Trainer, TrainingState,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `y = 2 x - 1` at 11 training and 5 validation points.
struct Line {
    slope: Var,
    offset: Var,
    /// Added to the validation score of each call in turn; then nothing.
    penalties: Vec<f64>,
    calls: AtomicUsize,
    train: usize,
    validation: usize,
    nan_at: Option<u64>,
    /// Training and validation windows from these places on are of another site.
    other_site: Option<[usize; 2]>,
    steps: AtomicU64,
    /// Windows, place of the first in the mini-batch, and seed of every step or part of one.
    asked: Mutex<Vec<(Vec<usize>, usize, u64)>>,
    /// Windows of a part of a batch.
    part: Option<usize>,
}

impl Line {
    fn new() -> Self {
        let zero = || Var::new(&[0f32], &Device::Cpu).unwrap();
        Self {
            slope: zero(),
            offset: zero(),
            penalties: Vec::new(),
            calls: AtomicUsize::new(0),
            train: 11,
            validation: 5,
            nan_at: None,
            other_site: None,
            steps: AtomicU64::new(0),
            asked: Mutex::default(),
            part: None,
        }
    }

    fn error(&self, xs: &[f32], noise: &[f32]) -> candle_core::Result<Tensor> {
        let ys: Vec<f32> = xs.iter().zip(noise).map(|(x, e)| 2. * x - 1. + e).collect();
        let (x, y) = (Tensor::new(xs, &Device::Cpu)?, Tensor::new(ys, &Device::Cpu)?);
        (x.broadcast_mul(&self.slope)?.broadcast_add(&self.offset)? - y)?.sqr()
    }

    /// Windows, place of the first in the mini-batch, and seed of every step so far, or part of one.
    fn asked(&self) -> Vec<(Vec<usize>, usize, u64)> {
        self.asked.lock().unwrap().clone()
    }

    fn weights(&self) -> Vec<u32> {
        let bits = |var: &Var| var.to_vec1::<f32>().unwrap()[0].to_bits();
        vec![bits(&self.slope), bits(&self.offset)]
    }
}

impl Stage for Line {
    fn name(&self) -> &'static str {
        "line"
    }

    fn trainable(&self) -> BTreeMap<String, Var> {
        [("slope".to_owned(), self.slope.clone()), ("offset".to_owned(), self.offset.clone())].into()
    }

    fn train_len(&self) -> usize {
        self.train
    }

    fn validation_len(&self) -> usize {
        self.validation
    }

    fn train_sites(&self) -> Vec<u32> {
        self.other_site.map_or_else(Vec::new, |[from, _]| (0..self.train).map(|i| u32::from(i >= from)).collect())
    }

    fn validation_sites(&self) -> Vec<u32> {
        self.other_site.map_or_else(Vec::new, |[_, from]| (0..self.validation).map(|i| u32::from(i >= from)).collect())
    }

    fn part_windows(&self) -> Option<usize> {
        self.part
    }

    fn loss(&self, part: Part<'_>) -> Result<Tensor, TrainError> {
        self.asked.lock().unwrap().push((part.windows.to_vec(), part.first, part.seed));
        let xs: Vec<f32> = part.windows.iter().map(|i| *i as f32 / 10.).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(part.seed);
        let noise = (0..part.first + xs.len()).map(|_| rng.random_range(-0.1..0.1));
        let noise: Vec<f32> = noise.skip(part.first).collect();
        let loss = self.error(&xs, &noise)?.mean_all()?;
        let step = self.steps.fetch_add(1, Ordering::Relaxed);
        Ok(if self.nan_at == Some(step) { (loss * f64::NAN)? } else { loss })
    }

    fn validate(&self, batch: &[usize]) -> Result<BatchTotals, TrainError> {
        let xs: Vec<f32> = batch.iter().map(|i| *i as f32 / 7.).collect();
        let sum = f64::from(self.error(&xs, &vec![0.; xs.len()])?.sum_all()?.to_scalar::<f32>()?);
        let call = self.calls.fetch_add(1, Ordering::Relaxed);
        let penalty = self.penalties.get(call).copied().unwrap_or(0.);
        Ok(BatchTotals::new(batch.len(), [("squared_error", sum + penalty), ("points", batch.len() as f64)]))
    }
}

fn config() -> TrainConfig {
    TrainConfig {
        epochs: 6,
        batch: 3,
        epoch_windows: 0,
        site_sampling_exponent: 0.,
        learning_rate: 0.05,
        schedule: Schedule::Step { factor: 0.5, epochs: vec![2, 4] },
        weight_decay: 0.01,
        clip_norm: 1.,
        patience: 0,
        seed: 8,
    }
}

/// Keeps what a file would: tensors under one set of names, and the progress as JSON.
#[derive(Default)]
struct Files {
    saved: Vec<(CheckpointSlot, BTreeMap<String, Tensor>, String)>,
    full: bool,
}

impl Sink for Files {
    fn save(&mut self, kind: CheckpointSlot, state: &TrainingState) -> Result<(), Box<dyn Error + Send + Sync>> {
        if self.full {
            return Err("no space left".into());
        }
        let mut tensors = state.tensors();
        // A frozen weight, as the checkpoint of a real stage has.
        tensors.insert("frozen".to_owned(), Tensor::new(&[7f32], &Device::Cpu)?);
        self.saved.push((kind, tensors, serde_json::to_string(&state.progress)?));
        Ok(())
    }
}

impl Files {
    fn last(&self, kind: CheckpointSlot) -> TrainingState {
        let (_, tensors, progress) = self.saved.iter().rfind(|(k, ..)| *k == kind).expect("saved");
        let progress: Progress = serde_json::from_str(progress).unwrap();
        TrainingState::from_tensors(tensors, progress)
    }
}

/// Raises the flag after a number of batches, or when the first epoch's last batch is done.
struct StopAfter<'a>(u64, &'a AtomicBool);

impl Observer for StopAfter<'_> {
    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        if report.steps == self.0 {
            self.1.store(true, Ordering::Relaxed);
        }
        Ok(())
    }
}

fn go() -> AtomicBool {
    AtomicBool::new(false)
}

fn train(config: &TrainConfig, stage: &Line) -> (gnp_train::Outcome, Files) {
    let stop = go();
    let mut files = Files::default();
    let outcome = Trainer { config, sink: &mut files, observer: (), stop: &stop }.fit(stage).unwrap();
    (outcome, files)
}

fn fails(config: &TrainConfig, stage: &Line) -> TrainError {
    let stop = go();
    Trainer { config, sink: Files::default(), observer: (), stop: &stop }.fit(stage).unwrap_err()
}

#[test]
fn a_line_is_found_and_the_curves_are_kept() {
    let line = Line::new();
    let config = TrainConfig { epochs: 200, weight_decay: 0., schedule: Schedule::Constant {}, ..config() };
    let (outcome, _) = train(&config, &line);
    let slope = line.slope.to_vec1::<f32>().unwrap()[0];
    assert!((slope - 2.).abs() < 0.1, "{slope}");
    assert_eq!(outcome.end, End::Finished);
    let history = &outcome.progress.history;
    assert_eq!(history.len(), 200);
    assert_eq!(history[9].epoch, 10);
    assert_eq!(history[9].steps, 40, "11 points in batches of 3 are 4 steps an epoch");
    assert!(history[199].train_loss < history[0].train_loss / 10.);
    assert_eq!(history[0].validation[1].value, 1.);
}

#[test]
fn the_loss_of_an_epoch_weighs_every_window_alike() {
    // At a rate too small to move f32 weights of 0 visibly, the mean over the epoch is that of all points.
    let line = Line::new();
    let config = TrainConfig { epochs: 1, learning_rate: 1e-12, ..config() };
    let (outcome, _) = train(&config, &line);
    let all: f64 = (0..11).map(|i| (2. * f64::from(i) / 10. - 1.).powi(2)).sum::<f64>() / 11.;
    let loss = f64::from(outcome.progress.history[0].train_loss);
    assert!((loss - all).abs() < 0.1, "{loss} and {all}");
    let validation: f64 = (0..5).map(|i| (2. * f64::from(i) / 7. - 1.).powi(2)).sum::<f64>() / 5.;
    assert!((f64::from(outcome.progress.history[0].validation[0].value) - validation).abs() < 1e-6);
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_one_does_not() {
    let run = |seed| {
        let line = Line::new();
        let (outcome, _) = train(&TrainConfig { seed, ..config() }, &line);
        (line.weights(), outcome.progress.history)
    };
    assert_eq!(run(8), run(8));
    assert_ne!(run(8).0, run(9).0);
}

#[test]
fn every_epoch_sees_every_window_once_in_an_order_and_with_seeds_of_its_own() {
    let line = Line::new();
    train(&TrainConfig { epochs: 3, ..config() }, &line);
    let asked = line.asked();
    let mut seeds: Vec<u64> = asked.iter().map(|(.., seed)| *seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 3 * 4);
    let orders: Vec<Vec<usize>> =
        asked.chunks(4).map(|epoch| epoch.iter().flat_map(|(windows, ..)| windows.clone()).collect()).collect();
    assert!(orders[0] != orders[1] && orders[1] != orders[2] && orders[0] != orders[2], "{orders:?}");
    for mut order in orders {
        order.sort_unstable();
        assert_eq!(order, (0..11).collect::<Vec<_>>());
    }
}

/// Training on `threads` threads.
fn train_on(threads: usize, config: &TrainConfig, stage: &Line) -> gnp_train::Outcome {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| train(config, stage).0)
}

#[test]
fn a_batch_in_parts_is_the_same_on_any_number_of_threads() {
    let run = |threads| {
        let line = Line { part: Some(2), ..Line::new() };
        let outcome = train_on(threads, &TrainConfig { batch: 5, ..config() }, &line);
        (line.weights(), outcome.progress)
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(7), one);
}

#[test]
fn the_parts_of_a_batch_are_its_windows_in_order() {
    let [whole, apart] = [None, Some(2)].map(|part| {
        let line = Line { part, ..Line::new() };
        train_on(1, &TrainConfig { batch: 5, epochs: 1, ..config() }, &line);
        line.asked()
    });
    let (mut windows, mut places): (Vec<usize>, Vec<_>) = Default::default();
    for (of_part, first, seed) in &apart {
        windows.extend(of_part);
        places.push((of_part.len(), *first, whole.iter().position(|(.., of_batch)| of_batch == seed).unwrap()));
    }
    assert_eq!(windows, whole.iter().flat_map(|(windows, ..)| windows).copied().collect::<Vec<_>>());
    assert_eq!(places, [(2, 0, 0), (2, 2, 0), (1, 4, 0), (2, 0, 1), (2, 2, 1), (1, 4, 1), (1, 0, 2)]);
    // Never more than 16 parts, since each has a gradient of every weight.
    let line = Line { part: Some(2), train: 67, ..Line::new() };
    train_on(1, &TrainConfig { batch: 67, epochs: 1, ..config() }, &line);
    let sizes: Vec<usize> = line.asked().iter().map(|(windows, ..)| windows.len()).collect();
    assert_eq!(sizes, [vec![5; 13], vec![2]].concat());
}

#[test]
fn parts_give_the_loss_and_the_step_of_the_whole_batch() {
    let [(weights, whole), (others, apart)] = [None, Some(2)].map(|part| {
        let line = Line { part, ..Line::new() };
        let (outcome, _) = train(&TrainConfig { batch: 5, ..config() }, &line);
        (line.weights().into_iter().map(f32::from_bits).collect::<Vec<_>>(), outcome.progress.history)
    });
    for (a, b) in weights.iter().zip(&others) {
        assert!((a - b).abs() < 1e-5, "{weights:?} {others:?}");
    }
    for (a, b) in whole.iter().zip(&apart) {
        let pairs = a.validation.iter().zip(&b.validation).map(|(a, b)| (a.value, b.value));
        for (a, b) in pairs.chain([(a.train_loss, b.train_loss)]) {
            assert!((a - b).abs() < 1e-4, "{whole:?} {apart:?}");
        }
    }
}

#[test]
fn a_bad_part_ends_training_as_a_bad_batch_does() {
    // Three parts a batch: the fifth loss is of the second batch.
    let line = Line { part: Some(1), nan_at: Some(4), ..Line::new() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let message = pool.install(|| fails(&config(), &line)).to_string();
    assert!(message.contains("epoch 1, batch 2") && message.contains("learning rate"), "{message}");
}

#[test]
fn a_run_resumed_after_any_batch_ends_with_the_same_bits() {
    let whole = Line::new();
    let (expected, _) = train(&config(), &whole);
    // 4 is the end of the first epoch's batches, before its validation; 24 the end of training.
    for after in 1..24 {
        let stop = go();
        let first = Line::new();
        let mut files = Files::default();
        let observer = StopAfter(after, &stop);
        let outcome = Trainer { config: &config(), sink: &mut files, observer, stop: &stop }.fit(&first).unwrap();
        assert_eq!(outcome.end, End::Interrupted);
        assert_eq!(outcome.progress.steps, after);

        let (stop, second) = (go(), Line::new());
        let state = files.last(CheckpointSlot::Last);
        assert!(!state.weights.contains_key("frozen"));
        let mut trainer = Trainer { config: &config(), sink: &mut files, observer: (), stop: &stop };
        let outcome = trainer.resume(&second, &state).unwrap();
        assert_eq!(outcome.end, End::Finished, "after {after}");
        assert_eq!(second.weights(), whole.weights(), "after {after}");
        assert_eq!(outcome.progress, expected.progress, "after {after}");
    }
}

#[test]
fn more_epochs_continue_a_finished_run() {
    let long = Line::new();
    train(&TrainConfig { epochs: 9, ..config() }, &long);
    let (stop, line) = (go(), Line::new());
    let (_, mut files) = train(&config(), &line);
    let state = files.last(CheckpointSlot::Last);
    let more = TrainConfig { epochs: 9, ..config() };
    let outcome = Trainer { config: &more, sink: &mut files, observer: (), stop: &stop }.resume(&line, &state).unwrap();
    assert_eq!(outcome.progress.epoch, 9);
    assert_eq!(line.weights(), long.weights());
}

#[test]
fn the_best_epoch_is_kept_and_training_stops_after_the_patience() {
    // Two validation batches an epoch; from the third epoch on every score is worse.
    let mut line = Line::new();
    line.penalties = [vec![0.; 4], vec![100.; 40]].concat();
    let (outcome, files) = train(&TrainConfig { epochs: 20, patience: 3, ..config() }, &line);
    assert_eq!(outcome.end, End::EarlyStopped);
    assert_eq!(outcome.progress.epoch, 5);
    assert_eq!(outcome.progress.best.unwrap().epoch, 2);
    let best = files.last(CheckpointSlot::Best);
    assert_eq!(best.progress.epoch, 2);
    assert_eq!(best.progress.best.unwrap().score, outcome.progress.history[1].validation[0].value);
    assert_eq!(files.last(CheckpointSlot::Last).progress.epoch, 5);
    let kinds = |kind| files.saved.iter().filter(|(k, ..)| *k == kind).count();
    assert_eq!((kinds(CheckpointSlot::Best), kinds(CheckpointSlot::Last)), (2, 5));
    // Without patience it goes to the end.
    line.calls.store(0, Ordering::Relaxed);
    assert_eq!(train(&TrainConfig { epochs: 20, ..config() }, &line).0.progress.epoch, 20);
}

#[test]
fn a_part_of_the_windows_makes_an_epoch_when_asked() {
    let line = Line::new();
    let (outcome, _) = train(&TrainConfig { epoch_windows: 7, epochs: 2, ..config() }, &line);
    assert_eq!(outcome.progress.steps, 2 * 3);
}

#[test]
fn sites_count_alike_when_asked() {
    let share = |site_sampling_exponent: f64| {
        let line = Line { other_site: Some([9, 4]), train: 11, ..Line::new() };
        let config = TrainConfig { epochs: 60, site_sampling_exponent, ..config() };
        train(&config, &line);
        let asked = line.asked();
        let drawn: Vec<usize> = asked.iter().flat_map(|(windows, ..)| windows.clone()).collect();
        assert_eq!(drawn.len(), 60 * 11);
        drawn.iter().filter(|window| **window >= 9).count() as f64 / drawn.len() as f64
    };
    assert_eq!(share(0.), 2. / 11.);
    assert!((share(1.) - 0.5).abs() < 0.06);
    // Weights of 9 to the power of a half against 2 to it.
    assert!((share(0.5) - 0.32).abs() < 0.06);
}

#[test]
fn validation_scores_weigh_sites_as_training_does() {
    let score = |site_sampling_exponent: f64| {
        let line = Line { other_site: Some([9, 4]), ..Line::new() };
        // No step to speak of: the scores are those of y = 0.
        let config = TrainConfig { epochs: 1, learning_rate: 1e-12, site_sampling_exponent, ..config() };
        train(&config, &line).0.progress.history[0].validation[0].value
    };
    let errors = [0, 1, 2, 3, 4].map(|i| (2. * i as f32 / 7. - 1.).powi(2));
    let first = errors[..4].iter().sum::<f32>() / 4.;
    assert!((score(0.) - errors.iter().sum::<f32>() / 5.).abs() < 1e-5);
    assert!((score(1.) - (first + errors[4]) / 2.).abs() < 1e-5);
}

#[test]
fn observers_hear_of_every_batch_and_epoch() {
    #[derive(Default)]
    struct Log(Vec<String>);
    impl Observer for Log {
        fn on_start(&mut self, plan: &Plan) -> Result<(), TrainError> {
            self.0.push(format!("{} {}x{} of {}", plan.stage, plan.epochs, plan.batches, plan.windows));
            Ok(())
        }
        fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
            self.0.push(format!("{}.{} {} {}", report.epoch, report.batch, report.windows, report.learning_rate));
            Ok(())
        }
        fn on_epoch(&mut self, report: &EpochReport<'_>) -> Result<(), TrainError> {
            assert!(report.windows_per_second > 0. && report.seconds > 0.);
            self.0.push(format!("epoch {}", report.record.epoch));
            Ok(())
        }
    }
    let (stop, mut log) = (go(), Log::default());
    let config = TrainConfig { epochs: 1, ..config() };
    Trainer { config: &config, sink: Files::default(), observer: ((), &mut log), stop: &stop }
        .fit(&Line::new())
        .unwrap();
    let expected = ["line 1x4 of 11", "1.1 3 0.05", "1.2 3 0.05", "1.3 3 0.05", "1.4 2 0.05", "epoch 1"];
    assert_eq!(log.0, expected);
}

#[test]
fn a_loss_that_is_not_a_number_ends_training_by_its_place() {
    let mut line = Line::new();
    line.nan_at = Some(5);
    let message = fails(&config(), &line).to_string();
    assert!(message.contains("epoch 2, batch 2") && message.contains("learning rate"), "{message}");
}

#[test]
fn a_score_that_is_not_a_number_ends_training_by_its_name() {
    let mut line = Line::new();
    line.penalties = vec![f64::NAN];
    let message = fails(&config(), &line).to_string();
    assert!(message.contains("`squared_error`"), "{message}");
}

#[test]
fn bad_input_is_refused_before_a_step() {
    let mut line = Line::new();
    line.validation = 0;
    assert!(fails(&config(), &line).to_string().contains("validation part has no window"));
    line.train = 0;
    assert!(fails(&config(), &line).to_string().contains("training part has no window"));
    let error = fails(&TrainConfig { batch: 0, ..config() }, &Line::new());
    assert!(matches!(error, TrainError::Config { key: "batch", .. }), "{error}");
    assert!(line.asked().is_empty());
}

#[test]
fn a_checkpoint_that_cannot_be_written_ends_training() {
    let stop = go();
    let sink = &mut Files { full: true, ..Files::default() };
    let message = Trainer { config: &config(), sink, observer: (), stop: &stop }.fit(&Line::new()).unwrap_err();
    assert!(message.to_string().contains("best checkpoint: no space left"), "{message}");
}

#[test]
fn a_state_of_another_run_is_refused_and_changes_nothing() {
    let (_, files) = train(&config(), &Line::new());
    let good = files.last(CheckpointSlot::Last);
    let refused = |config: &TrainConfig, line: &Line, state: &TrainingState| {
        let (stop, before) = (go(), line.weights());
        let mut trainer = Trainer { config, sink: Files::default(), observer: (), stop: &stop };
        let error = trainer.resume(line, state).unwrap_err();
        assert!(matches!(error, TrainError::Resume { .. }), "{error}");
        assert_eq!(line.weights(), before);
        error.to_string()
    };
    let changed = |change: &dyn Fn(&mut TrainingState)| {
        let mut state = good.clone();
        change(&mut state);
        refused(&config(), &Line::new(), &state)
    };
    assert!(refused(&TrainConfig { seed: 9, ..config() }, &Line::new(), &good).contains("`seed` is 9 and was 8"));
    assert!(refused(&config(), &Line { train: 12, ..Line::new() }, &good).contains("12 training windows and were 11"));
    assert!(changed(&|s| s.progress.stage = "goal".into()).contains("stage `goal`"));
    assert!(changed(&|s| drop(s.weights.remove("slope"))).contains("`slope`"));
    assert!(changed(&|s| drop(s.second.remove("offset"))).contains("`offset`"));
    let wide = Tensor::new(&[1f32, 2.], &Device::Cpu).unwrap();
    assert!(changed(&|s| drop(s.weights.insert("slope".into(), wide.clone()))).contains("[1] and had [2]"));
    assert!(changed(&|s| drop(s.weights.insert("bend".into(), wide.clone()))).contains("`bend`"));
}
