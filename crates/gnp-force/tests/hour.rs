//! Nobody touches anybody in dense traffic of cars and lorries that overtake each other.
//!
//! One seed here; `cargo run --example hour` drives five.
#![allow(clippy::unwrap_used, reason = "a test that cannot build its scene has failed")]
#[path = "../examples/scenes/motorway.rs"]
mod motorway;
use gnp_force::{Driver, Idm, MotorwayRule, Rule};

fn an_hour(rule: impl Into<Rule<f64>>) {
    let found = motorway::drive(rule.into(), 1500.0, 3600.0, 1).unwrap();
    assert!(found.contacts.is_empty(), "{:?}", found.contacts);
    assert!(found.entered.abs_diff(4500) < 200 && found.left > 4000, "{found:?}");
    assert!(found.lane_changes > 2000, "{found:?}");
}

#[test]
fn the_social_force_at_1500_vehicles_an_hour_and_lane() {
    an_hour(MotorwayRule::standard());
}

#[test]
fn the_intelligent_driver_at_1500_vehicles_an_hour_and_lane() {
    an_hour(Idm::of(&Driver::motorway()));
}
