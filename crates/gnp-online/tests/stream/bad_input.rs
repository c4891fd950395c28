//! What cannot be is told, and everybody else is predicted.

use gnp_data::{LaneMarking, LiveError, VehicleClass, WindowShape};
use gnp_online::{Frame, OnlineError, Reason, Stream, StreamConfig, Tracked, Validity};
use gnp_road::ReferenceLine;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::SHAPE;
use crate::model::{lines, model};

/// A small window, cheap to predict.
const SHORT: WindowShape = WindowShape { t_obs: 6, t_pred: 8, step: 1, rate_hz: 5. };

fn car(id: u64, time_s: f64) -> Tracked {
    Tracked::new(id, [40. * id as f64 + 25. * time_s, 1.8])
}

fn reasons(frame: Frame<'_>) -> Vec<(u64, usize, Reason)> {
    frame.problems().iter().map(|problem| (problem.id, problem.row, problem.reason)).collect()
}

#[test]
fn one_bad_track_does_not_blind() {
    let mut stream = Stream::new(&model(SHAPE), lines(), StreamConfig::default()).unwrap();
    for i in 0..35 {
        let time_s = 0.1 * f64::from(i);
        stream.push(time_s, &[car(1, time_s), car(2, time_s), car(3, time_s)]).unwrap();
    }
    let position = |id: u64, position: [f64; 2]| Tracked::new(id, position);
    let tracks = [
        position(1, [f64::NAN, 1.8]),
        position(2, [0., f64::INFINITY]),
        car(3, 3.5),
        car(3, 3.6),
        position(4, [1e9, 0.]),
        car(5, 3.5).with_velocity([f32::NAN, 0.]),
        car(6, 3.5).with_velocity([300., 0.]),
        car(7, 3.5).with_velocity([25., 0.]).with_size([15., 6.]), // feet
    ];
    let frame = stream.push(3.5, &tracks).unwrap();
    let expected = [
        (1, 0, Reason::Position),
        (2, 1, Reason::Position),
        (3, 3, Reason::Duplicate),
        (4, 4, Reason::Position),
        (5, 5, Reason::Velocity),
        (6, 6, Reason::Velocity),
        (7, 7, Reason::Size),
    ];
    assert_eq!(reasons(frame), expected);
    let left_out: Vec<bool> = expected.iter().map(|(.., reason)| reason.leaves_out()).collect();
    assert_eq!(left_out, [true, true, true, true, false, false, false]);
    // Those with a bad position are missing, and go on.
    assert_eq!(frame.vehicles().map(|it| it.id()).collect::<Vec<_>>(), [3, 5, 6, 7, 1, 2]);
    assert!((frame.get(1).unwrap().age_s() - 0.1).abs() < 1e-9);
    assert_eq!(frame.get(3).unwrap().validity(), Validity::Full);
    assert_eq!(frame.get(3).unwrap().position(), car(3, 3.5).position);
    assert_eq!(frame.get(5).unwrap().validity(), Validity::Not(Reason::NoVelocity));
    assert!(frame.get(7).unwrap().window().is_some());
}

#[test]
fn time_must_grow_and_nothing_else_stops_a_stream() {
    let mut stream = Stream::new(&model(SHORT), lines(), StreamConfig::default()).unwrap();
    for i in 0..10 {
        stream.push(0.2 * f64::from(i), &[car(1, 0.2 * f64::from(i))]).unwrap();
    }
    let before = stream.frame().get(1).unwrap().path(0).to_vec();
    for time_s in [1.8, 1.7, -1., f64::NAN, f64::INFINITY] {
        let error = stream.push(time_s, &[car(1, 0.)]).unwrap_err();
        assert!(matches!(error, OnlineError::Time { last_s, .. } if last_s == 1.8), "{error}");
        assert_eq!(stream.frame().get(1).unwrap().path(0), before);
    }
    assert_eq!(stream.push(2., &[]).unwrap().vehicles().len(), 1, "it goes on");
    let frame = stream.push(1e9, &[]).unwrap();
    assert_eq!((frame.vehicles().len(), frame.paths().len()), (0, 0));
}

#[test]
fn what_makes_no_stream_is_an_error() {
    let gnp = model(SHORT);
    let new = |lines: &[f32], config| {
        let lines = lines.iter().map(|y| LaneMarking::new(*y, false)).collect();
        Stream::new(&gnp, lines, config).unwrap_err()
    };
    let default = StreamConfig::default;
    for lines in [&[][..], &[0.], &[3., 0.], &[0., f32::NAN]] {
        let error = new(lines, default());
        assert!(matches!(error, OnlineError::Scene(LiveError::Lines)), "{lines:?}: {error}");
    }
    let feet = new(&[0., 12., 24.], default());
    assert!(matches!(feet, OnlineError::LaneWidth { .. }) && feet.to_string().contains("feet"), "{feet}");
    let of = |config| new(&[0., 3.7], config);
    assert!(matches!(of(StreamConfig { k: 0, ..default() }), OnlineError::Config { key: "k", .. }));
    assert!(matches!(of(StreamConfig { coast_s: f64::NAN, ..default() }), OnlineError::Config { key: "coast_s", .. }));
    assert!(matches!(of(StreamConfig { bridge_s: -1., ..default() }), OnlineError::Config { key: "bridge_s", .. }));
    assert!(matches!(of(StreamConfig { max_vehicles: 0, ..default() }), OnlineError::Config { .. }));
    let mut stream = Stream::new(&gnp, lines(), default()).unwrap();
    assert!(stream.set_lines(Vec::new()).is_err());
}

#[test]
fn off_the_road_is_not_on_it() {
    let points: Vec<[f64; 2]> = (0..50).map(|i| [20. * f64::from(i), 0.]).collect();
    let road = Some(ReferenceLine::from_points(&points).unwrap());
    let mut stream = Stream::new(&model(SHORT), lines(), StreamConfig { road, ..StreamConfig::default() }).unwrap();
    let frame = stream.push(0., &[car(1, 0.), Tracked::new(2, [100., 500.])]).unwrap();
    assert!(matches!(reasons(frame)[..], [(2, 1, Reason::OffRoad(_))]), "{:?}", frame.problems());
    assert_eq!(frame.vehicles().len(), 1);
}

#[test]
fn ten_thousand_vehicles_are_predicted_or_told() {
    let at = |i: u32| [f64::from(i / 2) * 15., if i.is_multiple_of(2) { 1.8 } else { 5.5 }];
    let tracks: Vec<Tracked> =
        (0..10_000).map(|i| Tracked::new(u64::from(i) * 7919 % 10_007, at(i)).with_velocity([25., 0.])).collect();
    let gnp = model(SHORT).explaining(false);
    let mut stream = Stream::new(&gnp, lines(), StreamConfig { k: 1, ..StreamConfig::default() }).unwrap();
    let frame = stream.push(0., &tracks).unwrap();
    assert_eq!((frame.vehicles().len(), frame.problems().len()), (512, 9488));
    assert!(frame.problems().iter().all(|problem| problem.reason == Reason::Capacity(512)));
    let config = StreamConfig { k: 1, max_vehicles: 10_000, ..StreamConfig::default() };
    let mut stream = Stream::new(&gnp, lines(), config).unwrap();
    let frame = stream.push(0., &tracks).unwrap();
    assert_eq!((frame.problems().len(), frame.paths().len()), (0, 10_000 * SHORT.t_pred));
}

/// Seeded garbage: nothing panics, and every number that comes out is finite.
#[test]
fn garbage_in_numbers_out() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let config = StreamConfig { k: 2, max_vehicles: 6, bridge_s: 0.7, ..StreamConfig::default() };
    let mut stream = Stream::new(&model(SHORT), lines(), config).unwrap();
    let odd = [f64::NAN, f64::INFINITY, -f64::INFINITY, 0., -0., 1e-310, 1e300, -131_072., 131_073., 1.8, f64::MAX];
    let (mut time_s, mut predicted, mut refused) = (0f64, 0, 0);
    for _ in 0..10_000 {
        time_s += match random.random_range(0..12) {
            0 => 1e-12,
            1 => random.random_range(-1. ..5.),
            2 => 0.,
            _ => random.random_range(1e-4..0.3),
        };
        let mut value = |around: f64, spread: f64| match random.random_range(0..40) {
            0 => odd[random.random_range(0..odd.len())],
            _ => around + random.random_range(-spread..spread),
        };
        let count = (value(3., 3.).clamp(0., 7.)) as usize;
        let tracks: Vec<Tracked> = (0..count)
            .map(|_| {
                let id = value(4., 4.).clamp(0., 9.) as u64;
                let mut track = Tracked::new(id, [value(20. * time_s, 8.), value(3.7, 5.)]);
                if value(0., 1.) > 0.5 {
                    track.velocity = Some([value(20., 5.) as f32, value(0., 2.) as f32]);
                }
                if value(0., 1.) > 0.8 {
                    track.size = Some([value(5., 6.) as f32, value(2., 2.) as f32]);
                    track.class = VehicleClass::Truck;
                }
                track
            })
            .collect();
        let last_s = stream.frame().time_s();
        let Ok(frame) = stream.push(time_s, &tracks) else {
            refused += 1;
            time_s = time_s.max(last_s);
            continue;
        };
        assert!(frame.vehicles().len() <= 6);
        for vehicle in frame.vehicles() {
            predicted += usize::from(vehicle.window().is_some());
            assert!(vehicle.position().iter().all(|value| value.is_finite()));
            assert!(vehicle.age_s().is_finite() && vehicle.gap_s().is_finite());
            assert!((0..2).all(|k| vehicle.path(k).iter().flatten().all(|value| value.is_finite())));
            assert!(vehicle.probabilities().iter().all(|p| (0. ..=1.).contains(p)));
            let forces = (0..frame.terms().len()).flat_map(|term| vehicle.force(term, 0)).flatten();
            assert!(forces.into_iter().all(|value| value.is_finite()));
        }
    }
    assert!(predicted > 10_000 && refused > 100, "{predicted} {refused}");
}

#[test]
fn sizes_of_classes_are_those_of_vehicles() {
    for class in [VehicleClass::Motorcycle, VehicleClass::Car, VehicleClass::Truck] {
        assert!(gnp_data::limits::is_size(class.default_size()));
    }
}
