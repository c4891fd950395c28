//! Windows of an embedded recording: cutting them, and turning a batch into the inputs of both networks.

#![allow(missing_docs)] // criterion's macros write functions without

use std::collections::BTreeMap;
use std::error::Error;
use std::hint::black_box;
use std::path::Path;

use candle_core::{DType, Device, Tensor};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gnp_baselines::{Drivers, PlatoonRule};
use gnp_data::{Dataset, Expectation, Recording, WindowConfig, WindowSet, discover, read};
use gnp_model::{
    AugmentedView, FeatureConfig, Features, NeighbourFuture, ReferencePath, Representation, SeenNeighbours,
};

const BATCH: usize = 64;

fn recordings(dataset: Dataset, folder: &str, rate_hz: f64) -> Result<Vec<Recording>, Box<dyn Error>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let source = discover(&fixtures, dataset)?.swap_remove(0);
    let expect = Expectation { dataset, rate_hz: Some(rate_hz) };
    Ok(read(&source, &expect)?.into_iter().map(|(recording, _)| recording).collect())
}

fn windows(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let mut group = criterion.benchmark_group("windows");
    for (name, dataset, rate_hz) in [("ngsim", Dataset::NGSIM, 10.), ("highd", Dataset::HIGHD, 25.)] {
        let recordings = recordings(dataset, name, rate_hz)?;
        let every_frame = WindowConfig {
            observed_s: 3.,
            predicted_s: 5.,
            rate_hz,
            stride_s: 1. / rate_hz,
            site_stride_s: BTreeMap::new(),
        };
        let (set, _) = WindowSet::cut(&recordings, &every_frame)?;
        let (count, shape) = (set.len(), set.shape());
        let frames = format!("{}_{}_frames", shape.t_obs, shape.t_pred);
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(format!("cut/{name}/{count}_windows/{frames}"), |bencher| {
            bencher.iter(|| black_box(WindowSet::cut(&recordings, &every_frame)));
        });

        let every = (count / BATCH).max(1);
        let seen: Vec<AugmentedView<'_>> =
            set.iter().step_by(every).take(BATCH).map(|window| AugmentedView::recorded(window.observation())).collect();
        let goals = Tensor::zeros((seen.len(), 1, 2), DType::F32, &Device::Cpu)?;
        group.throughput(Throughput::Elements(seen.len() as u64));
        let platoon = PlatoonRule::of_drivers(Drivers::TYPICAL)?;
        for (representation, reference) in [
            (Representation::Position, ReferencePath::ConstantVelocity),
            (Representation::Deviation, ReferencePath::ConstantVelocity),
            (Representation::Deviation, ReferencePath::Platoon),
        ] {
            let config = FeatureConfig {
                representation,
                reference,
                length_scale: 5.,
                velocity_window_s: 0.5,
                history_block_s: 0.,
                vehicles_ahead: 1,
                neighbours: SeenNeighbours::All,
                car_following_features: false,
            };
            let features = Features::fit(&config, shape, Some(&platoon), seen.iter().map(|seen| *seen.observation()))?;
            let id = format!("features/{name}/{representation:?}_from_{reference:?}/{}_windows/{frames}", seen.len());
            group.bench_function(id.to_lowercase(), |bencher| {
                bencher.iter(|| {
                    let situations: Result<Vec<_>, _> = seen.iter().map(|seen| features.situation(*seen)).collect();
                    situations.is_ok_and(|it| {
                        let straight = NeighbourFuture::ConstantVelocity;
                        black_box(features.goal_inputs(&it, &Device::Cpu)).is_ok()
                            && black_box(features.scene(&it, goals.clone(), straight, None, &Device::Cpu)).is_ok()
                    })
                });
            });
        }
    }
    group.finish();
    Ok(())
}

fn run(criterion: &mut Criterion) {
    if let Err(error) = windows(criterion) {
        eprintln!("{error}");
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
