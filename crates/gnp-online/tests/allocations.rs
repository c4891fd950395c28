//! In the steady state a stream allocates nothing.

#![allow(clippy::unwrap_used)] // also outside the test functions

#[path = "stream/model.rs"]
mod model;

use gnp_data::WindowShape;
use gnp_online::{Stream, StreamConfig, Tracked};

use model::{lines, model};

const SHAPE: WindowShape = WindowShape { t_obs: 16, t_pred: 25, step: 1, rate_hz: 5. };

/// Up to 20 vehicles, each there for a while and then another one in its place; now and then one track is bad.
fn tracks(number: u32, into: &mut Vec<Tracked>) {
    let time_s = f64::from(number) / 25.;
    into.clear();
    for i in 0..20u32 {
        let generation = (number + 17 * i) / 150;
        if (number + 7 * i) % 40 < 3 || (number + 17 * i) % 150 < 10 {
            continue;
        }
        let x = 20. * f64::from(i) + 20. * time_s - 100. * f64::from(generation % 3);
        let position = [if number % 50 == i { f64::NAN } else { x }, 1.85 + 3.7 * f64::from(i % 2)];
        into.push(Tracked::new(u64::from(i + 1000 * generation), position));
    }
}

#[test]
fn a_warm_stream_allocates_nothing() {
    let mut stream = Stream::new(&model(SHAPE), lines(), StreamConfig::default()).unwrap();
    let mut room = Vec::with_capacity(20);
    let mut number = 0;
    let mut push = |stream: &mut Stream| {
        number += 1;
        tracks(number, &mut room);
        let vehicles = stream.push(f64::from(number) / 25., &room).unwrap().vehicles().len();
        assert!((10..=22).contains(&vehicles), "{vehicles}");
    };
    (0..400).for_each(|_| push(&mut stream));
    let mut counts = Vec::with_capacity(100);
    for _ in 0..100 {
        counts.push(allocation_counter::measure(|| push(&mut stream)).count_total);
    }
    assert_eq!(counts, [0; 100]);
}
