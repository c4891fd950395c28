//! Whole runs: training on a GPU, and what a trained model predicts there.

use std::path::Path;
use std::sync::Arc;

use candle_core::Device;
use gnp::{Machine, Plan, Run, RunConfig, Silent, Stop};
use gnp_data::{Forecast, Observation, Predictor as _};
use gnp_model::{Gnp, Trust};
use tempfile::TempDir;

use crate::{close, gpu};

fn trained(device: &Device, more: &[&str], out: &Path) -> Run {
    let settings = ["data.max_recordings=3", "goal.epochs=1", "attraction.epochs=1", "repulsion.epochs=1"];
    let set: Vec<_> = settings.iter().chain(more).map(|text| text.parse().unwrap()).collect();
    let config = RunConfig::embedded("smoke", &set).unwrap();
    let machine = Machine::new(device.clone(), Arc::new(Silent), Stop::new());
    let mut run = Plan::new(config, None, out).begin(&machine).unwrap();
    run.train().unwrap();
    run
}

/// The forecasts of `run` for a few windows, made on `device`.
fn predicted(run: &Run, device: &Device, windows: usize, k: usize) -> Vec<Forecast> {
    let set = run.windows().unwrap();
    let seen: Vec<Observation<'_>> = set.iter().take(windows).map(|window| window.observation()).collect();
    let neighbours = run.config().predict.neighbours.without_future();
    let gnp = Gnp::load(run.path(), neighbours, device).unwrap();
    gnp.trusting(Trust::Share(1.)).unwrap().predict(&seen, k).unwrap()
}

fn points(forecasts: &[Forecast]) -> Vec<f32> {
    let modes = forecasts.iter().flat_map(|forecast| &forecast.modes);
    modes.flat_map(|mode| mode.path.iter().flatten().copied().chain([mode.probability])).collect()
}

#[test]
fn a_model_predicts_on_a_gpu_what_it_predicts_on_the_cpu() {
    let out = TempDir::new().unwrap();
    let run = trained(&Device::Cpu, &[], &out.path().join("run"));
    // All modes: which few are chosen may hang on the last bit.
    let (found, wanted) = (predicted(&run, gpu(), 40, 1000), predicted(&run, &Device::Cpu, 40, 1000));
    let sorted = |forecasts: Vec<Forecast>| -> Vec<Forecast> {
        let by_end = |mut forecast: Forecast| {
            let end = |path: &[[f32; 2]]| path.last().map_or(0., |end| end[0] + 0.3 * end[1]);
            forecast.modes.sort_by(|a, b| end(&a.path).total_cmp(&end(&b.path)));
            forecast
        };
        forecasts.into_iter().map(by_end).collect()
    };
    close("forecasts", &points(&sorted(found)), &points(&sorted(wanted)), 1e-4);
}

/// From several threads, as faithfulness asks.
#[test]
fn threads_that_share_a_model_get_what_one_gets() {
    let out = TempDir::new().unwrap();
    let run = trained(&Device::Cpu, &[], &out.path().join("run"));
    let wanted = predicted(&run, gpu(), 12, 3);
    let set = run.windows().unwrap();
    let seen: Vec<Observation<'_>> = set.iter().take(12).map(|window| window.observation()).collect();
    let gnp = Gnp::load(run.path(), run.config().predict.neighbours.without_future(), gpu()).unwrap();
    let gnp = gnp.trusting(Trust::Share(1.)).unwrap();
    for _ in 0..3 {
        std::thread::scope(|scope| {
            let ask = || gnp.predict(&seen, 3).unwrap();
            let asked: Vec<_> = (0..4).map(|_| scope.spawn(ask)).collect();
            for answer in asked {
                assert_eq!(points(&answer.join().unwrap()), points(&wanted));
            }
        });
    }
}

#[test]
fn training_gives_the_same_bits_twice_and_nearly_the_weights_of_the_cpu() {
    let out = TempDir::new().unwrap();
    // Masks of dropout differ between devices.
    let run = |device: &Device, dropout: &str, name: &str| {
        let run = trained(device, &[&format!("goal.dropout={dropout}")], &out.path().join(name));
        let read = |part: &str| std::fs::read(run.path().join(format!("{part}.safetensors"))).unwrap();
        (["goal", "attraction", "repulsion"].map(read), predicted(&run, &Device::Cpu, 30, 1))
    };
    let (first, second) = (run(gpu(), "0.1", "first"), run(gpu(), "0.1", "second"));
    assert!(first.0 == second.0, "the same seed gave other weights");
    let (found, wanted) = (run(gpu(), "0.0", "gpu").1, run(&Device::Cpu, "0.0", "cpu").1);
    // Adam divides by the size of a gradient, so that rounding alone moves a weight by its learning rate.
    close("forecasts after training", &points(&found), &points(&wanted), 2e-2);
}
