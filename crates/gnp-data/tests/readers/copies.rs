//! Recordings that are copies or cuts of others.

use gnp_data::{Copies, DataError, Dataset, Fingerprint, Recording, Taken};

use super::highd::scene;
use super::ngsim::{HEADER, Row, csv, rows};
use super::{fixtures, put, read_all};

/// A recording of a text.
fn recording(name: &str, rows: &[Row]) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), &format!("{name}.csv"), &csv(rows));
    read_all(&file, Dataset::NGSIM).unwrap().remove(0).0
}

/// Names that are left out, each with that of the recording it is a copy of.
fn left_out(recordings: &[&Recording]) -> Vec<(String, String)> {
    let mut copies = Copies::default();
    let taken = recordings.iter().flat_map(|recording| match copies.take(Fingerprint::of(recording)).unwrap() {
        Taken::Kept(left_out) => left_out,
        Taken::LeftOut(copy) => vec![copy],
    });
    taken.map(|copy| (copy.recording, copy.copy_of)).collect()
}

fn pair(a: &str, b: &str) -> Vec<(String, String)> {
    vec![(a.to_owned(), b.to_owned())]
}

/// Twelve vehicles for twenty seconds.
fn traffic() -> Vec<Row> {
    let vehicles: Vec<(u32, i32, f64)> = (1..=12).map(|i| (i, 1 + i as i32 % 3, 120. * f64::from(i))).collect();
    rows(&vehicles, 40..240)
}

#[test]
fn the_same_rows_under_another_name_are_a_copy_however_they_are_sorted() {
    let (a, mut mixed) = (recording("a", &traffic()), traffic());
    mixed.sort_by_key(|row| row.frame);
    let b = recording("b", &mixed);
    assert_eq!(left_out(&[&a, &b]), pair("b", "a"));
    assert_eq!(left_out(&[&b, &a]), pair("b", "a"), "the later by name, whichever comes first");
    // Rounded otherwise.
    let mut rounded = traffic();
    rounded.iter_mut().for_each(|row| row.y = (row.y * 100.).round() / 100. + 0.004);
    assert_eq!(left_out(&[&a, &recording("c", &rounded)]), pair("c", "a"));
    // One name, other rows.
    let mut copies = Copies::default();
    copies.take(Fingerprint::of(&a)).unwrap();
    let other = copies.take(Fingerprint::of(&recording("a", &rows(&[(1, 1, 0.)], 0..8)))).unwrap_err();
    assert!(matches!(&other, DataError::DuplicateRecording { recording } if recording == "a"), "{other}");
    // Too short for a sample: told by all rows together.
    let short = |name| recording(name, &rows(&[(1, 1, 0.)], 0..8));
    assert_eq!(left_out(&[&short("a"), &short("b")]), pair("b", "a"));
}

#[test]
fn of_a_recording_and_a_cut_of_it_the_cut_is_left_out() {
    let (all, cut) = (traffic(), |keep: &dyn Fn(&Row) -> bool| {
        recording("cut", &traffic().into_iter().filter(|row| keep(row)).collect::<Vec<_>>())
    });
    let whole = recording("whole", &all);
    for cut in [cut(&|row| (97..190).contains(&row.frame)), cut(&|row| row.vehicle < 4)] {
        assert_eq!(left_out(&[&whole, &cut]), pair("cut", "whole"));
        assert_eq!(left_out(&[&cut, &whole]), pair("cut", "whole"), "also when the whole comes later");
    }
    // Two cuts of one recording go when it comes, and only they.
    let [first, second] = [40..130, 130..240].map(|frames: std::ops::Range<u32>| {
        let rows: Vec<Row> = traffic().into_iter().filter(|row| frames.contains(&row.frame)).collect();
        recording(&format!("from-{}", frames.start), &rows)
    });
    assert_eq!(left_out(&[&first, &second]), []);
    assert_eq!(left_out(&[&first, &second, &whole]).len(), 2);
}

#[test]
fn other_traffic_and_partial_overlaps_are_no_copies() {
    let a = recording("a", &traffic());
    let changed = |change: &dyn Fn(&mut Row)| {
        let mut rows = traffic();
        rows.iter_mut().for_each(change);
        recording("b", &rows)
    };
    // The same vehicle numbers and frames at other places, other frames, other numbers.
    assert_eq!(left_out(&[&a, &changed(&|row| row.y += 40.)]), []);
    assert_eq!(left_out(&[&a, &changed(&|row| row.frame += 1600)]), []);
    assert_eq!(left_out(&[&a, &changed(&|row| row.vehicle += 100)]), []);
    // Half of its vehicles, and others.
    assert_eq!(left_out(&[&a, &changed(&|row| row.y += if row.vehicle > 6 { 40. } else { 0. })]), []);
    // One vehicle in twenty elsewhere is a copy all the same.
    assert_eq!(left_out(&[&a, &changed(&|row| row.y += if row.vehicle > 11 { 40. } else { 0. })]), pair("b", "a"));
}

#[test]
fn a_period_beside_the_merged_export_is_a_copy_though_its_site_is_not_told() {
    let folder = tempfile::tempdir().unwrap();
    let lines: Vec<String> = traffic()
        .iter()
        .map(|row| {
            let fields = row.fields();
            format!("{},,,,,,,{},us-101", fields[..14].join(","), fields[14..].join(","))
        })
        .collect();
    let header = HEADER.replace("Preceding", "O_Zone,D_Zone,Int_ID,Section_ID,Direction,Movement,Preceding");
    let merged = put(folder.path(), "export.csv", &format!("{header},Location\n{}\n", lines.join("\n")));
    let merged = read_all(&merged, Dataset::NGSIM).unwrap().remove(0).0;
    let period = recording("period", &traffic());
    assert_ne!(merged.meta().site, period.meta().site);
    assert_eq!(left_out(&[&merged, &period]), pair("period", "export"));
}

#[test]
fn highd_is_told_by_its_rows_too() {
    let read = |name: &str, site: &str| {
        let folder = tempfile::tempdir().unwrap();
        let mut files = scene();
        files.recording_meta = files.recording_meta.replace(site, "9");
        files.put(folder.path(), name);
        read_all(folder.path(), Dataset::HIGHD).unwrap().remove(0).0
    };
    assert_eq!(left_out(&[&read("05", "-"), &read("06", "-")]), pair("06", "05"));
}

#[test]
fn no_embedded_recording_is_a_copy_of_another() {
    for (name, dataset) in [("ngsim", Dataset::NGSIM), ("highd", Dataset::HIGHD), ("highd-congested", Dataset::HIGHD)] {
        let all = read_all(&fixtures(name), dataset).unwrap();
        assert_eq!(left_out(&all.iter().map(|(recording, _)| recording).collect::<Vec<_>>()), [], "{name}");
    }
}
