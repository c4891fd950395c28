//! A window's past with changes.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use std::path::Path;

use gnp_data::{
    DataError, Dataset, EditedScene, Expectation, LanePosition, Neighbour, Observation, Recording, SLOTS,
    SceneEditError, Slot, TrackState, VelocitySource, WindowConfig, WindowSet, WindowShape, discover, find_neighbours,
    read,
};
use scene::{NO_TRACK, from_positions, named, reachable};

/// Every `nth` window of the embedded recordings.
fn with_windows(folder: &str, dataset: Dataset, rate_hz: f64, nth: usize, check: impl Fn(Observation<'_>)) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let sources = discover(&folder, dataset).unwrap();
    let expect = Expectation { dataset, rate_hz: None };
    let read = sources.iter().flat_map(|source| read(source, &expect).unwrap());
    let recordings: Vec<Recording> = read.map(|(recording, _)| recording).collect();
    let config =
        WindowConfig { observed_s: 3., predicted_s: 5., rate_hz, stride_s: 0.2, site_stride_s: Default::default() };
    let (set, _) = WindowSet::cut(&recordings, &config).unwrap();
    let mut seen = 0;
    for window in set.iter().step_by(nth) {
        check(window.observation());
        seen += 1;
    }
    assert!(seen > 50, "{seen} windows");
}

fn last(observation: &Observation<'_>) -> usize {
    observation.shape().t_obs - 1
}

fn find<'a>(observation: &Observation<'a>, vehicle: u32) -> Neighbour<'a> {
    observation.others().find(|other| other.vehicle() == vehicle).unwrap()
}

#[test]
fn with_nothing_changed_every_bit_is_the_same() {
    let same = |observation: Observation<'_>| {
        let scene = EditedScene::of(&observation).unwrap();
        let edited = scene.observation().unwrap();
        assert!(reachable(edited, 1) == reachable(observation, 1), "{observation:?}");
        assert_eq!(edited.class(), observation.class());
        assert!(edited.column().map(|it| it.vehicle()).eq(observation.column().map(|it| it.vehicle())));
    };
    with_windows("ngsim", Dataset::NGSIM, 10., 37, same);
    with_windows("highd", Dataset::HIGHD, 25., 101, same);
}

#[test]
fn without_a_neighbour_the_slots_are_those_of_the_others() {
    with_windows("ngsim", Dataset::NGSIM, 10., 97, |observation| {
        for slot in Slot::ALL {
            let Some(gone) = observation.neighbour(slot) else { continue };
            let scene = EditedScene::of(&observation).unwrap().without(gone.vehicle()).unwrap();
            let edited = scene.observation().unwrap();
            // All vehicles but one, in lanes by number; ramps are right of the rest.
            let others: Vec<Neighbour<'_>> =
                observation.others().filter(|other| other.vehicle() != gone.vehicle()).collect();
            let mut places =
                vec![LanePosition { lane: observation.lane().min(7), x: 0., length: observation.size()[0] }];
            places.extend(others.iter().map(|other| LanePosition {
                lane: other.observation().map_or(0, |own| own.lane().min(7)),
                x: other.now().x,
                length: other.size()[0],
            }));
            if others.iter().any(|other| other.observation().is_none()) {
                continue; // its lane cannot be asked for
            }
            let expected = find_neighbours(&places).remove(0).map(|i| i.map(|i| others[i - 1].vehicle()));
            let found = edited.neighbours().map(|neighbour| neighbour.map(|neighbour| neighbour.vehicle()));
            assert_eq!(found, expected, "{observation:?} without {}", gone.vehicle());
            assert!(edited.others().all(|other| other.vehicle() != gone.vehicle()));
            for other in &others {
                let same = find(&edited, other.vehicle());
                assert!((0..=last(&observation)).all(|i| same.state(i) == other.state(i)));
            }
        }
    });
}

#[test]
fn without_a_neighbour_that_the_data_names_the_next_takes_its_place() {
    // highD numbers lanes to the left on one carriageway, to the right on the other.
    with_windows("highd", Dataset::HIGHD, 25., 53, |observation| {
        for (first, then) in [(Slot::LeftPreceding, 1.), (Slot::RightPreceding, -1.)] {
            let Some(gone) = observation.neighbour(first) else { continue };
            let Some(next) = gone.observation().and_then(|own| own.neighbour(Slot::Preceding)) else { continue };
            let scene = EditedScene::of(&observation).unwrap().without(gone.vehicle()).unwrap();
            let found = scene.observation().unwrap().neighbour(first).unwrap();
            assert_eq!(found.vehicle(), next.vehicle(), "{observation:?} {first:?}");
            assert!(found.now().y * then > 0.);
        }
    });
}

const SHAPE: WindowShape = WindowShape { t_obs: 21, t_pred: 3, step: 1, rate_hz: 10. };
const T0: u32 = 30;

/// Vehicles 3, 6 and 9 one behind the other in a lane, at 10 m/s with a slow swing, 30 m apart; 12 has just appeared
/// before them. 9 names leader 50, 20 m ahead, 3 named 51 before `T0`.
fn platoon() -> Recording {
    let position = |(vehicle, _, first, _): scene::Snippet, i: usize| {
        let t = (first + i as u32) as f32 / 10.;
        [10. * t + 0.5 * (2. * t + vehicle as f32).sin() + 10. * vehicle as f32, 0.2 * t.sin()]
    };
    let ahead = |index: usize, frame: u32| {
        let mut slots = [NO_TRACK; SLOTS];
        if index < 2 || (index == 2 && frame >= T0) {
            slots[Slot::Preceding.index()] = index as u32 + 1;
        }
        slots
    };
    let snippets = [(3, 0, 0, 40), (6, 0, 0, 40), (9, 0, 0, 40), (12, 0, T0, 10)];
    named(from_positions(Dataset::NGSIM, "r", "s", 10., &snippets, &position, &ahead), |vehicle, frame| match vehicle {
        9 => Some((50, 20. + 0.05 * frame as f32)),
        3 if frame < T0 => Some((51, 4.)),
        _ => None,
    })
}

fn observe(recording: &Recording) -> Observation<'_> {
    Observation::new(recording, SHAPE, 0, recording.tracks()[0].row_at(T0).unwrap()).unwrap()
}

fn column(scene: &EditedScene) -> Vec<u32> {
    scene.observation().unwrap().column().map(|leader| leader.vehicle()).collect()
}

#[test]
fn a_scene_ends_in_the_last_observed_frame() {
    let mut recording = platoon();
    let kept = reachable(EditedScene::of(&observe(&recording)).unwrap().observation().unwrap(), 2);
    // Stored velocities of the last frame know the next one: they may be anything.
    let mut columns = recording.columns().clone();
    for track in recording.tracks() {
        columns.vx[track.row_at(T0).unwrap()] = 1e6;
    }
    let parts = (recording.meta().clone(), recording.roads().to_vec(), recording.tracks().to_vec());
    recording = Recording::from_parts(parts.0, parts.1, parts.2, columns).unwrap();
    let scene = EditedScene::of(&observe(&recording)).unwrap();
    assert_eq!(reachable(scene.observation().unwrap(), 2), kept);
    assert_eq!(scene.recording().tracks().iter().map(|track| track.last_frame()).max(), Some(T0));
    assert!(scene.recording().columns().vx.iter().all(|vx| *vx < 1e3));
}

#[test]
fn who_followed_a_removed_vehicle_follows_its_leader() {
    let recording = platoon();
    let observation = observe(&recording);
    let scene = || EditedScene::of(&observation).unwrap();
    assert_eq!(column(&scene()), [6, 9, 50]);
    assert_eq!(column(&scene().without(6).unwrap()), [9, 50]);
    let both = scene().without(6).unwrap().without(9).unwrap();
    assert_eq!(column(&both), [50], "told by the target's rows now");
    let (was, is) = (observation.column().last().unwrap(), both.observation().unwrap().leader().unwrap());
    for i in 0..SHAPE.t_obs {
        // Where the target's rows named another one, 50 is not seen.
        let (Some(was), Some(is)) = (was.state(i), is.state(i)) else {
            assert!(i < last(&observation));
            continue;
        };
        assert!((was.x - is.x).abs() < 1e-4, "frame {i}: {was:?} {is:?}");
    }
    // Without the named one, whoever is recorded is the leader.
    assert_eq!(column(&scene().without(50).unwrap()), [6, 9, 12]);
    assert_eq!(column(&scene().without(50).unwrap().without(12).unwrap()), [6, 9]);
}

#[test]
fn a_changed_vehicle_arrives_at_its_place_with_the_speed() {
    let derived = platoon();
    let meta = derived.meta().clone().with_velocities(VelocitySource::Recorded);
    let parts = (derived.roads().to_vec(), derived.tracks().to_vec(), derived.columns().clone());
    let recorded = Recording::from_parts(meta, parts.0, parts.1, parts.2).unwrap();
    for recording in [&derived, &recorded] {
        let observation = observe(recording);
        for speed in [0., 4., 25.] {
            let scene = EditedScene::of(&observation).unwrap().with_speed(6, speed).unwrap();
            let edited = scene.observation().unwrap();
            let (was, is) = (find(&observation, 6), find(&edited, 6));
            assert_eq!((was.now().x, was.now().y), (is.now().x, is.now().y));
            assert!((is.velocity().unwrap()[0] - speed).abs() < 2e-3, "{:?}", is.velocity());
            assert_eq!(is.velocity().unwrap()[1], was.velocity().unwrap()[1]);
            let difference = speed - was.velocity().unwrap()[0];
            let mut place = 0.;
            for back in 0..SHAPE.t_obs {
                let (was, is) =
                    (was.state(last(&observation) - back).unwrap(), is.state(last(&observation) - back).unwrap());
                assert!((is.x - was.x - place).abs() < 1e-4, "{back} frames back: {was:?} {is:?}");
                assert_eq!(is.y, was.y);
                let share = |back: usize| (1. - back as f32 / 10.).max(0.);
                let of_pair = if back == 0 { 1. } else { (share(back) + share(back - 1)) / 2. };
                let share_of_speed = if std::ptr::eq(recording, &recorded) { share(back) } else { of_pair };
                assert!(
                    (is.vx - was.vx - difference * share_of_speed).abs() < 1e-3,
                    "{back} frames back: {was:?} {is:?}"
                );
                place -= difference * share(back) * 0.1;
            }
            // A second before, and earlier, it is half a second's worth of the difference away, and a frame's.
            assert!((place + difference * 0.55).abs() < 1e-4);
            let others = |o: &Observation<'_>| {
                let states =
                    o.others().filter(|it| it.vehicle() != 6).map(|it| (0..SHAPE.t_obs).map(|i| it.state(i)).collect());
                states.collect::<Vec<Vec<Option<TrackState>>>>()
            };
            assert_eq!(others(&edited), others(&observation));
        }
        // The target itself.
        let scene = EditedScene::of(&observation).unwrap().with_speed(3, 2.).unwrap();
        let edited = scene.observation().unwrap();
        assert!((edited.target(last(&edited)).vx - 2.).abs() < 2e-3);
        assert_eq!(edited.key(), observation.key());
        assert_eq!(column(&scene), [6, 9, 50]);
    }
}

#[test]
fn a_named_leader_takes_a_speed_and_keeps_its_own_when_its_follower_changes() {
    let recording = platoon();
    let observation = observe(&recording);
    let named = |scene: &EditedScene| {
        let leader = scene.observation().unwrap().column().last().unwrap().vehicle();
        assert_eq!(leader, 50);
        let observation = scene.observation().unwrap();
        let leader = observation.column().last().unwrap();
        (0..SHAPE.t_obs).map(|i| leader.state(i).unwrap()).collect::<Vec<TrackState>>()
    };
    let was = named(&EditedScene::of(&observation).unwrap());
    let slow = named(&EditedScene::of(&observation).unwrap().with_speed(50, 3.).unwrap());
    assert!((slow[20].vx - 3.).abs() < 2e-3 && slow[20].x == was[20].x, "{:?}", slow[20]);
    assert!((slow[0].x - was[0].x - (was[20].vx - 3.) * 0.55).abs() < 1e-3, "it comes from further ahead");
    let behind = named(&EditedScene::of(&observation).unwrap().with_speed(9, 3.).unwrap());
    for (was, is) in was.iter().zip(&behind) {
        assert!((was.x - is.x).abs() < 1e-4 && (was.vx - is.vx).abs() < 2e-3, "{was:?} {is:?}");
    }
    // Much faster, it comes from behind its follower's front, where it is not seen.
    let fast = EditedScene::of(&observation).unwrap().with_speed(50, 60.).unwrap();
    let leader = fast.observation().unwrap().column().last().unwrap();
    assert!(leader.state(0).is_none() && (leader.now().vx - 60.).abs() < 5e-3);
}

#[test]
fn what_cannot_be_changed_says_why() {
    let recording = platoon();
    let scene = || EditedScene::of(&observe(&recording)).unwrap();
    let refused = |edited: Result<EditedScene, DataError>| match edited {
        Err(DataError::SceneEdit(why)) => why,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(scene().without(3)), SceneEditError::Target { vehicle: 3 });
    assert_eq!(refused(scene().without(51)), SceneEditError::Absent { vehicle: 51 });
    assert_eq!(refused(scene().without(6).unwrap().without(6)), SceneEditError::Absent { vehicle: 6 });
    assert_eq!(refused(scene().with_speed(77, 1.)), SceneEditError::Absent { vehicle: 77 });
    assert_eq!(refused(scene().with_speed(12, 1.)), SceneEditError::NoPast { vehicle: 12 });
    assert_eq!(refused(scene().with_speed(6, -1.)), SceneEditError::Speed { vehicle: 6, speed_mps: -1. });
    for speed in [f32::NAN, 101., 1e30] {
        assert!(matches!(refused(scene().with_speed(6, speed)), SceneEditError::Speed { .. }));
    }
}
