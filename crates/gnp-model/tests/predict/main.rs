//! The whole predictor on a made-up road: what it may see, what it gives, how it is stored.

// clippy.toml allows it inside test functions alone; scenes and models are built outside.
#![allow(clippy::unwrap_used)]

mod explained;
mod into;
mod precision;
mod terms_off;
mod trust;

use std::collections::BTreeMap;
use std::path::Path;

use candle_core::{Device, Tensor};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{
    Columns, Dataset, LaneMarking, MarkingKind, Observation, Predictor, Recording, RecordingMeta, Road, SLOTS, Slot,
    Track, TrackState, Window, WindowShape,
};
use gnp_goal::{GoalConfig, GoalNet, ProbabilityHead, Regression};
use gnp_model::{
    AugmentedView, Checkpoint, Component, FeatureConfig, Features, Gnp, Header, ModelError, NeighbourFuture,
    NeighbourInput, ReferencePath, Representation, SeenNeighbours,
};
use gnp_modes::{ModeParams, Modes};
use gnp_nn::Weights;
use gnp_traj::{InputScale, Integrator, SocialForce, TrajConfig};

const SHAPE: WindowShape = WindowShape { t_obs: 6, t_pred: 9, step: 1, rate_hz: 5. };
/// Last observed row of every test window.
const T0: usize = 7;
const FRAMES: usize = 20;
const NO_TRACK: u32 = u32::MAX;

/// Three vehicles on two lanes: a target, its leader, and one on its left that appears two frames
/// before the last observed one. `mirror` exchanges left and right; `scramble` rewrites the future.
fn road(mirror: bool, scramble: bool) -> Recording {
    let side = if mirror { -1. } else { 1. };
    let starts = [0usize, 0, T0 - 2];
    let (mut tracks, mut columns) = (Vec::new(), Columns::default());
    for (v, first) in starts.into_iter().enumerate() {
        let start = columns.x.len();
        for f in first..FRAMES {
            let t = f as f32 / 5.;
            let gone = if scramble && f > T0 { 17. + 3. * (f * (v + 1)) as f32 } else { 0. };
            let speed = 20. + v as f32 - 0.4 * t;
            columns.x.push(30. * [0., 1., -0.4][v] + (20. + v as f32) * t - 0.2 * t * t + gone);
            columns.y.push(side * ([0.2, -0.1, 3.6][v] + 0.15 * t + gone));
            columns.vx.push(speed + if f >= T0 { gone } else { 0. });
            columns.vy.push(side * 0.15);
            columns.lane.push([1, 1, 2][v]);
            let mut slots = [NO_TRACK; SLOTS];
            let left = if mirror { Slot::RightAlongside } else { Slot::LeftAlongside };
            let right = if mirror { Slot::LeftAlongside } else { Slot::RightAlongside };
            match v {
                0 => {
                    slots[Slot::Preceding as usize] = 1;
                    if f >= starts[2] {
                        slots[left as usize] = 2;
                    }
                }
                1 => slots[Slot::Following as usize] = 0,
                _ => slots[right as usize] = 0,
            }
            columns.neighbours.push(slots);
        }
        tracks.push(Track::new(v as u32 + 1, [4.5, 1.9], first as u32, start..columns.x.len()));
    }
    let line = |kind, y| LaneMarking { kind, y };
    let mut lines =
        vec![line(MarkingKind::Boundary, -1.8), line(MarkingKind::LaneDivider, 1.9), line(MarkingKind::Boundary, 5.6)];
    if mirror {
        lines.reverse();
        lines.iter_mut().for_each(|line| line.y = -line.y);
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", "made-up", 5.);
    let roads = vec![Road { driving_direction: 2, lines, fitted: false, axis: None }];
    Recording::from_parts(meta, roads, tracks, columns).unwrap()
}

fn window(recording: &Recording, track: usize) -> Window<'_> {
    let row = recording.tracks()[track].row_at(T0 as u32).unwrap();
    Window::new(recording, SHAPE, track, row).unwrap()
}

fn features(recording: &Recording, representation: Representation) -> Features {
    features_from(recording, representation, ReferencePath::ConstantVelocity)
}

fn features_from(recording: &Recording, representation: Representation, reference: ReferencePath) -> Features {
    let config = FeatureConfig {
        representation,
        reference,
        length_scale: 10.,
        velocity_window_s: 0.4,
        history_block_s: 0.4,
        vehicles_ahead: if reference == ReferencePath::Platoon { 2 } else { 1 },
        neighbours: SeenNeighbours::All,
        car_following_features: true,
    };
    let observations = [0, 1].map(|track| window(recording, track).observation());
    let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL).unwrap();
    Features::fit(&config, SHAPE, Some(&platoon), observations.into_iter()).unwrap()
}

fn modes(features: &Features) -> Modes {
    let n = 12;
    let t_pred = features.shape().t_pred;
    let futures: Vec<f32> = (0..n * t_pred * 2).map(|i| ((i * 37 % 23) as f32 - 11.) * 0.3).collect();
    let params = ModeParams { modes: 5, seed: 3, max_iterations: 50, restarts: 1 };
    gnp_modes::fit(&futures, t_pred, features.mode_frame(), &params).unwrap()
}

fn goal_config() -> GoalConfig {
    GoalConfig {
        width: 16,
        heads: 2,
        layers: 1,
        feed_forward: 2,
        dropout: 0.,
        probability: ProbabilityHead::Decoder,
        regression: Regression::Residual,
        null_token: true,
        slot_embedding: true,
        zero_start: false,
    }
}

fn traj_config() -> TrajConfig {
    TrajConfig {
        hidden: 8,
        embedding: 7,
        latent_dim: 6,
        encoder: vec![9],
        decoder: vec![10],
        tau_max: 1.,
        k_max: 10.,
        k_max_line: 1.,
        k_bias: 0.,
        r_col: 26.,
        lines: true,
        input_scale: InputScale { position: 0.05, velocity: 0.05 },
        integrator: Integrator::SemiImplicitEuler,
        network_period: 1,
        terms: Vec::new(),
    }
}

/// Checkpoints of untrained networks: `(goal, repulsion)`.
fn checkpoints(features: &Features) -> (Checkpoint, Checkpoint) {
    checkpoints_of(features, &traj_config())
}

fn checkpoints_of(features: &Features, traj_config: &TrajConfig) -> (Checkpoint, Checkpoint) {
    let header = Header {
        part: Component::Goal,
        dataset: Dataset::NGSIM,
        simulated: false,
        shape: features.shape(),
        features: features.clone(),
        goal: Some(goal_config()),
        traj: None,
        seed: 1,
        code_version: "test".to_owned(),
        split_hash: "abc".to_owned(),
        epoch: 0,
        scores: BTreeMap::from([("loss".to_owned(), 0.5)]),
        origin: None,
        trust: None,
        trainer: None,
    };
    let named = |weights: &Weights| -> BTreeMap<String, Tensor> {
        weights.named().into_iter().map(|(name, var)| (name, var.as_tensor().clone())).collect()
    };
    let goal = Weights::seeded(1, &Device::Cpu);
    GoalNet::new(&goal_config(), features.goal_shape(), goal.builder()).unwrap();
    let force = Weights::seeded(2, &Device::Cpu);
    SocialForce::new(traj_config, force.builder()).unwrap();
    let traj = Some(traj_config.clone());
    let repulsion = Header { part: Component::Repulsion, goal: None, traj, ..header.clone() };
    (Checkpoint { header, tensors: named(&goal) }, Checkpoint { header: repulsion, tensors: named(&force) })
}

/// Deviations are from the platoon where neighbours follow it, else from constant velocity.
fn model(recording: &Recording, neighbours: NeighbourFuture) -> Gnp {
    let platoon = neighbours == NeighbourFuture::Platoon;
    let reference = if platoon { ReferencePath::Platoon } else { ReferencePath::ConstantVelocity };
    let features = features_from(recording, Representation::Deviation, reference);
    let (goal, force) = checkpoints(&features);
    Gnp::new(modes(&features), &goal, Some(&force), neighbours, &Device::Cpu).unwrap()
}

#[test]
fn forecasts_have_ordered_modes_whose_probabilities_sum_to_one() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::ConstantVelocity).explaining(true);
    let observations = [0, 1].map(|track| window(&recording, track).observation());
    let forecasts = model.predict(&observations, 3).unwrap();
    assert_eq!(forecasts.len(), 2);
    for forecast in &forecasts {
        assert_eq!(forecast.modes.len(), 3);
        let sum: f32 = forecast.modes.iter().map(|mode| mode.probability).sum();
        assert!((sum - 1.).abs() < 1e-5, "{sum}");
        assert!(forecast.modes.is_sorted_by(|a, b| a.probability >= b.probability));
        for mode in &forecast.modes {
            assert_eq!(mode.path.len(), SHAPE.t_pred);
            let why = mode.explanation.as_ref().unwrap();
            assert_eq!(why.steps(), SHAPE.t_pred);
            assert_eq!(why.term("lines").unwrap().sources(), 3);
            let tau = why.term("goal").unwrap().parameter(0, 0)[0];
            assert!(tau > 0.2 && tau < 1.2, "tau is sigmoid + dt");
            // The physics ends near the goal it was given.
            let end = mode.path[SHAPE.t_pred - 1];
            let miss = (end[0] - why.goal[0]).hypot(end[1] - why.goal[1]);
            assert!(miss < 5., "{miss} m from the goal");
        }
    }
    // Two neighbours push the target, one its leader.
    let pushed = |b: usize| {
        let why = forecasts[b].modes[0].explanation.as_ref().unwrap();
        why.term("neighbours").unwrap().parameter(0, 0).iter().filter(|k| **k > 0.).count()
    };
    assert_eq!((pushed(0), pushed(1)), (2, 1));
    assert_eq!(model.predict(&observations, 50).unwrap()[0].modes.len(), 5, "no more than there are modes");
}

#[test]
fn forces_and_steps_explain_the_path() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::ConstantVelocity).explaining(true);
    let observation = window(&recording, 0).observation();
    let forecast = model.predict(&[observation], 2).unwrap().remove(0);
    let (dt, mode) = (SHAPE.dt() as f32, &forecast.modes[0]);
    let start = AugmentedView::recorded(observation).velocity(0.4);
    let (mut p, mut v) = ([0f32; 2], start);
    for (step, point) in mode.path.iter().enumerate() {
        for axis in 0..2 {
            v[axis] += dt * mode.explanation.as_ref().unwrap().total(step)[axis];
            p[axis] += dt * v[axis];
            assert!((p[axis] - point[axis]).abs() < 1e-3, "{p:?} by the forces, {point:?} on the path");
        }
    }
}

#[test]
fn nothing_after_the_last_observed_frame_reaches_a_prediction() {
    for neighbours in [NeighbourFuture::ConstantVelocity, NeighbourFuture::Platoon, NeighbourFuture::Joint] {
        let (recorded, scrambled) = (road(false, false), road(false, true));
        let model = model(&recorded, neighbours).explaining(true);
        let predict = |recording: &Recording| {
            let observations = [0, 1].map(|track| window(recording, track).observation());
            model.predict(&observations, 4).unwrap()
        };
        assert_eq!(predict(&recorded), predict(&scrambled), "{neighbours:?}");
    }
    // The oracle does look ahead, and is the only one that does.
    let (recorded, scrambled) = (road(false, false), road(false, true));
    let model = model(&recorded, NeighbourInput::Oracle.without_future());
    let informed = |recording: &Recording| {
        gnp_data::OraclePredictor::predict_with_future(&model.oracle(), &[window(recording, 0)], 4).unwrap()
    };
    assert_ne!(informed(&recorded), informed(&scrambled));
}

/// Every choice of a predictor is listed here: the recorded future is none of them.
#[test]
fn only_a_run_can_ask_for_recorded_neighbours() {
    let of_key = |key: &str| serde_json::from_str::<NeighbourInput>(&format!("{key:?}"));
    for key in ["constant_velocity", "platoon", "joint", "oracle"] {
        let input = of_key(key).unwrap();
        assert_eq!((input.name(), input.uses_future()), (key, key == "oracle"));
        match input.without_future() {
            NeighbourFuture::ConstantVelocity => assert!(["constant_velocity", "oracle"].contains(&key)),
            NeighbourFuture::Platoon => assert_eq!(key, "platoon"),
            NeighbourFuture::Joint => assert_eq!(key, "joint"),
        }
    }
    assert!(of_key("recorded").is_err());
}

#[test]
fn clones_share_the_model_and_threads_change_nothing() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::Joint).explaining(true);
    let observations = [0, 1].map(|track| window(&recording, track).observation());
    let expected = model.predict(&observations, 4).unwrap();
    assert!(std::ptr::eq(model.header(), model.clone().header()));
    std::thread::scope(|scope| {
        for threads in [1, 3] {
            let model = model.clone().with_threads(threads).unwrap();
            let (expected, observations) = (&expected, &observations);
            scope.spawn(move || assert_eq!(&model.predict(observations, 4).unwrap(), expected, "{threads} threads"));
        }
    });
    let error = model.with_threads(0).unwrap_err().to_string();
    assert!(error.contains("1 or more"), "{error}");
}

/// General matrix products sum in another order for another number of rows, so that a window alone and
/// the same window in a batch differ in the last bits, and in no more than those.
#[test]
fn a_window_alone_is_as_in_a_batch_but_for_rounding() {
    let recording = road(false, false);
    for neighbours in [NeighbourFuture::ConstantVelocity, NeighbourFuture::Joint] {
        let recording = &recording;
        let model = model(recording, neighbours);
        let last_rows = |track: usize| {
            let rows = recording.tracks()[track].rows.clone();
            rows.filter_map(move |row| Observation::new(recording, SHAPE, track, row).ok())
        };
        let observations: Vec<Observation<'_>> = [0, 1].into_iter().flat_map(last_rows).collect();
        assert!(observations.len() > 20, "{}", observations.len());
        let batched = model.predict(&observations, 4).unwrap();
        for (observation, batched) in observations.iter().zip(&batched) {
            let alone = model.predict(&[*observation], 4).unwrap().remove(0);
            for (a, b) in alone.modes.iter().zip(&batched.modes) {
                assert!((a.probability - b.probability).abs() < 1e-5, "{} {}", a.probability, b.probability);
                for (a, b) in a.path.iter().zip(&b.path) {
                    assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-3, "{a:?} {b:?}");
                }
            }
        }
    }
}

/// Told the end it goes there and nowhere else, once, and neighbours stay as predicted.
#[test]
fn a_true_goal_is_the_only_one() {
    let recording = road(false, false);
    let model = model(&recording, NeighbourFuture::ConstantVelocity).explaining(true);
    let windows = [0, 1].map(|track| window(&recording, track));
    let forecasts = gnp_data::OraclePredictor::predict_with_future(&model.true_goal(), &windows, 4).unwrap();
    for (window, forecast) in windows.iter().zip(&forecasts) {
        let [mode] = &forecast.modes[..] else { panic!("{} modes", forecast.modes.len()) };
        assert_eq!((mode.probability, mode.explanation.as_ref().unwrap().goal), (1., window.truth().goal()));
    }
    assert!(gnp_data::OraclePredictor::predict_with_future(&model.true_goal(), &[], 4).unwrap().is_empty());
}

#[test]
fn joint_neighbours_take_their_own_predicted_paths() {
    let recording = road(false, false);
    let joint = model(&recording, NeighbourFuture::Joint).explaining(true);
    let alone = model(&recording, NeighbourFuture::ConstantVelocity).explaining(true);
    let observations = [0, 1].map(|track| window(&recording, track).observation());
    let (joint, alone) = (joint.predict(&observations, 1).unwrap(), alone.predict(&observations, 1).unwrap());
    let push = |forecasts: &[gnp_data::Forecast], step: usize| {
        forecasts[0].modes[0].explanation.as_ref().unwrap().term("neighbours").unwrap().forces(step)
            [Slot::Preceding as usize]
    };
    // At the last observed frame the neighbours are where they are; later they go their own way.
    for axis in 0..2 {
        assert!((push(&joint, 0)[axis] - push(&alone, 0)[axis]).abs() < 1e-3);
    }
    assert!((push(&joint, 8)[0] - push(&alone, 8)[0]).abs() > 1e-4);
}

#[test]
fn a_mirrored_road_is_seen_in_the_mirror() {
    let (road, mirrored) = (road(false, false), road(true, false));
    let features = features_from(&road, Representation::Deviation, ReferencePath::Platoon);
    let inputs =
        |seen: AugmentedView<'_>| features.goal_inputs(&[features.situation(seen).unwrap()], &Device::Cpu).unwrap();
    let a = inputs(AugmentedView::recorded(window(&mirrored, 0).observation()));
    let b = inputs(AugmentedView::mirrored(window(&road, 0).observation()));
    let c = inputs(AugmentedView::recorded(window(&road, 0).observation()));
    let flat = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    for (a, b) in flat(&a.observed).into_iter().zip(flat(&b.observed)) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    assert_eq!(flat(&a.mask), flat(&b.mask));
    assert_ne!(flat(&a.mask), flat(&c.mask));
    for (a, b) in flat(&a.neighbours).into_iter().zip(flat(&b.neighbours)) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    let future =
        |seen: AugmentedView<'_>, window: Window<'_>| features.future(&features.situation(seen).unwrap(), &window);
    let a = future(AugmentedView::recorded(window(&mirrored, 0).observation()), window(&mirrored, 0));
    let b = future(AugmentedView::mirrored(window(&road, 0).observation()), window(&road, 0));
    for (a, b) in a.into_iter().zip(b) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn a_stretch_multiplies_what_lies_along_the_road_and_nothing_else() {
    let recording = road(false, false);
    let window = window(&recording, 0);
    let (plain, scaled_along_road) = (
        AugmentedView::recorded(window.observation()),
        AugmentedView::recorded(window.observation()).scaled_along_road(0.5).scaled_along_road(3.),
    );
    let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-3 * (1. + b.abs()), "{a} {b}");
    let same = |a: TrackState, b: TrackState| {
        for (a, b) in [(a.x, 1.5 * b.x), (a.vx, 1.5 * b.vx), (a.y, b.y), (a.vy, b.vy)] {
            close(a, b);
        }
    };
    same(scaled_along_road.target(0), plain.target(0));
    same(scaled_along_road.true_target(&window.truth(), 3), plain.true_target(&window.truth(), 3));
    close(scaled_along_road.velocity(0.5)[0], 1.5 * plain.velocity(0.5)[0]);
    let mut neighbours = 0;
    for slot in Slot::ALL {
        let (Some(a), Some(b)) = (scaled_along_road.neighbour(slot), plain.neighbour(slot)) else { continue };
        neighbours += 1;
        same(a.now(0.5), b.now(0.5));
        assert_eq!(a.size(), b.size());
    }
    assert!(neighbours > 0);
    assert!(scaled_along_road.lines().eq(plain.lines()) && plain.lines().count() == 3);
}

#[test]
fn the_hint_says_what_the_leader_is_like() {
    let recording = road(false, false);
    let features = features(&recording, Representation::Deviation);
    let observed = |track: usize| {
        let seen = AugmentedView::recorded(window(&recording, track).observation());
        let inputs = features.goal_inputs(&[features.situation(seen).unwrap()], &Device::Cpu).unwrap();
        inputs.observed.flatten_all().unwrap().to_vec1::<f32>().unwrap()
    };
    // The last five numbers of a target are the hint; with a leader and without they differ.
    let (led, leads) = (observed(0), observed(1));
    let hint = |row: &[f32]| row[row.len() - 5..].to_vec();
    assert!(window(&recording, 0).observation().neighbour(Slot::Preceding).is_some());
    assert!(window(&recording, 1).observation().neighbour(Slot::Preceding).is_none());
    assert!(hint(&led).iter().zip(hint(&leads)).all(|(a, b)| (a - b).abs() > 0.1), "{led:?} {leads:?}");
}

#[test]
fn futures_come_back_from_the_modes_frame() {
    let recording = road(false, false);
    for (representation, reference) in [
        (Representation::Position, ReferencePath::ConstantVelocity),
        (Representation::Deviation, ReferencePath::ConstantVelocity),
        (Representation::Deviation, ReferencePath::Platoon),
    ] {
        let features = features_from(&recording, representation, reference);
        let window = window(&recording, 0);
        let seen = features.situation(AugmentedView::recorded(window.observation())).unwrap();
        let back = features.to_window_frame(&seen, &features.future(&seen, &window));
        for (j, point) in back.iter().enumerate() {
            let truth = window.truth().target(j);
            assert!((point[0] - truth.x).abs() < 1e-4 && (point[1] - truth.y).abs() < 1e-4);
        }
    }
}

#[test]
fn a_run_folder_loads_as_it_was_saved() {
    let recording = road(false, false);
    let features = features(&recording, Representation::Deviation);
    let (goal, force) = checkpoints(&features);
    let folder = tempfile::tempdir().unwrap();
    modes(&features).save(&folder.path().join("modes.safetensors")).unwrap();
    let save = |name: &str, c: &Checkpoint| c.save(&folder.path().join(name)).unwrap();
    save("goal.safetensors", &goal);
    let observation = [window(&recording, 0).observation()];
    let load = || Gnp::load(folder.path(), NeighbourFuture::ConstantVelocity, &Device::Cpu);
    // Part of a model once passed for another one under its own name.
    let attraction = Header { part: Component::Attraction, ..force.header.clone() };
    save("attraction.safetensors", &Checkpoint { header: attraction, tensors: force.tensors.clone() });
    let missing = load().unwrap_err().to_string();
    assert!(missing.contains("repulsion.safetensors: is missing: train it"), "{missing}");
    save("repulsion.safetensors", &force);
    let whole = load().unwrap();
    assert_eq!(whole.name(), "gnp");
    assert_eq!(whole.header(), &goal.header);
    let made = model(&recording, NeighbourFuture::ConstantVelocity);
    assert_eq!(whole.predict(&observation, 3).unwrap(), made.predict(&observation, 3).unwrap());

    for (name, part) in [("goal.safetensors", &goal), ("repulsion.safetensors", &force)] {
        let mut less = part.clone();
        let weight = less.tensors.pop_last().unwrap().0;
        save(name, &less);
        let message = load().unwrap_err().to_string();
        assert!(message.contains(name) && message.contains(&weight) && message.contains("train again"), "{message}");
        save(name, part);
    }
    let mut other = force.clone();
    other.header.split_hash = "def".to_owned();
    save("repulsion.safetensors", &other);
    assert!(load().unwrap_err().to_string().contains("another split"));
}

#[test]
fn a_damaged_or_foreign_checkpoint_is_refused_by_name() {
    let recording = road(false, false);
    let (goal, _) = checkpoints(&features(&recording, Representation::Position));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("goal.safetensors");
    goal.save(&path).unwrap();
    let message = |path: &Path| Checkpoint::load(path).unwrap_err().to_string();

    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(message(&path).contains("not a whole safetensors file"), "{}", message(&path));
    assert!(message(&path).contains("goal.safetensors"));
    assert!(message(&folder.path().join("missing")).contains("cannot be read"));
    modes(&features(&recording, Representation::Position)).save(&path).unwrap();
    assert!(message(&path).contains("not a checkpoint of this program"), "{}", message(&path));
}

#[test]
fn a_wrong_rate_is_refused_with_both_rates() {
    let recording = road(false, false);
    let features = features(&recording, Representation::Deviation);
    let (goal, _) = checkpoints(&features);
    let other = WindowShape { rate_hz: 10., ..SHAPE };
    let error = goal.header.expect(Path::new("goal.safetensors"), Component::Goal, Some(other)).unwrap_err();
    assert!(matches!(error, ModelError::Shape { .. }));
    assert!(error.to_string().contains("5 Hz") && error.to_string().contains("10 Hz"), "{error}");

    let model = model(&recording, NeighbourFuture::ConstantVelocity);
    let other = WindowShape { t_obs: 4, ..SHAPE };
    let observation = Observation::new(&recording, other, 0, T0).unwrap();
    let error = model.predict(&[observation], 3).unwrap_err().to_string();
    assert!(error.contains("6 + 9 frames") && error.contains("4 + 9 frames"), "{error}");
}
