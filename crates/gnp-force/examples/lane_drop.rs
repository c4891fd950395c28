//! Three lanes become two: what passes, what waits, and how fast the waves in the queue run.
//!
//! `cargo run --example lane_drop -- [--svg FILE]` drives 80 minutes, in which the demand rises from 2,400 to 4,000 vehicles
//! an hour and falls again. The left lane ends at 4 km; drivers merge by MOBIL.
use gnp_force::{
    Detector, Drive, Driver, Event, Headways, Idm, Inflow, Mobil, MotorwayRule, Noise, Road, Rule, Simulator,
    SimulatorParams, State, Vehicle, VehicleId,
};
use std::{collections::BTreeMap, error::Error};

#[path = "picture/chart.rs"]
mod chart;
use chart::{Curve, Panel, draw};

const DT: f64 = 0.1;
const DURATION: f64 = 4800.0;
const DROP: f64 = 4000.0;
const END: f64 = 5500.0;
const BEFORE: f64 = 1000.0;
const AFTER: f64 = 5000.0;
/// Detectors in the queue, in m before the drop.
const QUEUE: std::ops::Range<u32> = 4..13;
const QUEUE_STEP: f64 = 200.0;
/// Time over which speeds are averaged there, in s.
const BIN: f64 = 10.0;
/// The stretch of time of the time-space diagram, in s.
const WINDOW: std::ops::Range<f64> = 2100.0..2700.0;
/// From where on it shows vehicles, in m.
const SHOWN: f64 = 2000.0;

fn main() -> Result<(), Box<dyn Error>> {
    let (svg, _) = chart::arguments()?;
    println!("rule      demand_vph  passes_vph  speed_mps  waiting_most  contacts  wave_kmh  correlation");
    for (name, rule) in [("motorway", motorway as fn(f64) -> Rule<f64>), ("idm", idm)] {
        let found = drive(rule)?;
        let (wave, correlation) = found.wave();
        println!(
            "{name:8} {:11.0} {:11.0} {:10.1} {:13} {:9} {wave:9.1} {correlation:12.2}",
            demand(DURATION / 2.0),
            found.after.flow(None, 1500.0, 3300.0).unwrap_or(0.0),
            found.queue[0].speed(None, 1500.0, 3300.0).unwrap_or(0.0),
            found.waiting_most,
            found.contacts,
        );
        if let (Some(file), "idm") = (&svg, name) {
            std::fs::write(file, draw(&[found.flows(), found.time_space()]))?;
        }
    }
    Ok(())
}

/// Vehicles an hour over all lanes that want to enter.
fn demand(time: f64) -> f64 {
    let share = 1.0 - (time / DURATION * 2.0 - 1.0).abs();
    2400.0 + 1600.0 * (1.6 * share).min(1.0)
}

fn motorway(share: f64) -> Rule<f64> {
    MotorwayRule { headway: 1.0 + 0.5 * share, ..MotorwayRule::standard() }.into()
}

fn idm(share: f64) -> Rule<f64> {
    Idm { time_gap: 1.0 + 0.5 * share, acceleration: 1.2, braking: 2.0, ..Idm::of(&Driver::motorway()) }.into()
}

fn driver(rule: fn(f64) -> Rule<f64>, lane: u64, y: f64, number: u64) -> Vehicle<f64> {
    let share = (number as f64 * 0.618_033_988_75 + 0.3 * lane as f64).fract();
    let lorry = lane == 0 && number.is_multiple_of(5);
    let speed = if lorry { 23.0 } else { 29.0 + 8.0 * share };
    let (state, drive) = (State::new(0.0, y, speed, 0.0), Drive::Cruise { speed, y });
    let vehicle = if lorry { Vehicle::truck(state, drive) } else { Vehicle::car(state, drive) };
    let noise = Some(Noise { sigma: 0.2, correlation: 5.0 });
    Vehicle { noise, lane_change: Some(Mobil::standard()), ..vehicle }.with_rule(rule((share * 7.0).fract()))
}

/// What was seen.
struct Found {
    before: Detector<f64>,
    after: Detector<f64>,
    queue: Vec<Detector<f64>>,
    tracks: BTreeMap<VehicleId, Vec<(f64, f64)>>,
    contacts: usize,
    /// Most vehicles that found no room to enter at one time.
    waiting_most: u64,
}

fn drive(rule: fn(f64) -> Rule<f64>) -> Result<Found, Box<dyn Error>> {
    let road = Road::motorway(3, 3.75)?.closing(2, DROP, END)?.ending_at(END)?;
    let mut scene = Simulator::new(SimulatorParams { seed: 1, ..SimulatorParams::motorway(DT) }, road)?;
    let mut inflows =
        (0..3).map(|lane| Inflow::new(0.0, Headways::Random, lane)).collect::<Result<Vec<Inflow<f64>>, _>>()?;
    let mut found = Found {
        before: Detector::new(BEFORE),
        after: Detector::new(AFTER),
        queue: QUEUE.map(|i| Detector::new(DROP - QUEUE_STEP * f64::from(i))).collect(),
        tracks: BTreeMap::new(),
        contacts: 0,
        waiting_most: 0,
    };
    while scene.time() < DURATION {
        let time = scene.time();
        for (lane, inflow) in inflows.iter_mut().enumerate() {
            inflow.set_flow(demand(time) / 3.0, time)?;
            let Some(y) = scene.road().lane_centre(lane) else { continue };
            scene.admit(inflow, |number| driver(rule, lane as u64, y, number))?;
        }
        found.waiting_most = found.waiting_most.max(inflows.iter().map(Inflow::waiting).sum());
        for event in scene.step() {
            found.contacts += usize::from(matches!(event, Event::Contact { .. }));
        }
        found.before.watch(&scene);
        found.after.watch(&scene);
        found.queue.iter_mut().for_each(|detector| detector.watch(&scene));
        if WINDOW.contains(&time) && ((time / DT).round() as u64).is_multiple_of(40) {
            let some = scene.vehicles().filter(|(id, vehicle)| id.0 % 8 == 0 && vehicle.state.position.x > SHOWN);
            for (id, vehicle) in some {
                found.tracks.entry(id).or_default().push((time / 60.0, vehicle.state.position.x));
            }
        }
    }
    Ok(found)
}

impl Found {
    /// Speed in km/h against the traffic at which the speeds at one place in the queue best repeat those at the next
    /// place downstream, and how well.
    fn wave(&self) -> (f64, f64) {
        let count = ((WINDOW.end - WINDOW.start) * 2.0 / BIN) as usize;
        let series: Vec<Vec<f64>> = self
            .queue
            .iter()
            .map(|detector| {
                let at = |i: usize| WINDOW.start - 300.0 + BIN * i as f64;
                let mut speed = 0.0;
                let speeds = (0..count).map(|i| {
                    speed = detector.speed(None, at(i), at(i + 1)).unwrap_or(speed);
                    speed
                });
                speeds.collect()
            })
            .collect();
        let score = |kmh: f64| {
            let lag = QUEUE_STEP / (kmh / 3.6) / BIN;
            let pairs = series.windows(2).map(|pair| correlation(&pair[0], &pair[1], lag));
            pairs.sum::<f64>() / (series.len() - 1) as f64
        };
        let tried = (16..160).map(|i| f64::from(i) * 0.25);
        tried.map(|kmh| (kmh, score(kmh))).fold((0.0, -1.0), |best, next| if next.1 > best.1 { next } else { best })
    }

    fn flows(&self) -> Panel {
        let five = |detector: &Detector<f64>| {
            let at = |i: u32| 300.0 * f64::from(i);
            let flows = (0..(DURATION / 300.0) as u32)
                .filter_map(|i| Some((at(i) / 60.0 + 2.5, detector.flow(None, at(i), at(i + 1))?)));
            flows.collect::<Vec<_>>()
        };
        let wanted = (0..=80).map(|minute| (f64::from(minute), demand(60.0 * f64::from(minute)))).collect();
        let curves = vec![
            Curve::new("demand", wanted),
            Curve::new("at 1 km", five(&self.before)),
            Curve::new("at 5 km", five(&self.after)),
        ];
        Panel { title: "Three lanes to two at 4 km: flow", x: "time, min", y: "vehicles an hour", curves }
    }

    fn time_space(&self) -> Panel {
        let curve =
            |points: &Vec<_>| Curve { name: String::new(), points: points.clone(), colour: Some("#0b6e99".into()) };
        let curves = self.tracks.values().map(curve).collect();
        Panel { title: "Every eighth vehicle, on all lanes", x: "time, min", y: "x, m", curves }
    }
}

/// Correlation of `ahead(t)` and `behind(t + lag)`, the lag in steps.
fn correlation(ahead: &[f64], behind: &[f64], lag: f64) -> f64 {
    let whole = lag.floor();
    let later = |i: usize| {
        let at = i + whole as usize;
        Some(behind.get(at)? * (1.0 - lag + whole) + behind.get(at + 1)? * (lag - whole))
    };
    let pairs: Vec<(f64, f64)> = (0..ahead.len()).filter_map(|i| Some((ahead[i], later(i)?))).collect();
    let count = pairs.len() as f64;
    let mean = pairs.iter().fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0 / count, sum.1 + pair.1 / count));
    let (mut both, mut one, mut other) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        let (a, b) = (a - mean.0, b - mean.1);
        both += a * b;
        one += a * a;
        other += b * b;
    }
    if one * other > 0.0 { both / (one * other).sqrt() } else { 0.0 }
}
