//! A leader brakes, seven follow: `cargo run --example platoon`.
//!
//! Prints when, where and why each vehicle brakes hardest: the wave runs against the traffic, and grows weaker.
use gnp_force::{Driver, Follower, ForceError, Platoon};

fn main() -> Result<(), ForceError> {
    let (driver, speed, length) = (Driver::motorway(), 12.0_f64, 4.6);
    let pitch = length + driver.equilibrium_gap(speed).unwrap_or(20.0);
    let mut column: Vec<Follower<f64>> = (0..8_usize)
        .map(|i| {
            let position = -pitch * i as f64;
            Follower { position, speed, length, leader: i.checked_sub(1), driver, habit: 0.0 }
        })
        .collect();
    column[0].habit = -2.0; // the foremost brakes with 2 m/s², ever less: by 8 m/s in all
    let (dt, steps, decay) = (0.1, 300, 4.0);
    let platoon = Platoon::roll_out(&column, dt, steps, decay)?;

    println!("car  time_s  place_m  free_mps2  ahead_mps2  habit_mps2  speed_at_the_end_mps");
    for car in 0..column.len() {
        let row = car * steps..(car + 1) * steps;
        let parts = |at: usize| [platoon.free()[at], platoon.interaction()[at], platoon.habit()[at]];
        let sum = |at: &usize| parts(*at).iter().sum::<f64>();
        let hardest = row.clone().min_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap_or(row.start);
        let (time, place) = ((hardest - row.start) as f64 * dt, platoon.positions()[hardest]);
        let [free, ahead, habit] = parts(hardest);
        let end = platoon.speeds()[row.end - 1];
        println!("{car:3} {time:7.1} {place:8.1} {free:10.2} {ahead:11.2} {habit:11.2} {end:21.2}");
    }
    Ok(())
}
