//! Drives a scene and says what happened: `cargo run --example drive_scene -- [SCENE.toml | motorway | lane-drop | ring]`.
use gnp_simulation::{Scene, Simulated};
use std::{error::Error, ops::ControlFlow, time::Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "ring".to_owned());
    let embedded = Scene::EMBEDDED.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned());
    let scene = Scene::parse(&embedded.map_or_else(|| std::fs::read_to_string(&name), Ok)?)?;
    for &seed in &scene.seeds {
        let started = Instant::now();
        let Simulated { recording, counts, .. } = scene.run(seed, &mut |_| ControlFlow::Continue(()))?;
        let (rows, took) = (recording.len(), started.elapsed().as_secs_f64());
        println!("{}: {counts:?}, {rows} rows in {took:.1} s", recording.meta().name);
    }
    Ok(())
}
