//! The three stages on an embedded scene: the same seed gives the same bits, also over a stop and a resume
//! from files, and every trained weight is reached by its loss.

// clippy.toml allows these inside test functions alone; the runs stand outside.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use candle_core::{Device, Tensor, Var};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Recording, WindowConfig, WindowSet};
use gnp_goal::{GoalConfig, GoalNet, LabelConfig, LabelDistance, ProbabilityHead, Regression};
use gnp_model::{
    Component, FeatureConfig, Features, Header, NeighbourInput, ReferencePath, Representation, SeenNeighbours,
};
use gnp_modes::{ModeParams, Modes};
use gnp_nn::Weights;
use gnp_train::{
    BatchReport, CheckpointSlot, Checkpoints, End, GoalStage, GoalTraining, History, Observer, Part, PathStage,
    PathTraining, Schedule, Sink, Stage, TrainConfig, TrainError, Trainer, TrainingState, Windows,
};
use gnp_traj::{InputScale, Integrator, SocialForce, TrajConfig};

const SEED: u64 = 11;

/// Short windows of one embedded scene: enough to train on, and quick.
fn windows() -> WindowConfig {
    WindowConfig { observed_s: 1., predicted_s: 1.5, rate_hz: 10., stride_s: 2.5, site_stride_s: Default::default() }
}

fn recording() -> Recording {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/ngsim/us101-10_1.csv.gz");
    let sources = gnp_data::discover(&file, Dataset::NGSIM).unwrap();
    let expected = Expectation { dataset: Dataset::NGSIM, rate_hz: Some(10.) };
    let mut recordings = gnp_data::read(&sources[0], &expected).unwrap();
    recordings.remove(0).0
}

fn goal_config() -> GoalConfig {
    GoalConfig {
        width: 8,
        heads: 2,
        layers: 1,
        feed_forward: 2,
        dropout: 0.1,
        probability: ProbabilityHead::Decoder,
        regression: Regression::Residual,
        null_token: true,
        slot_embedding: true,
        zero_start: false,
    }
}

fn traj_config() -> TrajConfig {
    TrajConfig {
        hidden: 12,
        embedding: 6,
        latent_dim: 5,
        encoder: vec![7],
        decoder: vec![9, 8],
        tau_max: 1.,
        k_max: 10.,
        k_max_line: 1.,
        k_bias: -3.,
        r_col: 10.,
        lines: true,
        input_scale: InputScale { position: 0.02, velocity: 0.05 },
        integrator: Integrator::SemiImplicitEuler,
        network_period: 1,
        terms: Vec::new(),
    }
}

fn train_config() -> TrainConfig {
    TrainConfig {
        epochs: 2,
        batch: 16,
        epoch_windows: 50,
        site_sampling_exponent: 0.,
        learning_rate: 1e-3,
        schedule: Schedule::Constant {},
        weight_decay: 0.,
        clip_norm: 1.,
        patience: 0,
        seed: SEED,
    }
}

/// Stops after a number of steps; never for 0.
struct StopAfter<'a>(u64, &'a AtomicBool);

impl Observer for StopAfter<'_> {
    fn on_batch(&mut self, report: &BatchReport) -> Result<(), TrainError> {
        assert!(report.gradient_norm > 0.);
        self.1.store(report.steps == self.0, Ordering::Relaxed);
        Ok(())
    }
}

/// Trains to the end, by way of a stop after `stop_after` steps and a resume from files.
fn train<S: Stage>(build: &dyn Fn(&Weights) -> S, header: &Header, start: &Weights, stop_after: u64) -> Weights {
    let folder = tempfile::tempdir().unwrap();
    let config = train_config();
    let mut stops = if stop_after == 0 { vec![0] } else { vec![stop_after, 0] };
    loop {
        let weights = Weights::seeded(SEED, &Device::Cpu);
        let copies: Vec<(String, Tensor)> =
            start.named().into_iter().map(|(name, var)| (name, var.as_tensor().copy().unwrap())).collect();
        weights.set(copies.iter().map(|(name, tensor)| (name.as_str(), tensor))).unwrap();
        let stage = build(&weights);
        let mut sink = Checkpoints::new(folder.path(), header.clone(), &weights);
        let last = sink.last().unwrap();
        let stop = AtomicBool::new(false);
        let observer = StopAfter(stops.remove(0), &stop);
        let mut trainer = Trainer { config: &config, sink: &mut sink, observer, stop: &stop };
        let outcome = match &last {
            Some(state) => trainer.resume(&stage, state).unwrap(),
            None => trainer.fit(&stage).unwrap(),
        };
        if stops.is_empty() {
            assert_eq!(outcome.end, End::Finished);
            let scores: Vec<f32> = outcome.progress.history.iter().map(|record| record.validation[0].value).collect();
            assert!(scores[1] < scores[0], "{scores:?}");
            check_files(folder.path(), &sink, &weights);
            let history = History { stage: outcome.progress.stage, epochs: outcome.progress.history };
            history.save(&folder.path().join("history.json")).unwrap();
            drop(stage);
            return weights;
        }
        assert_eq!(outcome.end, End::Interrupted);
    }
}

/// The best epoch is the last one here, so its file has the weights of the network.
fn check_files(folder: &Path, sink: &Checkpoints, weights: &Weights) {
    let last = bits(weights);
    sink.restore_best().unwrap();
    assert_eq!(bits(weights), last);
    assert!(sink.path(CheckpointSlot::Best).starts_with(folder));
}

fn bits(weights: &Weights) -> Vec<(String, Vec<u32>)> {
    let values = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let bits = |(name, var): (String, candle_core::Var)| {
        (name, values(var.as_tensor()).into_iter().map(f32::to_bits).collect())
    };
    weights.named().into_iter().map(bits).collect()
}

struct Data<'a> {
    features: Features,
    modes: Modes,
    parts: [Windows<'a>; 2],
    header: Header,
}

fn with_data(test: impl FnOnce(&Data<'_>)) {
    let recordings = [recording()];
    let (set, _) = WindowSet::cut(&recordings, &windows()).unwrap();
    let ids = set.ids();
    let (train, validation) = ids.split_at(ids.len() - 17);
    let features = FeatureConfig {
        representation: Representation::Deviation,
        reference: ReferencePath::Platoon,
        length_scale: 5.,
        velocity_window_s: 0.3,
        history_block_s: 0.2,
        vehicles_ahead: 2,
        neighbours: SeenNeighbours::All,
        car_following_features: true,
    };
    let seen = || train.iter().filter_map(|id| set.get(*id));
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    let features =
        Features::fit(&features, set.shape(), Some(&platoon), seen().map(|window| window.observation())).unwrap();
    let futures: Vec<f32> = seen()
        .flat_map(|window| {
            let seen = gnp_model::AugmentedView::recorded(window.observation());
            features.future(&features.situation(seen).unwrap(), &window)
        })
        .collect();
    let params = ModeParams { modes: 6, seed: SEED, max_iterations: 30, restarts: 1 };
    let modes = gnp_modes::fit(&futures, set.shape().t_pred, features.mode_frame(), &params).unwrap();
    let header = Header {
        part: Component::Goal,
        dataset: Dataset::NGSIM,
        simulated: false,
        shape: set.shape(),
        features: features.clone(),
        goal: Some(goal_config()),
        traj: None,
        seed: SEED,
        code_version: "test".into(),
        split_hash: "test".into(),
        epoch: 0,
        scores: Default::default(),
        origin: None,
        trust: None,
        trainer: None,
    };
    let parts = [Windows::new(&set, train), Windows::new(&set, validation)];
    test(&Data { features, modes, parts, header });
}

fn goal_training() -> GoalTraining {
    let labels = LabelConfig { distance: LabelDistance::MeanDisplacement, temperature: 0.5 };
    GoalTraining { alpha: 0.2, mean_weight: 1., labels, mirror: 0.5, longitudinal_scale: 1.3 }
}

fn path_training() -> PathTraining {
    PathTraining { goal_noise_m: [0.05, 0.02], mirror: 0.5, longitudinal_scale: 1.3 }
}

/// No weight is out of the loss's reach.
fn check_reach(stage: &dyn Stage) {
    let gradients = stage.loss(Part::whole(&[0, 3, 8], 4)).unwrap().backward().unwrap();
    let norm = |tensor: &Tensor| tensor.sqr().unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
    let silent: Vec<String> = stage
        .trainable()
        .into_iter()
        .filter(|(_, var)| gradients.get(var).is_none_or(|gradient| norm(gradient) == 0.))
        .map(|(name, _)| name)
        .collect();
    // What is added to every key alike, or to every logit, leaves a softmax as it is.
    let flat = |name: &str| name.ends_with("attn.k.bias") || name == "prob.bias";
    let silent: Vec<&String> = silent.iter().filter(|name| !flat(name)).collect();
    assert!(silent.is_empty(), "{}: {silent:?}", stage.name());
}

/// Parts of a batch have its loss and its gradient, whatever is drawn for its windows.
fn check_parts(stage: &dyn Stage) {
    let (windows, seed) = ([0, 3, 8, 1, 4], 4);
    let of = |windows: &[usize], first: usize| {
        let share = windows.len() as f64 / 5.;
        let loss = (stage.loss(Part { windows, first, seed }).unwrap() * share).unwrap();
        let gradients = loss.backward().unwrap();
        let gradient = |(_, var): (String, Var)| match gradients.get(&var) {
            Some(gradient) => gradient.flatten_all().unwrap().to_vec1::<f32>().unwrap(),
            None => vec![0.; var.elem_count()],
        };
        let values: Vec<f32> = stage.trainable().into_iter().flat_map(gradient).collect();
        (loss.to_scalar::<f32>().unwrap(), values)
    };
    let (whole, first, second) = (of(&windows, 0), of(&windows[..3], 0), of(&windows[3..], 3));
    assert!((first.0 + second.0 - whole.0).abs() < 1e-4 * whole.0.abs(), "{}: loss", stage.name());
    let largest = whole.1.iter().fold(0f32, |most, g| most.max(g.abs()));
    for ((a, b), whole) in first.1.iter().zip(&second.1).zip(&whole.1) {
        assert!((a + b - whole).abs() < 1e-4 * largest, "{}: {a} + {b} is not {whole}", stage.name());
    }
    // Draws belong to the place in the batch: elsewhere they are others.
    assert_ne!(of(&windows[3..], 0), second, "{}", stage.name());
}

#[test]
fn goals_repeat_bit_for_bit_and_over_a_resume() {
    with_data(|data| {
        let training = goal_training();
        let build = |weights: &Weights| {
            let net = GoalNet::new(&goal_config(), data.features.goal_shape(), weights.builder()).unwrap();
            let stage = GoalStage::new(net, weights, &data.features, &data.modes, data.parts, &training).unwrap();
            check_reach(&stage);
            check_parts(&stage);
            stage
        };
        let none = Weights::seeded(SEED, &Device::Cpu);
        let whole = train(&build, &data.header, &none, 0);
        assert_eq!(bits(&train(&build, &data.header, &none, 0)), bits(&whole));
        assert_eq!(bits(&train(&build, &data.header, &none, 3)), bits(&whole));
    });
}

#[test]
fn paths_repeat_bit_for_bit_and_over_a_resume() {
    with_data(|data| {
        let training = path_training();
        let header = |part| Header { part, goal: None, traj: Some(traj_config()), ..data.header.clone() };
        let force = |weights: &Weights| SocialForce::new(&traj_config(), weights.builder()).unwrap();
        let attraction = |weights: &Weights| {
            let stage = PathStage::attraction(force(weights), weights, &data.features, data.parts, &training).unwrap();
            check_reach(&stage);
            check_parts(&stage);
            stage
        };
        let none = Weights::seeded(SEED, &Device::Cpu);
        let whole = train(&attraction, &header(Component::Attraction), &none, 0);
        assert_eq!(bits(&train(&attraction, &header(Component::Attraction), &none, 5)), bits(&whole));

        let mut ends = Vec::new();
        for neighbours in [NeighbourInput::ConstantVelocity, NeighbourInput::Oracle] {
            let repulsion = |weights: &Weights| {
                let parts = data.parts;
                let stage = PathStage::repulsion(force(weights), weights, &data.features, parts, neighbours, &training);
                let stage = stage.unwrap();
                check_reach(&stage);
                check_parts(&stage);
                stage
            };
            let pushed = train(&repulsion, &header(Component::Repulsion), &whole, 0);
            assert_eq!(bits(&train(&repulsion, &header(Component::Repulsion), &whole, 2)), bits(&pushed));
            // The attraction is frozen, and its weights are in the repulsion's file.
            let moved = |part: &str| {
                let pairs = bits(&whole).into_iter().zip(bits(&pushed));
                pairs.filter(|((name, _), _)| name.starts_with(part)).all(|((_, a), (_, b))| a != b)
            };
            for part in ["emb1.", "cell1.", "out1.", "enc_goal.", "tau."] {
                let still = bits(&whole).into_iter().zip(bits(&pushed)).filter(|((name, _), _)| name.starts_with(part));
                assert!(still.into_iter().all(|(a, b)| a == b), "{part}");
            }
            for part in ["emb2.", "cell2.", "out2.", "enc_nei.", "enc_line.", "k.", "k_line."] {
                assert!(moved(part), "{part}");
            }
            ends.push(bits(&pushed));
        }
        assert_ne!(ends[0], ends[1], "recorded neighbours teach something else");
    });
}

#[test]
fn noise_and_mirror_follow_the_step_and_are_off_in_validation() {
    with_data(|data| {
        let loss = |training: &PathTraining, seed| {
            let weights = Weights::seeded(SEED, &Device::Cpu);
            let force = SocialForce::new(&traj_config(), weights.builder()).unwrap();
            let stage = PathStage::attraction(force, &weights, &data.features, data.parts, training).unwrap();
            let scores = stage.validate(&[0, 2, 5]).unwrap().means();
            (stage.loss(Part::whole(&[1, 4, 7], seed)).unwrap().to_scalar::<f32>().unwrap(), scores)
        };
        let published = PathTraining { goal_noise_m: [0., 0.], mirror: 0., longitudinal_scale: 1. };
        let (plain, scores) = loss(&published, 1);
        assert_eq!(loss(&published, 2).0, plain);
        for training in [
            PathTraining { goal_noise_m: [3., 1.], mirror: 0., longitudinal_scale: 1. },
            PathTraining { goal_noise_m: [0., 0.], mirror: 1., longitudinal_scale: 1. },
        ] {
            let (changed, same_scores) = loss(&training, 1);
            assert_ne!(changed, plain);
            assert_eq!(same_scores, scores);
            assert_eq!(loss(&training, 1).0, changed);
        }
        assert_ne!(loss(&PathTraining { goal_noise_m: [3., 1.], mirror: 0., longitudinal_scale: 1. }, 2).0, plain);
    });
}

#[test]
fn scores_are_those_of_single_windows() {
    with_data(|data| {
        let weights = Weights::seeded(SEED, &Device::Cpu);
        let net = GoalNet::new(&goal_config(), data.features.goal_shape(), weights.builder()).unwrap();
        let training = goal_training();
        let stage = GoalStage::new(net, &weights, &data.features, &data.modes, data.parts, &training).unwrap();
        let together = stage.validate(&[0, 1, 2]).unwrap().means();
        let mut one_by_one = gnp_train::BatchTotals::default();
        for i in 0..3 {
            assert!(one_by_one.add(&stage.validate(&[i]).unwrap()));
        }
        let names = ["loss", "regression", "classification", "fde", "min_fde_6"];
        for (((name, a), (_, b)), expected) in together.iter().zip(one_by_one.means()).zip(names) {
            assert_eq!(*name, expected);
            assert!((a - b).abs() < 1e-4 * (1. + a.abs()), "{name}: {a} and {b}");
        }
        assert!(together[4].1 <= together[3].1);
    });
}

#[test]
fn a_last_checkpoint_of_other_windows_is_refused() {
    with_data(|data| {
        let training = goal_training();
        let weights = Weights::seeded(SEED, &Device::Cpu);
        let net = GoalNet::new(&goal_config(), data.features.goal_shape(), weights.builder()).unwrap();
        let stage = GoalStage::new(net, &weights, &data.features, &data.modes, data.parts, &training).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let config = TrainConfig { epochs: 1, ..train_config() };
        let sink = || Checkpoints::new(folder.path(), data.header.clone(), &weights);
        let stop = AtomicBool::new(false);
        Trainer { config: &config, sink: sink(), observer: (), stop: &stop }.fit(&stage).unwrap();
        assert_eq!(sink().last().unwrap().unwrap().progress.epoch, 1);

        let other = Header { split_hash: "other".into(), ..data.header.clone() };
        let message = Checkpoints::new(folder.path(), other, &weights).last().unwrap_err().to_string();
        assert!(message.contains("the split is not that of"), "{message}");
        let path = sink().path(CheckpointSlot::Last);
        std::fs::write(&path, b"cut off").unwrap();
        assert!(sink().last().unwrap().is_none(), "a damaged one is no place to go on from");
        // A network with a weight that the file lacks is not left with what was drawn.
        let larger = Weights::seeded(SEED, &Device::Cpu);
        larger.builder().get(1, "more").unwrap();
        let message =
            Checkpoints::new(folder.path(), data.header.clone(), &larger).restore_best().unwrap_err().to_string();
        assert!(message.contains("goal.safetensors: has no weight `more`"), "{message}");
    });
}

/// Fails as a full disk would, or a kill, at its last checkpoint of an epoch.
struct FullAt(usize, Checkpoints);

impl Sink for FullAt {
    fn save(
        &mut self,
        kind: CheckpointSlot,
        state: &TrainingState,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        if kind == CheckpointSlot::Last && state.progress.epoch == self.0 {
            return Err("no space left".into());
        }
        self.1.save(kind, state)
    }
}

/// Goes on with the training of goals in `folder`; what came of it, and whether it started anew.
fn go_on(
    data: &Data<'_>,
    config: &TrainConfig,
    folder: &Path,
    stop_after: u64,
    full_at: usize,
) -> (Result<gnp_train::Progress, TrainError>, bool) {
    let weights = Weights::seeded(SEED, &Device::Cpu);
    let net = GoalNet::new(&goal_config(), data.features.goal_shape(), weights.builder()).unwrap();
    let training = goal_training();
    let stage = GoalStage::new(net, &weights, &data.features, &data.modes, data.parts, &training).unwrap();
    let mut sink = FullAt(full_at, Checkpoints::new(folder, data.header.clone(), &weights));
    let last = sink.1.last().unwrap();
    let stop = AtomicBool::new(false);
    let mut trainer = Trainer { config, sink: &mut sink, observer: StopAfter(stop_after, &stop), stop: &stop };
    let outcome = match &last {
        Some(state) => trainer.resume(&stage, state),
        None => trainer.fit(&stage),
    };
    let close = |outcome: gnp_train::Outcome| match outcome.end {
        End::Interrupted => Ok(outcome.progress),
        _ => sink.1.close(&outcome.progress).map(|()| outcome.progress),
    };
    (outcome.and_then(close), last.is_none())
}

#[test]
fn the_best_weights_are_believed_only_as_those_of_this_training() {
    with_data(|data| {
        // A rate this high makes another epoch than the last the best one.
        let config = TrainConfig { epochs: 5, learning_rate: 1., ..train_config() };
        let best = |folder: &Path| folder.join("goal.safetensors");
        let undisturbed = tempfile::tempdir().unwrap();
        let whole = go_on(data, &config, undisturbed.path(), 0, 0).0.unwrap();
        let best_epoch = whole.best.unwrap().epoch;
        assert!(best_epoch < 5, "best in epoch {best_epoch}");
        let expected = std::fs::read(best(undisturbed.path())).unwrap();
        // The same epoch of a training that differs in its rate alone.
        let foreign = tempfile::tempdir().unwrap();
        let slower = TrainConfig { epochs: best_epoch, learning_rate: 0.5, ..config.clone() };
        go_on(data, &slower, foreign.path(), 0, 0).0.unwrap();
        let foreign = std::fs::read(best(foreign.path())).unwrap();

        let steps = whole.history[3].steps + 1; // in the last epoch
        let cut = expected[..expected.len() / 2].to_vec();
        let damages = [(Some(expected.clone()), false), (None, true), (Some(cut), true), (Some(foreign.clone()), true)];
        for (bytes, anew) in damages {
            let folder = tempfile::tempdir().unwrap();
            go_on(data, &config, folder.path(), steps, 0).0.unwrap();
            std::fs::remove_file(best(folder.path())).unwrap();
            let length = bytes.as_ref().map(Vec::len);
            if let Some(bytes) = bytes {
                std::fs::write(best(folder.path()), bytes).unwrap();
            }
            let (progress, started) = go_on(data, &config, folder.path(), 0, 0);
            assert_eq!((progress.unwrap(), started), (whole.clone(), anew), "{length:?}");
            assert!(std::fs::read(best(folder.path())).unwrap() == expected, "{length:?}");
        }
    });
}

#[test]
fn best_weights_one_epoch_ahead_are_written_again_or_refused() {
    with_data(|data| {
        let best = |folder: &Path| folder.join("goal.safetensors");
        let config = train_config(); // the second epoch of two is the best one
        let [undisturbed, folder] = [(), ()].map(|()| tempfile::tempdir().unwrap());
        go_on(data, &config, undisturbed.path(), 0, 0).0.unwrap();
        let expected = std::fs::read(best(undisturbed.path())).unwrap();
        assert!(go_on(data, &config, folder.path(), 0, 2).0.is_err());
        assert!(std::fs::read(best(folder.path())).unwrap() == expected, "ahead of the last checkpoint");
        let (progress, anew) = go_on(data, &config, folder.path(), 0, 0);
        assert_eq!((progress.unwrap().epoch, anew), (2, false));
        assert!(std::fs::read(best(folder.path())).unwrap() == expected);

        // What claims to be ahead of an ended training will not come again.
        let longer = tempfile::tempdir().unwrap();
        go_on(data, &TrainConfig { epochs: 3, ..config.clone() }, longer.path(), 0, 0).0.unwrap();
        std::fs::copy(best(longer.path()), best(folder.path())).unwrap();
        let message = go_on(data, &config, folder.path(), 0, 0).0.unwrap_err().to_string();
        assert!(message.contains("is not of epoch 2"), "{message}");
        let (progress, anew) = go_on(data, &config, folder.path(), 0, 0);
        assert!(progress.is_ok() && anew);
        assert!(std::fs::read(best(folder.path())).unwrap() == expected);
    });
}
