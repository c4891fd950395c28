//! Waves whose speed is known.

#![allow(clippy::unwrap_used)] // tests

mod road;

use std::f64::consts::TAU;

use gnp_measures::{Course, Missing, Traffic, WaveSettings, Waves};
use road::{RATE, Row, near, recording};

/// Vehicles in a field of speed that runs upstream at `wave` m/s with a period of `period` s.
fn field(wave: f64, period: f64, x: f64, t: f64) -> f64 {
    10. + 6. * (TAU * (x / wave + t) / period).sin()
}

/// Vehicles from 0 to `length`, one every `headway` s, driven by the field for `seconds`.
fn section(wave: f64, period: f64, length: f64, seconds: f64) -> Vec<Row> {
    let mut rows = Vec::new();
    for (vehicle, start) in (1..).zip((-40..(seconds / 2.5) as i32).map(|i| 2.5 * f64::from(i))) {
        let (mut x, step) = (0., 0.1 / 4.);
        for tick in 0..((seconds - start) / step) as i32 {
            let t = start + step * f64::from(tick);
            if x > length {
                break;
            }
            if tick % 4 == 0 && t > -1e-9 {
                let frame = (t * RATE).round() as u32;
                rows.push((vehicle, frame, x, -1.875, field(wave, period, x, t), 1));
            }
            x += step * field(wave, period, x, t);
        }
    }
    rows
}

fn waves(rows: &[Row], course: Course) -> Vec<Waves> {
    let recording = recording(rows);
    let traffic = Traffic::new(&recording, course).unwrap();
    traffic.waves(0, &WaveSettings::default()).unwrap()
}

#[test]
fn a_known_wave_speed_is_found() {
    for (wave, period) in [(4.5, 60.), (3., 40.), (7., 90.)] {
        let found = waves(&section(wave, period, 500., 300.), Course::Open);
        for of in &found {
            let speed = of.speed.as_ref().unwrap();
            near(speed.speed, wave, 0.05 * wave);
            assert!(speed.correlation > 0.9 && speed.pairs > 20, "{speed:?}");
        }
        // A sine of amplitude 6, flattened by the length of the cells; as many waves as periods, give or take an end.
        let half_cell = TAU / 2. * 20. / (wave * period);
        let flat = half_cell.sin() / half_cell;
        for place in &found[0].places {
            near(place.deviation, flat * 6. / 2f64.sqrt(), 0.35);
            near(place.waves as f64, 300. / period, 1.4);
            near(place.fall.unwrap(), flat * 12., 0.4);
        }
    }
}

/// 22 vehicles on a ring of 230 m, the field as long as the ring, x starting anew at the seam or counting on.
fn ring(wrapped: bool) -> Vec<Row> {
    let (around, wave) = (230., 230. / 45.);
    let mut rows = Vec::new();
    for vehicle in 0..22 {
        let (mut x, step) = (around * f64::from(vehicle) / 22., 0.1 / 4.);
        for tick in 0..4 * 2400 {
            let t = step * f64::from(tick);
            let speed = field(wave, 45., x, t);
            if tick % 4 == 0 {
                let at = if wrapped { x.rem_euclid(around) } else { x };
                rows.push((vehicle + 1, tick as u32 / 4, at, -1.875, speed, 1));
            }
            x += step * speed;
        }
    }
    rows
}

#[test]
fn a_wave_around_a_ring_is_found_and_not_its_echo() {
    for rows in [ring(true), ring(false)] {
        let found = waves(&rows, Course::Ring { circumference: 230. });
        near(found[1].speed.as_ref().unwrap().speed, 230. / 45., 0.25);
        assert!(found[0].places.iter().all(|place| (4..=6).contains(&place.waves)), "{:?}", found[0].places);
    }
}

/// Vehicles that keep their own speeds, which differ as given.
fn free(differ: f64) -> Vec<Row> {
    let vehicles = (0..200).map(|i| (i, 3. * f64::from(i), 25. + differ * f64::from((i * 7919) % 13 - 6) / 6.));
    let rows = |(vehicle, start, speed): (i32, f64, f64)| {
        let frame = move |i: u32| (start * RATE).round() as u32 + i;
        let seen = (0..).take_while(move |i| speed * f64::from(*i) / RATE <= 500. && frame(*i) < 6000);
        seen.map(move |i| (vehicle as u32 + 1, frame(i), speed * f64::from(i) / RATE, -1.875, speed, 1))
    };
    vehicles.flat_map(rows).collect()
}

#[test]
fn where_there_is_no_wave_the_reason_is_said() {
    for differ in [0., 0.1] {
        let steady = waves(&free(differ), Course::Open);
        assert!(matches!(steady[1].speed, Err(Missing::Steady { .. })), "{:?}", steady[1].speed);
    }
    // Fast and slow vehicles make a pattern, which travels with them.
    let free = waves(&free(5.), Course::Open);
    match free[1].speed {
        Err(Missing::Downstream { speed }) => near(speed, 25., 5.),
        ref other => panic!("{other:?}"),
    }
    assert!(free[1].places.iter().all(|place| place.waves == 0 && place.deviation > 1.));
    let short = waves(&section(5., 20., 500., 20.), Course::Open);
    assert!(matches!(short[1].speed, Err(Missing::TooShort { .. })), "{:?}", short[1].speed);
}

#[test]
fn what_happens_everywhere_at_once_is_no_wave() {
    let speed = |t: f64| 12. + 5. * (TAU * t / 50.).sin();
    let mut rows = Vec::new();
    for vehicle in 0..20 {
        let mut x = 25. * f64::from(vehicle);
        for frame in 0..3000 {
            let t = f64::from(frame) / RATE;
            rows.push((vehicle as u32 + 1, frame, x, -1.875, speed(t), 1));
            x += speed(t) / RATE;
        }
    }
    let found = waves(&rows, Course::Ring { circumference: 500. });
    assert_eq!(found[1].speed, Err(Missing::AtOnce));
}

#[test]
fn unrelated_places_make_no_wave() {
    // At every place the speed changes at its own pace: frequencies that no lag brings together.
    let mut rows = Vec::new();
    for place in 0..12 {
        for frame in 0..3000 {
            let t = f64::from(frame) / RATE;
            let pace = 0.2 + 0.11 * f64::from((place * 5) % 12);
            let x = 40. * f64::from(place) + 8. * (pace * t).sin();
            rows.push((place as u32 + 1, frame, x, -1.875, 8. * pace * (pace * t).cos(), 1));
        }
    }
    let found = waves(&rows, Course::Open);
    assert!(matches!(found[1].speed, Err(Missing::Weak { .. })), "{:?}", found[1].speed);
}
