//! Plain tracks from files.

use std::path::{Path, PathBuf};

use gnp_data::{VehicleClass, VelocitySource, discover, read_with};

use super::parquet::{Column, write};
use super::*;
use crate::{put, read_all};

/// The rows of a table as text.
fn text(table: &TrackTable, header: &str) -> String {
    let mut text = format!("{header}\n");
    for i in 0..table.len() {
        let name = &table.vehicles[table.vehicle[i] as usize].name;
        text += &format!("{name},{},{:.4},{:.4}\n", table.time_s[i], table.x[i], table.y[i]);
    }
    text
}

fn plain(folder: &Path) -> PathBuf {
    put(folder, "monday.csv", &text(&traffic(0.3, 10., 10), "id,time,x,y"))
}

/// The message of a text that is refused.
fn refused(text: &str) -> (TrackProblem, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "case.csv", text);
    match read_all(&file, Dataset::TRACKS).unwrap_err() {
        DataError::Tracks { problem, place, what, remedy, .. } => (problem, format!("{place}: {what}; {remedy}")),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_table_of_ten_rows_a_vehicle_is_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    plain(folder.path());
    put(folder.path(), "readme.txt", "made on a Monday\n");
    let (recording, report) = read_all(folder.path(), Dataset::TRACKS).unwrap().remove(0);
    assert_eq!((report.rows, report.vehicles, report.rate_hz, &*report.recording), (90, 9, 10., "monday"));
    assert_eq!(recording.vehicle_name(3), "car 2");
    let (expected, _) = read_table(&traffic(0.3, 10., 10)).unwrap();
    let off = recording.columns().x.iter().zip(&expected.columns().x).map(|(a, b)| (a - b).abs()).fold(0., f32::max);
    assert!(off < 1e-3, "{off}");
}

#[test]
fn columns_have_other_names_orders_and_units() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = String::from(
        "\u{feff}Type,timestamp_ms,Position_Y,TRACK_ID,position_x,yaw_deg,V,Length,width,Lane_ID,colour\n",
    );
    for i in 0..20 {
        let x = 400_000. + 2.5 * f64::from(i);
        rows += &format!("Truck,{},5800000.25,7,{x},0,25,12.5,2.5,1,red\n", 1_600_000_000_000i64 + 100 * i64::from(i));
        rows += &format!(
            "car,{},5799996.6,4,{},0,20,,,2,\n",
            1_600_000_000_000i64 + 100 * i64::from(i),
            x + 10. - 0.5 * f64::from(i)
        );
        rows += &format!("pedestrian,{},5799990,9,400020,90,1,,,,\n", 1_600_000_000_000i64 + 100 * i64::from(i));
    }
    put(folder.path(), "case.csv", &rows);
    let (recording, report) = read_all(folder.path(), Dataset::TRACKS).unwrap().remove(0);
    let bodies: Vec<_> = recording.tracks().iter().map(|t| (t.vehicle, t.class, t.length, t.width)).collect();
    assert_eq!(bodies, [(4, VehicleClass::Car, 4.8, 1.8), (7, VehicleClass::Truck, 12.5, 2.5)]);
    assert_eq!(recording.meta().velocities, VelocitySource::Recorded);
    assert_eq!(recording.meta().start_s, 1_600_000_000.);
    assert_eq!(report.vehicles_left_out.len(), 1, "{:?}", report.vehicles_left_out);
    // 3.65 m between the lanes, and no centimetre lost far from the origin.
    let c = recording.columns();
    assert!((c.y[20] - c.y[0] - 3.65).abs() < 1e-3 && (c.x[1] - c.x[0] - 2.).abs() < 1e-3, "{} {}", c.y[20], c.y[0]);
    assert_eq!((c.lane[0], c.lane[20]), (2, 1));
}

#[test]
fn gzip_blanks_and_parquet_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let table = traffic(0.3, 10., 12);
    let names: Vec<String> = table.vehicle.iter().map(|v| format!("{}", 10 + v)).collect();
    let mut csv = String::from("id,time,x,y\n");
    for (i, name) in names.iter().enumerate() {
        csv += &format!("{name},{},{},{}\n", table.time_s[i], table.x[i], table.y[i]);
    }
    put(folder.path(), "a.csv", &csv);
    std::fs::write(folder.path().join("b.csv.gz"), crate::gzip(&csv)).unwrap();
    put(folder.path(), "c.txt", &csv.replace(',', "  "));
    let position = |name, values: &[f64]| (name, Column::Double(values.to_vec()));
    let ids: Vec<i64> = table.vehicle.iter().map(|v| 10 + i64::from(*v)).collect();
    let moments = table.time_s.iter().map(|t| (t * 1e6).round() as i64).collect();
    let (x, y) = (position("x", &table.x), position("y", &table.y));
    write(
        &folder.path().join("d.parquet"),
        &[x.clone(), y.clone(), ("id", Column::Long(ids)), position("t", &table.time_s)],
        1000,
    );
    let columns = [x, y, ("Vehicle", Column::Text(names)), ("timestamp", Column::Moment(moments))];
    write(&folder.path().join("e.parquet"), &columns, 25);
    let all = read_all(folder.path(), Dataset::TRACKS).unwrap();
    assert_eq!(all.iter().map(|(_, report)| report.recording.as_str()).collect::<Vec<_>>(), ["a", "b", "c", "d", "e"]);
    for (recording, _) in &all[1..] {
        assert_eq!((recording.columns(), recording.tracks()), (all[0].0.columns(), all[0].0.tracks()));
    }
    assert_eq!(all[0].0.tracks()[0].vehicle, 10);
}

#[test]
fn a_lower_rate_and_lines_go_along() {
    let folder = tempfile::tempdir().unwrap();
    plain(folder.path());
    let source = &discover(folder.path(), Dataset::TRACKS).unwrap()[0];
    let options = TrackOptions { rate_hz: Some(5.), ..TrackOptions::default() };
    let (recording, _) = read_with(source, Dataset::TRACKS, &options).unwrap().remove(0);
    assert_eq!((recording.meta().rate_hz, recording.len()), (5., 45));
    let lines = Some([-0.1, 3.6, 7.2, 10.8].map(|y| gnp_data::LaneMarking::new(y, false)).to_vec());
    let options = TrackOptions { lines, ..options };
    let (recording, _) = read_with(source, Dataset::TRACKS, &options).unwrap().remove(0);
    assert_eq!(recording.roads()[0].lines.len(), 4);
    // Formats with a road of their own refuse another one.
    let source = &discover(&crate::fixtures("ngsim"), Dataset::NGSIM).unwrap()[0];
    let error = read_with(source, Dataset::NGSIM, &options).unwrap_err().to_string();
    assert!(error.contains("NGSIM") && error.contains("leave them out"), "{error}");
}

#[test]
fn what_is_wrong_is_said_with_line_and_column() {
    let good = text(&traffic(0., 10., 10), "id,time,x,y");
    let line = |n: usize| good.lines().nth(n - 1).unwrap().to_owned();
    let value = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let file = put(folder.path(), "case.csv", text);
        read_all(&file, Dataset::TRACKS).unwrap_err()
    };
    for (from, to, parts) in [
        (line(7), line(7).replacen("car 5", "", 1), ["line 7", "`id`", "empty"]),
        (line(7), "car 5,0.0,nan,9".to_owned(), ["line 7", "`x`", "not finite"]),
        (line(7), "car 5,zero,1,9".to_owned(), ["line 7", "`time`", "not a number"]),
        (line(7), "car 5,0,1".to_owned(), ["line 7", "3 fields", "4 are due"]),
    ] {
        let error = value(&good.replace(&from, &to)).to_string();
        assert!(error.contains("case.csv") && parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
    }
    let late = good.replacen("car 8,0.9,", "car 8,0.93,", 1);
    let (problem, message) = refused(&late);
    assert!(problem == TrackProblem::Time && message.contains("line 91, column `time`"), "{message}");
    let far = good.replacen("id,time,x,y", "id,time,pos_x,y", 1).replacen("car 4,0,100.0000", "car 4,0,1e12", 1);
    let (problem, message) = refused(&far);
    assert!(problem == TrackProblem::Value && message.contains("line 6, column `pos_x`"), "{message}");
}

#[test]
fn headers_that_say_too_little_or_too_much_are_named() {
    let rows = "1,0,0,0\n1,1,1,1\n";
    let (problem, message) = refused(&format!("frame,id,x,y\n{rows}"));
    assert!(problem == TrackProblem::Columns && message.contains("`time` is missing"), "{message}");
    assert!(message.contains("frame / rate"), "{message}");
    let (_, message) = refused(&format!("id,time,x,pos_x,y\n{rows}"));
    assert!(message.contains("`x` and `pos_x`"), "{message}");
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "case.csv", "id;time;x;y\n1;0;0;0\n");
    let error = read_all(&file, Dataset::TRACKS).unwrap_err();
    assert!(matches!(error, DataError::Delimiter { found: ';', .. }), "{error}");
    // Other tables are left alone, also beside tracks.
    put(folder.path(), "case.csv", "id,x,y,weight\n1,0,0,0\n");
    let error = read_all(folder.path(), Dataset::TRACKS).unwrap_err();
    assert!(
        matches!(error, DataError::NoRecordings { .. }) && error.to_string().contains("id, time, x and y"),
        "{error}"
    );
    let error = read_all(&crate::fixtures("ngsim"), Dataset::TRACKS).unwrap_err().to_string();
    assert!(error.contains("a table of NGSIM; choose that dataset"), "{error}");
    let error = read_all(&file, Dataset::NGSIM).unwrap_err().to_string();
    assert!(!error.contains("Plain tracks"), "{error}");
    plain(folder.path());
    let error = read_all(&folder.path().join("monday.csv"), Dataset::NGSIM).unwrap_err().to_string();
    assert!(error.contains("a table of Plain tracks; choose that dataset"), "{error}");
}

#[test]
fn parquet_that_cannot_be_read_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("case.parquet");
    let numbers = || Column::Double((0..20).map(f64::from).collect());
    let names = |n: usize| Column::Text((0..n).map(|i| format!("{}", i / 10)).collect());
    let read = || read_all(&file, Dataset::TRACKS).unwrap_err().to_string();
    let single = || Column::Single((0..20u8).map(f32::from).collect());
    write(&file, &[("id", names(20)), ("time", names(20)), ("x", single()), ("y", numbers())], 100);
    assert!(read().contains("column `time`") && read().contains("numbers"), "{}", read());
    write(&file, &[("id", Column::Flag(vec![true; 20])), ("time", numbers()), ("x", numbers()), ("y", numbers())], 100);
    assert!(read().contains("column `id`: it holds BOOLEAN"), "{}", read());
    let mut x: Vec<f64> = (0..20).map(f64::from).collect();
    x[13] = f64::NAN;
    write(&file, &[("id", names(20)), ("time", numbers()), ("x", Column::Double(x)), ("y", numbers())], 7);
    assert!(read().contains("case.parquet, row 13, column `x`"), "{}", read());
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    assert!(read().contains("case.parquet: the table cannot be read"), "{}", read());
    for at in (4..whole.len()).step_by(11) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        std::fs::write(&file, &damaged).unwrap();
        if let Err(error) = read_all(&file, Dataset::TRACKS) {
            assert!(error.to_string().contains("case"), "{at}: {error}");
        }
    }
}
