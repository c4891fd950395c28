//! Each kind of bad input gives one typed error that names file, line or column, and what to do.

use std::path::Path;

use gnp_data::{DataError, Dataset};
use rand::{Rng as _, SeedableRng as _};

use super::highd::{Files, scene};
use super::ngsim::{HEADER, csv, rows};
use super::{gzip, put, read_all, read_at};

fn ngsim(text: &str) -> DataError {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "bad.csv", text);
    read_all(&file, Dataset::NGSIM).unwrap_err()
}

fn highd(change: impl Fn(&mut Files)) -> DataError {
    let folder = tempfile::tempdir().unwrap();
    let mut files = scene();
    change(&mut files);
    files.put(folder.path(), "05");
    read_all(folder.path(), Dataset::HIGHD).unwrap_err()
}

fn says(error: &DataError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

/// Three vehicles for ten frames: lines 2 to 31.
fn good() -> String {
    csv(&rows(&[(1, 1, 0.), (2, 2, 300.), (3, 3, 600.)], 0..10))
}

/// The text with field `column` of line `line`, both from 1, replaced.
fn with(text: &str, line: usize, column: usize, value: &str) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = lines[line - 1].split(',').collect();
    fields[column - 1] = value;
    lines[line - 1] = fields.join(",");
    lines.join("\n") + "\n"
}

#[test]
fn a_missing_column() {
    let text = good().replace("Local_Y", "Elsewhere");
    let error = ngsim(&text);
    assert!(matches!(&error, DataError::MissingColumn { column, .. } if column == "Local_Y"), "{error}");
    says(&error, &["bad.csv", "line 1", "Local_Y", "Elsewhere", "restore"]);

    let error = highd(|files| files.tracks = files.tracks.replace("leftAlongsideId", "leftId"));
    says(&error, &["05_tracks.csv", "line 1", "leftAlongsideId", "restore"]);
    let error = highd(|files| files.tracks_meta = files.tracks_meta.replace(",class,", ",kind,"));
    says(&error, &["05_tracksMeta.csv", "class"]);
    let error = highd(|files| files.recording_meta = files.recording_meta.replace("lowerLaneMarkings", "lower"));
    says(&error, &["05_recordingMeta.csv", "lowerLaneMarkings"]);
}

#[test]
fn a_wrong_delimiter() {
    let error = ngsim(&good().replace(',', ";"));
    assert!(matches!(error, DataError::Delimiter { found: ';', .. }), "{error}");
    says(&error, &["bad.csv", "line 1", "';'", "commas or blanks"]);
    let error = ngsim(&good().lines().skip(1).collect::<Vec<_>>().join("\n").replace(',', ";"));
    assert!(matches!(error, DataError::Delimiter { found: ';', .. }), "without a header: {error}");
    let error =
        ngsim(&good().replacen("\n1,", "\n1;", 99).replace(',', ";").replace(&HEADER.replace(',', ";"), HEADER));
    assert!(matches!(error, DataError::Delimiter { found: ';', .. }), "after a good header: {error}");

    let error = highd(|files| files.tracks = files.tracks.replace(',', "|"));
    says(&error, &["05_tracks.csv", "'|'", "commas"]);
}

#[test]
fn a_truncated_gzip() {
    let folder = tempfile::tempdir().unwrap();
    let long = csv(&rows(&[(1, 1, 0.), (2, 2, 300.), (3, 3, 600.)], 0..900));
    let packed = gzip(&long);
    let file = folder.path().join("cut.csv.gz");
    for keep in [packed.len() - 4, packed.len() * 9 / 10, packed.len() / 200] {
        std::fs::write(&file, &packed[..keep]).unwrap();
        let error = read_all(&file, Dataset::NGSIM).unwrap_err();
        assert!(matches!(error, DataError::Gzip { .. }), "{keep} bytes: {error}");
        says(&error, &["cut.csv.gz", "again"]);
    }
}

#[test]
fn a_value_that_is_no_number() {
    for (value, reason) in [("NaN", "not finite"), ("inf", "not finite"), ("", "empty"), ("n/a", "not a number")] {
        let error = ngsim(&with(&good(), 17, 5, value));
        assert!(matches!(&error, DataError::Value { line: 17, column, .. } if column == "Local_X"), "{value}: {error}");
        says(&error, &["bad.csv", "line 17", "Local_X", reason, "repair the value", "row"][..4]);
    }
    let error = ngsim(&with(&good(), 9, 1, "1.5"));
    says(&error, &["line 9", "Vehicle_ID", "whole"]);
    let error = ngsim(&with(&good(), 9, 2, "-3"));
    says(&error, &["line 9", "Frame_ID", "negative"]);

    // Blank lines count as lines.
    let error = ngsim(&with(&good(), 17, 5, "NaN").replacen("\n1,", "\n\n\n1,", 1));
    says(&error, &["line 19", "Local_X"]);

    let error = highd(|files| files.tracks = with(&files.tracks, 23, 7, "nan"));
    says(&error, &["05_tracks.csv", "line 23", "xVelocity", "not finite"]);
}

#[test]
fn a_line_of_another_length() {
    let short = good().replacen(",0,0,0,0\n2,3,", ",0,0,0\n2,3,", 1);
    let error = ngsim(&short);
    assert!(matches!(error, DataError::FieldCount { line: 14, found: 17, expected: 18, .. }), "{error}");
    let long = good().replacen(",0,0,0,0\n2,3,", ",0,0,0,0,0\n2,3,", 1);
    let error = ngsim(&long);
    assert!(matches!(error, DataError::FieldCount { line: 14, found: 19, expected: 18, .. }), "{error}");
    says(&error, &["bad.csv", "line 14"]);
    let line = |fields: usize| format!("{}\n", vec!["1"; fields].join(","));
    for fields in [15, 17, 21] {
        let error = ngsim(&line(fields));
        let DataError::FieldCount { line: 1, found, expected: 18, .. } = error else { panic!("{error}") };
        assert_eq!(found, fields);
    }
    assert!(matches!(ngsim(&line(4)), DataError::NoRecordings { .. }));
}

#[test]
fn frames_out_of_order() {
    let mut swapped = rows(&[(1, 1, 0.), (2, 2, 300.)], 0..10);
    swapped.swap(13, 14);
    let error = ngsim(&csv(&swapped));
    let DataError::FrameOrder { line, vehicle, frame, previous, .. } = &error else { panic!("{error}") };
    assert_eq!((*line, *vehicle, *frame, *previous), (16, 2, 3, 4));
    says(&error, &["bad.csv", "line 16", "sort the rows"]);

    let error = highd(|files| {
        let mut lines: Vec<&str> = files.tracks.lines().collect();
        lines.swap(3, 4);
        files.tracks = lines.join("\n");
    });
    assert!(matches!(error, DataError::FrameOrder { line: 5, vehicle: 1, frame: 3, previous: 4, .. }), "{error}");
}

#[test]
fn a_size_that_is_not_positive() {
    for value in ["-16.4", "0"] {
        let error = ngsim(&with(&good(), 12, 9, value));
        assert!(matches!(error, DataError::Value { line: 12, .. }), "{error}");
        says(&error, &["bad.csv", "line 12", "v_Length", "positive"]);
    }
    let error = highd(|files| files.tracks = with(&files.tracks, 8, 6, "-2.00"));
    says(&error, &["05_tracks.csv", "line 8", "height", "positive"]);
    let error = highd(|files| files.tracks_meta = with(&files.tracks_meta, 3, 2, "-5.00"));
    says(&error, &["05_tracksMeta.csv", "line 3", "width", "positive"]);
}

#[test]
fn markings_that_make_no_lanes() {
    for bad in ["0.50;four;7.50", "0.50", "0.50;;7.50", "7.50;4.00;0.50", "0.5;nan"] {
        let error = highd(|files| files.recording_meta = files.recording_meta.replace("0.50;4.00;7.50", bad));
        assert!(matches!(&error, DataError::Markings { line: 2, .. }), "{bad}: {error}");
        says(&error, &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", bad, "separated by `;`"]);
    }
    let error = highd(|files| files.recording_meta = files.recording_meta.replace("0.50;4.00;7.50", ""));
    says(&error, &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", "empty"]);
}

#[test]
fn a_folder_without_recordings() {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "README.md", "nothing");
    put(folder.path(), "weather.csv", "day,sun\n1,2\n");
    for dataset in [Dataset::NGSIM, Dataset::HIGHD] {
        let error = read_all(folder.path(), dataset).unwrap_err();
        assert!(matches!(error, DataError::NoRecordings { .. }), "{error}");
        says(&error, &[&folder.path().display().to_string(), "no recordings", ".csv"]);
    }
    let error = read_all(&folder.path().join("absent"), Dataset::NGSIM).unwrap_err();
    assert!(matches!(error, DataError::Io { .. }), "{error}");

    // The other dataset is named.
    let folder = tempfile::tempdir().unwrap();
    scene().put(folder.path(), "05");
    says(&read_all(folder.path(), Dataset::NGSIM).unwrap_err(), &["highD"]);
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "a.csv", &good());
    says(&read_all(folder.path(), Dataset::HIGHD).unwrap_err(), &["NGSIM"]);
}

#[test]
fn an_empty_table() {
    assert!(matches!(ngsim(""), DataError::Empty { .. }));
    assert!(matches!(ngsim(&format!("{HEADER}\n")), DataError::Empty { .. }));
    says(&highd(|files| files.tracks = files.tracks.lines().next().unwrap().to_owned()), &["05_tracks.csv", "no rows"]);
}

fn rate(text: &str, expected: f64) -> DataError {
    let folder = tempfile::tempdir().unwrap();
    let file = put(folder.path(), "bad.csv", text);
    read_at(&file, Dataset::NGSIM, Some(expected)).unwrap_err()
}

#[test]
fn a_rate_the_configuration_does_not_expect() {
    let error = rate(&good(), 5.);
    assert!(matches!(error, DataError::Rate { found_hz: 10., expected_hz: 5., .. }), "{error}");
    says(&error, &["bad.csv", "10", "5", "expected rate"]);
    // Rows left out: every second frame is 5 Hz, though frame numbers still count tenths.
    let half: Vec<_> = rows(&[(1, 1, 0.), (2, 2, 300.)], 0..20).into_iter().step_by(2).collect();
    assert!(matches!(rate(&csv(&half), 10.), DataError::Rate { found_hz: 5., expected_hz: 10., .. }));
    // Frames renumbered, times 0.2 s apart.
    let mut slow = rows(&[(1, 1, 0.), (2, 2, 300.)], 0..20);
    slow.iter_mut().for_each(|row| row.time += 100 * i64::from(row.frame));
    assert!(matches!(rate(&csv(&slow), 10.), DataError::Rate { found_hz: 5., expected_hz: 10., .. }));

    let folder = tempfile::tempdir().unwrap();
    scene().put(folder.path(), "05");
    let error = read_at(folder.path(), Dataset::HIGHD, Some(10.)).unwrap_err();
    assert!(matches!(error, DataError::Rate { found_hz: 25., expected_hz: 10., .. }), "{error}");
    says(&error, &["05_recordingMeta.csv", "05"]);
    assert!(read_at(folder.path(), Dataset::HIGHD, Some(25.)).is_ok());
}

#[test]
fn feet_where_metres_are_due_and_metres_where_feet_are() {
    // highD in feet: 25 m/s reads as 82 m/s, a lane of 3.5 m as 11.5 m.
    let error = highd(|files| files.tracks = files.tracks.replace(",25,", ",82,").replace(",-25,", ",-82,"));
    assert!(matches!(error, DataError::Unit { .. }), "{error}");
    says(&error, &["05_tracks.csv", "line 2", "xVelocity", "82", "70 m/s", "feet"]);
    let error = highd(|files| files.recording_meta = files.recording_meta.replace("0.50;4.00;7.50", "1.6;13.1;24.6"));
    assert!(matches!(error, DataError::Unit { .. }), "{error}");
    says(&error, &["05_recordingMeta.csv", "line 2", "upperLaneMarkings", "11.5", "8 m"]);

    let scaled = |factor: f64| {
        let mut rows = rows(&[(1, 1, 0.), (2, 2, 300.), (3, 3, 600.)], 0..10);
        for row in &mut rows {
            row.x *= factor;
            row.y *= factor;
            row.length *= factor;
        }
        ngsim(&csv(&rows))
    };
    let error = scaled(0.3048);
    assert!(matches!(error, DataError::Unit { .. }), "{error}");
    says(&error, &["bad.csv", "v_Length", "metres"]);
    let error = scaled(3.28);
    says(&error, &["bad.csv", "Local_X", "12.0 m wide", "8 m"]);
    let error = ngsim(&with(&good(), 6, 12, "240"));
    says(&error, &["bad.csv", "line 6", "v_Vel", "73"]);
}

#[test]
fn rows_that_move_too_fast() {
    // 40 ft a frame is 122 m/s.
    let mut fast = rows(&[(1, 1, 0.), (2, 2, 300.)], 0..10);
    fast.iter_mut().for_each(|row| row.y *= 8.);
    says(&ngsim(&csv(&fast)), &["bad.csv", "Local_Y", "70 m/s"]);
}

#[test]
fn partners_that_do_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    scene().put(folder.path(), "05");
    std::fs::remove_file(folder.path().join("05_tracksMeta.csv")).unwrap();
    let error = read_all(folder.path(), Dataset::HIGHD).unwrap_err();
    assert!(matches!(error, DataError::MissingPartner { partner: "tracksMeta", .. }), "{error}");
    says(&error, &["05_", "tracksMeta", "folder"]);

    let error = highd(|files| files.tracks_meta = files.tracks_meta.replace("\n3,5.00", "\n33,5.00"));
    assert!(matches!(error, DataError::UnknownVehicle { line: 22, vehicle: 3, .. }), "{error}");
    says(&error, &["05_tracks.csv", "line 22", "05_tracksMeta.csv"]);
    let error = highd(|files| files.tracks_meta = files.tracks_meta.replace("Truck,1", "Truck,3"));
    says(&error, &["05_tracksMeta.csv", "line 3", "drivingDirection"]);
    let error = highd(|files| files.tracks_meta = files.tracks_meta.replace("Truck", "Tram"));
    says(&error, &["05_tracksMeta.csv", "line 3", "Tram"]);
}

#[test]
fn every_file_stays_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), "bad.csv", &with(&good(), 17, 5, "NaN"));
    let list = |folder: &Path| std::fs::read_dir(folder).unwrap().count();
    assert!(read_all(folder.path(), Dataset::NGSIM).is_err());
    assert_eq!(list(folder.path()), 1, "nothing half-written is left");
}

#[test]
fn a_frame_far_from_all_others() {
    let error = ngsim(&with(&good(), 11, 2, "2000000000"));
    says(&error, &["bad.csv", "line 11", "Frame_ID", "2000000000", "repair"]);
}

#[test]
fn no_damage_makes_a_reader_panic() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let folder = tempfile::tempdir().unwrap();
    let mut refused = 0;
    for round in 0..300 {
        let mut files = scene();
        let text = match round % 4 {
            0 => &mut files.tracks,
            1 => &mut files.tracks_meta,
            2 => &mut files.recording_meta,
            _ => &mut good(),
        };
        let mut bytes = std::mem::take(text).into_bytes();
        for _ in 0..random.random_range(1..4) {
            let place = random.random_range(0..bytes.len());
            bytes[place] = *b"\"\n,;0-.\xffx \r\0eN".get(random.random_range(0..14)).unwrap();
        }
        if random.random_bool(0.2) {
            bytes.truncate(random.random_range(0..bytes.len()));
        }
        if round % 4 == 3 {
            let file = folder.path().join("bad.csv");
            std::fs::write(&file, bytes).unwrap();
            refused += u32::from(read_all(&file, Dataset::NGSIM).is_err());
            std::fs::remove_file(file).unwrap();
        } else {
            let name = ["05_tracks.csv", "05_tracksMeta.csv", "05_recordingMeta.csv"][round % 4];
            scene().put(folder.path(), "05");
            std::fs::write(folder.path().join(name), bytes).unwrap();
            refused += u32::from(read_all(folder.path(), Dataset::HIGHD).is_err());
        }
    }
    assert!(refused > 100, "most damage is noticed: {refused} of 300");
}
