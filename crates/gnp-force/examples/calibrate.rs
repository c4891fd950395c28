//! Calibrates the intelligent driver model to a recorded pair by gradients: `cargo run --example calibrate [-- FILE]`.
//!
//! The leader moves as recorded, the follower as the model says from where he was at first. What is made small is the mean
//! squared error of the gap over the whole time; its gradient comes from one way back through the roll-out. The file has
//! the columns `time_s,leader_m,leader_length_m,follower_m,follower_length_m`, places of the centres, in even steps.
use gnp_force::{Drive, Extent, Idm, Profile, Road, RollOut, Simulator, SimulatorParams, State, Vehicle, VehicleId};
use std::{error::Error, sync::Arc};

const NAMES: [&str; 5] = ["desired_speed", "time_gap", "standstill_gap", "acceleration", "braking"];
const UNITS: [&str; 5] = ["m/s", "s", "m", "m/s²", "m/s²"];
/// Where to begin: a textbook driver in town (Treiber and Kesting 2013, table 11.2).
const START: [f64; 5] = [15.0, 1.0, 2.0, 1.0, 1.5];
/// What is still a driver.
const RANGES: [[f64; 2]; 5] = [[5.0, 40.0], [0.2, 4.0], [0.5, 8.0], [0.2, 4.0], [0.2, 6.0]];

/// A leader and his follower, at even steps.
struct Pair {
    dt: f64,
    leader: Vec<f64>,
    follower: Vec<f64>,
    lengths: [f64; 2],
}

impl Pair {
    fn read(text: &str) -> Result<Self, Box<dyn Error>> {
        let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(str::parse).collect::<Result<_, _>>()).collect::<Result<_, _>>()?;
        if rows.len() < 3 || rows.iter().any(|row| row.len() != 5) {
            return Err("three lines or more of five numbers are needed".into());
        }
        let column = |i: usize| rows.iter().map(|row| row[i]).collect::<Vec<_>>();
        Ok(Self {
            dt: rows[1][0] - rows[0][0],
            leader: column(1),
            follower: column(3),
            lengths: [rows[0][2], rows[0][4]],
        })
    }

    fn steps(&self) -> usize {
        self.leader.len() - 1
    }

    /// Speeds by central differences: followed from the first place, they lead to the recorded ones within centimetres.
    fn speeds(&self, places: &[f64]) -> Vec<f64> {
        let last = places.len() - 1;
        let between = |from: usize, to: usize| (places[to] - places[from]) / (self.dt * (to - from) as f64);
        (0..=last).map(|i| between(i.saturating_sub(1), (i + 1).min(last))).collect()
    }

    /// The scene at the beginning, with a driver of these parameters.
    fn scene(&self, driver: &[f64; 5]) -> Result<Simulator<f64, Idm<f64>>, Box<dyn Error>> {
        let [speed, time_gap, standstill_gap, acceleration, braking] = *driver;
        let rule = Idm { time_gap, standstill_gap, acceleration, braking };
        let leader_speeds = self.speeds(&self.leader);
        let knots: Vec<(f64, f64)> =
            leader_speeds.iter().enumerate().map(|(i, speed)| (self.dt * i as f64, *speed)).collect();
        let follow = Drive::Follow(Arc::new(Profile::speeds(&knots)?));
        let cruise = Drive::Cruise { speed, y: 0.0 };
        let vehicle = |x: f64, v: f64, length: f64, drive: Drive<f64>| {
            let vehicle = Vehicle::car(State::new(x, 0.0, v, 0.0), drive).with_rule(rule);
            Vehicle { extent: Extent { length, width: 1.8 }, ..vehicle }
        };
        let mut scene = Simulator::for_rules(SimulatorParams::motorway(self.dt), Road::open())?;
        scene.place(vehicle(self.leader[0], leader_speeds[0], self.lengths[0], follow))?;
        scene.place(vehicle(self.follower[0], self.speeds(&self.follower)[0], self.lengths[1], cruise))?;
        Ok(scene)
    }

    /// How much longer the gap is than recorded, after `step` steps, in m.
    fn error(&self, step: usize, scene: &Simulator<f64, Idm<f64>>) -> f64 {
        let place = |id: u64| scene.vehicle(VehicleId(id)).map_or(f64::NAN, |vehicle| vehicle.state.position.x);
        (place(0) - place(1)) - (self.leader[step] - self.follower[step])
    }

    /// Mean squared error of the gap, in m².
    fn loss(&self, driver: &[f64; 5]) -> Result<f64, Box<dyn Error>> {
        let mut scene = self.scene(driver)?;
        let mut sum = 0.0;
        for step in 1..=self.steps() {
            scene.step();
            sum += self.error(step, &scene).powi(2);
        }
        Ok(sum / self.steps() as f64)
    }

    /// The same, and its gradient with respect to the driver.
    fn loss_and_gradient(&self, driver: &[f64; 5]) -> Result<(f64, [f64; 5]), Box<dyn Error>> {
        let (follower, count) = (VehicleId(1), self.steps() as f64);
        let roll_out = RollOut::record(&mut self.scene(driver)?, self.steps());
        let mut loss = 0.0;
        let gradient = roll_out.vjp(|step, scene, gradient| {
            let error = self.error(step, scene);
            loss += error * error / count;
            gradient.of(follower)?.state.position.x -= 2.0 * error / count;
            Ok(())
        })?;
        let own = gradient.scene.get(follower).ok_or("the follower has left")?;
        Ok((loss, [own.wish.x, own.rule[0], own.rule[1], own.rule[2], own.rule[3]]))
    }

    /// Adam (Kingma and Ba 2015) on the logarithms of the parameters, within their ranges.
    fn calibrate(&self, mut driver: [f64; 5], iterations: i32) -> Result<[f64; 5], Box<dyn Error>> {
        let (mut mean, mut square) = ([0.0; 5], [0.0; 5]);
        for k in 1..=iterations {
            let (_, gradient) = self.loss_and_gradient(&driver)?;
            let rate = 0.05 * (1.0 - f64::from(k) / f64::from(iterations + 1));
            for i in 0..5 {
                let slope = gradient[i] * driver[i];
                mean[i] += 0.1 * (slope - mean[i]);
                square[i] += 0.01 * (slope * slope - square[i]);
                let (m, s) = (mean[i] / (1.0 - 0.9_f64.powi(k)), square[i] / (1.0 - 0.99_f64.powi(k)));
                driver[i] *= (-rate * m / (s.sqrt() + 1e-9)).exp();
                driver[i] = driver[i].clamp(RANGES[i][0], RANGES[i][1]);
            }
        }
        Ok(driver)
    }

    /// The best driver on a grid of `count` values a parameter, evenly spread over the logarithms of the ranges.
    fn search(&self, count: usize) -> Result<(f64, [f64; 5]), Box<dyn Error>> {
        let mut best = (f64::INFINITY, START);
        for number in 0..count.pow(5) {
            let mut rest = number;
            let driver = RANGES.map(|[least, most]| {
                let share = (rest % count) as f64 / (count - 1) as f64;
                rest /= count;
                least * (most / least).powf(share)
            });
            let loss = self.loss(&driver)?;
            if loss < best.0 {
                best = (loss, driver);
            }
        }
        Ok(best)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let text = match std::env::args().nth(1) {
        Some(file) => std::fs::read_to_string(file)?,
        None => include_str!("data/i80-pair.csv").to_owned(),
    };
    let pair = Pair::read(&text)?;

    let (before, gradient) = pair.loss_and_gradient(&START)?;
    println!("{:16} {:>12} {:>14} {:>14}", "at the start", "value", "gradient", "by differences");
    for i in 0..5 {
        let at = |by: f64| {
            let mut driver = START;
            driver[i] += by;
            pair.loss(&driver)
        };
        let difference = (at(1e-5)? - at(-1e-5)?) / 2e-5;
        println!("{:16} {:12.3} {:14.6} {:14.6}", NAMES[i], START[i], gradient[i], difference);
    }
    let began = std::time::Instant::now();
    let found = pair.calibrate(START, 400)?;
    let (after, gradient) = pair.loss_and_gradient(&found)?;
    println!("\n{:16} {:>12} {:>14}", "calibrated", "value", "gradient");
    for i in 0..5 {
        println!("{:16} {:12.3} {:14.6} {}", NAMES[i], found[i], gradient[i], UNITS[i]);
    }
    let time = began.elapsed().as_secs_f64();
    println!(
        "error of the gap, {} steps: {:.2} m, was {:.2} m; {time:.1} s",
        pair.steps(),
        after.sqrt(),
        before.sqrt()
    );
    let began = std::time::Instant::now();
    let (on_grid, driver) = pair.search(6)?;
    let time = began.elapsed().as_secs_f64();
    println!("the best of 6^5 on a grid: {:.2} m with {driver:.2?}; {time:.1} s", on_grid.sqrt());
    let (refined, _) = pair.loss_and_gradient(&pair.calibrate(driver, 400)?)?;
    println!("calibrated from there: {:.2} m", refined.sqrt());
    Ok(())
}
