//! A car moves over close in front of another, which falls back: `cargo run --example cut_in`.
//!
//! Prints CSV with the forces on the car that is cut off, by part; `-- --svg FILE` draws it.
use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
use std::error::Error;

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

fn main() -> Result<(), Box<dyn Error>> {
    let road = Road::motorway(2, 3.75)?;
    let [right, left] = [1.875, 5.625];
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), road)?;
    let follower = scene.add(Vehicle::car(State::new(0.0, left, 32.0, 0.0), Drive::Cruise { speed: 32.0, y: left }))?;
    let merging =
        scene.add(Vehicle::car(State::new(22.0, right, 29.0, 0.0), Drive::Cruise { speed: 29.0, y: right }))?;

    let mut rows = Vec::new();
    println!("time_s,gap_m,merging_y_m,follower_mps,follower_y_m,goal_mps2,neighbours_mps2,lines_lateral_mps2");
    for step in 0..=500 {
        let time = scene.time();
        if step == 50 {
            scene.set_drive(merging, Drive::Cruise { speed: 29.0, y: left })?;
        }
        let forces = scene.explain(follower)?.forces;
        let [ahead, behind] = [merging, follower].map(|id| scene.vehicle(id).map(|vehicle| vehicle.state));
        let (ahead, behind) = (ahead.ok_or("the merging car left")?, behind.ok_or("the follower left")?);
        let row = [
            time,
            ahead.position.x - behind.position.x - 4.6,
            ahead.position.y,
            behind.velocity.x,
            behind.position.y,
            forces.goal.x,
            forces.neighbours_total().x,
            forces.lines_total().y,
        ];
        println!("{}", row.map(|value| format!("{value:.4}")).join(","));
        rows.push(row);
        scene.step();
    }

    if let (Some(file), _) = chart::arguments()? {
        let curve = |name, column: usize| Curve::new(name, rows.iter().map(|row| (row[0], row[column])).collect());
        let panel = |title, y, curves| Panel { title, x: "time, s", y, curves };
        let panels = [
            panel(
                "Lateral positions; the line between the lanes is at 3.75 m",
                "y, m",
                vec![curve("merging car", 2), curve("car cut off", 4)],
            ),
            panel("Gap from bumper to bumper", "gap, m", vec![curve("gap", 1)]),
            panel("Forces on the car cut off", "F along x, m/s²", vec![curve("goal", 5), curve("neighbours", 6)]),
        ];
        std::fs::write(file, draw(&panels))?;
    }
    Ok(())
}
