//! A scene of a program's own tracks.

#![allow(clippy::unwrap_used)] // also outside the test functions

use gnp_data::{Dataset, LaneMarking, LiveError, LiveScene, Sample, Slot, VehicleClass, WindowError, WindowShape};

const RATE: f64 = 25.;
/// 1.6 s observed.
const FRAMES: usize = 41;

fn shape() -> WindowShape {
    WindowShape::new(FRAMES, 50, 1, RATE).unwrap()
}

/// Three lanes: left of 3.5 m, between -3.5 and 3.5 two more.
fn lines() -> Vec<LaneMarking> {
    [(-3.5, true), (0., false), (3.5, false), (7., true)].map(|(y, edge)| LaneMarking::new(y, edge)).to_vec()
}

/// A vehicle that passes `x` at time 0 at `speed`, in the frames `from..=to`; times begin anywhere.
fn drive(x: f64, y: f32, speed: f64, from: i32, to: i32) -> Vec<Sample> {
    let at = |i: i32| f64::from(i) / RATE;
    (from..=to).map(|i| Sample::new(1e4 + at(i), [(x + speed * at(i)) as f32, y])).collect()
}

fn measured(samples: Vec<Sample>, speed: f32) -> Vec<Sample> {
    samples.into_iter().map(|sample| sample.with_velocity([speed, 0.])).collect()
}

fn add(scene: &mut LiveScene, vehicle: u32, samples: &[Sample]) -> Result<(), LiveError> {
    scene.push(vehicle, [4.5, 1.8], VehicleClass::Car, samples)
}

#[test]
fn lanes_and_neighbours_follow_from_lines_and_positions() {
    let mut scene = LiveScene::new(RATE, lines()).unwrap();
    let past = 1 - FRAMES as i32;
    for (vehicle, x, y) in [(5, 0., 1.7), (6, 40., 1.6), (7, 2., 5.), (8, -20., -1.7), (9, 60., 30.)] {
        add(&mut scene, vehicle, &drive(x, y, 30., past, 0)).unwrap();
    }
    let observation = scene.observe(5, shape()).unwrap();
    assert_eq!((observation.lane(), observation.site()), (2, "live"));
    assert_eq!(scene.recording().unwrap().meta().dataset, Dataset::LIVE);
    let found = observation.neighbours().map(|neighbour| neighbour.map(|neighbour| neighbour.vehicle()));
    for (slot, vehicle) in found.iter() {
        let wanted = match slot {
            Slot::Preceding => Some(6),
            Slot::LeftAlongside => Some(7),
            Slot::RightFollowing => Some(8),
            _ => None,
        };
        assert_eq!(*vehicle, wanted, "{slot:?}");
    }
    assert!((observation.target(FRAMES - 1).vx - 30.).abs() < 1e-2);
    assert!((observation.target(0).x + 48.).abs() < 1e-3);
    // Beyond the edge there is no lane.
    assert_eq!(scene.observe(9, shape()).unwrap().lane(), 0);
}

#[test]
fn a_scene_grows_sample_by_sample() {
    let mut scene = LiveScene::new(RATE, lines()).unwrap();
    let all = drive(0., 1.7, 30., 0, 60);
    add(&mut scene, 5, &all[..41]).unwrap();
    let first = scene.observe(5, shape()).unwrap().origin();
    for sample in &all[41..] {
        add(&mut scene, 5, std::slice::from_ref(sample)).unwrap();
    }
    // A vehicle that was there before the first sample pushed.
    add(&mut scene, 6, &drive(50., 1.7, 30., -10, 60)).unwrap();
    let later = scene.observe(5, shape()).unwrap();
    assert!((later.origin()[0] - first[0] - 24.).abs() < 1e-3);
    assert_eq!(later.neighbour(Slot::Preceding).unwrap().vehicle(), 6);
}

#[test]
fn a_measured_velocity_counts_from_the_first_sample_on() {
    let past = 1 - FRAMES as i32;
    // The one ahead is slow. Seen once or all the time, it has its own speed.
    for from in [past, 0] {
        let mut scene = LiveScene::new(RATE, lines()).unwrap();
        add(&mut scene, 5, &measured(drive(0., 1.7, 30., past, 0), 30.)).unwrap();
        add(&mut scene, 6, &measured(drive(40., 1.7, 12., from, 0), 12.)).unwrap();
        let observation = scene.observe(5, shape()).unwrap();
        let ahead = observation.neighbour(Slot::Preceding).unwrap();
        assert_eq!((ahead.velocity(), ahead.now().vx), (Some([12., 0.]), 12.), "from frame {from}");
    }
    // Without a measurement one sample tells none, and that is said.
    let mut scene = LiveScene::new(RATE, lines()).unwrap();
    add(&mut scene, 5, &drive(0., 1.7, 30., past, 0)).unwrap();
    add(&mut scene, 6, &drive(40., 1.7, 12., 0, 0)).unwrap();
    let observation = scene.observe(5, shape()).unwrap();
    assert_eq!(observation.neighbour(Slot::Preceding).unwrap().velocity(), None);
}

#[test]
fn what_cannot_be_observed_says_why() {
    let mut scene = LiveScene::new(RATE, lines()).unwrap();
    add(&mut scene, 5, &drive(0., 1.7, 30., -40, 0)).unwrap();
    add(&mut scene, 6, &drive(40., 1.7, 30., -9, 0)).unwrap();
    add(&mut scene, 7, &drive(80., 1.7, 30., -40, -1)).unwrap();
    add(&mut scene, 8, &drive(-40., 1.7, 30., -40, -20)).unwrap();
    add(&mut scene, 8, &drive(-40., 1.7, 30., -18, 0)).unwrap();
    let observe = |vehicle, shape| scene.observe(vehicle, shape).map(|_| ());
    let window = |vehicle| match observe(vehicle, shape()) {
        Err(LiveError::Window(error)) => error,
        other => panic!("{other:?}"),
    };
    observe(5, shape()).unwrap();
    assert_eq!(window(6), WindowError::TooShort { vehicle: 6, found: 10, needed: FRAMES });
    assert_eq!(window(8), WindowError::Gap { vehicle: 8, found: 19, needed: FRAMES });
    for absent in [7, 99] {
        assert!(matches!(observe(absent, shape()), Err(LiveError::Absent { vehicle }) if vehicle == absent));
    }
    let slow = WindowShape::new(17, 50, 1, 10.).unwrap();
    assert!(matches!(observe(5, slow), Err(LiveError::Window(WindowError::Rate { .. }))));
    // Every fifth frame is 5 Hz.
    observe(5, WindowShape::new(9, 25, 5, 5.).unwrap()).unwrap();
    assert!(matches!(LiveScene::new(RATE, lines()).unwrap().observe(1, shape()), Err(LiveError::Absent { .. })));
}

#[test]
fn bad_samples_are_refused_and_change_nothing() {
    let mut scene = LiveScene::new(RATE, lines()).unwrap();
    add(&mut scene, 5, &drive(0., 1.7, 30., -40, 0)).unwrap();
    let sample = |time_s: f64| Sample::new(1e4 + time_s, [1., 1.]);
    // Half a millisecond of jitter passes.
    add(&mut scene, 5, &[sample(0.0405)]).unwrap();
    let refused = |scene: &mut LiveScene, samples: &[Sample]| add(scene, 5, samples).unwrap_err();
    let late = refused(&mut scene, &[sample(0.08), sample(0.1222)]);
    assert!(matches!(late, LiveError::Time { vehicle: 5, off_ms, .. } if (off_ms - 2.2).abs() < 1e-3), "{late}");
    assert!(matches!(refused(&mut scene, &[sample(0.04)]), LiveError::Order { .. }));
    assert!(matches!(refused(&mut scene, &[sample(f64::NAN)]), LiveError::Value { .. }));
    assert!(matches!(refused(&mut scene, &[Sample::new(1e4 + 0.08, [f32::INFINITY, 0.])]), LiveError::Value { .. }));
    let fast = sample(0.08).with_velocity([30., 0.]);
    assert!(matches!(refused(&mut scene, &[fast]), LiveError::Velocity { vehicle: 5 }));
    let flat = scene.push(6, [4.5, 0.], VehicleClass::Car, &[sample(0.04)]);
    assert!(matches!(flat, Err(LiveError::Value { vehicle: 6, .. })));
    let place = refused(&mut scene, &[Sample::new(1e4 + 0.08, [1e30, 0.])]);
    assert!(place.to_string().contains("within 131072 m of the origin"), "{place}");
    let huge = scene.push(6, [1e9, 2.], VehicleClass::Car, &[sample(0.04)]).unwrap_err();
    assert!(huge.to_string().contains("0.5 to 40 m long"), "{huge}");
    let mut measured_scene = LiveScene::new(RATE, lines()).unwrap();
    let speed = add(&mut measured_scene, 5, &[sample(0.).with_velocity([1e6, 0.])]).unwrap_err();
    assert!(speed.to_string().contains("within 100 m/s"), "{speed}");
    assert_eq!(scene.recording().unwrap().len(), 42);
    let far = Sample::new(1e300, [0., 0.]);
    add(&mut scene, 5, &[far]).unwrap();
    assert!(matches!(scene.recording(), Err(LiveError::Data(_))), "two moments years apart are no scene");
}

#[test]
fn a_scene_needs_a_rate_and_lanes() {
    assert!(matches!(LiveScene::new(0., lines()), Err(LiveError::Rate { .. })));
    assert!(matches!(LiveScene::new(1e9, lines()), Err(LiveError::Rate { .. })));
    assert!(matches!(LiveScene::new(RATE, lines()[..1].to_vec()), Err(LiveError::Lines)));
    let many = (0..100_000u32).map(|i| LaneMarking::new(i as f32, true)).collect();
    assert!(matches!(LiveScene::new(RATE, many), Err(LiveError::Lines)));
    assert!(matches!(LiveScene::new(RATE, lines().into_iter().rev().collect()), Err(LiveError::Lines)));
}
