//! Trains a small model on the real scenes that come with the project, predicts one window and scores the model.
//!
//! `cargo run -p gnp --example train_and_predict` takes less than a minute; the model is far too small to be good.

use gnp::{Machine, Plan, Run, RunConfig, Stage};
use gnp_data::Predictor as _;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("run");
    let config = RunConfig::embedded("smoke", &["data.max_recordings=3".parse()?])?;
    Plan::new(config, None, &out).begin(&Machine::default())?.train()?;

    let mut run = Run::open(&out, &Machine::default())?;
    let model = run.model()?.explaining(true);
    let set = run.windows()?;
    let split = run.split(&set)?;
    let window = split.test().first().and_then(|id| set.get(*id)).ok_or("there is no test window")?;
    for forecast in model.predict(&[window.observation()], 6)? {
        for mode in &forecast.modes {
            println!("{:.2}: ends at {:?} m, is at {:?} m", mode.probability, mode.path.last(), window.truth().goal());
        }
    }
    drop(set);

    run.perform(Stage::Evaluate)?;
    println!("{}", run.scores()?.summary().ok_or("there are no scores")?.terminal());
    Ok(())
}
