//! NGSIM: feet to metres, front to centre, lanes, slots.

use gnp_data::{Dataset, MarkingKind, Slot, VehicleClass};

use super::{fixtures, put, read_all};

pub(crate) const HEADER: &str = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,v_Vel,v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway";

/// A row of 18 columns.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) vehicle: u32,
    pub(crate) frame: u32,
    pub(crate) time: i64,
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) length: f64,
    pub(crate) lane: i32,
}

impl Row {
    pub(crate) fn fields(&self) -> Vec<String> {
        let Self { vehicle, frame, time, x, y, length, lane } = self;
        format!(
            "{vehicle},{frame},99,{time},{x:.3},{y:.3},6451137.641,1873344.962,{length:.1},6.6,2,50,0.5,{lane},0,0,0,0"
        )
        .split(',')
        .map(str::to_owned)
        .collect()
    }
}

pub(crate) const START: i64 = 1_118_846_978_900;

/// Vehicles given as (id, lane, first Local_Y in feet); each goes 5 ft a frame, in the middle of
/// lanes 12 ft wide.
pub(crate) fn rows(vehicles: &[(u32, i32, f64)], frames: std::ops::Range<u32>) -> Vec<Row> {
    let row = |(vehicle, lane, start): (u32, i32, f64), frame: u32| Row {
        vehicle,
        frame,
        time: START + 100 * i64::from(frame),
        x: 12. * f64::from(lane) - 6.,
        y: start + 5. * f64::from(frame - frames.start),
        length: 20.,
        lane,
    };
    vehicles.iter().flat_map(|vehicle| frames.clone().map(|frame| row(*vehicle, frame))).collect()
}

pub(crate) fn csv(rows: &[Row]) -> String {
    let lines: Vec<String> = rows.iter().map(|row| row.fields().join(",")).collect();
    format!("{HEADER}\n{}\n", lines.join("\n"))
}

#[test]
fn a_row_of_known_feet_stands_where_its_metres_say() {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "one.csv", &csv(&rows(&[(4, 2, 110.)], 7..12)));
    let [(recording, _)] = &read_all(&file, Dataset::NGSIM).unwrap()[..] else { panic!("one recording") };
    let track = &recording.tracks()[0];
    assert_eq!((track.vehicle, track.first_frame, track.rows.clone()), (4, 7, 0..5));
    assert_eq!(track.class, VehicleClass::Car);
    assert!((track.length - 6.096).abs() < 1e-4 && (track.width - 2.01168).abs() < 1e-4);
    let state = recording.state(0);
    // The front is at 110 ft, the centre 10 ft behind; 18 ft right of the left edge.
    assert!((state.x - 30.48).abs() < 1e-4, "{state:?}");
    assert!((state.y + 5.4864).abs() < 1e-4, "{state:?}");
    for row in 0..5 {
        // 5 ft in 0.1 s at the ends (one-sided) as inside (central).
        assert!((recording.state(row).vx - 15.24).abs() < 1e-2);
        assert_eq!(recording.state(row).vy, 0.);
    }
    assert_eq!(recording.meta().rate_hz, 10.);
    assert_eq!(recording.meta().site, "ngsim");
}

/// Local_X and Local_Y of the centre, in metres: what a forecast is given back in.
#[test]
fn positions_go_back_to_the_plane_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "one.csv", &csv(&rows(&[(4, 2, 110.)], 7..12)));
    let [(recording, _)] = &read_all(&file, Dataset::NGSIM).unwrap()[..] else { panic!("one recording") };
    let [x, y] = recording.to_file_coordinates(0, [recording.columns().x[0], recording.columns().y[0]]);
    // 20 ft long: the centre is 10 ft behind the front.
    assert!((x - 18. * 0.3048).abs() < 1e-4 && (y - 100. * 0.3048).abs() < 1e-4, "{x} {y}");
}

#[test]
fn a_vehicle_that_moves_to_a_smaller_local_x_moves_left() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = rows(&[(1, 3, 0.)], 0..6);
    rows.iter_mut().for_each(|row| row.x -= f64::from(row.frame));
    let file = put(folder.path(), "one.csv", &csv(&rows));
    let (recording, _) = &read_all(&file, Dataset::NGSIM).unwrap()[0];
    assert!((recording.state(3).vy - 3.048).abs() < 1e-3);
    assert!(recording.state(5).y > recording.state(0).y);
}

#[test]
fn slots_and_lines_come_from_lanes() {
    let folder = tempfile::tempdir().unwrap();
    let vehicles = [(1, 2, 300.), (2, 2, 400.), (3, 2, 200.), (4, 1, 310.), (5, 1, 380.), (6, 3, 240.)];
    let file = put(folder.path(), "one.csv", &csv(&rows(&vehicles, 0..40)));
    let (recording, quality) = &read_all(&file, Dataset::NGSIM).unwrap()[0];
    let vehicle = |slot: Slot| recording.neighbour(5, slot).map(|t| recording.tracks()[t].vehicle);
    assert_eq!(vehicle(Slot::Preceding), Some(2));
    assert_eq!(vehicle(Slot::Following), Some(3));
    assert_eq!(vehicle(Slot::LeftAlongside), Some(4));
    assert_eq!(vehicle(Slot::LeftPreceding), Some(5));
    assert_eq!(vehicle(Slot::LeftFollowing), None);
    assert_eq!(vehicle(Slot::RightFollowing), Some(6));
    assert_eq!(vehicle(Slot::RightAlongside), None);

    let road = &recording.roads()[0];
    assert!(road.fitted);
    let lines: Vec<(MarkingKind, f32)> = road.lines.iter().map(|line| (line.kind, line.y)).collect();
    let expected = [
        (MarkingKind::Boundary, -10.9752),
        (MarkingKind::LaneDivider, -7.3152),
        (MarkingKind::LaneDivider, -3.6576),
        (MarkingKind::Boundary, 0.0024),
    ];
    for (found, expected) in lines.iter().zip(expected) {
        assert!(found.0 == expected.0 && (found.1 - expected.1).abs() < 1e-3, "{lines:?}");
    }
    assert_eq!((lines.len() as u64, quality.lane_lines), (4, 4));
    assert!(!quality.simulated);
}

#[test]
fn the_embedded_scenes_are_whole_and_plausible() {
    let all = read_all(&fixtures("ngsim"), Dataset::NGSIM).unwrap();
    assert_eq!(all.len(), 18);
    assert!(all.windows(2).all(|pair| pair[0].0.meta().name < pair[1].0.meta().name));
    for (recording, quality) in &all {
        let meta = recording.meta();
        assert_eq!(meta.site, if meta.name.starts_with("i80") { "i-80" } else { "us-101" });
        assert_eq!((quality.duplicates, quality.conflicts, quality.rows_read), (0, 0, quality.rows));
        let lines = &recording.roads()[0].lines;
        for pair in lines.windows(2) {
            let width = pair[1].y - pair[0].y;
            assert!((2.5..5.5).contains(&width), "{}: a lane {width} m wide", meta.name);
        }
        // Vehicles keep within the edges, but for a few rows.
        let (right, left) = (lines[0].y, lines[lines.len() - 1].y);
        let off = recording.columns().y.iter().filter(|y| !(right..left).contains(*y)).count();
        assert!(off * 50 < recording.len(), "{}: {off} rows off the road", meta.name);
    }
    let (i80, quality) = &all[0];
    assert_eq!((quality.rows, quality.vehicles, quality.tracks, quality.gaps), (47_455, 100, 102, 2));
    assert_eq!(i80.roads()[0].lines.len(), 4);
}

#[test]
fn the_leader_of_the_slots_is_the_leader_of_the_file() {
    // Where the embedded I-80 names a leader that is in the file, the slot must hold it.
    use std::io::Read as _;
    let file = fixtures("ngsim").join("i80-lanes123.csv.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(&file).unwrap()).read_to_string(&mut text).unwrap();
    let (recording, _) = &read_all(&file, Dataset::NGSIM).unwrap()[0];
    let mut checked = 0;
    for line in text.lines().skip(1).step_by(50) {
        let field = |i: usize| line.split(',').nth(i).unwrap().parse::<f64>().unwrap() as u32;
        let (vehicle, frame, leader) = (field(0), field(1), field(14));
        let row = |vehicle| recording.tracks().iter().filter(|t| t.vehicle == vehicle).find_map(|t| t.row_at(frame));
        let (Some(row), Some(_)) = (row(vehicle), row(leader)) else { continue };
        let slot = recording.neighbour(row, Slot::Preceding).map(|t| recording.tracks()[t].vehicle);
        assert_eq!(slot, Some(leader), "vehicle {vehicle}, frame {frame}");
        checked += 1;
    }
    assert!(checked > 50, "only {checked} rows have their leader in the file");
}
