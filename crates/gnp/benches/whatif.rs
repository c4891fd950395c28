//! Answers to "what if" on the caller's thread: a real moment with a vehicle moved and another one removed, by the model
//! that comes with the program, 6 futures a vehicle. `moment`: from the recording to its vehicles with their pasts;
//! `changed`: the changes, as far as forecasts need them; `forecasts`: of 60 vehicles; `explain`: one vehicle, as it is and
//! changed.
//!
//! `RAYON_NUM_THREADS=1` keeps `explain` on one core.

#![allow(missing_docs)] // criterion's macros write functions without

use std::error::Error;
use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use gnp::{Change, Machine, Model, Moment, ScenePredictor, Workspace};
use gnp_data::{Dataset, Expectation, SceneEdit, discover, read};

const VEHICLES: usize = 60;
const FUTURES: usize = 6;

fn what_if(criterion: &mut Criterion) -> Result<(), Box<dyn Error>> {
    let mut group = criterion.benchmark_group("whatif");
    group.sample_size(20);
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/ngsim");
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: None };
    let mut recordings = Vec::new();
    for source in discover(&fixtures, Dataset::NGSIM)? {
        recordings.extend(read(&source, &expect)?.into_iter().map(|(recording, _)| recording));
    }
    let predictor = ScenePredictor::new(&Model::open(None, &Machine::default())?);
    let shape = predictor.gnp().shape();
    // The fullest moment.
    let frames = recordings.iter().enumerate().flat_map(|(i, it)| {
        let last = it.tracks().iter().map(|track| track.last_frame()).max().unwrap_or(0);
        (0..=last).step_by(10).map(move |frame| (i, frame))
    });
    let (i, frame) = frames.max_by_key(|(i, frame)| recordings[*i].present(*frame).len()).ok_or("no moment")?;
    let recording = &recordings[i];
    let moment = Moment::at_frame(recording, frame, shape)?;
    let there = moment.snapshot().vehicles().filter_map(|it| it.observation());
    let observed: Vec<_> = there.take(VEHICLES).collect();
    let vehicles: Vec<u32> = observed.iter().map(|seen| seen.vehicle()).collect();
    let mut followers = observed.iter().filter_map(|seen| Some((seen.vehicle(), seen.leader()?.recorded()?.vehicle())));
    let (follower, leader) = followers.next_back().ok_or("nobody follows anybody")?;
    let gone = vehicles.iter().copied().find(|it| ![follower, leader].contains(it)).ok_or("no third vehicle")?;
    let changes = [
        Change::Scene(SceneEdit::Move { vehicle: leader, by: [-3., 0.5] }),
        Change::Scene(SceneEdit::Remove { vehicle: gone }),
    ];

    let name = format!("{}_vehicles", vehicles.len());
    group.bench_function(format!("moment/{}_there", moment.snapshot().vehicles().len()), |bencher| {
        bencher.iter(|| black_box(Moment::at_frame(recording, frame, shape)).is_ok());
    });
    group.bench_function("changed", |bencher| {
        bencher.iter(|| moment.changed(&changes).map(|changed| changed.now().vehicles().len()).is_ok());
    });
    let mut workspace = Workspace::new();
    group.bench_function(format!("forecasts/{name}"), |bencher| {
        bencher.iter(|| {
            let changed = moment.changed(&changes);
            changed.is_ok_and(|it| predictor.forecasts(&it, Some(&vehicles), FUTURES, &mut workspace).is_ok())
        });
    });
    group.bench_function("explain", |bencher| {
        bencher.iter(|| predictor.explain(&moment, follower, &changes, FUTURES).is_ok());
    });
    group.finish();
    Ok(())
}

fn run(criterion: &mut Criterion) {
    if let Err(error) = what_if(criterion) {
        eprintln!("{error}");
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
