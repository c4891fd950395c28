//! A stream gives what the batch predictor gives for the same data.

use std::path::Path;

use gnp_data::{
    Dataset, Expectation, Leader, LiveScene, Observation, Past, Predictor, Recording, Sample, Snapshot, VelocitySource,
    WindowConfig, WindowShape, discover, read,
};
use gnp_online::{Stream, StreamConfig, Tracked, Validity};

use crate::model::model;

fn embedded(folder: &str, dataset: Dataset) -> Recording {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(folder);
    let source = discover(&folder, dataset).unwrap().swap_remove(0);
    read(&source, &Expectation { dataset, rate_hz: None }).unwrap().remove(0).0
}

/// One carriageway of `recording` as the batch predictor gets a program's tracks: lanes by the lines.
fn batch(recording: &Recording, road: u16) -> LiveScene {
    let meta = recording.meta();
    let mut scene = LiveScene::new(meta.rate_hz, recording.roads()[usize::from(road)].lines.clone()).unwrap();
    for track in recording.tracks().iter().filter(|track| track.road == road) {
        let samples: Vec<Sample> = track
            .rows
            .clone()
            .zip(track.first_frame..)
            .map(|(row, frame)| {
                let state = recording.state(row);
                let sample = Sample::new(f64::from(frame) / meta.rate_hz, [state.x, state.y]);
                let recorded = meta.velocities == VelocitySource::Recorded;
                if recorded { sample.with_velocity([state.vx, state.vy]) } else { sample }
            })
            .collect();
        scene.push(track.vehicle, [track.length, track.width], track.class, &samples).unwrap();
    }
    scene
}

/// The vehicles that a model looks at: those beside, and the columns ahead of the target and of them.
fn looked_at(observation: &Observation<'_>) -> Vec<u32> {
    let beside = observation.neighbours().0.into_iter().flatten();
    let columns = beside.clone().flat_map(|it| std::iter::successors(it.leader(), Leader::leader).take(8));
    let ahead = observation.column().take(8).chain(columns).map(|it| it.vehicle());
    ahead.chain(beside.map(|it| it.vehicle())).collect()
}

/// Pushes `count` frames and compares every `nth` with what the batch predictor says of them.
fn a_stream_is_the_batch_predictor(recording: &Recording, road: u16, shape: WindowShape, count: u32, nth: u32) {
    let scene = batch(recording, road);
    let whole = scene.recording().unwrap();
    let gnp = model(shape);
    let config = StreamConfig { k: 3, coast_s: 0., ..StreamConfig::default() };
    let mut stream = Stream::new(&gnp, whole.roads()[0].lines.clone(), config).unwrap();
    let (mut full, mut filled, mut cut) = (0, 0, 0);
    for number in 0..count {
        let present = whole.present(number).iter().map(|track| &whole.tracks()[*track as usize]);
        let tracks: Vec<Tracked> = present
            .map(|track| {
                let state = whole.state(track.row_at(number).unwrap());
                let it = Tracked::new(track.vehicle.into(), [state.x, state.y].map(f64::from))
                    .with_size([track.length, track.width])
                    .with_class(track.class);
                let recorded = whole.meta().velocities == VelocitySource::Recorded;
                if recorded { it.with_velocity([state.vx, state.vy]) } else { it }
            })
            .collect();
        let frame = stream.push(f64::from(number) / whole.meta().rate_hz, &tracks).unwrap();
        assert!(frame.problems().is_empty());
        if number % nth != 0 {
            continue;
        }
        // The same windows in one batch, cut out of the recording where nobody's past is short whom the target looks at.
        let snapshot = Snapshot::of(whole, number, shape).unwrap();
        let known: Vec<u32> = snapshot.vehicles().filter(|it| it.past() == Past::Full).map(|it| it.vehicle()).collect();
        let observations: Vec<Observation<'_>> = snapshot
            .vehicles()
            .filter_map(|it| {
                let seen = it.observation()?;
                let is_cut = it.past() == Past::Full && looked_at(&seen).iter().all(|vehicle| known.contains(vehicle));
                if !is_cut {
                    return Some(seen);
                }
                cut += 1;
                let mut tracks = whole.tracks().iter().enumerate();
                let (track, row) = tracks.find_map(|(index, track)| {
                    let row = track.row_at(number).filter(|_| track.vehicle == it.vehicle())?;
                    Some((index, row))
                })?;
                Some(Observation::new(whole, shape, track, row).unwrap())
            })
            .collect();
        let forecasts = gnp.predict(&observations, 3).unwrap();
        assert_eq!(frame.vehicles().filter(|vehicle| vehicle.window().is_some()).count(), forecasts.len());
        for (observation, forecast) in observations.iter().zip(&forecasts) {
            let vehicle = frame.get(observation.vehicle().into()).unwrap();
            match vehicle.validity() {
                Validity::Full => full += 1,
                Validity::Filled { .. } => filled += 1,
                other => panic!("{number}, {observation:?}: {other:?}"),
            }
            for (k, mode) in forecast.modes.iter().enumerate() {
                assert!((vehicle.probabilities()[k] - mode.probability).abs() < 1e-5);
                let own = vehicle.path(k).iter().map(|at| [0, 1].map(|i| at[i] - vehicle.position()[i]));
                for (a, b) in own.zip(&mode.path) {
                    let miss = (a[0] - f64::from(b[0])).hypot(a[1] - f64::from(b[1]));
                    // Within the rounding of f32.
                    let size = 1. + f64::from(b[0].hypot(b[1]));
                    assert!(miss < 1e-5 * size, "{number}, {observation:?}, {k}: {a:?} {b:?}");
                }
                let why = mode.explanation.as_ref().unwrap();
                for (term, of_batch) in frame.terms().iter().zip(&why.terms) {
                    assert_eq!(term.term.name, of_batch.term().name);
                }
                for (term, of_batch) in why.terms.iter().enumerate() {
                    for (a, b) in vehicle.force(term, k).iter().zip(of_batch.totals()) {
                        let size = 1. + b[0].hypot(b[1]);
                        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 3e-5 * size, "{a:?} {b:?}");
                    }
                }
            }
        }
    }
    assert!(full > 100 && filled > 20 && cut > 50, "{full} {filled} {cut}");
}

#[test]
fn a_stream_is_the_batch_predictor_ngsim() {
    let recording = embedded("ngsim", Dataset::NGSIM);
    a_stream_is_the_batch_predictor(&recording, 0, crate::SHAPE, 200, 5);
}

/// Velocities are recorded, and the model sees every fifth frame.
#[test]
fn a_stream_is_the_batch_predictor_highd() {
    let recording = embedded("highd", Dataset::HIGHD);
    let site_stride_s = Default::default();
    let config = WindowConfig { observed_s: 3., predicted_s: 5., rate_hz: 5., stride_s: 1., site_stride_s };
    let shape = config.shape_for(25.).unwrap();
    assert_eq!(shape.step, 5);
    a_stream_is_the_batch_predictor(&recording, 1, shape, 260, 17);
}
