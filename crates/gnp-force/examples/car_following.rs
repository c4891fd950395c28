//! A car catches up with another, follows it through a slowdown and on: `cargo run --example car_following`.
//!
//! Prints CSV with the forces on the follower by part; `-- --svg FILE` draws it.
use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
use std::error::Error;

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

fn main() -> Result<(), Box<dyn Error>> {
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04_f64), Road::motorway(1, 3.75)?)?;
    let y = 1.875;
    let cruise = |speed| Drive::Cruise { speed, y };
    let leader = scene.add(Vehicle::car(State::new(120.0, y, 28.0, 0.0), cruise(28.0)))?;
    let follower = scene.add(Vehicle::car(State::new(0.0, y, 33.0, 0.0), cruise(33.0)))?;

    let mut rows = Vec::new();
    println!("time_s,gap_m,leader_mps,follower_mps,goal_mps2,neighbours_mps2,lines_lateral_mps2");
    for step in 0..=2500 {
        let time = scene.time();
        // The leader eases off to 15 m/s at 40 s, a metre per second each second, and speeds up again at 65 s.
        let wish = if time < 65.0 { (28.0 - (time - 40.0).max(0.0)).max(15.0) } else { 28.0 };
        scene.set_drive(leader, cruise(wish))?;
        let forces = scene.explain(follower)?.forces;
        let [ahead, behind] = [leader, follower].map(|id| scene.vehicle(id).map(|vehicle| vehicle.state));
        let (ahead, behind) = (ahead.ok_or("the leader left")?, behind.ok_or("the follower left")?);
        let row = [
            time,
            ahead.position.x - behind.position.x - 4.6,
            ahead.velocity.x,
            behind.velocity.x,
            forces.goal.x,
            forces.neighbours_total().x,
            forces.lines_total().y,
        ];
        if step % 5 == 0 {
            println!("{}", row.map(|value| format!("{value:.4}")).join(","));
            rows.push(row);
        }
        scene.step();
    }

    if let (Some(file), _) = chart::arguments()? {
        let curve = |name, column: usize| Curve::new(name, rows.iter().map(|row| (row[0], row[column])).collect());
        let panel = |title, y, curves| Panel { title, x: "time, s", y, curves };
        let panels = [
            panel("Gap from bumper to bumper", "gap, m", vec![curve("gap", 1)]),
            panel("Speeds", "v, m/s", vec![curve("leader", 2), curve("follower", 3)]),
            panel("Forces on the follower", "F along x, m/s²", vec![curve("goal", 4), curve("neighbours", 5)]),
        ];
        std::fs::write(file, draw(&panels))?;
    }
    Ok(())
}
