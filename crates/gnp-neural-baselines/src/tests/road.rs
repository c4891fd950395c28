//! A road with three lanes and traffic that meanders, in numbers that all differ.

use gnp_data::{
    Columns, Dataset, LaneMarking, MarkingKind, Recording, RecordingMeta, Road, SLOTS, Track, VehicleClass,
    WindowConfig, WindowShape,
};

const FRAMES: usize = 70;

/// Vehicles: along the road at the start (m), lane from the right, speed (m/s).
const TRAFFIC: [(f32, usize, f32); 9] = [
    (0., 1, 12.),
    (14., 1, 11.5),
    (-13., 1, 12.5),
    (5., 2, 13.),
    (-9., 2, 12.2),
    (21., 2, 11.),
    (3.5, 0, 10.8),
    (-16., 0, 12.6),
    (24., 0, 11.7),
];

/// The recording at 10 Hz. `id` numbers the vehicles, and so fixes the order of their tracks; `moved` may
/// change a position by vehicle and frame.
pub(super) fn recording(id: impl Fn(usize) -> u32, moved: impl Fn(usize, usize) -> [f32; 2]) -> Recording {
    let mut order: Vec<usize> = (0..TRAFFIC.len()).collect();
    order.sort_by_key(|vehicle| id(*vehicle));
    let (mut tracks, mut columns) = (Vec::new(), Columns::default());
    for vehicle in order {
        let (start, lane, speed) = TRAFFIC[vehicle];
        let first = columns.x.len();
        for frame in 0..FRAMES {
            let t = frame as f32 / 10.;
            let wave = (0.9 * t + vehicle as f32).sin();
            let [dx, dy] = moved(vehicle, frame);
            columns.x.push(start + speed * t + 0.8 * wave + dx);
            columns.y.push(1.8 + 3.6 * lane as f32 + 0.3 * (0.7 * t + 2. * vehicle as f32).sin() + dy);
            columns.vx.push(speed);
            columns.vy.push(0.);
            columns.lane.push(3 - lane as i16);
            columns.neighbours.push([u32::MAX; SLOTS]);
        }
        let mut track = Track::new(id(vehicle), [4.5, 1.8], 1, first..columns.x.len());
        track.class = if vehicle == 4 { VehicleClass::Truck } else { VehicleClass::Car };
        tracks.push(track);
    }
    let line = |kind, y| LaneMarking { kind, y };
    let (edge, centre) = (MarkingKind::Boundary, MarkingKind::LaneDivider);
    let lines = vec![line(edge, 0.), line(centre, 3.6), line(centre, 7.2), line(edge, 10.8)];
    let roads = vec![Road { driving_direction: 2, lines, fitted: false, axis: None }];
    let meta = RecordingMeta::new(Dataset::NGSIM, "us-101", "meandering", 10.).with_simulated(true);
    Recording::from_parts(meta, roads, tracks, columns).unwrap()
}

/// The recording with vehicles numbered in the order of the list, nothing moved.
pub(super) fn plain() -> Recording {
    recording(|vehicle| 1 + vehicle as u32, |_, _| [0.; 2])
}

/// The plain recording with left and right exchanged.
pub(super) fn mirrored() -> Recording {
    let plain = plain();
    let mut columns = plain.columns().clone();
    columns.y.iter_mut().for_each(|y| *y = -*y);
    let mut roads = plain.roads().to_vec();
    for road in &mut roads {
        road.lines.reverse();
        road.lines.iter_mut().for_each(|line| line.y = -line.y);
    }
    Recording::from_parts(plain.meta().clone(), roads, plain.tracks().to_vec(), columns).unwrap()
}

/// The plain recording with lengths and speeds along the road multiplied; sizes stay.
pub(super) fn stretched(along: f32) -> Recording {
    let plain = plain();
    let mut columns = plain.columns().clone();
    columns.x.iter_mut().chain(&mut columns.vx).for_each(|value| *value *= along);
    Recording::from_parts(plain.meta().clone(), plain.roads().to_vec(), plain.tracks().to_vec(), columns).unwrap()
}

/// Their shape.
pub(super) fn shape() -> WindowShape {
    WindowShape { t_obs: 13, t_pred: 10, step: 1, rate_hz: 10. }
}

/// Windows of 7 past and 5 future points at 5 Hz.
pub(super) fn config() -> WindowConfig {
    WindowConfig { observed_s: 1.2, predicted_s: 1., rate_hz: 10., stride_s: 0.7, site_stride_s: Default::default() }
}
