//! Roads that curve: a real scene on an arc is predicted as on the straight, and no road is taken for straight that is not.

#![allow(clippy::unwrap_used, clippy::panic)] // also outside the test functions

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use gnp::{Machine, PredictRequest};
use gnp_data::{
    DataError, Dataset, Expectation, Predictor as _, Recording, Track, TrackOptions, TrackTable, VehicleClass, Window,
    discover, read,
};
use gnp_road::ReferenceLine;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;

/// Radius of the arc, to the left, m.
const RADIUS: f64 = 500.;

/// A place along and across the arc.
fn on_the_arc([s, d]: [f64; 2]) -> [f64; 2] {
    let angle = s / RADIUS;
    [(RADIUS - d) * angle.sin(), RADIUS - (RADIUS - d) * angle.cos()]
}

/// The first US-101 scene that comes with the project.
fn scene() -> Recording {
    let folder = gnp::embedded_folder(Dataset::NGSIM).unwrap();
    let sources = discover(&folder, Dataset::NGSIM).unwrap();
    let source = sources.iter().find(|source| source.site.as_deref() == Some("us-101")).unwrap();
    let expect = Expectation { dataset: Dataset::NGSIM, rate_hz: None };
    read(source, &expect).unwrap().remove(0).0
}

/// The tracks of a recording in the plane, as a file would have them.
fn tracks(recording: &Recording, place: impl Fn([f64; 2]) -> [f64; 2]) -> TrackTable {
    let mut table = TrackTable::new(Dataset::TRACKS, "us-101", "scene");
    let (mut names, mut bodies) = (Vec::new(), Vec::new());
    for track in recording.tracks() {
        for row in track.rows.clone() {
            let frame = track.first_frame + (row - track.rows.start) as u32;
            let [x, y] = place([recording.columns().x[row].into(), recording.columns().y[row].into()]);
            table.time_s.push(f64::from(frame) / recording.meta().rate_hz);
            table.x.push(x);
            table.y.push(y);
            names.push(track.vehicle.to_string());
            bodies.push((track.length, track.width, track.class));
        }
    }
    table.lane = Some(recording.columns().lane.clone());
    table.set_names(names.iter().map(String::as_str));
    let length: Vec<f64> = bodies.iter().map(|body| body.0.into()).collect();
    let width: Vec<f64> = bodies.iter().map(|body| body.1.into()).collect();
    let class = |class: &VehicleClass| match class {
        VehicleClass::Motorcycle => "motorcycle",
        VehicleClass::Car => "car",
        VehicleClass::Truck => "truck",
    };
    let classes: Vec<&str> = bodies.iter().map(|body| class(&body.2)).collect();
    table.set_bodies(Some(&length), Some(&width), Some(&classes));
    table
}

/// The arc as points 10 m apart.
fn arc() -> ReferenceLine {
    let points: Vec<[f64; 2]> = (0..80).map(|i| on_the_arc([10. * f64::from(i), 0.])).collect();
    ReferenceLine::from_points(&points).unwrap()
}

#[test]
fn a_scene_on_an_arc_is_predicted_as_on_the_straight() {
    let scene = scene();
    let lines = Some(scene.roads()[0].lines.clone());
    let read = |table: TrackTable, road: ReferenceLine| {
        table.recordings(&TrackOptions { road: Some(road), lines: lines.clone(), rate_hz: None }).unwrap().remove(0).0
    };
    let straight = read(tracks(&scene, |place| place), ReferenceLine::straight([0., 0.], 0.));
    let bent = read(tracks(&scene, on_the_arc), arc());
    assert_eq!(straight.tracks(), bent.tracks());
    assert_eq!(straight.columns().neighbours, bent.columns().neighbours);

    let gnp = gnp_pretrained::ngsim().unwrap();
    let windows = |recording| -> Vec<Window<'_>> {
        let all = Recording::tracks(recording).iter().enumerate();
        // The first window of each track.
        let first = |track: &Track| track.rows.start + gnp.shape().t_obs - 1;
        all.filter_map(|(index, track)| Window::new(recording, gnp.shape(), index, first(track)).ok()).collect()
    };
    let (on_straight, on_bend) = (windows(&straight), windows(&bent));
    assert!(on_straight.len() > 5 && on_straight.len() == on_bend.len(), "{}", on_straight.len());
    let forecasts = |windows: &[Window<'_>]| {
        let observations: Vec<_> = windows.iter().map(Window::observation).collect();
        gnp.predict(&observations, 6).unwrap()
    };
    let mut worst = 0f64;
    for ((window, straight), bend) in on_bend.iter().zip(forecasts(&on_straight)).zip(forecasts(&on_bend)) {
        let origin = window.observation().origin();
        for (expected, found) in straight.modes.iter().zip(&bend.modes) {
            assert!((expected.probability - found.probability).abs() < 1e-3);
            for (expected, found) in expected.path.iter().zip(&found.path) {
                let place = |step: &[f32; 2]| [0, 1].map(|axis| origin[axis] + step[axis]);
                let [x, y] = on_the_arc(place(expected).map(f64::from));
                let [u, v] = bent.to_file_coordinates(0, place(found));
                worst = worst.max((x - u).hypot(y - v));
            }
        }
    }
    assert!(worst < 0.05, "{worst} m");
}

/// Writes tracks as a file of their own, and the road beside it with the lines of the scene.
fn written(scene: &Recording, place: impl Fn([f64; 2]) -> [f64; 2], folder: &Path, name: &str) -> (PathBuf, PathBuf) {
    let table = tracks(scene, &place);
    let mut text = String::from("id,time,x,y,lane,length,width\n");
    for (row, vehicle) in table.vehicle.iter().enumerate() {
        let body = &table.vehicles[*vehicle as usize];
        let (id, time, lane) = (&body.name, table.time_s[row], table.lane.as_ref().unwrap()[row]);
        let [length, width] = [body.length, body.width].map(Option::unwrap);
        text += &format!("{id},{time:.3},{:.4},{:.4},{lane},{length},{width}\n", table.x[row], table.y[row]);
    }
    let (file, road) = (folder.join(format!("{name}.csv")), folder.join(format!("{name}-road.csv")));
    fs::write(&file, text).unwrap();
    let lines: Vec<String> = scene.roads()[0].lines.iter().map(|line| line.y.to_string()).collect();
    let points = (0..80).map(|i| place([10. * f64::from(i), 0.])).map(|[x, y]| format!("{x:.4},{y:.4}\n"));
    fs::write(&road, format!("# lane lines: {}\nx,y\n{}", lines.join(","), points.collect::<String>())).unwrap();
    (file, road)
}

/// Forecasts of a file: position in the coordinates of the file, by vehicle, mode and step.
fn predicted(file: &Path, road: &Path, out: &Path) -> BTreeMap<[u32; 3], [f64; 2]> {
    let tracks = gnp::road_options(Some(road), None).unwrap();
    gnp::predict(&PredictRequest { tracks, ..PredictRequest::new(file, out) }, &Machine::default()).unwrap();
    let reader = SerializedFileReader::new(File::open(out).unwrap()).unwrap();
    let rows = reader.get_row_iter(None).unwrap().map(Result::unwrap);
    rows.map(|row| {
        let of = |name: &str| row.get_column_iter().find(|(column, _)| *column == name).unwrap().1.clone();
        let whole = |name: &str| if let Field::UInt(value) = of(name) { value } else { panic!("{name}") };
        let double = |name: &str| if let Field::Double(value) = of(name) { value } else { panic!("{name}") };
        (["vehicle", "mode", "step"].map(whole), ["x", "y"].map(double))
    })
    .collect()
}

/// From files to a file, as `gnp predict --road FILE`.
#[test]
fn a_file_of_tracks_on_an_arc_is_predicted_as_on_the_straight() {
    let (scene, folder) = (scene(), tempfile::tempdir().unwrap());
    let forecasts = |place: fn([f64; 2]) -> [f64; 2], name: &str| {
        let (file, road) = written(&scene, place, folder.path(), name);
        predicted(&file, &road, &folder.path().join(format!("{name}.parquet")))
    };
    let straight = forecasts(|place| place, "straight");
    let bent = forecasts(on_the_arc, "bent");
    assert!(straight.len() > 1000 && straight.keys().eq(bent.keys()), "{} {}", straight.len(), bent.len());
    let off = straight.iter().map(|(key, place)| {
        let ([x, y], [u, v]) = (on_the_arc(*place), bent[key]);
        (x - u).hypot(y - v)
    });
    let worst = off.fold(0., f64::max);
    assert!(worst < 0.05, "{worst} m");
}

#[test]
fn an_arc_without_its_line_is_no_straight_road() {
    let table = tracks(&scene(), on_the_arc);
    let error = table.recordings(&TrackOptions::default()).unwrap_err();
    assert!(matches!(error, DataError::Tracks { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("--road FILE") && message.contains("degrees"), "{message}");
    // The line of another road.
    let elsewhere = ReferenceLine::from_points(&[[0., 1000.], [100., 1000.]]).unwrap();
    let error = table.recordings(&TrackOptions { road: Some(elsewhere), ..TrackOptions::default() }).unwrap_err();
    assert!(error.to_string().contains("off the road's line"), "{error}");
}
