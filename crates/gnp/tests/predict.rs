//! Forecasts of tracks: equal to the model's, the same bytes however the work is shared out or interrupted.

#![allow(clippy::unwrap_used, clippy::panic, clippy::result_large_err)] // also outside the test functions

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use gnp::{
    Asked, At, Machine, Precision, PredictRequest, Predicted, Progress, Stop, TracksQuestion, Work, forecasts, predict,
};
use gnp_data::{
    Dataset, Expectation, Forecast, Predictor as _, Recording, Snapshot, TrackState, WindowKey, discover, read,
};
use gnp_eval::{Detail, read_predictions};
use gnp_model::Device;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use tempfile::TempDir;

const SCENES: [&str; 3] = ["us101-13_1", "us101-24_1", "us101-26_1"];

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures")
}

/// A folder of real scenes.
fn scenes(place: &Path, names: &[&str]) -> PathBuf {
    let folder = place.join("tracks");
    fs::create_dir(&folder).unwrap();
    for name in names {
        let file = format!("{name}.csv.gz");
        fs::copy(fixtures().join("ngsim").join(&file), folder.join(&file)).unwrap();
    }
    folder
}

fn recording(path: &Path) -> Recording {
    let source = discover(path, Dataset::NGSIM).unwrap().remove(0);
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: None };
    read(&source, &expect).unwrap().remove(0).0
}

fn every(seconds: f64, input: &Path, output: &Path) -> PredictRequest {
    PredictRequest { at: At::Every(seconds), ..PredictRequest::new(input, output) }
}

/// Rows of a file of forecasts, each by the names of its columns.
fn rows(path: &Path) -> Vec<BTreeMap<String, Field>> {
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let rows = reader.get_row_iter(None).unwrap();
    rows.map(|row| row.unwrap().get_column_iter().map(|(name, value)| (name.clone(), value.clone())).collect())
        .collect()
}

fn number(field: &Field) -> f64 {
    match field {
        Field::Double(value) => *value,
        Field::Float(value) => f64::from(*value),
        Field::UInt(value) => f64::from(*value),
        other => panic!("{other}"),
    }
}

#[test]
fn forecasts_are_those_of_the_model_in_the_coordinates_of_the_file() {
    let place = TempDir::new().unwrap();
    let (input, out) = (scenes(place.path(), &SCENES[1..2]), place.path().join("forecasts.parquet"));
    let done = predict(&PredictRequest::new(&input, &out), &Machine::default()).unwrap();
    let recording = recording(&input);
    let last = recording.tracks().iter().map(|track| track.last_frame()).max().unwrap();
    let gnp = gnp_pretrained::ngsim().unwrap().explaining(true);
    let snapshot = Snapshot::of(&recording, last, gnp.shape()).unwrap();
    let seen: Vec<_> = snapshot.vehicles().filter_map(|vehicle| vehicle.observation()).collect();
    let expected = gnp.predict(&seen, 6).unwrap();
    assert_eq!(done.counts.forecasts, expected.len() as u64);

    let read = read_predictions(&out, Detail::Explanations).unwrap();
    assert_eq!(read.len(), expected.len());
    for (seen, expected) in seen.iter().zip(&expected) {
        let found = read.get(&WindowKey { t0: last, ..seen.key() }).unwrap();
        let paths = |forecast: &Forecast| -> Vec<_> {
            forecast.modes.iter().map(|mode| (mode.probability, mode.path.clone())).collect()
        };
        assert_eq!(paths(&found.forecast), paths(expected));
        let goal = |forecast: &Forecast| forecast.modes[0].explanation.as_ref().map(|why| why.goal);
        assert_eq!(goal(&found.forecast), goal(expected));
    }
    let rows = rows(&out);
    assert_eq!(rows.len(), 6 * 50 * expected.len());
    let origins: BTreeMap<u32, [f32; 2]> = seen.iter().map(|seen| (seen.vehicle(), seen.origin())).collect();
    for row in &rows {
        let at = |names: [&str; 2]| names.map(|name| number(&row[name]));
        let [x, y] = at(["x", "y"]);
        let on_road = at(["s", "d"]);
        let expected = recording.to_file_coordinates(0, on_road.map(|value| value as f32));
        assert!((x - expected[0]).hypot(y - expected[1]) < 1e-6, "{row:?}");
        let [x0, y0] = origins[&(number(&row["vehicle"]) as u32)].map(f64::from);
        let forward = at(["forward", "left"]);
        assert!((on_road[0] - x0 - forward[0]).hypot(on_road[1] - y0 - forward[1]) < 1e-3, "{row:?}");
        let sentence = number(&row["mode"]) == 0. && number(&row["step"]) == 50.;
        assert_eq!(matches!(&row["why"], Field::Str(why) if why.contains("vehicle")), sentence, "{row:?}");
    }
    assert!(rows.iter().any(|row| row["past"] == Field::Str("filled".to_owned())) == (done.counts.filled > 0));
}

#[test]
fn nothing_after_its_moment_reaches_a_forecast() {
    let recording = recording(&fixtures().join("ngsim/us101-24_1.csv.gz"));
    let gnp = gnp_pretrained::ngsim().unwrap().explaining(true);
    let frame = 40;
    let mut columns = recording.columns().clone();
    for track in recording.tracks() {
        for (row, at) in track.rows.clone().zip(track.first_frame..) {
            if at > frame {
                columns.x[row] += 30. * (row % 7) as f32;
                columns.y[row] = -columns.y[row];
                columns.lane[row] = 0;
                columns.neighbours[row] = [u32::MAX; 8];
            }
        }
    }
    let (meta, roads) = (recording.meta().clone(), recording.roads().to_vec());
    let scrambled = Recording::from_parts(meta, roads, recording.tracks().to_vec(), columns).unwrap();
    let all = |recording: &Recording| {
        let asked = Asked::of(recording, &At::Times(vec![f64::from(frame) / 10.]), gnp.shape()).unwrap();
        let mut found = Vec::new();
        let left_out = forecasts(&gnp, recording, &asked, 3, |made| {
            found.push((made.observation.key(), made.past, made.forecast.clone()));
            Ok(())
        });
        (found, left_out.unwrap())
    };
    let (a, b) = (all(&recording), all(&scrambled));
    assert!(a.0.len() > 5);
    assert_eq!(a, b);
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let place = TempDir::new().unwrap();
    let input = scenes(place.path(), &SCENES);
    let made: Vec<(Predicted, Vec<u8>)> = [1, 2, 5]
        .map(|jobs| {
            let out = place.path().join(format!("{jobs}.parquet"));
            let request = PredictRequest { jobs: Some(jobs), k: Some(2), ..every(0.5, &input, &out) };
            let done = predict(&request, &Machine::default()).unwrap();
            (done, fs::read(out).unwrap())
        })
        .into();
    for (done, bytes) in &made[1..] {
        assert_eq!(done.counts, made[0].0.counts);
        assert!(*bytes == made[0].1, "other bytes");
    }
    let counts = &made[0].0.counts;
    assert_eq!(counts.recordings, 3);
    assert!(counts.filled > 0 && counts.forecasts > 512, "{counts:?}");
    assert_eq!(fs::read_dir(place.path()).unwrap().count(), 4, "nothing is left beside the outputs");
}

/// Keeps what is said, and asks to stop when a piece of work is told how far it is.
#[derive(Debug)]
struct Stopping {
    stop: Option<Stop>,
    notes: Mutex<Vec<String>>,
}

impl Progress for Stopping {
    fn result(&self, _: &str) {}

    fn note(&self, text: &str) {
        self.notes.lock().unwrap().push(text.to_owned());
    }

    fn start(&self, _: &str, _: u64, _: u64, _: &'static str) -> Box<dyn Work> {
        Box::new(AtFirst(self.stop.clone()))
    }
}

struct AtFirst(Option<Stop>);

impl Work for AtFirst {
    fn at(&self, _: u64, _: &str) {
        if let Some(stop) = &self.0 {
            stop.request();
        }
    }
}

fn listening(stop: Option<Stop>) -> (Arc<Stopping>, Machine) {
    let progress = Arc::new(Stopping { stop: stop.clone(), notes: Mutex::default() });
    let machine = Machine::new(Device::Cpu, progress.clone(), stop.unwrap_or_default());
    (progress, machine)
}

#[test]
fn an_interrupted_prediction_goes_on_and_another_one_starts_anew() {
    let place = TempDir::new().unwrap();
    let input = scenes(place.path(), &SCENES);
    let (whole, out) = (place.path().join("whole.parquet"), place.path().join("out.parquet"));
    let request = |out: &Path| PredictRequest { jobs: Some(1), k: Some(2), ..every(1., &input, out) };
    predict(&request(&whole), &Machine::default()).unwrap();
    let expected = fs::read(&whole).unwrap();

    let interrupted = |request: &PredictRequest| {
        let (_, machine) = listening(Some(Stop::new()));
        let error = predict(request, &machine).unwrap_err();
        assert_eq!(error.kept().flatten(), Some(&place.path().join(".out.parquet.parts")), "{error}");
        assert!(!out.exists());
    };
    let again = |request: &PredictRequest| {
        let (progress, machine) = listening(None);
        let done = predict(request, &machine).unwrap();
        let notes = progress.notes.lock().unwrap().join("\n");
        (done.finished_before, fs::read(&out).unwrap() == expected, notes)
    };
    interrupted(&request(&out));
    let (before, same, notes) = again(&request(&out));
    assert!(before == 1 && same && !notes.contains("starting anew"), "{before} {same} {notes}");
    assert!(!place.path().join(".out.parquet.parts").exists());
    fs::remove_file(&out).unwrap();

    // A finished file that was touched is read again, a damaged part made again.
    interrupted(&request(&out));
    let touched = input.join("us101-13_1.csv.gz");
    File::open(&touched).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
    let (before, same, _) = again(&request(&out));
    assert!(before == 0 && same, "{before} {same}");
    fs::remove_file(&out).unwrap();

    // Another number of futures is another job, and so is another precision.
    let mut others = vec![(PredictRequest { k: Some(3), ..request(&out) }, "number of futures")];
    if Precision::Bf16.check().is_ok() {
        others.push((PredictRequest { precision: Some(Precision::Bf16), ..request(&out) }, "precision"));
    }
    for (other, what) in others {
        interrupted(&other);
        let (before, same, notes) = again(&request(&out));
        assert!(before == 0 && same, "{before} {same}");
        assert!(notes.contains(&format!("of another {what}; starting anew")), "{notes}");
        fs::remove_file(&out).unwrap();
    }
}

#[test]
fn forecasts_in_bf16_are_others_or_refused_where_the_processor_does_not_multiply_it() {
    let place = TempDir::new().unwrap();
    let (input, out) = (scenes(place.path(), &SCENES[1..2]), place.path().join("forecasts.parquet"));
    let mut request = PredictRequest::new(&input, &out);
    let exact = predict(&request, &Machine::default()).unwrap();
    let bytes = fs::read(&out).unwrap();
    request.precision = Some(Precision::Bf16);
    match (predict(&request, &Machine::default()), Precision::Bf16.check()) {
        (Ok(done), Ok(())) => {
            assert_eq!(done.counts, exact.counts);
            assert_ne!(fs::read(&out).unwrap(), bytes);
        }
        (Err(error), Err(_)) => assert!(error.chain().contains("AVX512-BF16"), "{}", error.chain()),
        (found, here) => panic!("{found:?}, {here:?}"),
    }
    request.precision = Some(Precision::F32);
    predict(&request, &Machine::default()).unwrap();
    assert_eq!(fs::read(&out).unwrap(), bytes);
}

#[test]
fn a_folder_gets_a_file_a_recording_once() {
    let place = TempDir::new().unwrap();
    let (input, out) = (scenes(place.path(), &SCENES[..2]), place.path().join("forecasts"));
    let request = PredictRequest { k: Some(2), ..every(2., &input, &out) };
    let first = predict(&request, &Machine::default()).unwrap();
    let files = SCENES[..2].iter().map(|name| out.join(format!("{name}.parquet"))).collect::<Vec<_>>();
    let content = || files.iter().map(|file| fs::read(file).unwrap()).collect::<Vec<_>>();
    let (made, times) = (content(), files.iter().map(|file| fs::metadata(file).unwrap().modified().unwrap()));
    let times: Vec<_> = times.collect();
    assert_eq!(first.finished_before, 0);
    fs::remove_file(&files[0]).unwrap();
    let second = predict(&request, &Machine::default()).unwrap();
    assert_eq!((second.finished_before, &second.counts), (1, &first.counts));
    assert!(content() == made);
    assert_eq!(fs::metadata(&files[1]).unwrap().modified().unwrap(), times[1], "it was not made again");
    // Together they are what one file for all has.
    let one = place.path().join("one.parquet");
    predict(&PredictRequest { output: one.clone(), ..request.clone() }, &Machine::default()).unwrap();
    let apart: usize = files.iter().map(|file| rows(file).len()).sum();
    assert_eq!(rows(&one).len(), apart);
}

#[test]
fn what_cannot_be_predicted_is_said() {
    let place = TempDir::new().unwrap();
    let (input, out) = (scenes(place.path(), &SCENES[..1]), place.path().join("out.parquet"));
    let refused = |request: PredictRequest| predict(&request, &Machine::default()).unwrap_err().chain();
    let good = || PredictRequest::new(&input, &out);
    let highd = fixtures().join("highd");
    for (request, parts) in [
        (PredictRequest { input: place.path().join("none"), ..good() }, vec!["there is nothing at"]),
        (PredictRequest { model: Some(place.path().join("none")), ..good() }, vec!["there is no model at", "ngsim"]),
        (PredictRequest { input: highd, ..good() }, vec!["25 Hz", "model's 10 Hz", "resample"]),
        (PredictRequest { format: Some(Dataset::HIGHD), ..good() }, vec!["highD"]),
        (PredictRequest { output: place.path().join("out.csv"), ..good() }, vec!["out.csv", "NAME.parquet"]),
        (PredictRequest { k: Some(1000), ..good() }, vec!["k = 1000", "1 to 40"]),
        (PredictRequest { at: At::Every(0.), ..good() }, vec!["above 0"]),
        (PredictRequest { at: At::Times(vec![1e6]), ..good() }, vec!["1 asked times outside of a recording"]),
    ] {
        let message = refused(request);
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert!(!out.exists());
    }
    let empty = place.path().join("empty");
    fs::create_dir(&empty).unwrap();
    assert!(refused(PredictRequest { input: empty, ..good() }).contains("no tracks in a format that is known"));
}

#[test]
fn a_moment_of_tracks_is_explained() {
    let input = fixtures().join("ngsim/us101-24_1.csv.gz");
    let ask = |vehicle: Option<&str>, at_s: Option<f64>| {
        let vehicle = vehicle.map(str::to_owned);
        let question = TracksQuestion { input: input.clone(), vehicle, at_s, ..TracksQuestion::default() };
        gnp::explain_tracks(&question, &Machine::default())
    };
    let explained = ask(None, None).unwrap();
    let account = &explained.as_it_is.as_ref().unwrap().account;
    let end = account.steps();
    let (start, sum, path) = (account.constant_velocity(end), account.sum(end), account.path_at(end));
    for axis in 0..2 {
        assert!((start[axis] + sum[axis] - path[axis]).abs() < 1e-3);
    }
    // Its forecast is that of a prediction at the same moment.
    let name = explained.key.vehicle.to_string();
    let again = ask(Some(&name), Some(f64::from(explained.key.t0) / 10.)).unwrap();
    assert_eq!(again.key, explained.key);
    let recording = recording(&input);
    let state = |frame| -> Option<TrackState> {
        let track = recording.tracks().iter().find(|track| track.vehicle == explained.key.vehicle)?;
        Some(recording.state(track.row_at(frame)?))
    };
    assert!(state(explained.key.t0).is_some());
    // Where the past is filled, the figure has the recording's frame, too.
    let early = ask(None, Some(0.5)).unwrap();
    assert!(early.key.t0 < 31 && early.figures[0].svg.contains(&format!("frame {}<", early.key.t0)));
    let unknown = ask(Some("99999"), None).unwrap_err().to_string();
    assert!(unknown.contains("no recording with a vehicle 99999; there are us101-24_1 (vehicles "), "{unknown}");
    assert!(ask(None, Some(1e4)).unwrap_err().to_string().contains("which goes from"));
}

/// docs/predict.md names every column; those by axis, slot or kind stand under a pattern.
#[test]
fn the_columns_are_documented() {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/predict.md")).unwrap();
    let patterns: Vec<&str> = page.split('`').skip(1).step_by(2).collect();
    let told = |name: &str| {
        patterns.iter().any(|pattern| {
            let begins = pattern.split(['*', 'S']).next().unwrap_or_default();
            *pattern == name
                || pattern.contains(['*']) && name.starts_with(begins)
                || *pattern == "k_SLOT" && name.starts_with("k_")
        })
    };
    let missing: Vec<String> =
        gnp_eval::forecast_columns().into_iter().map(|column| column.name).filter(|name| !told(name)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
