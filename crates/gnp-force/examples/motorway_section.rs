//! Five minutes on two kilometres of a three-lane motorway with lorries, overtaking and a slowdown.
//!
//! `cargo run --example motorway_section -- [FILE] [--svg FILE]` writes every vehicle once a second with its forces:
//! SUMO's floating car data when the name ends in `.xml`, CSV otherwise, CSV to the terminal without a name. As a
//! driver's decision, overtaking is no force; the rule here is a plain one and stands at the end of this file.
use gnp_force::{Drive, Road, Simulator, SimulatorParams, State, Surroundings, Vehicle, VehicleId};
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

fn main() -> Result<(), Box<dyn Error>> {
    let (svg, files) = chart::arguments()?;
    let name = files.first();
    let xml = name.is_some_and(|name| name.ends_with(".xml"));
    let mut out: Box<dyn Write> = match name {
        Some(name) => Box::new(BufWriter::new(File::create(name)?)),
        None => Box::new(BufWriter::new(std::io::stdout().lock())),
    };

    let mut section = Section::new()?;
    write_head(&mut out, xml)?;
    let mut tracks = BTreeMap::<VehicleId, Vec<(f64, f64)>>::new();
    for step in 0..STEPS {
        section.enter(step)?;
        section.decide()?;
        if step % 25 == 0 {
            write_frame(&mut out, xml, &section.scene)?;
            for (id, vehicle) in section.scene.vehicles() {
                if section.scene.road().lane_at(vehicle.state.position.y) == 1 {
                    tracks.entry(id).or_default().push((section.scene.time(), vehicle.state.position.x));
                }
            }
        }
        section.scene.step();
        section.scene.retain(|_, vehicle| vehicle.state.position.x < LENGTH);
    }
    if xml {
        writeln!(out, "</fcd-export>")?;
    }
    out.flush()?;
    eprintln!("{} vehicles entered, {} are still on the section", section.entered, section.scene.vehicles().len());

    if let Some(file) = svg {
        std::fs::write(file, draw(&[time_space(tracks)]))?;
    }
    Ok(())
}

/// The traffic: a scene, what every driver wishes, and how many came.
struct Section {
    scene: Simulator<f64>,
    wishes: BTreeMap<VehicleId, f64>,
    entered: usize,
}

impl Section {
    fn new() -> Result<Self, Box<dyn Error>> {
        let scene = Simulator::new(SimulatorParams::motorway(DT), Road::motorway(LANES, 3.75)?)?;
        Ok(Self { scene, wishes: BTreeMap::new(), entered: 0 })
    }

    /// Every 2.4 s a vehicle enters each lane, if there is room; every third in the right lane is a lorry.
    fn enter(&mut self, step: u32) -> Result<(), Box<dyn Error>> {
        for lane in 0..LANES {
            let Some(y) = self.scene.road().lane_centre(lane) else { continue };
            if step % 60 != 20 * lane as u32 {
                continue;
            }
            let truck = lane == 0 && (step / 60).is_multiple_of(3);
            // Spread the wishes without a random number: the golden ratio visits an interval evenly.
            let share = (f64::from(step) * 0.618_033_988_75 / 20.0).fract();
            let wish = if truck { 22.5 + 1.5 * share } else { 27.0 + 3.0 * lane as f64 + 5.0 * share };
            let last =
                self.scene.vehicles().filter(|(_, other)| self.scene.road().lane_at(other.state.position.y) == lane);
            let last = last.map(|(_, other)| *other).min_by(|a, b| a.state.position.x.total_cmp(&b.state.position.x));
            let (room, ahead) = last.map_or((LENGTH, wish), |other| {
                (other.state.position.x - other.extent.length / 2.0, other.state.velocity.x)
            });
            let speed = wish.min(ahead);
            if room < 15.0 + speed {
                continue;
            }
            let (state, drive) = (State::new(0.0, y, speed, 0.0), Drive::Cruise { speed: wish, y });
            let id = self.scene.add(if truck { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) })?;
            self.wishes.insert(id, wish);
            self.entered += 1;
        }
        Ok(())
    }

    /// Each driver's lane and speed for the next moment.
    fn decide(&mut self) -> Result<(), Box<dyn Error>> {
        let ids: Vec<VehicleId> = self.scene.vehicles().map(|(id, _)| id).collect();
        for id in ids {
            let (Some(me), Some(wish)) = (self.scene.vehicle(id).copied(), self.wishes.get(&id).copied()) else {
                continue;
            };
            let x = me.state.position.x;
            // Works between 1200 m and 1500 m for two minutes: 17 m/s.
            let slow = (1200.0..1500.0).contains(&x) && (90.0..210.0).contains(&self.scene.time());
            let speed = if slow { wish.min(17.0) } else { wish };
            let lane = self.lane(id, &me, wish)?;
            let y = self.scene.road().lane_centre(lane).unwrap_or(me.state.position.y);
            self.scene.set_drive(id, Drive::Cruise { speed, y })?;
        }
        Ok(())
    }

    /// The lane to be in: left past somebody slower, right again when that is free, else where the vehicle is.
    fn lane(&self, id: VehicleId, me: &Vehicle<f64>, wish: f64) -> Result<usize, Box<dyn Error>> {
        let road = self.scene.road();
        let lane = road.lane_at(me.state.position.y);
        let Drive::Cruise { y, .. } = me.drive else { return Ok(lane) };
        let aim = road.lane_at(y);
        if (me.state.position.y - y).abs() > 0.6 {
            return Ok(aim); // under way
        }
        let Surroundings { ahead, left_ahead, left_behind, right_ahead, right_behind, .. } =
            self.scene.surroundings(id)?;
        let v = me.state.velocity.x;
        let held_up = self.gap(me, ahead).is_some_and(|(gap, speed)| gap < 2.0 * v && speed < wish - 2.0);
        let free = |front, back| {
            let front =
                self.gap(me, front).is_none_or(|(gap, speed)| gap > 10.0 + 0.6 * v + 3.0 * (v - speed).max(0.0));
            let back =
                self.gap(me, back).is_none_or(|(gap, speed)| gap > 10.0 + 0.6 * speed + 4.0 * (speed - v).max(0.0));
            front && back
        };
        if held_up && lane + 1 < LANES && me.extent.length < 10.0 && free(left_ahead, left_behind) {
            return Ok(lane + 1);
        }
        let clear =
            self.gap(me, right_ahead).is_none_or(|(gap, speed)| gap > 6.0 * v || (gap > 2.5 * v && speed > wish));
        if lane > 0 && clear && free(right_ahead, right_behind) {
            return Ok(lane - 1);
        }
        Ok(aim)
    }

    /// Gap to another vehicle in m and its speed.
    fn gap(&self, me: &Vehicle<f64>, other: Option<VehicleId>) -> Option<(f64, f64)> {
        let other = self.scene.vehicle(other?)?;
        Some((me.separation_from(other).ahead, other.state.velocity.x))
    }
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
