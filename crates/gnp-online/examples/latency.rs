//! What a frame of 20 and of 100 vehicles takes on one core: p50, p99 and the longest of a thousand frames at 10 a second.
//!
//! `cargo run --release --package gnp-online --example latency [MODEL] [--explain] [--frames N]`; MODEL is a model folder,
//! else the model that comes with the program is taken. One line of JSON a size.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use gnp_data::LaneMarking;
use gnp_model::{Device, Gnp};
use gnp_online::{Stream, StreamConfig, Tracked};

const LANES: u32 = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut gnp, mut explain, mut frames) = (None, false, 1000u32);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--explain" => explain = true,
            "--frames" => frames = arguments.next().ok_or("--frames needs a number")?.parse()?,
            folder => gnp = Some(Gnp::open(Path::new(folder), &Device::Cpu)?),
        }
    }
    let gnp = match gnp {
        Some(gnp) => gnp,
        None => gnp_pretrained::ngsim()?,
    };
    let gnp = gnp.with_threads(1)?.explaining(explain);
    for vehicles in [20, 100] {
        let (mut whole, mut own) = (Vec::new(), Vec::new());
        measure(&gnp, vehicles, frames, |total_ms, own_ms| {
            whole.push(total_ms);
            own.push(own_ms);
        })?;
        let [[p50, p99, most], [own_p50, own_p99, own_most]] = [whole, own].map(quantiles);
        println!(
            "{{\"vehicles\": {vehicles}, \"k\": 6, \"explaining\": {explain}, \"frames\": {frames}, \
             \"p50_ms\": {p50:.3}, \"p99_ms\": {p99:.3}, \"longest_ms\": {most:.3}, \
             \"without_model_p50_ms\": {own_p50:.3}, \"without_model_p99_ms\": {own_p99:.3}, \
             \"without_model_longest_ms\": {own_most:.3}}}"
        );
    }
    Ok(())
}

/// Drives `vehicles` in four lanes with waves of speed; some change lanes, and each frame comes up to 20 ms late.
fn measure(gnp: &Gnp, vehicles: u32, frames: u32, mut took: impl FnMut(f64, f64)) -> Result<(), Box<dyn Error>> {
    let lines: Vec<LaneMarking> = (0..=LANES).map(|i| LaneMarking::new(3.7 * i as f32, i == 0 || i == LANES)).collect();
    let mut stream = Stream::new(gnp, lines, StreamConfig::default())?;
    let mut tracks = Vec::new();
    let mut late = 1u32;
    for number in 0..frames + 50 {
        late = late.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let time_s = f64::from(number) / 10. + f64::from(late >> 16) / 65_536. * 0.02;
        tracks.clear();
        tracks.extend((0..vehicles).map(|i| {
            let (place, lane) = (f64::from(i / LANES) * 28., f64::from(i % LANES));
            let wave = 4. * (0.3 * time_s + f64::from(i)).sin();
            let aside = if i % 7 == 0 { 1.5 * (0.2 * time_s).sin() } else { 0. };
            Tracked::new(i.into(), [place + 22. * time_s + wave, 1.85 + 3.7 * lane + aside])
        }));
        let before = Instant::now();
        let frame = stream.push(time_s, &tracks)?;
        let total_ms = before.elapsed().as_secs_f64() * 1e3;
        let own_ms = total_ms - frame.model_s() * 1e3;
        if number >= 50 {
            took(total_ms, own_ms);
        }
    }
    Ok(())
}

/// Median, 99th percentile and maximum.
fn quantiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * (values.len().max(1) - 1) as f64).round() as usize);
    [0.5, 0.99, 1.].map(|share| at(share).copied().unwrap_or_default())
}
