//! An hour of mixed traffic at 1,500 vehicles an hour and lane: how many touch each other.
//!
//! `cargo run --example hour -- [FLOW]`: three lanes, 3 km, steps of 0.1 s, the social force and the intelligent driver
//! model, each with five seeds.
use gnp_force::{Driver, Idm, MotorwayRule, Rule};
use std::error::Error;

#[path = "scenes/motorway.rs"]
mod motorway;

fn main() -> Result<(), Box<dyn Error>> {
    let flow = std::env::args().nth(1).map_or(Ok(1500.0), |flow| flow.parse())?;
    println!("rule      seed  entered  left  lane_changes  contacts  hardest_braking_mps2  speed_mps  seconds");
    let rules: [(&str, Rule<f64>); 2] =
        [("motorway", MotorwayRule::standard().into()), ("idm", Idm::of(&Driver::motorway()).into())];
    for (name, rule) in rules {
        for seed in 1..=5 {
            let start = std::time::Instant::now();
            let found = motorway::drive(rule, flow, 3600.0, seed)?;
            println!(
                "{name:8} {seed:5} {:8} {:5} {:13} {:9} {:21.2} {:10.2} {:8.1}",
                found.entered,
                found.left,
                found.lane_changes,
                found.contacts.len(),
                found.hardest,
                found.speed,
                start.elapsed().as_secs_f64()
            );
            for (time, id, with) in found.contacts.iter().take(5) {
                println!("    {time:.1} s: vehicle {id} and {with}");
            }
        }
    }
    Ok(())
}
