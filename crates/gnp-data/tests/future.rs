//! Nothing that an observation gives depends on a row after the last observed frame.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use gnp_data::{Dataset, Observation, Recording, SLOTS, VelocitySource, Window, WindowError, WindowShape};
use scene::{NO_TRACK, Snippet, from_positions, named, reachable};

const SHAPE: WindowShape = WindowShape { t_obs: 7, t_pred: 11, step: 2, rate_hz: 5. };
/// Last observed frame; six steps of two frames before it are observed.
const T0: u32 = 40;

/// Vehicle 1 is the target. 2 was there all the time, 3 appears in `T0`, 4 one frame before, 5 was
/// there and leaves right after `T0`, 6 comes after it, 7 has a gap before.
const STRETCHES: [Snippet; 8] = [
    (1, 0, 20, 60),
    (2, 0, 10, 80),
    (3, 0, T0, 30),
    (4, 0, T0 - 1, 30),
    (5, 0, 22, (T0 - 22 + 2) as usize),
    (6, 0, T0 + 1, 40),
    (7, 0, 15, 20),
    (7, 1, 37, 40),
];

/// What may become of the rows after the last observed frame.
#[derive(Clone, Copy)]
enum Future {
    Recorded,
    Scrambled,
    Absent,
}

/// Velocities are differentiated centrally, as for NGSIM, so that those stored know the next row.
fn scene(future: Future) -> Recording {
    let position = |(vehicle, _, first, _): Snippet, i: usize| {
        let frame = first + i as u32;
        if frame > T0 && matches!(future, Future::Scrambled) {
            // Another place every frame, and nowhere near the recorded one.
            let noise = (frame * 7919 + vehicle * 104_729) % 1009;
            return [noise as f32 * 3., noise as f32 * -0.7];
        }
        let time = frame as f32 / 10.;
        let lane = (vehicle % 3) as f32 * 3.5;
        [time * (9. + vehicle as f32) + 0.3 * time * time, lane + (time + vehicle as f32).sin()]
    };
    let snippets = STRETCHES.iter().copied().filter_map(|(vehicle, segment, first, rows)| {
        let until = if matches!(future, Future::Absent) { T0 + 1 } else { u32::MAX };
        let rows = rows.min(until.saturating_sub(first) as usize);
        (rows > 0).then_some((vehicle, segment, first, rows))
    });
    let snippets: Vec<Snippet> = snippets.collect();
    let there = |index: usize, frame: u32| {
        let (_, _, first, rows) = snippets[index];
        frame >= first && frame < first + rows as u32
    };
    // Every other vehicle takes a slot in turn; after the last observed frame the slots turn round.
    let neighbours = |index: usize, frame: u32| {
        let mut slots = [NO_TRACK; SLOTS];
        let others = (0..snippets.len()).filter(|other| *other != index && there(*other, frame));
        let turn = if frame > T0 && matches!(future, Future::Scrambled) { 3 } else { 0 };
        for (slot, other) in others.enumerate() {
            slots[(slot + turn) % SLOTS] = other as u32;
        }
        slots
    };
    let recording = from_positions(Dataset::NGSIM, "scene", "site", 10., &snippets, &position, &neighbours);
    // Vehicles 4 and 2 also name leaders that have no row, 4 a few frames long.
    named(recording, |vehicle, frame| match vehicle {
        _ if frame > T0 && matches!(future, Future::Scrambled) => Some((60 + frame, 5.)),
        2 => Some((90, 20. + 0.01 * (frame * frame) as f32)),
        4 => Some((91, 30. - frame as f32 / 8.)),
        _ => None,
    })
}

fn observe(recording: &Recording) -> Observation<'_> {
    let row = recording.tracks()[0].row_at(T0).unwrap();
    Observation::new(recording, SHAPE, 0, row).unwrap()
}

#[test]
fn scrambling_the_future_changes_no_observation() {
    let (recorded, scrambled) = (scene(Future::Recorded), scene(Future::Scrambled));
    let row = recorded.tracks()[0].row_at(T0).unwrap();
    assert_ne!(recorded.columns().vx[row], scrambled.columns().vx[row], "the stored velocity knows the next row");
    assert_eq!(reachable(observe(&recorded), 2), reachable(observe(&scrambled), 2));
    let goal = |recording| Window::new(recording, SHAPE, 0, row).unwrap().truth().goal();
    assert_ne!(goal(&recorded), goal(&scrambled), "the scrambling reaches the truth");
}

#[test]
fn a_recording_that_ends_in_the_last_observed_frame_gives_the_same_observation() {
    let (recorded, ended) = (scene(Future::Recorded), scene(Future::Absent));
    assert!(ended.len() < recorded.len());
    assert_eq!(reachable(observe(&recorded), 2), reachable(observe(&ended), 2));
    let row = ended.tracks()[0].row_at(T0).unwrap();
    assert!(matches!(Window::new(&ended, SHAPE, 0, row), Err(WindowError::NoFuture { found: 0, .. })));
}

#[test]
fn the_last_velocity_looks_back_and_earlier_ones_both_ways() {
    let recording = scene(Future::Recorded);
    let observation = observe(&recording);
    let x = |frame: u32| recording.columns().x[recording.tracks()[0].row_at(frame).unwrap()];
    let last = observation.target(SHAPE.t_obs - 1);
    assert!((last.vx - (x(T0) - x(T0 - 1)) * 10.).abs() < 1e-3);
    let before = observation.target(SHAPE.t_obs - 2);
    assert!((before.vx - (x(T0 - 1) - x(T0 - 3)) * 5.).abs() < 1e-3);
}

#[test]
fn a_derived_velocity_of_a_neighbour_that_has_just_appeared_is_unknown() {
    let recording = scene(Future::Recorded);
    let observation = observe(&recording);
    let target = observation.target(SHAPE.t_obs - 1);
    let find = |vehicle| observation.others().find(|other| other.vehicle() == vehicle).unwrap();
    let newcomer = find(3);
    assert_eq!(newcomer.velocity(), None);
    assert_eq!((newcomer.now().vx, newcomer.now().vy), (target.vx, target.vy), "assumed to be the target's");
    assert_eq!(newcomer.state(SHAPE.t_obs - 2), None);
    assert!(newcomer.observation().is_none(), "it has no past to be observed");
    // One row more, and the velocity is its own.
    let second = find(4);
    assert!((second.now().vx - target.vx).abs() > 1.);
    assert_eq!(second.velocity(), Some([second.now().vx, second.now().vy]));
}

#[test]
fn a_recorded_velocity_counts_from_the_first_frame_on() {
    let derived = scene(Future::Recorded);
    let (roads, tracks, columns) = (derived.roads().to_vec(), derived.tracks().to_vec(), derived.columns().clone());
    // Whatever the dataset is called.
    let meta = derived.meta().clone().with_velocities(VelocitySource::Recorded);
    let recording = Recording::from_parts(meta, roads, tracks, columns).unwrap();
    let observation = observe(&recording);
    let newcomer = observation.others().find(|other| other.vehicle() == 3).unwrap();
    let row = recording.tracks()[2].row_at(T0).unwrap();
    let recorded = [recording.columns().vx[row], recording.columns().vy[row]];
    assert_eq!(newcomer.velocity(), Some(recorded));
    assert_eq!([newcomer.now().vx, newcomer.now().vy], recorded);
    let target = observation.target(SHAPE.t_obs - 1);
    assert!((recorded[0] - target.vx).abs() > 1., "it is not the target's");
}

#[test]
fn presence_follows_the_frames_a_neighbour_was_there() {
    let recording = scene(Future::Recorded);
    let observation = observe(&recording);
    let vehicles: Vec<u32> = observation.others().map(|other| other.vehicle()).collect();
    assert_eq!(vehicles, [2, 3, 4, 5, 7], "6 comes later, and the target is not its own neighbour");
    let by_slot: Vec<u32> = observation.neighbours().values().flatten().map(|other| other.vehicle()).collect();
    assert_eq!(by_slot, vehicles);
    let present = |vehicle| {
        let neighbour = observation.others().find(|other| other.vehicle() == vehicle).unwrap();
        (0..SHAPE.t_obs).map(|i| u8::from(neighbour.state(i).is_some())).collect::<Vec<u8>>()
    };
    // Observed frames are 28, 30, .., 40; the second snippet of vehicle 7 starts in frame 37.
    assert_eq!(present(2), [1, 1, 1, 1, 1, 1, 1]);
    assert_eq!(present(7), [0, 0, 0, 0, 0, 1, 1]);
    assert_eq!(present(4), [0, 0, 0, 0, 0, 0, 1]);
    let truth = Window::new(&recording, SHAPE, 0, recording.tracks()[0].row_at(T0).unwrap()).unwrap().truth();
    assert_eq!(truth.others(0).count(), 5, "the first predicted frame: 5 has left, 6 has come");
}

#[test]
fn printing_a_window_prints_its_name_and_not_the_recording() {
    let recording = scene(Future::Recorded);
    let text = format!("{:?}", Window::new(&recording, SHAPE, 0, recording.tracks()[0].row_at(T0).unwrap()).unwrap());
    assert!(text.contains("vehicle: 1") && text.len() < 300, "{text}");
}
