//! Positions, velocities and headings along and across lines, against roads whose course is known.

use std::f64::consts::{FRAC_PI_2, PI};

use gnp_road::{EXTENSION, OffLine, REACH, ReferenceLine};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::roads::{Road, beside, distance, every, turn};

/// The line through points of a road at `at`.
fn line(road: &Road, at: &[f64]) -> ReferenceLine {
    let points: Vec<[f64; 2]> = road.poses(at).iter().map(|pose| pose.0).collect();
    ReferenceLine::from_points(&points).unwrap()
}

/// Lengths along a road at random distances from 5 to 20 m.
fn uneven(random: &mut ChaCha8Rng, length: f64) -> Vec<f64> {
    let mut at = vec![0.];
    while at[at.len() - 1] < length - 20. {
        let last = at[at.len() - 1];
        at.push(last + random.random_range(5. ..20f64).min(length - last - 5.));
    }
    at.push(length);
    at
}

/// Roads of every kind, at headings all around, some far from the origin as in UTM.
fn roads() -> Vec<Road> {
    let arc = |radius: f64, length: f64| Road::new(&[[length, 1. / radius, 1. / radius]]);
    vec![
        Road::new(&[[400., 0., 0.]]).at([10., -20.], 1.),
        arc(150., 300.).at([688_000., 5_334_000.], 2.),
        arc(-150., 300.).at([0., 0.], -2.),
        arc(500., 700.).at([0., 0.], 3.),
        arc(-3000., 2000.),
        // Clothoids of A = 150 m and A = 110 m to a radius of 150 m, and from one radius to another.
        Road::new(&[[150., 0., 1. / 150.]]).at([5., 5.], -1.),
        Road::new(&[[80., 0., -1. / 150.]]),
        Road::new(&[[200., 1. / 300., -1. / 400.]]).at([0., 0.], 0.4),
        Road::s_curve(),
        Road::s_curve().at([688_000., 5_334_000.], 2.5),
    ]
}

#[test]
fn follows_arcs_and_clothoids_to_a_centimetre() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut worst = [0f64; 4];
    for road in roads() {
        for spacing in [Some(5.), Some(10.), Some(20.), None] {
            let at = match spacing {
                Some(step) => every(step, road.length()),
                None => uneven(&mut random, road.length()),
            };
            let line = line(&road, &at);
            assert!((line.length() - road.length()).abs() < 0.01, "{} {}", line.length(), road.length());
            let at = every(3.7, road.length());
            for (s, pose) in at.iter().zip(road.poses(&at)) {
                let d = random.random_range(-20. ..20.);
                let position = beside(pose, d);
                let point = line.to_road(position).unwrap();
                // Along the offset path, which is longer or shorter than the line.
                let along = (point.s - s).abs() * (1. - d * road.curvature(*s));
                let heading = turn(pose.1, point.heading).abs();
                let there = distance(line.to_world(*s, d), position);
                for (worst, is) in worst.iter_mut().zip([along, (point.d - d).abs(), there, heading]) {
                    *worst = worst.max(is);
                }
            }
        }
    }
    // m, m, m, rad. 20 m from the line an angle of 0.001 rad is 2 cm along it.
    assert!(worst[0] < 0.025 && worst[1] < 0.01 && worst[2] < 0.025 && worst[3] < 0.0015, "{worst:?}");
}

#[test]
fn an_arc_has_its_radius() {
    for (radius, step) in [(150., 20.), (-150., 20.), (500., 10.), (-2000., 50.)] {
        let road = Road::new(&[[260., 1. / radius, 1. / radius]]);
        let line = line(&road, &every(step, 260.));
        for s in every(1.3, 259.9) {
            let curvature = line.at(s, 0.).curvature;
            assert!((curvature * radius - 1.).abs() < 0.02, "radius {radius}, {s}: {}", 1. / curvature);
        }
    }
}

#[test]
fn there_and_back_is_the_same_place() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for road in roads() {
        let made = line(&road, &uneven(&mut random, road.length()));
        for line in [made.clone(), made.reversed(), made.mirrored(), made.reversed().mirrored()] {
            for _ in 0..300 {
                let (s, d) = (random.random_range(-200. ..road.length() + 200.), random.random_range(-20. ..20.));
                let position = line.to_world(s, d);
                let point = line.locate(position).unwrap();
                assert!((point.s - s).abs() < 1e-6 && (point.d - d).abs() < 1e-6, "{s} {d}: {point:?}");
                assert!(distance(line.to_world(point.s, point.d), position) < 1e-6);

                let velocity = [random.random_range(-40. ..40.), random.random_range(-40. ..40.)];
                let back = point.velocity_to_world(point.velocity_to_road(velocity));
                assert!(distance(velocity, back) < 1e-9);
                let (ahead, aside) = (point.heading_of([30., 0.]), point.heading_of([0., 1.]));
                assert!(turn(ahead, point.heading).abs() < 1e-9);
                // The left of travel is to the left where the plane is as seen, and mirrored where it is mirrored.
                let left = if line == made.mirrored() || line == made.reversed().mirrored() { -1. } else { 1. };
                assert!((turn(ahead, aside) - left * FRAC_PI_2).abs() < 1e-9);
            }
        }
    }
}

/// A velocity by the road is how fast the place by the road changes.
#[test]
fn velocities_are_the_rates_of_places() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let road = Road::s_curve();
    let made = line(&road, &every(10., road.length()));
    for line in [made.clone(), made.reversed(), made.mirrored()] {
        for _ in 0..300 {
            let (s, d) = (random.random_range(-50. ..road.length() + 50.), random.random_range(-20. ..20.));
            let velocity = [random.random_range(-40. ..40.), random.random_range(-40. ..40.)];
            let position = line.to_world(s, d);
            let step = 1e-4;
            let moved =
                |by: f64| line.locate([position[0] + by * velocity[0], position[1] + by * velocity[1]]).unwrap();
            let (before, after) = (moved(-step), moved(step));
            let rates = [(after.s - before.s) / (2. * step), (after.d - before.d) / (2. * step)];
            let told = line.locate(position).unwrap().velocity_to_road(velocity);
            assert!(distance(rates, told) < 1e-3, "at {s}, {d}: {rates:?} {told:?}");
        }
    }
}

#[test]
fn the_nearest_place_is_found() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let road = Road::s_curve();
    let line = line(&road, &uneven(&mut random, road.length()));
    let at = every(0.05, road.length());
    let places: Vec<[f64; 2]> = at.iter().map(|s| line.to_world(*s, 0.)).collect();
    for _ in 0..300 {
        let position = line.to_world(random.random_range(0. ..road.length()), random.random_range(-45. ..45.));
        let nearest = places.iter().map(|place| distance(*place, position)).fold(f64::INFINITY, f64::min);
        let point = line.locate(position).unwrap();
        // The places are 5 cm apart.
        let farther = nearest.powi(2) - point.d.powi(2);
        assert!((-1e-9..1e-3).contains(&farther), "{position:?}: {} {nearest}", point.d);
    }
}

#[test]
fn straight_lines_are_exact() {
    // The frame of NGSIM: along y, and to the right x.
    let north = ReferenceLine::straight([0., 0.], FRAC_PI_2);
    let point = north.to_road([3.5, 100.]).unwrap();
    assert_eq!((point.s, point.d, point.curvature), (100., -3.5, 0.));
    assert_eq!(north.to_world(100., -3.5), [3.5, 100.]);
    assert_eq!(point.velocity_to_road([1., 30.]), [30., -1.]);
    // highD, whose y points down: carriageway 2 drives to the right, 1 to the left.
    let right = ReferenceLine::straight([0., 0.], 0.).mirrored();
    let left = ReferenceLine::straight([0., 0.], PI).mirrored();
    assert_eq!(right.to_road([10., 20.]).map(|p| (p.s, p.d)), Some((10., -20.)));
    assert_eq!(left.to_road([10., 20.]).map(|p| (p.s, p.d)), Some((-10., 20.)));
    let back = right.reversed();
    assert_eq!(back.to_road([10., 20.]).map(|p| (p.s, p.d)), Some((-10., 20.)));
    assert_eq!(back.to_world(-10., 20.), [10., 20.]);
    assert_eq!(north.length(), f64::INFINITY);
    // No reach and no end: it is a frame.
    assert!(north.to_road([1e5, 1e5]).is_some());
    assert_eq!(north.locate([f64::NAN, 0.]), Err(OffLine::NotFinite));
    assert_eq!(ReferenceLine::straight([f64::NAN, 0.], 0.).locate([0., 0.]), Err(OffLine::NotFinite));
}

#[test]
fn beyond_the_ends_it_goes_on_straight() {
    let road = Road::new(&[[300., 1. / 200., 1. / 200.]]);
    let line = line(&road, &every(10., 300.));
    let ends = road.poses(&[0., 300.]);
    let ahead = |pose: ([f64; 2], f64), by: f64| [pose.0[0] + by * pose.1.cos(), pose.0[1] + by * pose.1.sin()];
    let after = line.locate(ahead(ends[1], 100.)).unwrap();
    assert!((after.s - 400.).abs() < 0.05 && after.d.abs() < 0.2 && after.curvature == 0., "{after:?}");
    let before = line.locate(ahead(ends[0], -100.)).unwrap();
    assert!((before.s + 100.).abs() < 0.05 && before.d.abs() < 0.2, "{before:?}");
    assert_eq!(line.locate(ahead(ends[1], EXTENSION + 1.)), Err(OffLine::BeyondTheEnds));
    assert_eq!(line.locate(ahead(ends[0], -EXTENSION - 1.)), Err(OffLine::BeyondTheEnds));
    // A forecast may lead farther.
    assert!(distance(line.to_world(1300., 0.), ahead(ends[1], 1000.)) < 2.);
}

#[test]
fn what_has_no_place_is_told() {
    // A loop of a ramp: its centre is within reach, but no place along it is nearer than another.
    let road = Road::new(&[[188., 1. / 40., 1. / 40.]]);
    let line = line(&road, &every(5., 188.));
    assert_eq!(line.locate([1., 40.]), Err(OffLine::InsideBend));
    assert!(line.locate([0., 30.]).is_ok());
    let outside = |d: f64| line.to_world(90., -d);
    assert!(line.locate(outside(REACH - 0.1)).is_ok());
    assert_eq!(line.locate(outside(REACH + 0.1)), Err(OffLine::TooFar));
    for position in [[f64::NAN, 0.], [0., f64::INFINITY]] {
        assert_eq!(line.locate(position), Err(OffLine::NotFinite));
    }
}

#[test]
fn a_kept_line_is_the_same_line() {
    let road = Road::s_curve();
    let curve = line(&road, &every(10., road.length()));
    for line in [curve.reversed().mirrored(), curve, ReferenceLine::straight([1e5 / 3., 0.1], 1. / 3.).mirrored()] {
        let text = serde_json::to_string(&line).unwrap();
        let back: ReferenceLine = serde_json::from_str(&text).unwrap();
        assert_eq!(back, line);
        assert_eq!(back.to_world(100., 5.), line.to_world(100., 5.));
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
    }
    let error = serde_json::from_str::<ReferenceLine>(r#"{"points":[[0.0,0.0]]}"#).unwrap_err().to_string();
    assert!(error.contains("1 points make no line"), "{error}");
}
