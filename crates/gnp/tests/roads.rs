//! Roads that curve: a real scene on an arc is predicted as on the straight, and no road is taken for straight that is not.

#![allow(clippy::unwrap_used)] // also outside the test functions

use gnp_data::{
    DataError, Dataset, Expectation, Predictor as _, Recording, TrackOptions, TrackTable, VehicleClass, Window,
    discover, read,
};
use gnp_road::ReferenceLine;

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
    let now = straight.tracks().iter().map(|track| track.first_frame).max().unwrap() + gnp.shape().t_obs as u32;
    let windows = |recording| -> Vec<Window<'_>> {
        let all = Recording::tracks(recording).iter().enumerate();
        let rows = all.filter_map(|(index, track)| Some((index, track.row_at(now)?)));
        rows.filter_map(|(index, row)| Window::new(recording, gnp.shape(), index, row).ok()).collect()
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
    eprintln!("{worst} m");
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
