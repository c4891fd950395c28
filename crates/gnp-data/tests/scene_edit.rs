//! A window's past with changes.

#![allow(clippy::unwrap_used)] // also outside the test functions

mod scene;

use std::path::Path;

use gnp_data::{
    Dataset, EditedScene, Expectation, LanePosition, Neighbour, NewVehicle, Observation, Recording, SLOTS, SceneEdit,
    SceneEditError, Slot, TrackState, VehicleClass, VelocitySource, WindowConfig, WindowSet, WindowShape, discover,
    find_neighbours, read,
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

trait Edit {
    fn without(self, vehicle: u32) -> Result<EditedScene, SceneEditError>;
    fn with_speed(self, vehicle: u32, speed_mps: f32) -> Result<EditedScene, SceneEditError>;
    fn moved(self, vehicle: u32, by: [f32; 2]) -> EditedScene;
}

impl Edit for EditedScene {
    fn without(self, vehicle: u32) -> Result<EditedScene, SceneEditError> {
        self.with(&SceneEdit::Remove { vehicle })
    }

    fn with_speed(self, vehicle: u32, speed_mps: f32) -> Result<EditedScene, SceneEditError> {
        self.with(&SceneEdit::Speed { vehicle, speed_mps })
    }

    fn moved(self, vehicle: u32, by: [f32; 2]) -> EditedScene {
        self.with(&SceneEdit::Move { vehicle, by }).unwrap()
    }
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
        let scene = EditedScene::of(&observation);
        let edited = scene.observation(observation.vehicle()).unwrap();
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
            let scene = EditedScene::of(&observation).without(gone.vehicle()).unwrap();
            let edited = scene.observation(observation.vehicle()).unwrap();
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
            let scene = EditedScene::of(&observation).without(gone.vehicle()).unwrap();
            let found = scene.observation(observation.vehicle()).unwrap().neighbour(first).unwrap();
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
    scene.observation(3).unwrap().column().map(|leader| leader.vehicle()).collect()
}

#[test]
fn a_scene_ends_in_the_last_observed_frame() {
    let mut recording = platoon();
    let kept = reachable(EditedScene::of(&observe(&recording)).observation(3).unwrap(), 2);
    // Stored velocities of the last frame know the next one: they may be anything.
    let mut columns = recording.columns().clone();
    for track in recording.tracks() {
        columns.vx[track.row_at(T0).unwrap()] = 1e6;
    }
    let parts = (recording.meta().clone(), recording.roads().to_vec(), recording.tracks().to_vec());
    recording = Recording::from_parts(parts.0, parts.1, parts.2, columns).unwrap();
    let scene = EditedScene::of(&observe(&recording));
    assert_eq!(reachable(scene.observation(3).unwrap(), 2), kept);
    assert_eq!(scene.snapshot().recording().tracks().iter().map(|track| track.last_frame()).max(), Some(T0));
    assert!(scene.snapshot().recording().columns().vx.iter().all(|vx| *vx < 1e3));
}

#[test]
fn who_followed_a_removed_vehicle_follows_its_leader() {
    let recording = platoon();
    let observation = observe(&recording);
    let scene = || EditedScene::of(&observation);
    assert_eq!(column(&scene()), [6, 9, 50]);
    assert_eq!(column(&scene().without(6).unwrap()), [9, 50]);
    let both = scene().without(6).unwrap().without(9).unwrap();
    assert_eq!(column(&both), [50], "told by the target's rows now");
    let (was, is) = (observation.column().last().unwrap(), both.observation(3).unwrap().leader().unwrap());
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
            let scene = EditedScene::of(&observation).with_speed(6, speed).unwrap();
            let edited = scene.observation(observation.vehicle()).unwrap();
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
                let share = |back: usize| (1. - (back as f32 - 15.) / 10.).clamp(0., 1.);
                let of_pair = if back == 0 { 1. } else { (share(back) + share(back - 1)) / 2. };
                let share_of_speed = if std::ptr::eq(recording, &recorded) { share(back) } else { of_pair };
                assert!(
                    (is.vx - was.vx - difference * share_of_speed).abs() < 1e-3,
                    "{back} frames back: {was:?} {is:?}"
                );
                place -= difference * share(back) * 0.1;
            }
            let others = |o: &Observation<'_>| {
                let states =
                    o.others().filter(|it| it.vehicle() != 6).map(|it| (0..SHAPE.t_obs).map(|i| it.state(i)).collect());
                states.collect::<Vec<Vec<Option<TrackState>>>>()
            };
            assert_eq!(others(&edited), others(&observation));
        }
        // The target itself.
        let scene = EditedScene::of(&observation).with_speed(3, 2.).unwrap();
        let edited = scene.observation(observation.vehicle()).unwrap();
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
        let leader = scene.observation(3).unwrap().column().last().unwrap().vehicle();
        assert_eq!(leader, 50);
        let observation = scene.observation(3).unwrap();
        let leader = observation.column().last().unwrap();
        (0..SHAPE.t_obs).map(|i| leader.state(i).unwrap()).collect::<Vec<TrackState>>()
    };
    let was = named(&EditedScene::of(&observation));
    let slow = named(&EditedScene::of(&observation).with_speed(50, 3.).unwrap());
    assert!((slow[20].vx - 3.).abs() < 2e-3 && slow[20].x == was[20].x, "{:?}", slow[20]);
    assert!((slow[0].x - was[0].x - (was[20].vx - 3.) * 1.9).abs() < 1e-3, "it comes from further ahead");
    let behind = named(&EditedScene::of(&observation).with_speed(9, 3.).unwrap());
    for (was, is) in was.iter().zip(&behind) {
        assert!((was.x - is.x).abs() < 1e-4 && (was.vx - is.vx).abs() < 2e-3, "{was:?} {is:?}");
    }
    // Much faster, it comes from behind its follower's front, where it is not seen.
    let fast = EditedScene::of(&observation).with_speed(50, 60.).unwrap();
    let leader = fast.observation(3).unwrap().column().last().unwrap();
    assert!(leader.state(0).is_none() && (leader.now().vx - 60.).abs() < 5e-3);
}

#[test]
fn what_cannot_be_changed_says_why() {
    let recording = platoon();
    let scene = || EditedScene::of(&observe(&recording));
    let refused = |edited: Result<EditedScene, SceneEditError>| edited.unwrap_err();
    assert_eq!(refused(scene().without(51)), SceneEditError::Absent { vehicle: 51 });
    assert_eq!(refused(scene().without(6).unwrap().without(6)), SceneEditError::Removed { vehicle: 6 });
    assert_eq!(refused(scene().with_speed(77, 1.)), SceneEditError::Absent { vehicle: 77 });
    assert_eq!(refused(scene().with_speed(12, 1.)), SceneEditError::NoPast { vehicle: 12 });
    assert_eq!(refused(scene().with_speed(6, -1.)), SceneEditError::Speed { vehicle: 6, speed_mps: -1. });
    for speed in [f32::NAN, 101., 1e30] {
        assert!(matches!(refused(scene().with_speed(6, speed)), SceneEditError::Speed { .. }));
    }
}

/// Vehicle, lane, leader, neighbours, states in the observed frames.
type Relation = (u32, i16, Option<u32>, [Option<u32>; SLOTS], Vec<TrackState>);

/// Of every vehicle that can be predicted.
fn relations(scene: &EditedScene) -> Vec<Relation> {
    let observed = scene.snapshot().vehicles().filter_map(|vehicle| vehicle.observation());
    let states = |seen: &Observation<'_>| (0..seen.shape().t_obs).map(|i| seen.target(i)).collect();
    observed
        .map(|seen| {
            let slots = seen.neighbours().map(|other| other.map(|other| other.vehicle())).0;
            (seen.vehicle(), seen.lane(), seen.leader().map(|leader| leader.vehicle()), slots, states(&seen))
        })
        .collect()
}

/// What `find_neighbours` says of the last frame of a scene whose lanes are numbered from the left; vehicles with
/// another past than a full one are beside the others, too.
fn by_places(scene: &EditedScene) -> Vec<[Option<u32>; SLOTS]> {
    let recording = scene.snapshot().recording();
    let place = |track: &gnp_data::Track| LanePosition {
        lane: recording.columns().lane[track.rows.end - 1].min(7),
        x: recording.columns().x[track.rows.end - 1],
        length: track.length,
    };
    let places: Vec<LanePosition> = recording.tracks().iter().map(place).collect();
    let slots = find_neighbours(&places).into_iter().zip(scene.snapshot().vehicles());
    let observed = slots.filter(|(_, vehicle)| vehicle.observation().is_some());
    observed.map(|(slots, _)| slots.map(|other| other.map(|i| recording.tracks()[i].vehicle)).0).collect()
}

#[test]
fn moved_there_and_back_nothing_is_changed() {
    let there_and_back = |observation: Observation<'_>| {
        let scene = EditedScene::of(&observation);
        let kept = relations(&scene);
        let Some(leader) = observation.leader().map(|leader| leader.vehicle()) else { return };
        for (vehicle, by) in [(leader, [-10., 0.]), (leader, [31.7, 3.6]), (observation.vehicle(), [55., -7.2])] {
            let away = scene.clone().moved(vehicle, by);
            let back = away.moved(vehicle, by.map(|length: f32| -length));
            assert!(relations(&back) == kept, "{observation:?}: {vehicle} by {by:?}");
            let whole = back.observation(observation.vehicle()).unwrap();
            assert!(reachable(whole, 1) == reachable(observation, 1), "{observation:?}: {vehicle} by {by:?}");
        }
    };
    with_windows("ngsim", Dataset::NGSIM, 10., 97, there_and_back);
    with_windows("highd", Dataset::HIGHD, 25., 201, there_and_back);
}

#[test]
fn a_moved_vehicle_is_among_those_where_it_is() {
    with_windows("ngsim", Dataset::NGSIM, 10., 61, |observation| {
        let scene = EditedScene::of(&observation);
        let lines: Vec<f32> = observation.lines().map(|line| line.y + observation.origin()[1]).collect();
        let was = scene.present(observation.vehicle()).unwrap().at();
        for by in [[-25., 0.], [0., 3.7], [40., -3.7], [3., 200.]] {
            let moved = scene.clone().moved(observation.vehicle(), by);
            let now = moved.present(observation.vehicle()).unwrap();
            assert_eq!(now.at(), [was[0] + by[0], was[1] + by[1]]);
            let seen = now.observation().unwrap();
            let y = now.at()[1];
            if by[1] == 0. {
                assert_eq!(seen.lane(), observation.lane());
            } else if y < lines[0] || lines.last().is_some_and(|edge| y >= *edge) {
                assert_eq!(seen.lane(), 0);
            } else if lines.iter().all(|line| (line - y).abs() > 1.) {
                // Who drives there says what the lane is called.
                let beside = moved.snapshot().vehicles().filter_map(|other| other.observation());
                let mut beside = beside.filter(|other| (other.origin()[1] - y).abs() < 0.3 && other.lane() <= 6);
                assert!(beside.all(|other| other.lane() == seen.lane()), "{observation:?} by {by:?}");
            }
            // Its whole past came along.
            for i in 0..=last(&observation) {
                let (a, b) = (seen.target(i), observation.target(i));
                assert!(
                    (a.x - b.x).abs() < 1e-3 && (a.y - b.y).abs() < 1e-3 && (a.vx - b.vx).abs() < 1e-2,
                    "{a:?} {b:?}"
                );
            }
            let found: Vec<_> = relations(&moved).into_iter().map(|(.., slots, _)| slots).collect();
            assert_eq!(found, by_places(&moved), "{observation:?} by {by:?}");
            if by[1] == 200. {
                let nobody = |slots: &[Option<u32>; SLOTS]| !slots.contains(&Some(observation.vehicle()));
                assert!(found.iter().all(nobody) && seen.leader().is_none());
            }
        }
    });
}

#[test]
fn lanes_that_the_data_numbers_to_the_left_are_followed_across_the_road() {
    // highD numbers lanes to the left on one carriageway, to the right on the other.
    with_windows("highd", Dataset::HIGHD, 25., 53, |observation| {
        for (slot, side) in [(Slot::LeftPreceding, 1.), (Slot::RightPreceding, -1.)] {
            let Some(ahead) = observation.neighbour(slot) else { continue };
            let now = ahead.now();
            // Beside the other one, 8 m behind it.
            let by = [now.x - 8. - ahead.size()[0], now.y];
            let scene = EditedScene::of(&observation).moved(observation.vehicle(), by);
            let seen = scene.observation(observation.vehicle()).unwrap();
            assert_eq!(seen.leader().unwrap().vehicle(), ahead.vehicle(), "{observation:?} {slot:?}");
            assert_eq!(seen.lane(), ahead.observation().map_or(seen.lane(), |own| own.lane()));
            assert!(now.y * side > 0.);
        }
    });
}

#[test]
fn a_leader_that_only_rows_name_keeps_its_place_among_moved_vehicles() {
    let recording = platoon();
    let observation = observe(&recording);
    let scene = || EditedScene::of(&observation);
    // In one lane, so that places tell what the data names; 9 is 60 m ahead of 3, and 50 some 21 m before it.
    let place_of = |scene: &EditedScene| {
        let seen = scene.observation(3).unwrap();
        let leader = seen.column().find(|it| it.vehicle() == 50)?;
        Some([leader.now().x + seen.origin()[0], leader.velocity().unwrap()[0]])
    };
    let kept = place_of(&scene()).unwrap();
    let same = |scene: &EditedScene| {
        let now = place_of(scene).unwrap();
        assert!((now[0] - kept[0]).abs() < 1e-3 && (now[1] - kept[1]).abs() < 2e-2, "{now:?} {kept:?}");
    };
    // Its follower falls back: the gap is wider, the place the same.
    let back = scene().moved(9, [-5., 0.]);
    assert_eq!(column(&back), [6, 9, 50]);
    same(&back);
    // Its follower leaves the lane: who followed that one follows it.
    let aside = scene().moved(9, [0., 300.]);
    assert_eq!(column(&aside), [6, 50]);
    same(&aside);
    assert!(aside.observation(9).unwrap().leader().is_none());
    // Another one comes between, or is added there.
    let between = scene().moved(6, [38., 0.]);
    assert_eq!(column(&between), [9, 6, 50]);
    same(&between);
    let added = scene().with(&SceneEdit::Add(new_vehicle(99, [kept[0] - 10., 0.1]))).unwrap();
    assert_eq!(column(&added), [6, 9, 99, 50]);
    same(&added);
    // Its follower overtakes it.
    let past = scene().moved(9, [30., 0.]);
    assert_eq!(column(&past), [6, 50]);
    same(&past);
    // It is moved itself; behind its follower's front it follows that one, and the next follows it.
    let nearer = place_of(&scene().moved(50, [-8., 0.])).unwrap();
    assert!((nearer[0] - kept[0] + 8.).abs() < 1e-3 && (nearer[1] - kept[1]).abs() < 2e-2, "{nearer:?}");
    assert_eq!(column(&scene().moved(50, [-35., 0.])), [6, 50]);
    assert!(place_of(&scene().moved(50, [0., 300.])).is_none());
    assert_eq!(column(&scene().moved(50, [0., 300.])), [6, 9, 12]);
}

fn new_vehicle(vehicle: u32, at: [f32; 2]) -> NewVehicle {
    let (name, class, size) = (Some("new 1".to_owned()), VehicleClass::Car, [4.5, 1.8]);
    NewVehicle { vehicle, name, road: 0, at, speed_mps: 12., class, size }
}

#[test]
fn an_added_vehicle_is_one_of_them() {
    with_windows("ngsim", Dataset::NGSIM, 10., 61, |observation| {
        let scene = EditedScene::of(&observation);
        let (vehicle, [x, y]) = (scene.free_number(&[]).unwrap(), observation.origin());
        let new = NewVehicle { road: observation.road(), ..new_vehicle(vehicle, [x + 9., y]) };
        let added = scene.clone().with(&SceneEdit::Add(new)).unwrap();
        let (seen, own) = (added.observation(observation.vehicle()).unwrap(), added.observation(vehicle).unwrap());
        let near = observation.leader().is_some_and(|leader| leader.now().x < 10.);
        if near || own.lane() != seen.lane() {
            return; // no place before the leader, or the data has the target in another lane than the lane lines
        }
        assert_eq!(seen.neighbour(Slot::Preceding).unwrap().vehicle(), vehicle, "{observation:?}");
        assert_eq!(seen.leader().unwrap().vehicle(), vehicle);
        assert_eq!(own.leader().map(|it| it.vehicle()), observation.leader().map(|it| it.vehicle()));
        let found: Vec<_> = relations(&added).into_iter().map(|(.., slots, _)| slots).collect();
        assert_eq!(found, by_places(&added));
        for i in 0..=last(&observation) {
            let way = 1.2 * (last(&observation) - i) as f32;
            let state = own.target(i);
            assert!((state.x + way).abs() < 1e-3 && (state.vx - 12.).abs() < 5e-3 && state.vy == 0., "{state:?}");
        }
        // It can be moved and changed like the others, and taken away again: then nothing is left of it.
        let edits = [SceneEdit::Move { vehicle, by: [-2., 0.] }, SceneEdit::Speed { vehicle, speed_mps: 3. }];
        let changed = edits.iter().try_fold(added, |scene, edit| scene.with(edit)).unwrap();
        let own = changed.observation(vehicle).unwrap();
        assert!((own.origin()[0] - x - 7.).abs() < 1e-3 && (own.target(last(&own)).vx - 3.).abs() < 5e-3);
        assert_eq!(changed.snapshot().recording().vehicle_name(vehicle), "new 1");
        assert_eq!(changed.snapshot().recording().vehicle_named("new 1"), Some(vehicle));
        let number = observation.vehicle();
        assert_eq!(changed.snapshot().recording().vehicle_named(&number.to_string()), Some(number));
        assert!(relations(&changed.without(vehicle).unwrap()) == relations(&scene));
    });
}

#[test]
fn what_lies_in_another_is_told() {
    let recording = platoon();
    let scene = || EditedScene::of(&observe(&recording));
    assert!(scene().overlaps().is_empty());
    assert_eq!(scene().moved(3, [29., 0.]).overlaps(), [[3, 6]]);
    assert!(scene().moved(3, [29., 2.2]).overlaps().is_empty());
    let added = scene().with(&SceneEdit::Add(new_vehicle(99, scene().present(9).unwrap().at()))).unwrap();
    assert_eq!(added.overlaps(), [[9, 99]]);
}

#[test]
fn what_cannot_be_moved_or_added_says_why() {
    let recording = platoon();
    let scene = || EditedScene::of(&observe(&recording));
    let refused = |edit: SceneEdit| scene().with(&edit).unwrap_err();
    assert_eq!(refused(SceneEdit::Move { vehicle: 77, by: [1., 0.] }), SceneEditError::Absent { vehicle: 77 });
    for by in [[f32::NAN, 0.], [0., f32::INFINITY], [1e6, 0.], [0., -2e5]] {
        for vehicle in [6, 50] {
            assert!(matches!(refused(SceneEdit::Move { vehicle, by }), SceneEditError::Move { .. }), "{by:?}");
        }
    }
    let new = new_vehicle(99, [0., 0.]);
    for vehicle in [3, 50] {
        assert_eq!(refused(SceneEdit::Add(new_vehicle(vehicle, [0., 0.]))), SceneEditError::Taken { vehicle });
    }
    assert_eq!(scene().free_number(&[60]), Some(61));
    assert_eq!(scene().free_number(&[u32::MAX]), None);
    let other = |of: &dyn Fn(&mut NewVehicle)| {
        let mut new = new.clone();
        of(&mut new);
        refused(SceneEdit::Add(new))
    };
    assert!(matches!(other(&|new| new.road = 1), SceneEditError::Road { road: 1, roads: 1, .. }));
    assert!(matches!(other(&|new| new.at = [f32::NAN, 0.]), SceneEditError::Place { .. }));
    assert!(matches!(other(&|new| new.speed_mps = -1.), SceneEditError::Speed { .. }));
    assert!(matches!(other(&|new| new.size = [4.5, 0.]), SceneEditError::Size { .. }));
    // What is refused changes nothing.
    let mut scene = scene();
    let kept = relations(&scene);
    scene.apply(&SceneEdit::Move { vehicle: 6, by: [1e9, 0.] }).unwrap_err();
    assert!(relations(&scene) == kept);
}
