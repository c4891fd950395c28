//! NGSIM's `Preceding` and `Space_Headway`: what is taken from them, and what is not.

use std::collections::BTreeMap;

use gnp_data::{Dataset, IngestReport, NamedLeader, Recording};

use super::ngsim::{HEADER, rows};
use super::{fixtures, put, read_all};

/// Vehicles 1 and 2, 100 ft apart in lane 2, 1 behind, and 3 in lane 1, over four frames; `leader` gives what a row
/// says of the vehicle ahead: number and headway, ft.
fn table(leader: impl Fn(u32, u32) -> (String, String)) -> String {
    let line = |row: &super::ngsim::Row| {
        let mut fields = row.fields();
        fields[2] = "4".into();
        (fields[14], fields[16]) = leader(row.vehicle, row.frame);
        fields.join(",")
    };
    let rows = rows(&[(1, 2, 100.), (2, 2, 200.), (3, 1, 100.)], 0..4);
    format!("{HEADER}\n{}\n", rows.iter().map(line).collect::<Vec<_>>().join("\n"))
}

fn read(text: &str) -> (Recording, IngestReport) {
    let folder = tempfile::tempdir().unwrap();
    read_all(&put(folder.path(), "one.csv", text), Dataset::NGSIM).unwrap().remove(0)
}

#[test]
fn only_what_the_rows_do_not_contradict_is_taken() {
    let text = table(|vehicle, frame| {
        let (leader, headway) = match (vehicle, frame) {
            (1, 0) => ("2", "100"),   // its own row tells
            (1, 1) => ("77", "100"),  // no nearer than vehicle 2
            (1, 2) => ("77", "99.5"), // between the two
            (2, 0) => ("2", "30"),    // itself
            (2, 1) => ("88", "0"),    // no headway
            (2, 2) => ("88", "9999.99"),
            (3, 3) => ("99", "1000"),
            _ => ("0", "50"),
        };
        (leader.into(), headway.into())
    });
    let (recording, report) = read(&text);
    let mut expected = vec![NamedLeader::default(); 12];
    expected[2] = NamedLeader { vehicle: 77, headway: 99.5 * 0.3048 };
    expected[11] = NamedLeader { vehicle: 99, headway: 304.8 };
    let found = recording.columns().named_leader.clone().unwrap();
    for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert!(
            found.vehicle == expected.vehicle && (found.headway - expected.headway).abs() < 1e-4,
            "row {row}: {found:?}"
        );
    }
    assert_eq!(report.named_leaders, 2);
    let reasons = BTreeMap::from([
        ("another vehicle is recorded before it in the lane".to_owned(), 1),
        ("it has a row of its own in the frame".to_owned(), 1),
        ("it is the vehicle itself".to_owned(), 1),
        ("its headway is none".to_owned(), 2),
    ]);
    assert_eq!(report.leaders_not_taken, reasons);
    assert_eq!(report.remarks().len(), 5, "{:?}", report.remarks());
}

#[test]
fn the_columns_need_not_be_there_and_need_not_be_right() {
    let plain = table(|_, _| ("0".into(), "0".into()));
    let without: Vec<String> = plain
        .lines()
        .map(|line| {
            line.split(',').enumerate().filter(|(i, _)| *i != 14).map(|(_, field)| field).collect::<Vec<_>>().join(",")
        })
        .collect();
    for text in [plain.clone(), without.join("\n")] {
        let (recording, report) = read(&text);
        assert_eq!((recording.columns().named_leader.as_ref(), report.notes.len()), (None, 0));
    }
    let (wrong, report) = read(&table(|vehicle, _| ("9".into(), if vehicle == 3 { "NaN".into() } else { "9".into() })));
    assert_eq!(wrong.columns(), read(&plain).0.columns());
    assert!(report.notes.iter().any(|note| note.contains("Space_Headway")), "{:?}", report.notes);
}

#[test]
fn they_are_kept_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("kept.gnprec");
    let (before, _) =
        read(&table(|vehicle, frame| (if vehicle == 2 { "9" } else { "0" }.into(), (20 + frame).to_string())));
    before.save(&file).unwrap();
    let after = Recording::load(&file).unwrap();
    assert!(after.columns().named_leader.is_some());
    assert_eq!(after.columns(), before.columns());
    after.save(&file).unwrap();
    assert_eq!(Recording::load(&file).unwrap().columns(), before.columns());
}

#[test]
fn most_leaders_of_the_embedded_i_80_are_named() {
    let (recording, report) = &read_all(&fixtures("ngsim").join("i80-lanes123.csv.gz"), Dataset::NGSIM).unwrap()[0];
    let reasons: Vec<(&str, u64)> = report.leaders_not_taken.iter().map(|(why, n)| (why.as_str(), *n)).collect();
    assert_eq!((report.named_leaders, reasons), (26_353, vec![("it has a row of its own in the frame", 21_102)]));
    assert_eq!(recording.len(), 47_455);
}
