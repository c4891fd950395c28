//! Argoverse 2 scenarios.

use std::path::Path;

use gnp_data::{VehicleClass, VelocitySource};

use super::parquet::{Column, write};
use super::*;
use crate::read_all;

/// Columns of a scenario, as the authors' own program writes them. `kinds` are the object types of the vehicles.
fn scenario(table: &TrackTable, kinds: &[&str]) -> Vec<(&'static str, Column)> {
    let rows = 0..table.len();
    let name = |i: usize| {
        let vehicle = table.vehicle[i];
        if vehicle == 0 { "AV".to_owned() } else { format!("{}", 139_000 + vehicle) }
    };
    let text = |of: &dyn Fn(usize) -> String| Column::Text(rows.clone().map(of).collect());
    let long = |of: &dyn Fn(usize) -> i64| Column::Long(rows.clone().map(of).collect());
    let step = |i: usize| (10. * table.time_s[i]).round() as i64;
    let slope = |values: &[f64]| {
        let of = table.vehicles.len();
        let next = |i: usize| if i + of < values.len() { (i, i + of) } else { (i - of, i) };
        Column::Double(rows.clone().map(|i| 10. * (values[next(i).1] - values[next(i).0])).collect())
    };
    let (Column::Double(vx), Column::Double(vy)) = (slope(&table.x), slope(&table.y)) else { panic!() };
    let heading = vx.iter().zip(&vy).map(|(x, y)| y.atan2(*x)).collect();
    vec![
        ("observed", Column::Flag(rows.clone().map(|i| step(i) < 50).collect())),
        ("track_id", text(&name)),
        ("object_type", text(&|i| kinds[table.vehicle[i] as usize % kinds.len()].to_owned())),
        ("object_category", long(&|_| 2)),
        ("timestep", long(&step)),
        ("position_x", Column::Double(table.x.iter().map(|x| x + 3200.).collect())),
        ("position_y", Column::Double(table.y.iter().map(|y| y - 1500.).collect())),
        ("heading", Column::Double(heading)),
        ("velocity_x", Column::Double(vx)),
        ("velocity_y", Column::Double(vy)),
        ("scenario_id", text(&|_| "0a0a2bb7".to_owned())),
        ("start_timestamp", long(&|_| 315_966_265_259_836_000)),
        ("end_timestamp", long(&|_| 315_966_276_159_836_000)),
        ("num_timestamps", long(&|_| 110)),
        ("focal_track_id", text(&|_| "139004".to_owned())),
        ("city", text(&|_| "Austin".to_owned())),
    ]
}

fn put(folder: &Path, table: &TrackTable, kinds: &[&str]) {
    let folder = folder.join("0a0a2bb7");
    std::fs::create_dir_all(&folder).unwrap();
    write(&folder.join("scenario_0a0a2bb7.parquet"), &scenario(table, kinds), 10_000);
    std::fs::write(folder.join("log_map_archive_0a0a2bb7.json"), "{}").unwrap();
}

#[test]
fn a_scenario_on_a_straight_road_is_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = ["vehicle", "bus", "vehicle", "motorcyclist", "vehicle", "pedestrian", "vehicle", "unknown", "vehicle"];
    put(folder.path(), &traffic(1.1, 10., 110), &kinds);
    let (recording, report) = read_all(folder.path(), Dataset::AV2).unwrap().remove(0);
    assert_eq!((report.rate_hz, report.frames, report.vehicles), (10., [0, 109], 7));
    assert_eq!((&*report.recording, &*report.site), ("scenario_0a0a2bb7", "austin"));
    assert_eq!(recording.meta().velocities, VelocitySource::Recorded);
    assert_eq!(recording.vehicle_name(1), "AV");
    let class = |name: &str| {
        let vehicle = recording.vehicle_named(name).unwrap();
        recording.tracks().iter().find(|track| track.vehicle == vehicle).unwrap().class
    };
    assert_eq!(
        [class("AV"), class("139001"), class("139003")],
        [VehicleClass::Car, VehicleClass::Truck, VehicleClass::Motorcycle]
    );
    let left_out: Vec<&str> = report.vehicles_left_out.keys().map(String::as_str).collect();
    assert_eq!(left_out, ["are of class pedestrian", "are of class unknown"]);
    assert!(report.notes.iter().any(|note| note.contains("vehicle 139004")), "{:?}", report.notes);
    assert_eq!(recording.roads()[0].lines.len(), 4, "{:?}", report.notes);
}

#[test]
fn a_junction_is_refused_and_other_files_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let mut junction = traffic(0., 10., 110);
    for i in 0..junction.len() {
        // Half of them turn left within the scenario.
        let (at, turns) = ((junction.x[i] - 120.) / 40., junction.vehicle[i].is_multiple_of(2));
        if turns && at > 0. {
            let angle = at.min(std::f64::consts::FRAC_PI_2);
            let rest = (at - angle) * 40.;
            junction.x[i] = 120. + 40. * angle.sin();
            junction.y[i] += 40. * (1. - angle.cos()) + rest;
        }
    }
    put(folder.path(), &junction, &["vehicle"]);
    let error = read_all(folder.path(), Dataset::AV2).unwrap_err();
    let DataError::Tracks { problem: TrackProblem::Road, .. } = &error else { panic!("{error}") };
    assert!(
        error.to_string().contains("scenario_0a0a2bb7.parquet, row") && error.to_string().contains("--road"),
        "{error}"
    );
    let error = read_all(folder.path(), Dataset::TRACKS).unwrap_err().to_string();
    assert!(error.contains("a table of Argoverse 2; choose that dataset"), "{error}");

    let other = folder.path().join("0a0a2bb7/scenario_0a0a2bb7.parquet");
    let columns: Vec<(&str, Column)> =
        scenario(&traffic(0., 10., 20), &["vehicle"]).into_iter().filter(|(name, _)| *name != "heading").collect();
    write(&other, &columns, 100);
    let error = read_all(&other, Dataset::AV2).unwrap_err();
    assert!(matches!(&error, DataError::MissingColumn { column, .. } if column == "heading"), "{error}");
}
