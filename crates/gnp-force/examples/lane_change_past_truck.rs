//! A car moves out, passes a lorry and moves back in: `cargo run --example lane_change_past_truck`.
//!
//! Prints CSV with the forces on the car by part; `-- --svg FILE` draws it. When to change lanes is the driver's
//! decision, taken here from the gap; the forces do the rest.
use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Vehicle};
use std::error::Error;

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

fn main() -> Result<(), Box<dyn Error>> {
    let [right, left] = [1.875, 5.625];
    let mut scene = Simulator::new(SimulatorParams::motorway(0.04), Road::motorway(2, 3.75)?)?;
    let truck =
        scene.add(Vehicle::truck(State::new(150.0, right, 23.0, 0.0), Drive::Cruise { speed: 23.0, y: right }))?;
    let car = scene.add(Vehicle::car(State::new(0.0, right, 32.0, 0.0), Drive::Cruise { speed: 32.0, y: right }))?;

    let mut rows = Vec::new();
    println!("time_s,x_m,y_m,speed_mps,truck_x_m,truck_y_m,goal_x,goal_y,neighbours_x,neighbours_y,lines_y");
    for _ in 0..=900 {
        let (me, other) = (scene.vehicle(car).ok_or("the car left")?, scene.vehicle(truck).ok_or("the lorry left")?);
        let gap = me.separation_from(other).ahead;
        let (state, other) = (me.state, other.state);
        let behind = state.position.x < other.position.x;
        let lane = if (behind && gap < 90.0) || (!behind && gap < 15.0) { left } else { right };
        scene.set_drive(car, Drive::Cruise { speed: 32.0, y: lane })?;

        let forces = scene.explain(car)?.forces;
        let (pushes, lines) = (forces.neighbours_total(), forces.lines_total());
        let row = [
            scene.time(),
            state.position.x,
            state.position.y,
            state.velocity.x,
            other.position.x,
            other.position.y,
            forces.goal.x,
            forces.goal.y,
            pushes.x,
            pushes.y,
            lines.y,
        ];
        println!("{}", row.map(|value| format!("{value:.4}")).join(","));
        rows.push(row);
        scene.step();
    }

    if let (Some(file), _) = chart::arguments()? {
        let over =
            |x: usize, name, column: usize| Curve::new(name, rows.iter().map(|row| (row[x], row[column])).collect());
        let panels = [
            Panel {
                title: "Lateral positions; the line between the lanes is at 3.75 m",
                x: "time, s",
                y: "y, m",
                curves: vec![over(0, "car", 2), over(0, "lorry", 5)],
            },
            Panel {
                title: "How far the car is ahead of the lorry",
                x: "time, s",
                y: "centres, m",
                curves: vec![Curve::new("distance", rows.iter().map(|row| (row[0], row[1] - row[4])).collect())],
            },
            Panel {
                title: "Lateral forces on the car",
                x: "time, s",
                y: "F along y, m/s²",
                curves: vec![over(0, "goal", 7), over(0, "neighbours", 9), over(0, "lines", 10)],
            },
        ];
        std::fs::write(file, draw(&panels))?;
    }
    Ok(())
}
