//! How often simulated drivers change lanes, and the threshold at which they do so as often as recorded.
use super::{distribution::DriverDistribution, error::DriverError};
use gnp_data::Recording;
use gnp_force::{Event, Mobil, Road, Simulator, SimulatorParams, State};
use rayon::prelude::*;

/// Vehicles of a lane, whatever the density.
const PER_LANE: usize = 40;
/// Step, time before anything is counted, and time after it, s.
const TIMES_S: [f64; 3] = [0.2, 60., 180.];
/// Scenes that a rate is the mean of.
const SEEDS: u64 = 4;
/// Greatest threshold, m/s², and how often the range is halved.
const MOST: f64 = 3.;
const HALVINGS: usize = 8;
/// Width of a lane, m.
const WIDTH_M: f64 = 3.7;

/// Traffic as recorded, on the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mean {
    /// Lanes of a carriageway.
    lanes: usize,
    /// Way from one vehicle to the next in a lane, m.
    spacing: f64,
    /// m/s.
    speed: f64,
}

impl Mean {
    /// Of the carriageways with two lanes or more; none where there is none.
    pub(super) fn of(recordings: &[Recording]) -> Option<Self> {
        let (mut lane_metres, mut rows, mut lanes, mut speed) = (0., 0., 0., 0.);
        for recording in recordings {
            let columns = recording.columns();
            for (number, road) in recording.roads().iter().enumerate().filter(|(_, road)| road.lines.len() > 2) {
                let here = || recording.tracks().iter().filter(|track| usize::from(track.road) == number);
                let (mut ends, mut frames) = ([f64::INFINITY, f64::NEG_INFINITY], [u32::MAX, 0]);
                let mut count = 0.;
                for track in here() {
                    frames = [frames[0].min(track.first_frame), frames[1].max(track.last_frame())];
                    for row in track.rows.clone() {
                        let x = f64::from(columns.x[row]);
                        ends = [ends[0].min(x), ends[1].max(x)];
                        speed += f64::from(columns.vx[row]);
                    }
                    count += track.rows.len() as f64;
                }
                if count > 0. && ends[1] > ends[0] {
                    let here = (road.lines.len() - 1) as f64;
                    lane_metres += f64::from(frames[1] - frames[0] + 1) * (ends[1] - ends[0]) * here;
                    rows += count;
                    lanes += count * here;
                }
            }
        }
        let mean = || Self { lanes: (lanes / rows).round() as usize, spacing: lane_metres / rows, speed: speed / rows };
        (rows > 0.).then(mean)
    }
}

/// Changes per vehicle kilometre of drivers with a rule, on a ring with the recorded density.
pub(super) fn simulated_rate(drivers: &DriverDistribution, mobil: Mobil<f64>, mean: &Mean) -> Result<f64, DriverError> {
    let runs = (0..SEEDS).into_par_iter().map(|seed| run(drivers, mobil, mean, seed));
    let sums = runs.collect::<Result<Vec<_>, _>>()?.into_iter().fold([0.; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    Ok(sums[0] / (sums[1] / 1000.).max(1e-9))
}

/// Changes, and metres driven.
fn run(drivers: &DriverDistribution, mobil: Mobil<f64>, mean: &Mean, seed: u64) -> Result<[f64; 2], DriverError> {
    let [dt, before, after] = TIMES_S;
    let road = Road::motorway(mean.lanes, WIDTH_M)?.ring(mean.spacing * PER_LANE as f64)?;
    let mut scene = Simulator::new(SimulatorParams { seed, ..SimulatorParams::motorway(dt) }, road)?;
    for i in 0..PER_LANE * mean.lanes {
        let (lane, place) = (i % mean.lanes, i / mean.lanes);
        // The lanes begin a part of the spacing apart.
        let x = mean.spacing * (place as f64 + lane as f64 / mean.lanes as f64);
        let y = scene.road().lane_centre(lane).unwrap_or_default();
        let mut vehicle = drivers.vehicle(seed, i as u64, State::new(x, y, mean.speed.max(0.), 0.));
        vehicle.lane_change = Some(mobil);
        scene.place(vehicle)?;
    }
    let mut sums = [0.; 2];
    for step in 0..((before + after) / dt) as usize {
        let changes = scene.step().iter().filter(|event| matches!(event, Event::LaneChange { .. })).count();
        if step as f64 * dt >= before {
            sums[0] += changes as f64;
            sums[1] += scene.vehicles().map(|(_, vehicle)| vehicle.state.velocity.x * dt).sum::<f64>();
        }
    }
    Ok(sums)
}

/// The threshold at which drivers change lanes at a rate, per vehicle kilometre, and the rate at it; by halving, so that it
/// is 0 or 3 m/s² where none is right.
pub(super) fn threshold_for(drivers: &DriverDistribution, rate: f64, mean: &Mean) -> Result<(f64, f64), DriverError> {
    let at = |threshold| simulated_rate(drivers, Mobil { threshold, ..drivers.lane_changes.mobil }, mean);
    let [mut low, mut high] = [0., MOST];
    if at(low)? <= rate {
        return Ok((low, at(low)?));
    }
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.;
        if at(middle)? > rate { low = middle } else { high = middle }
    }
    Ok((high, at(high)?))
}
