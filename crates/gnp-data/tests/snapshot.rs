//! All vehicles of a moment, with short pasts filled.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use std::collections::BTreeMap;
use std::path::Path;

use gnp_data::{
    Dataset, EditedScene, Expectation, LaneMarking, Leader, LiveError, LiveScene, Observation, Past, Present,
    Recording, RecordingMeta, SLOTS, Sample, SceneEdit, Slot, Snapshot, TrackState, VehicleBody, VehicleClass,
    VelocitySource, WindowConfig, WindowError, WindowSet, WindowShape, discover, read,
};
use scene::{NO_TRACK, from_positions, reachable};

const SHAPE: WindowShape = WindowShape { t_obs: 11, t_pred: 5, step: 1, rate_hz: 10. };

fn embedded(folder: &str, dataset: Dataset) -> Vec<Recording> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let sources = discover(&folder, dataset).unwrap();
    let expect = Expectation { dataset, rate_hz: None };
    sources.iter().flat_map(|source| read(source, &expect).unwrap()).map(|(recording, _)| recording).collect()
}

/// The vehicles that a model looks at: those beside, and the columns ahead of the target and of them.
fn looked_at<'a>(observation: &Observation<'a>) -> Vec<Leader<'a>> {
    let columns = observation
        .neighbours()
        .0
        .into_iter()
        .flatten()
        .flat_map(|beside| std::iter::successors(beside.leader(), Leader::leader).take(8));
    observation.column().take(8).chain(columns).collect()
}

/// Every number of them, to the bit.
fn looked_at_bits(observation: &Observation<'_>) -> Vec<u32> {
    let bits = |state: TrackState| [state.x, state.y, state.vx, state.vy].map(f32::to_bits);
    let states = |state: &dyn Fn(usize) -> Option<TrackState>| -> Vec<u32> {
        (0..observation.shape().t_obs).flat_map(|i| state(i).map_or([u32::MAX; 4], bits)).collect()
    };
    let mut all = states(&|i| Some(observation.target(i)));
    all.extend(observation.origin().into_iter().chain(observation.size()).map(f32::to_bits));
    all.extend([observation.lane() as u32, observation.frame()]);
    all.extend(observation.lines().map(|line| line.y.to_bits()));
    for beside in observation.neighbours().0 {
        all.push(beside.map_or(u32::MAX, |beside| beside.vehicle()));
        all.extend(beside.iter().flat_map(|beside| states(&|i| beside.state(i))));
        all.extend(beside.iter().flat_map(|beside| beside.size().map(f32::to_bits)));
    }
    for leader in looked_at(observation) {
        all.push(leader.vehicle());
        all.extend(states(&|i| leader.state(i)));
        all.extend(leader.size().map(f32::to_bits));
    }
    all
}

/// What a snapshot shows of windows of every `nth` frame of the embedded recordings are the same bits, where nobody's
/// past is short whom the target looks at.
fn full_pasts_are_those_of_the_recording(folder: &str, dataset: Dataset, rate_hz: f64, nth: u32) {
    let recordings = embedded(folder, dataset);
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz, stride_s: 0.2, site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let mut by_frame: BTreeMap<(u32, u32), Vec<Observation<'_>>> = BTreeMap::new();
    for (id, window) in set.ids().iter().zip(set.iter()) {
        let observation = window.observation();
        if observation.frame() % nth == 0 {
            by_frame.entry((id.recording, observation.frame())).or_default().push(observation);
        }
    }
    assert!(by_frame.len() > 10, "{}", by_frame.len());
    let mut reused: Option<Snapshot> = None;
    let (mut same, mut filled) = (0, 0);
    for ((recording, frame), windows) in by_frame {
        let recording = &recordings[recording as usize];
        let shape = windows[0].shape();
        let snapshot = reused.get_or_insert_with(|| Snapshot::of(recording, 0, shape).unwrap());
        snapshot.take(recording, frame).unwrap();
        let full: BTreeMap<u32, Observation<'_>> = snapshot
            .vehicles()
            .filter(|it| it.past() == Past::Full)
            .map(|it| (it.vehicle(), it.observation().unwrap()))
            .collect();
        for window in &windows {
            let own = full[&window.vehicle()];
            let beside = window.neighbours().0.into_iter().flatten().map(|it| it.vehicle());
            let ahead = looked_at(window).into_iter().filter(|it| it.recorded().is_some()).map(|it| it.vehicle());
            if beside.chain(ahead).all(|vehicle| full.contains_key(&vehicle)) {
                assert!(looked_at_bits(&own) == looked_at_bits(window), "{window:?}");
                same += 1;
            } else {
                filled += 1;
            }
        }
        // Windows need a recorded future, snapshots do not.
        assert!(full.len() >= windows.len());
        assert_eq!(snapshot.vehicles().len(), recording.present(frame).len());
    }
    assert!(same > 40 && filled > 10, "{same} {filled}");
}

#[test]
fn full_pasts_are_those_of_the_recording_ngsim() {
    full_pasts_are_those_of_the_recording("ngsim", Dataset::NGSIM, 10., 74);
}

#[test]
fn full_pasts_are_those_of_the_recording_highd() {
    full_pasts_are_those_of_the_recording("highd", Dataset::HIGHD, 5., 170);
}

/// Vehicle 1 from the start at 20 m/s; 2 ahead of it from frame 5 at 15 m/s; 3 in frame 12 alone.
fn late() -> Recording {
    let position = |(vehicle, _, first, _): scene::Snippet, i: usize| {
        let t = (first + i as u32) as f32 / 10.;
        match vehicle {
            1 => [20. * t, 0.],
            2 => [60. + 15. * t, 0.1 * t],
            _ => [200., 4.],
        }
    };
    let ahead = |index: usize, frame: u32| {
        let mut slots = [NO_TRACK; SLOTS];
        if index == 0 && frame >= 5 {
            slots[Slot::Preceding.index()] = 1;
        }
        slots
    };
    from_positions(Dataset::NGSIM, "r", "s", 10., &[(1, 0, 0, 13), (2, 0, 5, 8), (3, 0, 12, 1)], &position, &ahead)
}

fn find(snapshot: &Snapshot, vehicle: u32) -> Present<'_> {
    snapshot.vehicles().find(|it| it.vehicle() == vehicle).unwrap()
}

#[test]
fn a_short_past_is_filled_at_constant_velocity() {
    let recording = late();
    let snapshot = Snapshot::of(&recording, 12, SHAPE).unwrap();
    assert_eq!((snapshot.frame(), snapshot.vehicles().len()), (12, 3));
    assert_eq!(find(&snapshot, 1).past(), Past::Full);
    let second = find(&snapshot, 2);
    assert_eq!(second.past(), Past::Filled { observed_s: 0.7 });
    let own = second.observation().unwrap();
    for i in 0..SHAPE.t_obs {
        let ago = (SHAPE.t_obs - 1 - i) as f32 / 10.;
        let state = own.target(i);
        let expected = [-15. * ago, -0.1 * ago, 15., 0.1];
        for (value, expected) in [state.x, state.y, state.vx, state.vy].into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-3, "{i}: {state:?} {expected}");
        }
    }
    // The one behind sees the same.
    let first = find(&snapshot, 1).observation().unwrap();
    let ahead = first.neighbour(Slot::Preceding).unwrap();
    assert_eq!(ahead.vehicle(), 2);
    assert!((ahead.state(0).unwrap().x - (60. + 15. * 0.2 - 20. * 1.2)).abs() < 1e-3, "{:?}", ahead.state(0));
    assert_eq!(first.others().map(|it| it.vehicle()).collect::<Vec<_>>(), [2, 3]);
    assert_eq!(own.others().map(|it| it.vehicle()).collect::<Vec<_>>(), [1, 3]);
    // One frame without a velocity is no prediction.
    assert_eq!(find(&snapshot, 3).past(), Past::NoVelocity);
    assert!(find(&snapshot, 3).observation().is_none());
}

/// Who brakes was faster before: the filled past goes on without a kink.
#[test]
fn a_filled_past_ends_where_the_seen_one_begins() {
    let x = |t: f32| 20. * t - 1.5 * t * t;
    let position = |_: scene::Snippet, i: usize| [x(i as f32 / 10.), 1.];
    for (rows, slope) in [(8, 20.), (9, 20.), (4, 20. - 3. * 0.15)] {
        let none = |_: usize, _: u32| [NO_TRACK; SLOTS];
        let recording = from_positions(Dataset::NGSIM, "r", "s", 10., &[(1, 0, 0, rows)], &position, &none);
        let snapshot = Snapshot::of(&recording, rows as u32 - 1, SHAPE).unwrap();
        let own = find(&snapshot, 1).observation().unwrap();
        let first = own.target(SHAPE.t_obs - rows);
        let before = own.target(0);
        let found = (first.x - before.x) / (0.1 * (SHAPE.t_obs - rows) as f32);
        assert!((found - slope).abs() < 0.01, "{rows}: {found}");
    }
}

#[test]
fn pasts_are_filled_before_the_first_frame_of_a_recording() {
    let recording = late();
    assert_eq!(find(&Snapshot::of(&recording, 0, SHAPE).unwrap(), 1).past(), Past::NoVelocity);
    let snapshot = Snapshot::of(&recording, 3, SHAPE).unwrap();
    let first = find(&snapshot, 1);
    assert_eq!(first.past(), Past::Filled { observed_s: 0.3 });
    let observation = first.observation().unwrap();
    assert_eq!(observation.frame(), snapshot.frame());
    assert!((observation.target(0).x + 20.).abs() < 1e-3);
    // Recorded velocities tell it from the first frame on.
    let recorded = recording.meta().clone().with_velocities(VelocitySource::Recorded);
    let mut columns = recording.columns().clone();
    columns.vx[0] = 18.;
    let recording =
        Recording::from_parts(recorded, recording.roads().to_vec(), recording.tracks().to_vec(), columns).unwrap();
    let snapshot = Snapshot::of(&recording, 0, SHAPE).unwrap();
    assert_eq!(find(&snapshot, 1).past(), Past::Filled { observed_s: 0. });
    assert!((find(&snapshot, 1).observation().unwrap().target(0).x + 18.).abs() < 1e-3);
}

#[test]
fn what_is_filled_can_be_asked_what_if() {
    let snapshot_of = late();
    let snapshot = Snapshot::of(&snapshot_of, 12, SHAPE).unwrap();
    for vehicle in [1, 2] {
        let seen = find(&snapshot, vehicle).observation().unwrap();
        let scene = EditedScene::of(&seen);
        let edited = scene.observation(vehicle).unwrap();
        assert!((0..SHAPE.t_obs).all(|i| edited.target(i) == seen.target(i)));
        assert!(edited.others().map(|it| it.vehicle()).eq(seen.others().map(|it| it.vehicle())));
    }
    let seen = find(&snapshot, 1).observation().unwrap();
    let alone = EditedScene::of(&seen).with(&SceneEdit::Remove { vehicle: 2 }).unwrap();
    assert!(alone.observation(1).unwrap().neighbour(Slot::Preceding).is_none());
}

#[test]
fn a_snapshot_needs_the_rate_of_its_windows() {
    let recording = late();
    let other = WindowShape { rate_hz: 25., ..SHAPE };
    assert!(matches!(Snapshot::of(&recording, 12, other), Err(WindowError::Rate { .. })));
    let none = WindowShape { t_obs: 0, ..SHAPE };
    assert!(matches!(Snapshot::of(&recording, 12, none), Err(WindowError::Shape { .. })));
    assert_eq!(Snapshot::of(&recording, 99, SHAPE).unwrap().vehicles().len(), 0);
}

fn lines() -> Vec<LaneMarking> {
    [-1.85f32, 1.85, 5.55].map(|y| LaneMarking::new(y, y != 1.85)).to_vec()
}

fn car() -> VehicleBody {
    VehicleBody { class: VehicleClass::Car, length: 4.5, width: 1.8, road: 0 }
}

/// Positions of a vehicle in the last `n` frames.
fn path(x: f32, y: f32, n: usize, speed: f32) -> Vec<[f32; 2]> {
    (0..n).map(|i| [x + speed * 0.1 * (i as f32 - n as f32 + 1.) + 0.01 * (i * i) as f32, y]).collect()
}

/// What a program pushes is what a live scene of the same samples shows.
#[test]
fn pushed_tracks_are_those_of_a_live_scene() {
    for measured in [false, true] {
        let mut scene = LiveScene::new(10., lines()).unwrap();
        let mut snapshot = Snapshot::live("live", lines(), SHAPE).unwrap();
        for _ in 0..2 {
            snapshot.begin();
            for (vehicle, x, y, n) in [(3, 0., 0., 12), (5, 30., 0.3, 12), (9, 4., 3.9, 12)] {
                let positions = path(x, y, n, 20.);
                let velocity = |i: usize| measured.then_some([20. + i as f32 * 0.1, 0.01]);
                let velocities: Vec<_> = (0..n).map(velocity).collect();
                snapshot.push(vehicle, car(), &positions, &velocities).unwrap();
                let samples = positions.iter().enumerate().map(|(i, position)| {
                    let sample = Sample::new(0.1 * (i + 12 - n) as f64, *position);
                    velocity(i).map_or(sample, |velocity| sample.with_velocity(velocity))
                });
                scene.push(vehicle, [4.5, 1.8], VehicleClass::Car, &samples.collect::<Vec<_>>()).ok();
            }
            snapshot.finish();
        }
        for vehicle in [3, 5, 9] {
            let own = find(&snapshot, vehicle);
            assert_eq!(own.past(), Past::Full);
            let (a, b) = (own.observation().unwrap(), scene.observe(vehicle, SHAPE).unwrap());
            // Frame 0 is the first that is kept there, and another number here.
            let bits = |o| reachable(o, 0).into_iter().filter(|bits| *bits > 20).collect::<Vec<_>>();
            assert!(bits(a) == bits(b), "{vehicle}");
            assert!(a.neighbours().map(|n| n.map(|n| n.vehicle())) == b.neighbours().map(|n| n.map(|n| n.vehicle())));
        }
    }
}

#[test]
fn a_velocity_that_is_measured_for_some_is_used_for_them() {
    let mut snapshot = Snapshot::live("live", lines(), SHAPE).unwrap();
    snapshot.push(1, car(), &[[0., 0.]], &[Some([25., 0.])]).unwrap();
    snapshot.push(2, car(), &[[30., 0.]], &[None]).unwrap();
    snapshot.push(3, car(), &[[58., 0.], [60., 0.]], &[None, None]).unwrap();
    snapshot.finish();
    assert_eq!(find(&snapshot, 1).past(), Past::Filled { observed_s: 0. });
    assert_eq!(find(&snapshot, 2).past(), Past::NoVelocity);
    let first = find(&snapshot, 1).observation().unwrap();
    assert!((first.target(0).x + 25.).abs() < 1e-4);
    // Its leader's velocity is not known: it is assumed to be the target's, not 0.
    let ahead = first.neighbour(Slot::Preceding).unwrap();
    assert_eq!((ahead.velocity(), ahead.now().vx), (None, 25.));
    let third = find(&snapshot, 3).observation().unwrap().target(SHAPE.t_obs - 1);
    assert!((third.vx - 20.).abs() < 1e-4, "{third:?}");
}

#[test]
fn what_cannot_be_pushed_is_refused_and_changes_nothing() {
    let no_lines = Snapshot::live("live", Vec::new(), SHAPE);
    assert!(matches!(no_lines, Err(LiveError::Lines)));
    let no_rate = Snapshot::live("live", lines(), WindowShape { rate_hz: 1e9, ..SHAPE });
    assert!(matches!(no_rate, Err(LiveError::Rate { .. })));
    let mut snapshot = Snapshot::live("live", lines(), SHAPE).unwrap();
    snapshot.push(5, car(), &[[0., 0.]], &[]).unwrap();
    for vehicle in [4, 5] {
        let error = snapshot.push(vehicle, car(), &[[0., 0.]], &[]).unwrap_err();
        assert!(matches!(error, LiveError::Number { last: 5, .. }), "{error}");
    }
    let refused = [
        (car(), [f32::NAN, 0.], None),
        (car(), [0., 1e9], None),
        (car(), [0., 0.], Some([f32::INFINITY, 0.])),
        (VehicleBody { length: 400., ..car() }, [0., 0.], None),
        (VehicleBody { road: 1, ..car() }, [0., 0.], None),
    ];
    for (body, position, velocity) in refused {
        let error = snapshot.push(6, body, &[position], &[velocity]).unwrap_err();
        assert!(matches!(error, LiveError::Value { vehicle: 6, .. }), "{error}");
    }
    assert!(matches!(snapshot.push(6, car(), &[], &[]), Err(LiveError::Absent { vehicle: 6 })));
    snapshot.finish();
    assert_eq!((snapshot.vehicles().len(), snapshot.recording().len()), (1, 1));
    assert!(matches!(snapshot.set_lines(Vec::new()), Err(LiveError::Lines)));
    let meta: &RecordingMeta = snapshot.recording().meta();
    assert_eq!((meta.dataset, &snapshot.recording().roads()[0].lines), (Dataset::LIVE, &lines()));
}
