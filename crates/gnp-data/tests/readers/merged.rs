//! The merged export: several sites and periods in one file of 25 columns, in any order.

use gnp_data::{Dataset, Recording};

use super::ngsim::{Row, START, rows};
use super::{put, read_all};

const HEADER: &str = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_length,v_Width,v_Class,v_Vel,v_Acc,Lane_ID,O_Zone,D_Zone,Int_ID,Section_ID,Direction,Movement,Preceding,Following,Space_Headway,Time_Headway,Location";

/// A row of the merged export; it has no zones on motorways.
fn line(row: &Row, site: &str) -> String {
    let f = row.fields();
    format!("{},,,,,,,{},{site}", f[..14].join(","), f[14..].join(","))
}

fn later(rows: &[Row], ms: i64) -> Vec<Row> {
    rows.iter().map(|row| Row { time: row.time + ms, ..row.clone() }).collect()
}

/// Lines of two periods of US-101 with the same vehicle and frame numbers, one of I-80, and a street.
fn lines() -> Vec<String> {
    let first = rows(&[(1, 1, 100.), (2, 2, 130.)], 10..20);
    let second = later(&rows(&[(1, 2, 400.)], 10..25), 900_000);
    let other = later(&rows(&[(1, 3, 50.)], 10..16), -5_733_676_500);
    let street = rows(&[(1, 1, 50.)], 0..3);
    let mut lines: Vec<String> = Vec::new();
    lines.extend(first.iter().map(|row| line(row, "us-101")));
    lines.extend(street.iter().map(|row| line(row, "lankershim")));
    lines.extend(second.iter().map(|row| line(row, "us-101")));
    lines.extend(other.iter().map(|row| line(row, "i-80")));
    lines
}

fn summary(all: &[(Recording, gnp_data::IngestReport)]) -> Vec<(&str, &str, u64, u64)> {
    all.iter().map(|(r, q)| (r.meta().name.as_str(), r.meta().site.as_str(), q.vehicles, q.rows)).collect()
}

#[test]
fn sites_and_periods_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "export.csv", &format!("{HEADER}\n{}\n", lines().join("\n")));
    let all = read_all(&file, Dataset::NGSIM).unwrap();
    assert_eq!(
        summary(&all),
        [("export-i-80-1", "i-80", 1, 6), ("export-us-101-1", "us-101", 2, 20), ("export-us-101-2", "us-101", 1, 15),]
    );
    // Vehicle 1 of the second period starts elsewhere than vehicle 1 of the first: not joined.
    assert!((all[2].0.state(0).x - (400. - 10.) * 0.3048).abs() < 1e-3);
    let skipped: u64 = all.iter().flat_map(|(_, q)| q.skipped_rows.values()).sum();
    assert_eq!(skipped, 3);
    assert!(all[0].1.skipped_rows.keys().all(|reason| reason.contains("lankershim")), "{:?}", all[0].1.skipped_rows);
}

#[test]
fn rows_in_any_order_and_repeated_give_the_same_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let sorted = put(folder.path(), "sorted/export.csv", &format!("{HEADER}\n{}\n", lines().join("\n")));
    let mut shuffled = lines();
    shuffled.extend(lines().into_iter().step_by(7));
    // A fixed permutation: 61 lines at most, 37 is coprime to their number.
    let n = shuffled.len();
    let order: Vec<String> = (0..n).map(|i| shuffled[i * 37 % n].clone()).collect();
    assert_eq!(order.iter().collect::<std::collections::BTreeSet<_>>().len(), lines().len());
    let mixed = put(folder.path(), "mixed/export.csv", &format!("{HEADER}\n{}\n", order.join("\n")));
    let (sorted, mixed) = (read_all(&sorted, Dataset::NGSIM).unwrap(), read_all(&mixed, Dataset::NGSIM).unwrap());
    assert_eq!(summary(&sorted), summary(&mixed));
    for (a, b) in sorted.iter().zip(&mixed) {
        assert_eq!(a.0.columns(), b.0.columns());
        assert_eq!(a.0.tracks(), b.0.tracks());
    }
    let counts = |all: &[(Recording, gnp_data::IngestReport)]| {
        let sum = |of: fn(&gnp_data::IngestReport) -> u64| all.iter().map(|(_, q)| of(q)).sum::<u64>();
        (sum(|q| q.duplicates), sum(|q| q.conflicts), sum(|q| q.out_of_order) > 0)
    };
    assert_eq!(counts(&sorted), (0, 0, false));
    // 44 lines, every seventh twice: 7, of which one is of the street.
    assert_eq!(counts(&mixed), (6, 0, true));
}

#[test]
fn what_is_wrong_in_rows_of_streets_does_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let street = line(&rows(&[(1, 1, 50.)], 0..1)[0], "lankershim");
    let header: Vec<&str> = HEADER.split(',').collect();
    let bad = |column: &str, value: &str| {
        let place = header.iter().position(|name| name.eq_ignore_ascii_case(column)).unwrap();
        let mut fields: Vec<&str> = street.split(',').collect();
        fields[place] = value;
        fields.join(",")
    };
    let all = [("v_Length", "0"), ("v_Class", "4"), ("v_Vel", "400"), ("Local_X", "1e9"), ("Lane_ID", "-1")];
    let lines: Vec<String> = lines().into_iter().chain(all.map(|(column, value)| bad(column, value))).collect();
    let file = put(folder.path(), "export.csv", &format!("{HEADER}\n{}\n", lines.join("\n")));
    let read = read_all(&file, Dataset::NGSIM).unwrap();
    let skipped =
        |all: &[(Recording, gnp_data::IngestReport)]| all[0].1.skipped_rows["site lankershim is not a motorway"];
    assert!(skipped(&read) >= all.len() as u64);
    let damaged = format!("{HEADER}\n{}\n", lines.join("\n").replace("lankershim", "us-101"));
    assert!(read_all(&put(folder.path(), "bad/export.csv", &damaged), Dataset::NGSIM).is_err());
}

#[test]
fn a_file_of_streets_alone_is_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    let street: Vec<String> = rows(&[(1, 1, 50.)], 0..3).iter().map(|row| line(row, "peachtree")).collect();
    let file = put(folder.path(), "export.csv", &format!("{HEADER}\n{}\n", street.join("\n")));
    let message = read_all(&file, Dataset::NGSIM).unwrap_err().to_string();
    assert!(message.contains("export.csv") && message.contains("peachtree"), "{message}");
}

#[test]
fn an_id_that_returns_after_a_gap_is_another_segment() {
    let folder = tempfile::tempdir().unwrap();
    let mut both = rows(&[(1, 1, 100.)], 10..15);
    both.extend(rows(&[(1, 3, 700.)], 30..33));
    assert_eq!(both[5].time, START + 3000);
    let text: Vec<String> = both.iter().map(|row| line(row, "us-101")).collect();
    let file = put(folder.path(), "export.csv", &format!("{HEADER}\n{}\n", text.join("\n")));
    let (recording, quality) = &read_all(&file, Dataset::NGSIM).unwrap()[0];
    let tracks: Vec<_> =
        recording.tracks().iter().map(|t| (t.vehicle, t.segment, t.first_frame, t.rows.len())).collect();
    assert_eq!(tracks, [(1, 0, 10, 5), (1, 1, 30, 3)]);
    assert_eq!((quality.vehicles, quality.gaps), (1, 1));
    // No velocity is taken across the gap.
    assert!(recording.columns().vx.iter().all(|vx| (vx - 15.24).abs() < 1e-2));
}
