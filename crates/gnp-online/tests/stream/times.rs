//! Times are what they are: jitter, other rates, large numbers, roads that curve.

use gnp_online::{Stream, StreamConfig, Tracked, Validity};
use gnp_road::ReferenceLine;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::SHAPE;
use crate::model::{lines, model};

/// Three vehicles at constant speed: id, x at time 0, y, speed.
const CARS: [(u64, f64, f64, f64); 3] = [(1, 0., 1.8, 30.), (2, 45., 1.8, 28.), (3, 20., 5.5, 33.)];

fn tracks(time_s: f64) -> [Tracked; 3] {
    CARS.map(|(id, x, y, speed)| Tracked::new(id, [x + speed * time_s, y]))
}

/// Last points of the first path of each vehicle after frames at `seen` (s) that are said to be at `said`.
fn ends(seen: &[f64], said: &[f64], config: StreamConfig) -> Vec<[f64; 2]> {
    let gnp = model(SHAPE);
    let mut stream = Stream::new(&gnp, lines(), config).unwrap();
    for (seen, said) in seen.iter().zip(said) {
        stream.push(*said, &tracks(*seen)).unwrap();
    }
    let frame = stream.frame();
    assert!(frame.vehicles().all(|vehicle| vehicle.validity() == Validity::Full), "{:?}", frame.vehicles().next());
    frame.vehicles().map(|vehicle| *vehicle.path(0).last().unwrap()).collect()
}

fn farthest(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0., f64::max)
}

#[test]
fn jitter_of_20_ms_moves_nothing() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let even: Vec<f64> = (0..=80).map(|i| 0.04 * f64::from(i)).collect();
    let mut jittered = even.clone();
    // As late as it can be: the last frame is at its time.
    jittered[1..80].iter_mut().for_each(|time| *time += random.random_range(-0.0199..0.0199));
    let exact = ends(&even, &even, StreamConfig::default());
    let moved = farthest(&exact, &ends(&jittered, &jittered, StreamConfig::default()));
    assert!(moved < 0.05, "{moved} m");
    // Taken as if they were even the same frames do move it.
    let taken_as_even = farthest(&exact, &ends(&jittered, &even, StreamConfig::default()));
    assert!(taken_as_even > 0.3, "{taken_as_even} m");
}

#[test]
fn the_rate_of_frames_and_the_start_of_time_do_not_matter() {
    let at = |rate: f64, start: f64| -> Vec<f64> {
        (0..).map(|i| start + f64::from(i) / rate).take((3.3 * rate) as usize + 1).collect()
    };
    let exact = ends(&at(10., 0.), &at(10., 0.), StreamConfig::default());
    for rate in [20., 30., 100., 370.] {
        let found = ends(&at(rate, 0.), &at(rate, 0.), StreamConfig::default());
        // The last frames are not at the same time.
        let late = at(rate, 0.).last().unwrap() - 3.3;
        let found: Vec<[f64; 2]> = found.iter().zip(CARS).map(|(end, (.., v))| [end[0] - v * late, end[1]]).collect();
        assert!(farthest(&exact, &found) < 0.02, "{rate} Hz: {} m", farthest(&exact, &found));
    }
    // Seconds since 1970 have a resolution of 0.2 microseconds.
    let found = ends(&at(10., 0.), &at(10., 1.7e9), StreamConfig::default());
    assert!(farthest(&exact, &found) < 0.01, "{} m", farthest(&exact, &found));
}

#[test]
fn slow_frames_are_interpolated_and_it_is_said() {
    let gnp = model(SHAPE);
    let mut stream = Stream::new(&gnp, lines(), StreamConfig::default()).unwrap();
    for i in 0..10 {
        stream.push(0.5 * f64::from(i), &tracks(0.5 * f64::from(i))).unwrap();
    }
    for vehicle in stream.frame().vehicles() {
        assert_eq!(vehicle.validity(), Validity::Interpolated { gap_s: 0.5 });
        assert_eq!(vehicle.path(0).len(), SHAPE.t_pred);
    }
}

/// On a bend of 400 m, by its line, the forecast is that of a straight road.
#[test]
fn a_road_that_curves_is_straightened_and_forecasts_bent_back() {
    const RADIUS: f64 = 400.;
    let on_arc = |s: f64| [RADIUS * (s / RADIUS).sin(), 1e6 + RADIUS * (1. - (s / RADIUS).cos())];
    let points: Vec<[f64; 2]> = (0..90).map(|i| on_arc(10. * f64::from(i) - 50.)).collect();
    let road = ReferenceLine::from_points(&points).unwrap();
    let zero = road.to_road(on_arc(0.)).unwrap().s;
    let gnp = model(SHAPE);
    let mut straight = Stream::new(&gnp, lines(), StreamConfig::default()).unwrap();
    let config = StreamConfig { road: Some(road.clone()), ..StreamConfig::default() };
    let mut curved = Stream::new(&gnp, lines(), config).unwrap();
    for i in 0..=40 {
        let time_s = 0.1 * f64::from(i);
        let plain = tracks(time_s).map(|track| track.with_velocity([CARS[track.id as usize - 1].3 as f32, 0.]));
        let bent = plain.map(|track| {
            let [s, d] = track.position;
            let place = road.at(zero + s, d);
            let velocity = place.velocity_to_world([CARS[track.id as usize - 1].3, 0.]).map(|value| value as f32);
            Tracked::new(track.id, road.to_world(zero + s, d)).with_velocity(velocity)
        });
        straight.push(time_s, &plain).unwrap();
        curved.push(time_s, &bent).unwrap();
    }
    for (plain, bent) in straight.frame().vehicles().zip(curved.frame().vehicles()) {
        assert_eq!(bent.validity(), Validity::Full);
        for k in 0..6 {
            for (a, b) in plain.path(k).iter().zip(bent.path(k)) {
                let [x, y] = road.to_world(zero + a[0], a[1]);
                assert!((x - b[0]).hypot(y - b[1]) < 0.05, "{} {k}: {a:?} {b:?}", plain.id());
            }
        }
    }
}
