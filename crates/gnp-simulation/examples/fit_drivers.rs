//! Fits the drivers of the recordings of a run, prints what was found, and writes them as a distribution.
//!
//! `gnp ingest` reads NGSIM or highD and keeps the recordings in its run folder. The files of
//! `crates/gnp-simulation/drivers` were made by
//!
//! ```text
//! gnp ingest --dataset ngsim --data-dir fixtures/ngsim --out runs/ngsim
//! gnp ingest --dataset highd --data-dir fixtures/highd --out runs/highd
//! cargo run -p gnp-simulation --example fit_drivers -- runs/ngsim us-101 shared > us-101.toml
//! cargo run -p gnp-simulation --example fit_drivers -- runs/ngsim i-80 > i-80.toml
//! cargo run -p gnp-simulation --example fit_drivers -- runs/highd highd-simulated > highd-simulated.toml
//! ```
use gnp_data::{Recording, VehicleClass};
use gnp_simulation::drivers::{DriverDistribution, FitConfig, Spread, fit_drivers};
use std::{error::Error, fs, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [run, site, rest @ ..] = &arguments[..] else {
        return Err("give a run folder, a site, and `shared` if the same vehicles are in several recordings".into());
    };
    let files = fs::read_dir(Path::new(run).join("recordings"))?;
    let mut files = files.map(|file| Ok(file?.path())).collect::<Result<Vec<_>, std::io::Error>>()?;
    files.sort();
    let mut recordings = files.iter().map(|file| Recording::load(file)).collect::<Result<Vec<_>, _>>()?;
    // Simulated recordings make one site.
    recordings.retain(|it| it.meta().site == *site || it.meta().simulated);
    let config = FitConfig { shared_vehicles: rest.iter().any(|it| it == "shared"), ..FitConfig::default() };
    let traffic = fit_drivers(&recordings, &config)?;
    let drivers = DriverDistribution::fit(site, &recordings, &config)?;
    eprintln!("{site}: {} recordings, left out {:?}", recordings.len(), traffic.left_out());
    eprintln!("{:?}\n{:?}\n{} drive freely", traffic.errors(), traffic.noise(), traffic.free().len());
    for class in [None, Some(VehicleClass::Car), Some(VehicleClass::Truck)] {
        let Some(of) = drivers.spreads(class) else { continue };
        let text = |Spread { median, spread }: Spread| format!("{median:.2} ±{:.0} %", spread * 100.);
        let numbers = [of.desired_speed, of.time_gap, of.standstill_gap, of.acceleration, of.braking].map(text);
        eprintln!("{class:?}, {} drivers: v0, T, s0, a, b = {}", of.drivers, numbers.join(", "));
    }
    let lane_changes = drivers.lane_changes();
    eprintln!("{lane_changes:?}\n{:.2} changes per vehicle km", lane_changes.per_vehicle_km());
    print!("{}", drivers.to_toml()?);
    Ok(())
}
