//! Clips are cut out of recordings.

#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use std::collections::BTreeSet;
use std::convert::Infallible;

use gnp_data::{
    Columns, Dataset, Explanation, Forecast, LaneMarking, MarkingKind, Mode, Observation, Recording, RecordingMeta,
    Road, SLOTS, Track, VehicleClass, VelocitySource, WindowShape,
};
use gnp_plot::{Clip, ClipForecast, ClipNeighbour, ClipSpan, Evaluated, TimedState};

/// 25 Hz, so that every third frame is shown.
const SHAPE: WindowShape = WindowShape { t_obs: 4, t_pred: 2, step: 2, rate_hz: 12.5 };

/// Two vehicles on the second of two roads, a truck from recorded frame 40 on and a car that is ahead of it and leaves
/// earlier: `x` is a tenth of the frame, `y` the row.
fn recording() -> Recording {
    let meta = RecordingMeta::new(Dataset::HIGHD, "site 3", "recording 4", 25.)
        .with_simulated(true)
        .with_velocities(VelocitySource::Recorded);
    let lines = |y| [y, y + 4.].map(|y| LaneMarking { kind: MarkingKind::Boundary, y }).to_vec();
    let road = |driving_direction, y| Road { driving_direction, lines: lines(y), fitted: false, axis: None };
    let track = |vehicle, class, rows| {
        let mut track = Track::new(vehicle, [11., 2.5], 40, rows);
        (track.road, track.class) = (1, class);
        track
    };
    let rows = 70;
    let frame = |row: usize| (if row < 50 { row } else { row - 50 } + 40) as f32;
    let mut neighbours = vec![[u32::MAX; SLOTS]; rows];
    for row in neighbours.iter_mut().take(20) {
        row[0] = 1; // the car is ahead of the truck
    }
    let columns = Columns {
        x: (0..rows).map(|row| frame(row) / 10. + if row < 50 { 0. } else { 30. }).collect(),
        y: (0..rows).map(|row| row as f32).collect(),
        vx: vec![2.5; rows],
        vy: (0..rows).map(|row| row as f32 / 4.).collect(),
        lane: vec![1; rows],
        neighbours,
        named_leader: None,
    };
    let tracks = vec![track(9, VehicleClass::Truck, 0..50), track(14, VehicleClass::Car, 50..70)];
    Recording::from_parts(meta, vec![road(1, 50.), road(2, 0.)], tracks, columns).unwrap()
}

fn forecast() -> Forecast {
    let mode = |probability| Mode {
        probability,
        path: vec![[1., 0.], [2., 0.5]],
        explanation: Some(Explanation { goal: [2., 0.5], ..Explanation::default() }),
    };
    Forecast { modes: vec![mode(0.75), mode(0.25)] }
}

fn cut(recording: &Recording, road: u16) -> Clip {
    let evaluated = Evaluated { subset: "test", tracks: &BTreeSet::from([0]) };
    let span = ClipSpan { road, first_frame: 37, seconds: 2. };
    let forecasts = |asked: &[Observation<'_>]| Ok::<_, Infallible>(vec![forecast(); asked.len()]);
    Clip::cut(recording, SHAPE, span, evaluated, forecasts).unwrap()
}

#[test]
fn a_clip_is_in_the_road_frame() {
    let clip = cut(&recording(), 1);
    assert_eq!(clip.heading(), "recording 4, site 3, driving direction 2 (simulated)");
    assert_eq!((clip.rate_hz, clip.first_frame, clip.frame_step, clip.forecast_step), (25., 37, 3, 2));
    assert_eq!((clip.frames, clip.subset.as_str()), (16, "test"));
    assert!((clip.observed_s - 0.24).abs() < 1e-9 && (clip.predicted_s - 0.16).abs() < 1e-9);
    assert_eq!(clip.lines.iter().map(|line| line.y).collect::<Vec<_>>(), [0., 4.]);
    let [truck, car] = &clip.vehicles[..] else { panic!("{:?}", clip.vehicles) };
    assert_eq!((truck.id, truck.class, truck.evaluated, truck.size), (9, VehicleClass::Truck, true, [11., 2.5]));
    assert_eq!((car.id, car.evaluated), (14, false));
    // Shown are 37, 40, 43, ...: the truck is there from 40 to 82, the car to 58.
    assert_eq!(truck.states[0], TimedState { frame: 40, centre: [4., 0.], velocity: [2.5, 0.] });
    assert_eq!(truck.states[3], TimedState { frame: 49, centre: [4.9, 9.], velocity: [2.5, 2.25] });
    assert_eq!((truck.states.len(), truck.states.last().unwrap().frame), (15, 82));
    assert_eq!((car.states.last().unwrap().frame, clip.last_frame()), (58, 82));
}

#[test]
fn every_vehicle_is_forecast_each_second() {
    let clip = cut(&recording(), 1);
    // Shown frames 0 and 8: recorded frames 37, before there is anybody, and 61, after the car has left.
    let [truck, car] = &clip.vehicles[..] else { panic!("{:?}", clip.vehicles) };
    assert!(car.forecasts.is_empty());
    let [found] = &truck.forecasts[..] else { panic!("{:?}", truck.forecasts) };
    assert_eq!(found.frame, 61);
    assert_eq!(found.history.iter().map(|point| point[1]).collect::<Vec<_>>(), [15., 17., 19., 21.]);
    assert!((found.history[3][0] - 6.1).abs() < 1e-6, "{:?}", found.history);
    assert_eq!(found.modes, forecast().modes);
    assert_eq!(clip.forecast_ids(), [9]);
}

#[test]
fn neighbours_are_vehicles_of_the_clip() {
    let recording = recording();
    let evaluated = Evaluated { subset: "test", tracks: &BTreeSet::new() };
    // Shown frame 0 is recorded frame 50: both are there.
    let span = ClipSpan { road: 1, first_frame: 50, seconds: 0.5 };
    let forecasts = |asked: &[Observation<'_>]| Ok::<_, Infallible>(vec![forecast(); asked.len()]);
    let clip = Clip::cut(&recording, SHAPE, span, evaluated, forecasts).unwrap();
    let of = |i: usize| -> &ClipForecast { &clip.vehicles[i].forecasts[0] };
    assert_eq!((of(0).neighbours[0], of(0).neighbours[1]), (ClipNeighbour::Vehicle(1), ClipNeighbour::Empty));
    assert_eq!(of(1).neighbours, [ClipNeighbour::Empty; SLOTS]);
}

#[test]
fn an_error_of_the_predictor_is_passed_on_and_a_missing_road_is_empty() {
    let recording = recording();
    let evaluated = Evaluated { subset: "test", tracks: &BTreeSet::new() };
    let span = ClipSpan { road: 1, first_frame: 40, seconds: 2. };
    assert_eq!(Clip::cut(&recording, SHAPE, span, evaluated, |_| Err("stopped")), Err("stopped"));
    assert!(cut(&recording, 2).vehicles.is_empty());
}

#[test]
fn half_a_second_is_a_whole_number_of_points() {
    let every = |rate_hz| Clip::new("", rate_hz).points_every();
    assert_eq!([10., 5., 25., 1.].map(every), [5, 3, 13, 1]);
}
