//! Jams out of nothing: 22 vehicles on a ring of 230 m, as in the experiment of Sugiyama and others (2008).
//!
//! `cargo run --example ring -- [--svg FILE]` lets intelligent drivers with several accelerations and time gaps drive for
//! 20 minutes, unsteady by 0.1 m/s², and prints whether theory says that disturbances grow, and what became of them.
use gnp_force::{
    Drive, Driver, ForceError, Idm, Noise, Road, Simulator, SimulatorParams, State, Vehicle, following_acceleration,
};
use std::{error::Error, f64::consts::TAU};

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

const LENGTH: f64 = 230.0;
const VEHICLES: usize = 22;
const DT: f64 = 0.1;
const DURATION: f64 = 1200.0;
/// Of the figure, in s.
const FIGURE: f64 = 300.0;
/// Of a vehicle, in m.
const CAR: f64 = 4.6;

fn main() -> Result<(), Box<dyn Error>> {
    let (svg, _) = chart::arguments()?;
    println!("acceleration_mps2  time_gap_s  theory    slowest_mps  fastest_mps  grown_s  wave_kmh");
    for time_gap in [0.8, 1.0] {
        for acceleration in [0.8, 1.0, 1.2, 1.5, 2.0, 3.0] {
            let driver = driver(acceleration, time_gap);
            let theory = if disturbances_grow(&driver) { "unstable" } else { "stable" };
            let found = Found::of(&tracks(&driver, DURATION)?);
            println!(
                "{acceleration:17.1} {time_gap:11.1}  {theory:8} {:12.2} {:12.2} {:>8} {:>9}",
                found.slowest,
                found.fastest,
                found.grown.map_or("-".into(), |time| format!("{time:.0}")),
                found.wave_kmh.map_or("-".into(), |speed| format!("{speed:.1}")),
            );
        }
    }
    if let Some(file) = svg {
        let tracks = tracks(&driver(1.5, 0.8), FIGURE)?;
        std::fs::write(file, draw(&[time_space(&tracks), speeds(&tracks)]))?;
    }
    Ok(())
}

/// Drivers who were asked to drive 30 km/h, as in the experiment.
fn driver(acceleration: f64, time_gap: f64) -> Driver<f64> {
    Driver { desired_speed: 30.0 / 3.6, time_gap, standstill_gap: 2.0, acceleration, braking: 3.0 }
}

/// The speed at which all drive alike, in m/s.
fn even_speed(driver: &Driver<f64>) -> f64 {
    let pitch = LENGTH / VEHICLES as f64;
    let (mut low, mut high) = (0.0, driver.desired_speed);
    for _ in 0..60 {
        let v = (low + high) / 2.0;
        if following_acceleration(pitch, CAR, v, v, driver) > 0.0 { low = v } else { high = v }
    }
    low
}

/// Whether long waves grow along a column: `a_v² - a_l² < 2 a_s`, with the derivatives of the acceleration with respect to
/// the own speed, the leader's and the gap at even driving (Wilson and Ward 2011).
fn disturbances_grow(driver: &Driver<f64>) -> bool {
    let (pitch, v, h) = (LENGTH / VEHICLES as f64, even_speed(driver), 1e-5);
    let slope = |ds: f64, dv: f64, dl: f64| {
        let at = |sign: f64| following_acceleration(pitch + sign * ds, CAR, v + sign * dv, v + sign * dl, driver);
        (at(1.0) - at(-1.0)) / (2.0 * h)
    };
    let (a_s, a_v, a_l) = (slope(h, 0.0, 0.0), slope(0.0, h, 0.0), slope(0.0, 0.0, h));
    a_v * a_v - a_l * a_l < 2.0 * a_s
}

/// Position in m and speed in m/s of all vehicles, once a second.
fn tracks(driver: &Driver<f64>, duration: f64) -> Result<Vec<Vec<(f64, f64)>>, ForceError> {
    let road = Road::motorway(1, 3.75)?.ring(LENGTH)?;
    let mut scene = Simulator::for_rules(SimulatorParams { seed: 1, ..SimulatorParams::motorway(DT) }, road)?;
    let (y, v) = (1.875, even_speed(driver));
    for i in 0..VEHICLES {
        let state = State::new(LENGTH / VEHICLES as f64 * i as f64, y, v, 0.0);
        let car = Vehicle::car(state, Drive::Cruise { speed: driver.desired_speed, y });
        scene.add(Vehicle { noise: Some(Noise { sigma: 0.1, correlation: 5.0 }), ..car }.with_rule(Idm::of(driver)))?;
    }
    let mut tracks = Vec::new();
    while scene.time() < duration {
        tracks.push(scene.vehicles().map(|(_, car)| (car.state.position.x, car.state.velocity.x)).collect());
        for _ in 0..10 {
            if !scene.step().is_empty() {
                eprintln!("contact at {} s", scene.time());
            }
        }
    }
    Ok(tracks)
}

/// What became of the disturbance.
struct Found {
    /// In the last five minutes, in m/s.
    slowest: f64,
    fastest: f64,
    /// When the speeds of all first differed by more than 2 m/s, in s.
    grown: Option<f64>,
    /// How fast the jam runs against the traffic in the last five minutes, in km/h.
    wave_kmh: Option<f64>,
}

impl Found {
    fn of(tracks: &[Vec<(f64, f64)>]) -> Self {
        let spread = |cars: &[(f64, f64)]| {
            cars.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), (_, v)| (low.min(*v), high.max(*v)))
        };
        let late = &tracks[tracks.len() - 300..];
        let (slowest, fastest) =
            late.iter().map(|cars| spread(cars)).fold((f64::INFINITY, 0.0_f64), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let grown = tracks.iter().position(|cars| spread(cars).1 - spread(cars).0 > 2.0).map(|time| time as f64);
        Self { slowest, fastest, grown, wave_kmh: (fastest - slowest > 2.0).then(|| wave_kmh(late)) }
    }
}

/// The jam's place is the mean angle of the vehicles, weighted by how much slower than the fastest they are; its speed the
/// way of that angle over the time, against the traffic.
fn wave_kmh(tracks: &[Vec<(f64, f64)>]) -> f64 {
    let angle = |cars: &Vec<(f64, f64)>| {
        let fastest = cars.iter().fold(0.0_f64, |fastest, (_, v)| fastest.max(*v));
        let (sin, cos) = cars.iter().fold((0.0, 0.0), |(sin, cos), (x, v)| {
            let (weight, angle) = (fastest - v, TAU * x / LENGTH);
            (sin + weight * angle.sin(), cos + weight * angle.cos())
        });
        f64::atan2(sin, cos)
    };
    let way: f64 =
        tracks.windows(2).map(|pair| (angle(&pair[1]) - angle(&pair[0]) + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0).sum();
    -way / TAU * LENGTH / (tracks.len() - 1) as f64 * 3.6
}

/// Every lap of every vehicle.
fn time_space(tracks: &[Vec<(f64, f64)>]) -> Panel {
    let mut curves = Vec::new();
    for car in 0..VEHICLES {
        let points: Vec<(f64, f64)> =
            tracks.iter().enumerate().map(|(time, cars)| (time as f64, cars[car].0)).collect();
        for lap in points.chunk_by(|a, b| b.1 >= a.1 - 1.0) {
            curves.push(Curve { name: String::new(), points: lap.to_vec(), colour: Some("#0b6e99".into()) });
        }
    }
    Panel { title: "22 vehicles on a ring of 230 m: the first five minutes", x: "time, s", y: "x, m", curves }
}

fn speeds(tracks: &[Vec<(f64, f64)>]) -> Panel {
    let curve = |name: &str, pick: fn(f64, f64) -> f64, start: f64| {
        let speeds = |cars: &Vec<(f64, f64)>| cars.iter().fold(start, |all, (_, v)| pick(all, *v)) * 3.6;
        Curve::new(name, tracks.iter().enumerate().map(|(time, cars)| (time as f64, speeds(cars))).collect())
    };
    let curves = vec![curve("fastest", f64::max, 0.0), curve("slowest", f64::min, f64::INFINITY)];
    Panel { title: "Speeds", x: "time, s", y: "speed, km/h", curves }
}
