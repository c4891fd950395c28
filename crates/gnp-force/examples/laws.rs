//! The four laws over distance, as CSV: `cargo run --example laws [-- --svg FILE]`.
use gnp_force::{
    MarkingKind, Side, goal_force, line_force,
    na::{Point2, Vector2},
    vehicle_force,
};
use std::error::Error;

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

fn main() -> Result<(), Box<dyn Error>> {
    let goal = |d: f64| goal_force(Point2::new(-d, 0.0), Vector2::new(25.0, 0.0), Point2::origin(), 5.0, 1.0).x;
    let vehicle = |d: f64| vehicle_force(Vector2::new(d, 0.0), 9.0, 26.0).x;
    let centre = |d: f64| line_force(MarkingKind::LaneDivider, d, 0.2, Side::Left);
    let boundary = |d: f64| line_force(MarkingKind::Boundary, d, 0.3, Side::Left);

    println!("distance_m,goal_mps2,vehicle_mps2,centre_line_mps2,boundary_mps2");
    for i in -200..=200 {
        let d = f64::from(i) * 0.5;
        println!("{d},{:.5},{:.5},{:.5},{:.5}", goal(d), vehicle(d), centre(d), boundary(d));
    }

    if let (Some(file), _) = chart::arguments()? {
        let curve = |name: &str, law: &dyn Fn(f64) -> f64, from: f64, to: f64| {
            let at = |i: u32| from + (to - from) * f64::from(i) / 400.0;
            Curve::new(name, (0..=400).map(|i| (at(i), law(at(i)))).collect())
        };
        let panels = [
            Panel {
                title: "Attraction at 25 m/s with 5 s left, tau = 1 s",
                x: "distance to the goal, m",
                y: "F, m/s²",
                curves: vec![curve("goal", &goal, 0.0, 200.0)],
            },
            Panel {
                title: "Repulsion between vehicles, k = 9 m/s², r_col = 26 m",
                x: "x of the vehicle minus x of the neighbour, m",
                y: "F, m/s²",
                curves: vec![curve("neighbour", &vehicle, -100.0, 100.0)],
            },
            Panel {
                title: "Lines: centre line k = 0.2 m²/s², right boundary k = 0.3 m⁴/s²",
                x: "y of the vehicle minus y of the line, m (left is positive)",
                y: "lateral F, m/s²",
                curves: vec![curve("centre line", &centre, -4.0, 4.0), curve("boundary", &boundary, -4.0, 4.0)],
            },
        ];
        std::fs::write(file, draw(&panels))?;
    }
    Ok(())
}
