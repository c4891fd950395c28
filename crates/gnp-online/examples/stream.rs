//! Simulated tracks at 25 frames a second, predicted as they come, with what each frame takes.
//!
//! `cargo run --release --package gnp-online --example stream [MODEL]`; MODEL is a model folder, else the model that comes
//! with the program is taken.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use gnp_data::LaneMarking;
use gnp_model::{Device, Gnp};
use gnp_online::{Stream, StreamConfig, Tracked};

fn main() -> Result<(), Box<dyn Error>> {
    let gnp = match std::env::args().nth(1) {
        Some(folder) => Gnp::open(Path::new(&folder), &Device::Cpu)?,
        None => gnp_pretrained::ngsim()?,
    };
    let lines = [0., 3.7, 7.4, 11.1].map(|y| LaneMarking::new(y, y == 0. || y == 11.1));
    let mut stream = Stream::new(&gnp, lines.to_vec(), StreamConfig::default())?;
    for number in 0..100 {
        let time_s = f64::from(number) / 25.;
        // Twelve vehicles in three lanes, the left one faster.
        let track = |i: u8| {
            let lane = f64::from(i % 3);
            Tracked::new(i.into(), [15. * f64::from(i) + (14. + 3. * lane) * time_s, 1.85 + 3.7 * lane])
        };
        let tracks: Vec<Tracked> = (0..12).map(track).collect();
        let before = Instant::now();
        let frame = stream.push(time_s, &tracks)?;
        let took_ms = before.elapsed().as_secs_f64() * 1e3;
        if let Some(vehicle) = frame.get(5).filter(|_| number % 20 == 19) {
            let ahead = vehicle.path(0).last().map_or(0., |end| end[0] - vehicle.position()[0]);
            let (validity, p) = (vehicle.validity(), vehicle.probabilities().first().unwrap_or(&0.));
            println!("{time_s:.2} s, {took_ms:.2} ms: vehicle 5 {ahead:.1} m ahead in 5 s with {p:.2} ({validity:?})");
        }
    }
    Ok(())
}
