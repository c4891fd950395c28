//! Tables of tracks: rate, names, carriageways, lanes, sizes.

use gnp_data::{LaneMarking, LaneNumbers, Slot, VehicleClass, VelocitySource};
use gnp_road::ReferenceLine;

use super::*;

fn lines(recording: &Recording, road: usize) -> Vec<f32> {
    recording.roads()[road].lines.iter().map(|line| (100. * line.y).round() / 100.).collect()
}

/// Row of a vehicle in a frame.
fn row(recording: &Recording, name: &str, frame: u32) -> usize {
    let vehicle = recording.vehicle_named(name).unwrap();
    let track = recording.tracks().iter().find(|track| track.vehicle == vehicle).unwrap();
    track.row_at(frame).unwrap()
}

#[test]
fn a_road_in_any_direction_is_the_same_recording() {
    let (along_x, _) = read_table(&traffic(0., 10., 50)).unwrap();
    assert_eq!(lines(&along_x, 0), [0.04, 3.7, 7.3, 10.96]);
    for heading in [0.3, 1.5, 2.9, -2., -0.7] {
        let (turned, report) = read_table(&traffic(heading, 10., 50)).unwrap();
        let (a, b) = (along_x.columns(), turned.columns());
        let off = a.x.iter().zip(&b.x).chain(a.y.iter().zip(&b.y)).map(|(a, b)| (a - b).abs()).fold(0., f32::max);
        assert!(off < 1e-3, "{off} m at {heading}");
        assert_eq!((&a.lane, &a.neighbours), (&b.lane, &b.neighbours));
        assert!(report.notes[0].contains(&format!("{:.1} degrees", heading.to_degrees())), "{:?}", report.notes);
    }
}

#[test]
fn ten_rows_a_vehicle_are_enough() {
    let mut table = traffic(0.4, 25., 10);
    table.lane = None;
    let (recording, report) = read_table(&table).unwrap();
    assert_eq!((recording.meta().rate_hz, report.vehicles, report.rows, report.tracks), (25., 9, 90, 9));
    assert_eq!(recording.roads().len(), 1);
    assert_eq!(recording.roads()[0].lines.len(), 4, "{:?}", report.notes);
    let leader = recording.neighbour(row(&recording, "car 0", 5), Slot::Preceding).unwrap();
    assert_eq!(recording.vehicle_name(recording.tracks()[leader].vehicle), "car 3");
}

#[test]
fn both_directions_are_carriageways_of_their_own() {
    let there = [2., 5.6].map(|left| Vehicle { left, from: 0., speed: 30., lane: 0 });
    let back = [9.5, 13.1].map(|left| Vehicle { left, from: 300., speed: -25., lane: 0 });
    let stands = Vehicle { left: 13.2, from: 80., speed: 0., lane: 0 };
    let table = table(&[there[0], back[0], there[1], back[1], stands], 0.8, 10., 60);
    let (recording, _) = read_table(&table).unwrap();
    let way = |name: &str| {
        let vehicle = recording.vehicle_named(name).unwrap();
        recording.tracks().iter().find(|track| track.vehicle == vehicle).unwrap().road
    };
    assert_eq!(["car 0", "car 2", "car 1", "car 3", "car 4"].map(way), [0, 0, 1, 1, 1]);
    assert_eq!(recording.roads().iter().map(|road| road.driving_direction).collect::<Vec<_>>(), [2, 1]);
    // All drive forward in their own frame, and left is left.
    let state = recording.state(row(&recording, "car 3", 20));
    assert!((state.vx - 25.).abs() < 0.01 && (state.y + 13.1).abs() < 0.01, "{state:?}");
    let passed = recording.state(row(&recording, "car 1", 20));
    assert!(passed.y > state.y, "the lane at 9.5 m is left of that at 13.1 m for who comes back");
}

#[test]
fn a_curved_road_is_straightened_by_its_line() {
    // A left bend of 400 m radius, as points of its line every 15 m.
    let at = |s: f64, d: f64| [(400. - d) * (s / 400.).sin(), 400. - (400. - d) * (s / 400.).cos()];
    let points: Vec<[f64; 2]> = (0..50).map(|i| at(15. * f64::from(i), 0.)).collect();
    let road = ReferenceLine::from_points(&points).unwrap();
    let straight = traffic(0., 10., 60);
    let mut bent = straight.clone();
    for i in 0..bent.len() {
        [bent.x[i], bent.y[i]] = at(straight.x[i], straight.y[i]);
    }
    let (problem, message) = fault(&bent);
    assert_eq!(problem, TrackProblem::Road);
    assert!(message.contains("not straight") || message.contains("turns by"), "{message}");
    assert!(message.contains("--road"), "{message}");
    let options = TrackOptions { road: Some(road), ..TrackOptions::default() };
    let (there, _) = bent.recordings(&options).unwrap().remove(0);
    let (expected, _) = read_table(&straight).unwrap();
    let (a, b) = (there.columns(), expected.columns());
    let off = a.x.iter().zip(&b.x).chain(a.y.iter().zip(&b.y)).map(|(a, b)| (a - b).abs()).fold(0., f32::max);
    assert!(off < 0.02, "{off} m");
    assert_eq!(a.neighbours, b.neighbours);
}

#[test]
fn every_position_comes_back_in_the_coordinates_of_the_table() {
    let mut table = traffic(2.2, 10., 20);
    let back = traffic(2.2, 10., 20);
    for i in 0..back.len() {
        table.x[i] += 4.6e5;
        table.y[i] += 5.4e6;
    }
    // Half of them drive the other way.
    let (sin, cos) = 2.2f64.sin_cos();
    for i in (0..table.len()).filter(|i| i % 9 >= 5) {
        let along = back.x[i] * cos + back.y[i] * sin;
        table.x[i] += (600. - 2. * along) * cos + 15. * sin;
        table.y[i] += (600. - 2. * along) * sin - 15. * cos;
    }
    let (recording, _) = read_table(&table).unwrap();
    assert_eq!(recording.roads().len(), 2);
    for i in 0..table.len() {
        let name = &table.vehicles[table.vehicle[i] as usize].name;
        let row = row(&recording, name, (10. * table.time_s[i]).round() as u32);
        let vehicle = recording.vehicle_named(name).unwrap();
        let track = recording.tracks().iter().find(|track| track.vehicle == vehicle).unwrap();
        let axis = recording.roads()[usize::from(track.road)].axis.as_ref().unwrap();
        let state = recording.state(row);
        let [x, y] = axis.to_world(state.x.into(), state.y.into());
        assert!((x - table.x[i]).hypot(y - table.y[i]) < 1e-3, "({x}, {y}), row {i}");
        assert!(state.vx > 0., "all drive forward");
    }
}

#[test]
fn a_gentle_bend_is_noticed_and_a_lane_change_is_not() {
    // 8 degrees over the section.
    let mut bent = traffic(0., 10., 80);
    for i in 0..bent.len() {
        bent.y[i] += bent.x[i] * bent.x[i] / 2. * 8f64.to_radians() / 440.;
    }
    let (problem, message) = fault(&bent);
    assert!(problem == TrackProblem::Road && message.contains("turns by"), "{message}");
    // One of nine, and one alone, change lanes within 3 s.
    let change = |time: f64| 3.6 * ((time - 1.) / 3.).clamp(0., 1.);
    let mut all = traffic(0., 10., 80);
    let mut alone = table(&[Vehicle { left: 0., from: 0., speed: 20., lane: 0 }], 0., 10., 80);
    for i in 0..all.len() {
        all.y[i] += if i % 9 == 4 { change(all.time_s[i]) } else { 0. };
    }
    for i in 0..alone.len() {
        alone.y[i] += change(alone.time_s[i]);
    }
    read_table(&all).unwrap();
    read_table(&alone).unwrap();
}

#[test]
fn lane_numbers_may_count_from_either_side() {
    let from_left = traffic(0., 10., 50);
    let mut from_right = from_left.clone();
    from_right.lane.iter_mut().flatten().for_each(|lane| *lane = 4 - *lane);
    let (expected, _) = read_table(&from_left).unwrap();
    let (noticed, report) = read_table(&from_right).unwrap();
    assert_eq!(noticed.columns().lane, expected.columns().lane);
    assert!(report.notes.iter().any(|note| note.contains("count from the right")), "{:?}", report.notes);
    from_right.lane_numbers = LaneNumbers::FromRight;
    assert_eq!(read_table(&from_right).unwrap().0.columns().lane, expected.columns().lane);
    // Numbers that say nothing of where vehicles are do not count.
    let mut nonsense = from_left.clone();
    nonsense.lane.iter_mut().flatten().zip(0..).for_each(|(lane, i)| *lane = 1 + (i % 4));
    let (recording, report) = read_table(&nonsense).unwrap();
    assert_eq!(recording.columns().lane, expected.columns().lane, "{:?}", report.notes);
}

#[test]
fn given_lines_are_taken() {
    let table = traffic(0., 10., 50);
    let at = |lines: &[f32]| {
        let edge = |i: usize| i == 0 || i + 1 == lines.len();
        lines.iter().enumerate().map(|(i, y)| LaneMarking::new(*y, edge(i))).collect::<Vec<_>>()
    };
    let given = |lines: Vec<LaneMarking>| TrackOptions { lines: Some(lines), ..TrackOptions::default() };
    let options = given(at(&[0., 3.5, 7.1, 10.8]));
    let (recording, report) = table.recordings(&options).unwrap().remove(0);
    assert_eq!(recording.roads()[0].lines, options.lines.unwrap());
    assert_eq!(report.lanes, gnp_data::LaneSource::Given);
    let (problem, message) = fault_with(&table, &given(at(&[100., 103.5])));
    assert!(problem == TrackProblem::Road && message.contains("outside the lane lines"), "{message}");
    let (problem, _) = fault_with(&table, &given(at(&[3., 1.])));
    assert_eq!(problem, TrackProblem::Road);
}

#[test]
fn velocities_are_those_given_in_any_form() {
    let heading = 0.9f64;
    let plain = traffic(heading, 10., 30);
    let speeds: Vec<f64> = (0..plain.len()).map(|i| 30. - 3. * (i % 9 % 3) as f64).collect();
    let mut by_heading = plain.clone();
    (by_heading.speed, by_heading.heading) = (Some(speeds.clone()), Some(vec![heading; plain.len()]));
    let mut by_axis = plain.clone();
    let along = |f: f64| speeds.iter().map(|speed| speed * f).collect::<Vec<f64>>();
    by_axis.velocity = Some([along(heading.cos()), along(heading.sin())]);
    for table in [by_heading, by_axis] {
        let (recording, _) = read_table(&table).unwrap();
        assert_eq!(recording.meta().velocities, VelocitySource::Recorded);
        let state = recording.state(row(&recording, "car 1", 10));
        assert!((state.vx - 27.).abs() < 1e-4 && state.vy.abs() < 1e-4, "{state:?}");
        let mut unknown = table.clone();
        unknown.speed.iter_mut().flatten().take(1).for_each(|speed| *speed = f64::NAN);
        unknown.velocity.iter_mut().for_each(|[vx, _]| vx[0] = f64::NAN);
        let (recording, report) = read_table(&unknown).unwrap();
        assert_eq!(recording.meta().velocities, VelocitySource::Derived);
        assert!(report.notes.iter().any(|note| note.contains("speeds are not taken")), "{:?}", report.notes);
    }
}

#[test]
fn the_order_of_rows_does_not_matter_and_is_counted() {
    let sorted = traffic(0.2, 10., 40);
    let mut shuffled = sorted.clone();
    let order: Vec<usize> = (0..sorted.len()).map(|i| (i * 7919) % sorted.len()).collect();
    let pick = |values: &[f64]| order.iter().map(|i| values[*i]).collect::<Vec<f64>>();
    (shuffled.time_s, shuffled.x, shuffled.y) = (pick(&sorted.time_s), pick(&sorted.x), pick(&sorted.y));
    shuffled.vehicle = order.iter().map(|i| sorted.vehicle[*i]).collect();
    shuffled.lane = sorted.lane.as_ref().map(|lane| order.iter().map(|i| lane[*i]).collect());
    let ((a, before), (b, after)) = (read_table(&sorted).unwrap(), read_table(&shuffled).unwrap());
    assert_eq!((a.tracks(), a.columns()), (b.tracks(), b.columns()));
    assert_eq!(before.out_of_order, 0);
    assert!(after.out_of_order > 0);
}

#[test]
fn times_keep_their_clock_and_vehicles_their_names() {
    let mut table = traffic(0., 25., 100);
    table.time_s.iter_mut().for_each(|time| *time += 1_718_000_000.48);
    let options = TrackOptions { rate_hz: Some(5.), ..TrackOptions::default() };
    let (recording, report) = table.recordings(&options).unwrap().remove(0);
    assert_eq!((recording.meta().rate_hz, report.frames), (5., [0, 19]));
    // The last of the 100 frames stays.
    assert!((recording.meta().time_s(19) - (1_718_000_000.48 + 99. / 25.)).abs() < 1e-5);
    assert_eq!(report.skipped_rows.values().sum::<u64>() + report.rows, 900);
    assert_eq!(recording.vehicle_name(1), "car 0");
    assert_eq!(recording.vehicle_named("car 8"), Some(9));
    assert_eq!(recording.vehicle_named("car 9"), None);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.rec");
    for heading in [0., 0.37, 1.234_567_890_123, std::f64::consts::FRAC_PI_2, 3., std::f64::consts::PI, -2.] {
        let mut turned = traffic(heading, 25., 100);
        turned.time_s.clone_from(&table.time_s);
        let (recording, _) = turned.recordings(&options).unwrap().remove(0);
        recording.save(&file).unwrap();
        let again = Recording::load(&file).unwrap();
        assert_eq!((again.vehicle_name(9), again.meta()), (recording.vehicle_name(9), recording.meta()));
        assert_eq!(again.roads(), recording.roads(), "{heading}");
    }
}

#[test]
fn parts_of_a_table_are_read_alike() {
    let mut whole = traffic(0.7, 10., 60);
    whole.time_s.iter_mut().for_each(|time| *time += 100.);
    let options = TrackOptions { rate_hz: Some(5.), ..TrackOptions::default() };
    let (expected, _) = whole.recordings(&options).unwrap().remove(0);
    let layout = whole.layout(&options).unwrap();
    let pick = |rows: std::ops::Range<usize>| {
        let mut part = whole.clone();
        for column in [&mut part.time_s, &mut part.x, &mut part.y] {
            *column = column[rows.clone()].to_vec();
        }
        // Vehicles in the order of another file.
        part.set_names(rows.clone().map(|row| whole.vehicles[whole.vehicle[row] as usize].name.as_str()));
        part.lane = part.lane.map(|lane| lane[rows.clone()].to_vec());
        layout.recording(&part).unwrap().0
    };
    for part in [pick(0..202), pick(202..540)] {
        assert_eq!((part.roads(), part.meta()), (expected.roads(), expected.meta()));
        for track in part.tracks() {
            let whole = expected.tracks().iter().find(|it| it.vehicle == track.vehicle).unwrap();
            let at = whole.row_at(track.first_frame).unwrap();
            let rows = at..at + track.rows.len();
            assert_eq!(part.columns().x[track.rows.clone()], expected.columns().x[rows.clone()]);
            assert_eq!(part.columns().lane[track.rows.clone()], expected.columns().lane[rows]);
            assert_eq!(part.vehicle_name(track.vehicle), expected.vehicle_name(track.vehicle));
        }
    }
    let mut later = whole.clone();
    later.time_s.iter_mut().for_each(|time| *time += 0.05);
    assert!(layout.recording(&later).unwrap_err().to_string().contains("off a frame"));
}

#[test]
fn sizes_that_are_not_known_are_assumed_and_counted() {
    let mut table = traffic(0., 10., 20);
    table.vehicles[0].length = Some(16.5);
    table.vehicles[1].class = Some(VehicleClass::Motorcycle);
    (table.vehicles[2].length, table.vehicles[2].width) = (Some(4.), Some(1.7));
    table.vehicles[3].left_out = Some("are no motor vehicles but of class cyclist".to_owned());
    let (recording, report) = read_table(&table).unwrap();
    let body = |i: usize| (recording.tracks()[i].class, recording.tracks()[i].length, recording.tracks()[i].width);
    assert_eq!(body(0), (VehicleClass::Truck, 16.5, 2.5));
    assert_eq!(body(1), (VehicleClass::Motorcycle, 2.2, 0.8));
    assert_eq!(body(2), (VehicleClass::Car, 4., 1.7));
    assert_eq!(body(3), (VehicleClass::Car, 4.8, 1.8));
    assert_eq!(report.vehicles_left_out.values().sum::<u64>(), 1);
    assert!(report.notes.iter().any(|note| note.contains("6 of 8 vehicles have no length")), "{:?}", report.notes);
    assert_eq!(report.rows_read, 180);
}
