//! Points that make no line.

use gnp_road::{LineError, ReferenceLine};

use crate::roads::{Road, every};

fn refused(points: &[[f64; 2]]) -> LineError {
    ReferenceLine::from_points(points).unwrap_err()
}

#[test]
fn points_that_make_no_line_are_named() {
    assert_eq!(refused(&[]), LineError::TooFew(0));
    assert_eq!(refused(&[[0., 0.]]), LineError::TooFew(1));
    assert!(matches!(refused(&[[0., 0.], [f64::NAN, 0.]]), LineError::Coordinate { point: 2, .. }));
    assert!(matches!(refused(&[[f64::INFINITY, 0.], [1., 0.]]), LineError::Coordinate { point: 1, .. }));
    let repeated = refused(&[[0., 0.], [10., 0.], [10., 0.], [20., 0.]]);
    assert_eq!(repeated, LineError::Repeated { point: 2, distance: 0. });
    assert!(matches!(refused(&[[0., 0.], [1e7, 0.]]), LineError::TooLong(_)));
    let kink = refused(&[[0., 0.], [10., 0.], [15., 5.], [20., 10.]]);
    assert!(matches!(kink, LineError::Kink { point: 2, degrees, .. } if (degrees - 45.).abs() < 1e-9), "{kink:?}");
    // There and back, as where two halves of a file are in the wrong order.
    assert!(matches!(refused(&[[0., 0.], [10., 0.], [5., 0.], [15., 0.]]), LineError::Kink { point: 2, .. }));
    // Each turn is small, yet together they make no road: a polygon with a radius of 10 m.
    let road = Road::new(&[[30., 1. / 10., 1. / 10.]]);
    let points: Vec<[f64; 2]> = road.poses(&every(2., 30.)).iter().map(|pose| pose.0).collect();
    let bend = refused(&points);
    assert!(matches!(bend, LineError::Bend { radius, .. } if (radius - 10.).abs() < 1.), "{bend:?}");
    for error in [kink, bend, repeated] {
        assert!(error.to_string().contains("point"), "{error}");
    }
}

#[test]
fn a_line_that_comes_back_is_refused() {
    let made = |elements: &[[f64; 3]]| {
        let road = Road::new(elements);
        let points: Vec<[f64; 2]> = road.poses(&every(5., road.length())).iter().map(|pose| pose.0).collect();
        ReferenceLine::from_points(&points)
    };
    // One and a half circles; a hairpin whose sides are 48 m apart; the same 60 m apart, three quarters of a loop.
    let circles = made(&[[950., 1. / 100., 1. / 100.]]);
    assert!(matches!(circles, Err(LineError::Crossing { .. })), "{circles:?}");
    let hairpin = |radius: f64| {
        made(&[[200., 0., 0.], [radius * std::f64::consts::PI, 1. / radius, 1. / radius], [200., 0., 0.]])
    };
    let narrow = hairpin(24.);
    assert!(matches!(narrow, Err(LineError::Crossing { distance, .. }) if (distance - 48.).abs() < 6.), "{narrow:?}");
    assert!(hairpin(30.).is_ok());
    let quarters = 1.5 * std::f64::consts::PI * 60.;
    assert!(made(&[[quarters, 1. / 60., 1. / 60.]]).is_ok());
}

#[test]
fn a_long_line_is_made_at_once() {
    // 200,000 points: a square of the number would take minutes.
    let points: Vec<[f64; 2]> = (0..200_000).map(|i| [f64::from(i), 20. * (f64::from(i) / 300.).sin()]).collect();
    let line = ReferenceLine::from_points(&points).unwrap();
    let point = line.locate(line.to_world(150_000., 12.)).unwrap();
    assert!((point.s - 150_000.).abs() < 1e-5 && (point.d - 12.).abs() < 1e-6);
}
