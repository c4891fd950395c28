//! Five minutes on two kilometres of a three-lane motorway with lorries, overtaking and a slowdown.
//!
//! `cargo run --example motorway_section -- [FILE] [--svg FILE]` writes every vehicle once a second with its forces:
//! SUMO's floating car data when the name ends in `.xml`, CSV otherwise, CSV to the terminal without a name. Vehicles
//! enter by an inflow for each lane, drivers overtake by MOBIL, and whoever passes the end of the road leaves.
use gnp_force::{Drive, Event, Headways, Inflow, Mobil, Road, Simulator, SimulatorParams, State, Vehicle, VehicleId};
use std::{
    collections::BTreeMap,
    error::Error,
    fs::File,
    io::{BufWriter, Write},
};

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

const LENGTH: f64 = 2000.0;
const LANES: usize = 3;
const STEPS: u32 = 7500;
const DT: f64 = 0.04;
/// Vehicles an hour and lane.
const FLOW: f64 = 1400.0;

fn main() -> Result<(), Box<dyn Error>> {
    let (svg, files) = chart::arguments()?;
    let name = files.first();
    let xml = name.is_some_and(|name| name.ends_with(".xml"));
    let mut out: Box<dyn Write> = match name {
        Some(name) => Box::new(BufWriter::new(File::create(name)?)),
        None => Box::new(BufWriter::new(std::io::stdout().lock())),
    };

    let road = Road::motorway(LANES, 3.75)?.ending_at(LENGTH)?;
    let mut scene = Simulator::new(SimulatorParams::motorway(DT), road)?;
    let mut inflows =
        (0..LANES as u64).map(|lane| Inflow::new(FLOW, Headways::Even, lane)).collect::<Result<Vec<_>, _>>()?;
    let mut wishes = BTreeMap::new();
    let mut tracks = BTreeMap::<VehicleId, Vec<(f64, f64)>>::new();
    let [mut left, mut changes, mut contacts] = [0, 0, 0];
    write_head(&mut out, xml)?;
    for step in 0..STEPS {
        for (lane, inflow) in inflows.iter_mut().enumerate() {
            let Some(y) = scene.road().lane_centre(lane) else { continue };
            let wish = wish(lane, inflow.entered());
            if let Some(id) = scene.admit(inflow, |number| driver(lane, number, wish, y))? {
                wishes.insert(id, wish);
            }
        }
        slow_down_at_works(&mut scene, &wishes)?;
        if step % 25 == 0 {
            write_frame(&mut out, xml, &scene)?;
            for (id, vehicle) in scene.vehicles() {
                if scene.road().lane_at(vehicle.state.position.y) == 1 {
                    tracks.entry(id).or_default().push((scene.time(), vehicle.state.position.x));
                }
            }
        }
        for event in scene.step() {
            match event {
                Event::Left { .. } => left += 1,
                Event::LaneChange { .. } => changes += 1,
                Event::Contact { .. } => contacts += 1,
                Event::Arrived { .. } => {}
            }
        }
    }
    if xml {
        writeln!(out, "</fcd-export>")?;
    }
    out.flush()?;
    let entered: u64 = inflows.iter().map(Inflow::entered).sum();
    eprintln!("{entered} vehicles entered, {left} left, {changes} lane changes, {contacts} contacts");

    if let Some(file) = svg {
        std::fs::write(file, draw(&[time_space(tracks)]))?;
    }
    Ok(())
}

/// Whether the vehicle of that number is a lorry: every third in the right lane.
fn is_lorry(lane: usize, number: u64) -> bool {
    lane == 0 && number.is_multiple_of(3)
}

/// Its desired speed, in m/s. Spread without a random number: the golden ratio visits an interval evenly.
fn wish(lane: usize, number: u64) -> f64 {
    let share = (number as f64 * 0.618_033_988_75).fract();
    if is_lorry(lane, number) { 22.5 + 1.5 * share } else { 27.0 + 3.0 * lane as f64 + 5.0 * share }
}

fn driver(lane: usize, number: u64, speed: f64, y: f64) -> Vehicle<f64> {
    let (state, drive) = (State::new(0.0, y, speed, 0.0), Drive::Cruise { speed, y });
    if is_lorry(lane, number) {
        Vehicle::truck(state, drive)
    } else {
        Vehicle { lane_change: Some(Mobil::standard()), ..Vehicle::car(state, drive) }
    }
}

/// Works between 1200 m and 1500 m for two minutes: nobody wants to drive faster than 17 m/s.
fn slow_down_at_works(scene: &mut Simulator<f64>, wishes: &BTreeMap<VehicleId, f64>) -> Result<(), Box<dyn Error>> {
    scene.steer(|scene, id, vehicle| {
        let (Drive::Cruise { speed, y }, Some(wish)) = (&vehicle.drive, wishes.get(&id)) else { return None };
        let slow = (1200.0..1500.0).contains(&vehicle.state.position.x) && (90.0..210.0).contains(&scene.time());
        let now = if slow { wish.min(17.0) } else { *wish };
        (now != *speed).then_some(Drive::Cruise { speed: now, y: *y })
    })?;
    Ok(())
}

fn write_head(out: &mut dyn Write, xml: bool) -> std::io::Result<()> {
    if xml {
        writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fcd-export>")
    } else {
        writeln!(out, "time_s,vehicle,kind,lane,x_m,y_m,vx_mps,vy_mps,goal_x,goal_y,neighbours_x,neighbours_y,lines_y")
    }
}
/// All vehicles now. SUMO counts lanes from the right, as we do, gives the middle of the front bumper, and measures
/// angles clockwise from north, where x points east.
fn write_frame(out: &mut dyn Write, xml: bool, scene: &Simulator<f64>) -> Result<(), Box<dyn Error>> {
    let time = scene.time();
    if xml {
        writeln!(out, "  <timestep time=\"{time:.2}\">")?;
    }
    for (id, vehicle) in scene.vehicles() {
        let State { position: p, velocity: v } = vehicle.state;
        let kind = if vehicle.extent.length > 10.0 { "truck" } else { "car" };
        let lane = scene.road().lane_at(p.y);
        if xml {
            let (front, angle) = (p.x + vehicle.extent.length / 2.0, 90.0 - v.y.atan2(v.x).to_degrees());
            writeln!(
                out,
                "    <vehicle id=\"{id}\" x=\"{front:.2}\" y=\"{:.2}\" angle=\"{angle:.2}\" type=\"{kind}\" \
                 speed=\"{:.2}\" pos=\"{front:.2}\" lane=\"section_{lane}\" slope=\"0.00\"/>",
                p.y,
                v.norm(),
            )?;
        } else {
            let forces = scene.explain(id)?.forces;
            let (goal, pushes, lines) = (forces.goal, forces.neighbours_total(), forces.lines_total());
            let numbers = [p.x, p.y, v.x, v.y, goal.x, goal.y, pushes.x, pushes.y, lines.y];
            writeln!(out, "{time:.2},{id},{kind},{lane},{}", numbers.map(|value| format!("{value:.3}")).join(","))?;
        }
    }
    if xml {
        writeln!(out, "  </timestep>")?;
    }
    Ok(())
}

/// Every stretch that a vehicle drove in the middle lane, a line each.
fn time_space(tracks: BTreeMap<VehicleId, Vec<(f64, f64)>>) -> Panel {
    let mut curves = Vec::new();
    for points in tracks.into_values() {
        for stretch in points.chunk_by(|a, b| b.0 - a.0 < 1.5) {
            curves.push(Curve { name: String::new(), points: stretch.to_vec(), colour: Some("#0b6e99".into()) });
        }
    }
    Panel { title: "Middle lane: works at 1200 m to 1500 m from 90 s to 210 s", x: "time, s", y: "x, m", curves }
}
