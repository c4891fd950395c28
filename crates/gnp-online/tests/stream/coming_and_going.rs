//! Vehicles come, vanish for a while and return.

use gnp_online::{Reason, Stream, StreamConfig, Tracked, Validity};

use crate::SHAPE;
use crate::model::{lines, model};

fn car(id: u64, time_s: f64) -> Tracked {
    Tracked::new(id, [40. * id as f64 + 25. * time_s, 1.8])
}

fn stream(config: StreamConfig) -> Stream {
    Stream::new(&model(SHAPE), lines(), config).unwrap()
}

/// Pushes car 1 alone in the `from`th to the `to`th tenth of a second.
fn drive(stream: &mut Stream, frames: std::ops::RangeInclusive<u32>) {
    for i in frames {
        let time_s = 0.1 * f64::from(i);
        stream.push(time_s, &[car(1, time_s)]).unwrap();
    }
}

fn validity(stream: &Stream, id: u64) -> Option<Validity> {
    stream.frame().get(id).map(|vehicle| vehicle.validity())
}

#[test]
fn a_new_vehicle_is_predicted_from_its_second_position_on() {
    let mut stream = stream(StreamConfig::default());
    drive(&mut stream, 0..=0);
    assert_eq!(validity(&stream, 1), Some(Validity::Not(Reason::NoVelocity)));
    let frame = stream.frame();
    let vehicle = frame.get(1).unwrap();
    assert!(vehicle.path(0).is_empty() && vehicle.probabilities().is_empty() && frame.paths().is_empty());
    for i in 1..40u32 {
        drive(&mut stream, i..=i);
        let observed_s = f64::from(i) / 10.;
        match validity(&stream, 1).unwrap() {
            Validity::Filled { observed_s: found } => {
                assert!(i < 30 && (found - observed_s).abs() < 1e-9, "{i} {found}")
            }
            Validity::Full => assert!(i >= 30, "{i}"),
            other => panic!("{i}: {other:?}"),
        }
        let frame = stream.frame();
        let vehicle = frame.get(1).unwrap();
        assert_eq!((vehicle.path(5).len(), vehicle.path(6).len(), vehicle.probabilities().len()), (50, 0, 6));
        assert!((vehicle.probabilities().iter().sum::<f32>() - 1.).abs() < 1e-5);
        // Alone on a straight road it goes about as far as it did.
        let ahead = vehicle.path(0)[49][0] - vehicle.position()[0];
        assert!((ahead - 125.).abs() < 25., "{ahead}");
        assert_eq!(frame.terms().len(), vehicle_terms(&stream));
    }
}

/// Terms that have a force along the first path.
fn vehicle_terms(stream: &Stream) -> usize {
    let vehicle = stream.frame().get(1).unwrap();
    (0..).take_while(|term| vehicle.force(*term, 0).len() == SHAPE.t_pred).count()
}

#[test]
fn a_measured_velocity_is_enough_for_a_first_prediction() {
    let mut stream = stream(StreamConfig::default());
    let frame = stream.push(0., &[car(1, 0.).with_velocity([25., 0.]), car(2, 0.)]).unwrap();
    assert_eq!(frame.get(1).unwrap().validity(), Validity::Filled { observed_s: 0. });
    assert_eq!(frame.get(2).unwrap().validity(), Validity::Not(Reason::NoVelocity));
    assert_eq!((frame.get(1).unwrap().window(), frame.get(2).unwrap().window()), (Some(0), None));
}

#[test]
fn a_missing_vehicle_goes_on_for_a_while_and_is_bridged_when_it_returns() {
    let mut stream = stream(StreamConfig::default());
    drive(&mut stream, 0..=40);
    // Others are there.
    for i in 41..=48 {
        let time_s = 0.1 * f64::from(i);
        stream.push(time_s, &[car(2, time_s)]).unwrap();
        let frame = stream.frame();
        let missing = frame.get(1);
        if i <= 45 {
            let missing = missing.unwrap();
            let age_s = 0.1 * f64::from(i - 40);
            assert!((missing.age_s() - age_s).abs() < 1e-9 && missing.window().is_some());
            assert!((missing.position()[0] - car(1, time_s).position[0]).abs() < 1e-6);
            assert!(
                matches!(missing.validity(), Validity::Full if i == 41)
                    || matches!(missing.validity(), Validity::Interpolated { gap_s } if (gap_s - age_s).abs() < 1e-9)
            );
        } else {
            assert!(missing.is_none(), "{i}");
        }
    }
    drive(&mut stream, 49..=49);
    assert!(matches!(validity(&stream, 1), Some(Validity::Interpolated { gap_s }) if (gap_s - 0.9).abs() < 1e-9));
    drive(&mut stream, 50..=79);
    assert!(matches!(validity(&stream, 1), Some(Validity::Interpolated { .. })));
    // Three seconds and a frame later the gap is no longer in its past.
    drive(&mut stream, 80..=80);
    assert_eq!(validity(&stream, 1), Some(Validity::Full));
}

#[test]
fn who_was_away_too_long_or_jumped_starts_anew() {
    let mut stream = stream(StreamConfig::default());
    drive(&mut stream, 0..=40);
    drive(&mut stream, 52..=52);
    assert_eq!(validity(&stream, 1), Some(Validity::Not(Reason::NoVelocity)));
    drive(&mut stream, 53..=90);
    assert_eq!(validity(&stream, 1), Some(Validity::Full));
    let elsewhere = Tracked::new(1, [car(1, 9.1).position[0] + 60., 1.8]).with_velocity([25., 0.]);
    let frame = stream.push(9.1, &[elsewhere]).unwrap();
    assert_eq!(frame.get(1).unwrap().validity(), Validity::Filled { observed_s: 0. });
}

#[test]
fn a_dropped_leader_still_holds_back() {
    // A standing vehicle 60 m ahead, seen and then not detected for 0.3 s.
    let end = |coast_s: f64| {
        let mut stream = stream(StreamConfig { coast_s, k: 1, ..StreamConfig::default() });
        let standing = Tracked::new(9, [190., 1.8]);
        for i in 0..=40 {
            let own = Tracked::new(1, [25. * 0.1 * f64::from(i), 1.8]);
            let both = [own, standing];
            stream.push(0.1 * f64::from(i), if i > 37 { &both[..1] } else { &both }).unwrap();
        }
        stream.frame().get(1).unwrap().path(0)[49][0] - 100.
    };
    let (blind, coasting) = (end(0.), end(0.5));
    assert!(coasting < blind - 10., "{coasting} m behind it, {blind} m without it");
}

#[test]
fn lines_move_and_streams_start_anew() {
    let mut stream = stream(StreamConfig::default());
    drive(&mut stream, 0..=10);
    let before = stream.frame().get(1).unwrap().path(0)[49];
    let moved = lines().into_iter().map(|line| gnp_data::LaneMarking { y: line.y + 1., ..line }).collect();
    stream.set_lines(moved).unwrap();
    stream.reset();
    assert_eq!(stream.frame().vehicles().len(), 0);
    drive(&mut stream, 0..=10);
    let after = stream.frame().get(1).unwrap().path(0)[49];
    assert!((before[1] - after[1]).abs() > 1e-4, "{before:?} {after:?}");
}
