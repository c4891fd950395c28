//! A column of four vehicles over 5 s at 10 Hz, as a prediction rolls it out, in memory that is used again.
use criterion::{Criterion, criterion_group, criterion_main};
use gnp_force::{Driver, Follower, Platoon};
use std::hint::black_box;

fn platoon(criterion: &mut Criterion) {
    let car = |i: usize| Follower {
        position: -30.0 * i as f32,
        speed: 25.0,
        length: 4.6,
        leader: i.checked_sub(1),
        driver: Driver::motorway(),
        habit: if i == 0 { -2.0 } else { 0.3 },
    };
    let column: Vec<Follower<f32>> = (0..4).map(car).collect();
    let mut platoon = Platoon::default();
    criterion.bench_function("platoon/4_vehicles/50_steps", |bencher| {
        bencher.iter(|| {
            let result = platoon.roll_out_into(black_box(&column), 0.1, 50, 4.0);
            black_box((result.is_ok(), platoon.positions().last().copied()))
        });
    });
}

criterion_group!(benches, platoon);
criterion_main!(benches);
