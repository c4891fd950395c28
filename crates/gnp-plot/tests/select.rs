//! Rules that find scenes, on a road made up for them.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

use gnp_data::{
    Columns, Dataset, LaneMarking, MarkingKind, Recording, RecordingMeta, Road, SLOTS, Track, Window, WindowShape,
};
use gnp_plot::{LateralManoeuvre, Scene, SceneRule, find_scene, lateral_manoeuvre};

/// 1 s observed, 2 s predicted at 10 Hz.
const SHAPE: WindowShape = WindowShape { t_obs: 11, t_pred: 20, step: 1, rate_hz: 10. };
const ROWS: usize = 31;

/// Vehicles at 20 m/s on three lanes, each with a start and a lateral way per second after 1 s.
fn recording(vehicles: &[(f32, f32, f32)]) -> Recording {
    let line = |kind, y| LaneMarking { kind, y };
    let lines = vec![
        line(MarkingKind::Boundary, -1.75),
        line(MarkingKind::LaneDivider, 1.75),
        line(MarkingKind::LaneDivider, 5.25),
        line(MarkingKind::Boundary, 8.75),
    ];
    let (mut columns, mut tracks) = (Columns::default(), Vec::new());
    for (vehicle, (x, y, drift)) in vehicles.iter().enumerate() {
        let start = columns.x.len();
        for i in 0..ROWS {
            let y = y + drift * (i as f32 - 10.).max(0.) / 10.;
            columns.x.push(x + 2. * i as f32);
            columns.y.push(y);
            columns.vx.push(20.);
            columns.vy.push(0.);
            columns.lane.push(if y < 1.75 {
                3
            } else if y < 5.25 {
                2
            } else {
                1
            });
            columns.neighbours.push([u32::MAX; SLOTS]);
        }
        tracks.push(Track::new(vehicle as u32, [4.5, 1.8], 1, start..columns.x.len()));
    }
    let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", "made up", 10.).with_simulated(true);
    let road = Road { driving_direction: 2, lines, fitted: false, axis: None };
    Recording::from_parts(meta, vec![road], tracks, columns).unwrap()
}

fn windows(recording: &Recording) -> Vec<Window<'_>> {
    let last = |track: &Track| track.rows.start + SHAPE.t_obs - 1;
    recording.tracks().iter().enumerate().filter_map(|(i, t)| Window::new(recording, SHAPE, i, last(t)).ok()).collect()
}

#[test]
fn manoeuvres_are_what_happened() {
    // Straight, to the left, to the right, half a lane, and within one lane but far.
    let recording = recording(&[(0., 3.5, 0.), (30., 3.5, 1.8), (60., 3.5, -1.8), (90., 3.5, 0.9), (120., 0., 0.2)]);
    let found: Vec<_> = windows(&recording).iter().map(lateral_manoeuvre).collect();
    let expected =
        [Some(LateralManoeuvre::Straight), Some(LateralManoeuvre::Left), Some(LateralManoeuvre::Right), None];
    assert_eq!(found[..4], expected);
    assert_eq!(found[4], Some(LateralManoeuvre::Straight));
}

#[test]
fn rules_find_the_busiest_and_the_loneliest() {
    // 0 goes straight among 1, 2 and 3; 3 changes left towards 1; 4 changes right, far from all.
    let recording = recording(&[(0., 3.5, 0.), (5., 7., 0.), (20., 3.5, 0.), (-20., 3.5, 1.8), (500., 3.5, -1.8)]);
    let windows = windows(&recording);
    assert_eq!(find_scene(SceneRule::ChangeAgainstTraffic, &windows), Some(3));
    assert_eq!(find_scene(SceneRule::ChangeAlone, &windows), Some(4));
    let straight = find_scene(SceneRule::StraightWithTraffic, &windows).unwrap();
    assert!(straight <= 2, "{straight}");
    assert_eq!(find_scene(SceneRule::ChangeAlone, &windows[..3]), None);
}

/// The lane number changes where the path crosses the line.
#[test]
fn a_lane_change_is_marked_on_the_line() {
    let recording = recording(&[(0., 3.5, 1.8), (40., 3.5, 0.)]);
    let scene = Scene::of(&windows(&recording)[0], Default::default(), String::new());
    let line = scene.lines[2].y;
    assert!((line - 1.75).abs() < 1e-6, "5.25 m, seen from 3.5 m");
    assert_eq!(scene.lane_changes.len(), 1);
    assert!((scene.lane_changes[0][1] - line).abs() < 0.2, "{:?}", scene.lane_changes);
    assert_eq!((scene.history.len(), scene.truth.len(), scene.others.len()), (11, 20, 1));
    assert_eq!(scene.others[0].now.centre, [40., 0.]);
    assert_eq!(scene.history[10], [0., 0.]);
}
