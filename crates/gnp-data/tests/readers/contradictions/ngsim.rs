//! NGSIM: against positions.

use gnp_data::{DataError, Dataset, IngestReport, Recording};

use super::{counted, says};
use crate::ngsim::{self, HEADER, Row};
use crate::{put, read_all};

/// Twenty vehicles in four lanes for 60 frames.
pub(super) fn traffic() -> Vec<Row> {
    let vehicles: Vec<(u32, i32, f64)> = (0..20).map(|i| (i + 1, 1 + (i % 4) as i32, 60. * f64::from(i))).collect();
    ngsim::rows(&vehicles, 0..60)
}

fn read_ngsim(text: &str) -> Result<(Recording, IngestReport), DataError> {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "made.csv", text);
    read_all(&file, Dataset::NGSIM).map(|mut all| all.remove(0))
}

pub(super) fn ngsim(change: impl Fn(&mut Vec<Row>)) -> Result<(Recording, IngestReport), DataError> {
    let mut rows = traffic();
    change(&mut rows);
    read_ngsim(&ngsim::csv(&rows))
}

/// The rows with the fields of each changed, by place.
fn fields(change: impl Fn(&Row, &mut Vec<String>)) -> String {
    let lines = traffic().into_iter().map(|row| {
        let mut fields = row.fields();
        fields[2] = "60".into();
        change(&row, &mut fields);
        fields.join(",")
    });
    format!("{HEADER}\n{}\n", lines.collect::<Vec<_>>().join("\n"))
}

fn refused_ngsim(result: Result<(Recording, IngestReport), DataError>, parts: &[&str]) {
    let error = result.unwrap_err();
    assert!(matches!(error, DataError::Contradiction { .. }), "{error}");
    says(&error, parts);
}

#[test]
fn ngsim_vehicles_that_drive_backwards() {
    refused_ngsim(
        ngsim(|rows| rows.iter_mut().for_each(|row| row.y = 4000. - row.y)),
        &["made.csv", "line 2", "Local_Y", "20 of 20 vehicles drive backwards", "direction of travel"],
    );
    let back = |rows: &mut Vec<Row>| {
        rows.iter_mut().filter(|row| row.vehicle == 7).for_each(|row| row.y = 2000. - row.y);
    };
    let (recording, report) = ngsim(back).unwrap();
    assert_eq!(counted(&report).0, [("drive backwards", 1)]);
    assert_eq!((recording.tracks().len(), report.rows_read, report.rows), (19, 1200, 1140));
}

#[test]
fn ngsim_sizes() {
    let size = |vehicles: std::ops::Range<u32>, length: f64| {
        ngsim(|rows| rows.iter_mut().filter(|row| vehicles.contains(&row.vehicle)).for_each(|row| row.length = length))
    };
    let no_size = "are of no size a vehicle has (0.5 to 40 m by 0.3 to 5 m)";
    refused_ngsim(size(1..21, 1e9), &["made.csv", "line 2", "v_Length", "20 of 20 vehicles", no_size]);
    let (recording, report) = size(7..8, 1e9).unwrap();
    assert_eq!((counted(&report).0, recording.tracks().len()), (vec![(no_size, 1)], 19));
    // One that changes is that of the first row, and does not move the centre.
    let (recording, report) = ngsim(|rows| rows[20..30].iter_mut().for_each(|row| row.length = 40.)).unwrap();
    let rows = "rows have another size than the first row of their track: the first is taken";
    assert!(counted(&report).1.contains(&(rows, 10)), "{:?}", report.remarks());
    assert_eq!(recording.columns().x, ngsim(|_| {}).unwrap().0.columns().x);
    refused_ngsim(
        ngsim(|rows| rows.iter_mut().for_each(|row| row.length = 15. + f64::from(row.frame % 7))),
        &["v_Length", "rows have another size than the first row"],
    );
}

#[test]
fn ngsim_speeds_that_are_not_those_of_positions() {
    let speed = |vehicle: u32, value: &str| {
        let change = |row: &Row, fields: &mut Vec<String>| {
            if row.vehicle >= vehicle {
                fields[11] = value.into();
            }
        };
        read_ngsim(&fields(change))
    };
    for wrong in ["0", "15.24", "90"] {
        refused_ngsim(speed(1, wrong), &["made.csv", "line 2", "v_Vel", "20 of 20 vehicles have another speed"]);
    }
    let (_, report) = speed(19, "0").unwrap();
    assert_eq!(
        counted(&report),
        (vec![], vec![("vehicles have another speed than their positions: positions are taken", 2)])
    );
    assert_eq!(speed(1, "52").unwrap().1.remarks(), Vec::<String>::new());
}

#[test]
fn ngsim_lanes_that_are_not_those_of_positions() {
    let lane = &["made.csv", "Lane_ID", "contradicts Local_X", "from the left"];
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 2)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 5 - row.lane)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = 1 + (row.frame % 4) as i32)), lane);
    refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.x = 60. - row.x)), lane);
    for change in [&|_| 99, &|lane| lane + 6, &|_| 7] as [&dyn Fn(i32) -> i32; 3] {
        let ramps = &["line 2", "Lane_ID", "1200 of 1200 rows are on ramps", "from the left"];
        refused_ngsim(ngsim(|rows| rows.iter_mut().for_each(|row| row.lane = change(row.lane))), ramps);
    }
    let ninth = ngsim(|rows| rows[..10].iter_mut().for_each(|row| row.lane = 9)).unwrap().0;
    assert_eq!(&ninth.columns().lane[..11], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    let off = |vehicles: std::ops::Range<u32>| {
        ngsim(|rows| rows.iter_mut().filter(|row| vehicles.contains(&row.vehicle)).for_each(|row| row.x += 500.))
    };
    assert_eq!(counted(&off(7..8).unwrap().1).0, [("drive more than 20 m outside the lanes", 1)]);
    refused_ngsim(off(1..6), &["made.csv", "Local_X", "5 of 20 vehicles drive more than 20 m outside"]);
    let (recording, report) = ngsim(|rows| rows[..10].iter_mut().for_each(|row| row.lane = 4)).unwrap();
    let rows = "rows have a Lane_ID that contradicts Local_X: the lane is taken as unknown";
    assert!(counted(&report).1.contains(&(rows, 10)), "{:?}", report.remarks());
    assert_eq!(&recording.columns().lane[..11], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    assert!(recording.neighbour(5, gnp_data::Slot::Following).is_none());
}

#[test]
fn ngsim_leaders_that_positions_contradict() {
    // Vehicle i + 4 is 240 ft before vehicle i; 900 has no rows.
    let leaders = |named: &dyn Fn(&Row) -> (i64, f64)| {
        let (recording, report) = read_ngsim(&fields(|row, fields| {
            let (vehicle, headway) = named(row);
            (fields[14], fields[16]) = (vehicle.to_string(), headway.to_string());
        }))
        .unwrap();
        (recording.columns().named_leader.is_some(), report)
    };
    let ahead = |row: &Row| if row.vehicle <= 16 { i64::from(row.vehicle) + 4 } else { 900 };
    let (taken, report) = leaders(&|row| (ahead(row), 240.));
    assert!(taken && report.named_leaders == 4 * 60);
    assert_eq!(counted(&report), (vec![], vec![]));
    // The distance or the vehicle is wrong throughout: those that cannot be compared are not believed either.
    let rows = |report: &IngestReport| counted(report).1[0].1;
    for wrong in [&|row: &Row| (ahead(row), 120.) as (i64, f64), &|row: &Row| {
        (if row.vehicle > 4 { i64::from(row.vehicle) - 4 } else { 900 }, 240.)
    }] as [&dyn Fn(&Row) -> (i64, f64); 2]
    {
        let (taken, report) = leaders(wrong);
        assert!(!taken && report.named_leaders == 0);
        assert_eq!(rows(&report), 16 * 60, "{:?}", report.remarks());
        assert!(report.leaders_not_taken["most rows that can be compared contradict positions"] >= 60);
    }
    // In one row it is counted.
    let (taken, report) = leaders(&|row| (ahead(row), if row.vehicle == 3 && row.frame == 9 { 300. } else { 240. }));
    assert!(taken);
    assert_eq!(counted(&report).1, [("rows have a headway that is more than 5 m off the positions", 1)]);
    let (taken, report) = leaders(&|_| (-4, 240.));
    assert!(!taken);
    assert_eq!(counted(&report).1, [("rows have a negative number for the vehicle ahead: none is taken", 1200)]);
    let (_, report) = leaders(&|row| (i64::from(row.vehicle), 240.));
    assert_eq!(report.leaders_not_taken["it is the vehicle itself"], 1200);
}

#[test]
fn ngsim_numbers_of_rows_that_are_not_there() {
    let (_, report) =
        read_ngsim(&fields(|row, fields| fields[2] = if row.vehicle < 4 { "99" } else { "60" }.into())).unwrap();
    assert_eq!(
        counted(&report),
        (vec![], vec![("vehicles have another number of rows than Total_Frames says: kept", 3)])
    );
}
